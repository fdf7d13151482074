"""Files of Ouster's SDK, against the captures that they are made of."""

from __future__ import annotations

import gzip
import json
import struct
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest

from furrowmap.core.readers.reader import ReadOptions, Recognised
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.scan import Clock
from tests.core.readers.osf_files import RECORD, osf_of
from tests.core.readers.test_ouster import changed, recorded, scans_of


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three turns with two returns, of which five packets are lost."""
    path = recorded(tmp_path_factory.mktemp("osf"), 3.0, return_mode="dual")
    data = path.read_bytes()
    size = (len(data) - 24) // 192
    path.write_bytes(data[: 24 + 70 * size] + data[24 + 75 * size :])
    return path


@pytest.mark.parametrize("encoding", ["zpng", "png"])
def test_scans__are_those_of_the_capture(encoding: str, capture: Path, tmp_path: Path) -> None:
    path = tmp_path / "drive.osf"
    path.write_bytes(osf_of([capture], encoding=encoding))
    reader, scans = scans_of(path)
    packets, expected = scans_of(capture)
    assert (reader.clock, len(scans)) == (packets.clock, len(expected))
    for scan, other in zip(scans, expected, strict=True):
        assert scan.whole == other.whole
        for column in ("t_s", "xyz_m", "intensity", "laser", "column", "return_number", "returns"):
            np.testing.assert_array_equal(getattr(scan, column), getattr(other, column))
    texts = [notice.text for notice in reader.notices]  # type: ignore[attr-defined]
    assert texts == [notice.text for notice in packets.notices]  # type: ignore[attr-defined]
    assert texts[0].startswith("5 packets are missing")
    assert Recognised.by_content(path).inspect().facts["profile"] == "RNG19_RFL8_SIG16_NIR16_DUAL"


def test_two_sensors__are_told_apart(capture: Path, tmp_path: Path) -> None:
    other = recorded(tmp_path, 2.0, changed("sensor_info", prod_sn="122000000099"), return_mode="dual")
    path = tmp_path / "drive.osf"
    path.write_bytes(osf_of([capture, other]))
    with pytest.raises(InputError, match="122000000032; OS-1-32-U0, serial number 122000000099") as caught:
        scans_of(path)
    assert caught.value.code == "two-sensors"
    scans = scans_of(path, ReadOptions(model="122000000099"))[1]
    assert sum(map(len, scans)) == 128 * 16 * 48
    with pytest.raises(InputError) as caught:
        scans_of(path, ReadOptions(model="OS0"))
    assert caught.value.code == "ouster-other-sensor"


def test_damaged_files__say_what_is_lost(capture: Path, tmp_path: Path) -> None:
    data = osf_of([capture])
    path = tmp_path / "drive.osf"
    middle = bytearray(data)
    middle[len(data) // 2] ^= 1
    path.write_bytes(middle)
    reader, scans = scans_of(path)
    assert next(notice.code for notice in reader.notices) == "osf-damaged"  # type: ignore[attr-defined]
    assert len(scans) == len(scans_of(capture)[1]) - 1
    for broken, words in (
        (data[:-1000], "not finished by the recorder, or is cut"),
        (data[:20] + b"\xff" + data[21:], "its header is damaged"),
        (data[:-10] + b"\xff" + data[-9:], "its metadata are damaged"),
        (gzip.compress(data), "its header is damaged"),
        (osf_of([]), "it has no scans"),
    ):
        path.write_bytes(broken)
        with pytest.raises(InputError, match=words) as caught:
            Recognised.by_content(path).inspect()
        assert caught.value.code == "osf-unreadable"


def with_turns(capture: Path, folder: Path, lost: slice, *, ahead_s: int = 0) -> Path:
    """The capture with some turns without valid columns, whose stamps are 0, and other stamps later by some seconds."""
    data = capture.read_bytes()
    packets = np.frombuffer(data, RECORD, offset=24).copy()
    packets["columns"]["ns"] = packets["columns"]["ns"].astype(np.int64) + ahead_s * 10**9
    for frame in np.unique(packets["frame"])[lost]:
        columns = packets["columns"][packets["frame"] == frame]
        columns["ns"] = 0
        columns["status"] = 0
        packets["columns"][packets["frame"] == frame] = columns
    path = folder / "lost.pcap"
    path.write_bytes(data[:24] + packets.tobytes())
    said = json.loads(capture.with_suffix(".json").read_text())
    said["config_params"]["timestamp_mode"] = "TIME_FROM_PTP_1588"
    path.with_suffix(".json").write_text(json.dumps(said))
    return path


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("packed", [True, False])
@pytest.mark.parametrize(("ahead_s", "told"), [(0, None), (37, "ouster-clock-tai"), (-3600, "ouster-clock-apart")])
def test_clock__is_not_told_by_a_turn_without_columns(
    capture: Path, tmp_path: Path, ahead_s: int, told: str | None, *, packed: bool
) -> None:
    whole = with_turns(capture, tmp_path, slice(0), ahead_s=ahead_s)
    expected, scans = scans_of(whole)
    path = with_turns(capture, tmp_path, slice(0, 1), ahead_s=ahead_s)
    if packed:
        (tmp_path / "lost.osf").write_bytes(osf_of([path]))
        path = tmp_path / "lost.osf"
    reader, found = scans_of(path)
    assert (reader.clock, reader.clock) == (expected.clock, Clock.SENSOR)
    codes = {notice.code for notice in reader.notices}  # type: ignore[attr-defined]
    assert codes & {"ouster-clock-own", "ouster-clock-tai", "ouster-clock-apart"} == ({told} if told else set())
    np.testing.assert_array_equal(found[-1].t_s, scans[-1].t_s)


@pytest.mark.filterwarnings("error")
def test_turns_without_any_valid_column__are_told_as_such(capture: Path, tmp_path: Path) -> None:
    path = tmp_path / "drive.osf"
    path.write_bytes(osf_of([with_turns(capture, tmp_path, slice(None))]))
    with pytest.raises(InputError, match="its turns have no valid columns") as caught:
        Recognised.by_content(path).inspect()
    assert caught.value.code == "osf-unreadable"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("encoding", ["zpng", "png"])
def test_unreadable_image__costs_its_turn_alone(capture: Path, tmp_path: Path, encoding: str) -> None:
    data = bytearray(osf_of([capture], encoding=encoding))
    begin = data.index(b"OSF!") - 8
    size = struct.unpack_from("<I", data, begin)[0]
    mark = b"\x89PNG" if encoding == "png" else b"\xf8\xfb"
    at = data.index(mark, begin)
    data[at + 60 : at + 90] = bytes(30)
    data[begin + 4 + size : begin + 8 + size] = struct.pack("<I", crc32(data[begin : begin + 4 + size]))
    path = tmp_path / "drive.osf"
    path.write_bytes(data)
    reader, scans = scans_of(path)
    assert "osf-damaged" in {notice.code for notice in reader.notices}  # type: ignore[attr-defined]
    expected, whole = scans_of(capture)
    assert (reader.clock, len(scans)) == (expected.clock, len(whole) - 1)
    np.testing.assert_array_equal(scans[-1].t_s, whole[-1].t_s)


@pytest.mark.filterwarnings("error")
def test_sample_with_a_lost_first_turn__is_dated_by_the_recorder(shared_data: Path) -> None:
    folder = shared_data / "foreign" / "21-osf-first-turn-without-columns"
    reader, scans = scans_of(folder / "first_frame_invalid_osc.osf")
    assert "ouster-clock-own" in {notice.code for notice in reader.notices}  # type: ignore[attr-defined]
    assert reader.clock is Clock.RECORDER
    assert scans[0].t_s[0] == pytest.approx(1765521702.998, abs=0.05)  # 2025-12-12T06:41:42.998Z
