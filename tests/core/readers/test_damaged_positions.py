"""Damaged logs and trajectories: whatever bytes they hold, they are read or refused, never a traceback."""

from __future__ import annotations

import functools
import tempfile
from pathlib import Path

import numpy as np
import pysbf2
import pytest
import pyubx2
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.readers.nmea.log import NmeaLog
from furrowmap.core.readers.poses.csv import PoseCsv
from furrowmap.core.readers.poses.sbet import Sbet
from furrowmap.core.readers.reader import Inspection, ReadOptions
from furrowmap.core.readers.rtklib.pos import RtklibPos
from furrowmap.core.readers.sbf.log import SbfLog
from furrowmap.core.readers.source import look
from furrowmap.core.readers.ubx.log import UbxLog
from furrowmap.core.runtime.errors import InputError

DAMAGE = st.lists(st.tuples(st.floats(0, 1), st.binary(max_size=40), st.integers(0, 200)), max_size=8)
OPTIONS = ReadOptions(date="2026-06-11", week=2422)


def damaged(data: bytes, damage: list[tuple[float, bytes, int]]) -> bytes:
    """`data` with pieces of it replaced by other bytes."""
    for share, put, taken in damage:
        at = int(share * len(data))
        data = data[:at] + put + data[at + taken :]
    return data or b"\0"


TRACKS = (NmeaLog, UbxLog, SbfLog, RtklibPos)


def outcome(
    reader: type[NmeaLog | UbxLog | SbfLog | RtklibPos | PoseCsv | Sbet], data: bytes
) -> Inspection | InputError:
    """What comes of a file of these bytes; reading all of it must end as inspecting it did."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "recording")
        path.write_bytes(data)
        opened = reader([path], OPTIONS)
        try:
            assert 0.0 <= reader.recognise(look(path)) <= 1.0
            inspection = opened.inspect()
        except InputError as error:
            return error
        try:
            whole = opened.track() if isinstance(opened, TRACKS) else opened.poses()
        except InputError as error:
            assert error.code in {notice.code for notice in inspection.notices}  # noqa: PT017 (not all are refused)
        else:
            assert len(whole) == inspection.facts["epochs" if isinstance(opened, TRACKS) else "poses"]
        return inspection


@functools.cache
def piece(path: Path) -> bytes:
    """The beginning of a sample, short enough for many trials."""
    return path.read_bytes()[: 40 * 136]


@given(damage=DAMAGE)
def test_nmea(damage: list[tuple[float, bytes, int]], shared_data: Path) -> None:
    result = outcome(NmeaLog, damaged(piece(shared_data / "tractor_loop/gnss.nmea"), damage))
    # A log is always reported, unless the damage makes it look compressed.
    assert isinstance(result, Inspection) or result.code == "empty-file"


@given(damage=DAMAGE)
@pytest.mark.parametrize(
    ("reader", "name"),
    [
        (UbxLog, "gnss/ubx/f9p_pvt_hpposllh_1hz.ubx"),
        (UbxLog, "gnss/walk_f9p/walk.ubx"),
        (SbfLog, "gnss/sbf/x5pvt.sbf"),
        (SbfLog, "gnss/sbf/x5_pvtgeod.sbf"),
        (RtklibPos, "gnss/pos/static_rtk.pos"),
        (RtklibPos, "gnss/clas/clas_kinematic.pos"),
    ],
)
def test_receivers_logs(
    reader: type[UbxLog | SbfLog | RtklibPos], name: str, damage: list[tuple[float, bytes, int]], shared_data: Path
) -> None:
    result = outcome(reader, damaged(piece(shared_data / name), damage))
    assert isinstance(result, Inspection) or result.code in ("empty-file", "date-contradicted")


@given(frames=st.lists(st.tuples(st.integers(0, 3), st.binary(min_size=92, max_size=92)), min_size=1, max_size=4))
def test_ubx__with_right_checksums_and_any_content(frames: list[tuple[int, bytes]]) -> None:
    """Damage is caught by the checksum; what a receiver itself writes may still be any number."""
    kinds = [(b"\x01\x07", 92), (b"\x01\x14", 36), (b"\x01\x36", 64), (b"\x01\x20", 16)]
    log = b"".join(
        pyubx2.UBXMessage(kinds[k][0][:1], kinds[k][0][1:], pyubx2.GET, payload=content[: kinds[k][1]]).serialize()
        for k, content in frames
    )
    assert outcome(UbxLog, log)


@given(
    blocks=st.lists(
        st.tuples(st.sampled_from([4007, 4006, 5906, 5905, 5938, 4001]), st.binary(min_size=88, max_size=88))
    )
)
def test_sbf__with_right_checksums_and_any_content(blocks: list[tuple[int, bytes]]) -> None:
    heads = [(number.to_bytes(2, "little") + (96).to_bytes(2, "little") + content) for number, content in blocks]
    log = b"".join(b"$@" + pysbf2.calc_crc(rest).to_bytes(2, "little") + rest for rest in heads)
    assert outcome(SbfLog, log or b"$@")


@given(damage=DAMAGE)
def test_csv(damage: list[tuple[float, bytes, int]], shared_data: Path) -> None:
    assert outcome(PoseCsv, damaged(piece(shared_data / "tractor_loop/truth/trajectory.csv"), damage))


@given(damage=DAMAGE)
def test_sbet(damage: list[tuple[float, bytes, int]], shared_data: Path) -> None:
    assert outcome(Sbet, damaged(piece(shared_data / "sbet/flight_derived.sbet"), damage))


@given(data=st.binary(min_size=1, max_size=600))
def test_bytes_of_any_kind(data: bytes) -> None:
    for reader in (NmeaLog, PoseCsv, Sbet):
        assert outcome(reader, data)


@given(values=st.lists(st.floats(), min_size=34, max_size=17 * 6))
def test_doubles_of_any_kind(values: list[float]) -> None:
    assert outcome(Sbet, np.array(values, "<f8").tobytes())


@given(text=st.text(alphabet='0123456789.,;-+eE \t\r\n"naif_', max_size=300))
def test_text_of_any_kind_below_the_header(text: str) -> None:
    header = "time_unix_s,e_m,n_m,h_m,roll_deg,pitch_deg,heading_deg\n"
    assert outcome(PoseCsv, (header + text).encode())
