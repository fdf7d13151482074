"""VectorNav logs: examples of the manual and of real sensors, and what was written comes out."""

from __future__ import annotations

import json
import struct
from binascii import crc_hqx
from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.readers.reader import ReadOptions, Recognised
from furrowmap.core.readers.vectornav.log import AsciiSentences, BinaryMessages, VectorNavAscii, VectorNavBinary
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.json_text import plain
from furrowmap.core.values.clock import gps_to_utc_s
from tests.core.readers.vectornav_logs import TOW_S, WEEK, common, grouped, message, sentence, vnimu, vnins

BEGIN_S = float(gps_to_utc_s(604_800 * WEEK + TOW_S))
K = np.arange(60)


def written(folder: Path, content: bytes) -> Path:
    (folder / "vn.log").write_bytes(content)
    return folder / "vn.log"


def test_example_of_the_manual__is_its_yaw_pitch_roll() -> None:
    found = BinaryMessages()
    found.scan(bytes.fromhex("fa010800 93502e42 833ef13f 48b504bb 9288"))
    (header,) = found.found
    assert found.rows(header)[0, 7:] == pytest.approx([43.578686, 1.884720, -0.002025], abs=1e-5)


def test_sentences_of_real_sensors__are_intact() -> None:
    found = AsciiSentences()
    found.scan(
            b"$VNIMU,-00.0350,+00.4222,-00.6643,-00.015,+00.019,+09.948,+00.002066,-00.008442,-00.044656,+20.7,+084.322*66\r\n"
            b"$VNINS,224159.474991,2048,8085,-149.042,+013.639,+010.915,+40.09623362,-088.20139124,+00204.179,"
            b"+000.023,+000.007,-000.248,20.5,02.5,0.20*6F\r\n"
    )  # fmt: skip
    assert found.counts.bad == 0
    measured, timed = found.table()
    assert measured[3:9].tolist() == [0.002066, -0.008442, -0.044656, -0.015, 0.019, 9.948]
    assert timed[1] == pytest.approx(2048 * 604_800 + 224_159.474991)


def test_binary__gives_what_was_written(tmp_path: Path) -> None:
    noise = b"\xfa\x01\x00\x02hello\xfa"
    path = written(tmp_path, noise + b"".join(common(int(k)) + noise[: k % 9] for k in K))
    found = Recognised.by_content(path)
    assert found.reader is VectorNavBinary
    track = VectorNavBinary([path], ReadOptions()).inertial()
    assert track.t_s == pytest.approx(BEGIN_S + 0.01 * K, abs=1e-6)
    assert track.force_mps2 == pytest.approx(np.column_stack([0 * K + 0.1, 0.01 * K, 0 * K - 9.8]), abs=1e-6)
    assert track.rate_radps == pytest.approx(np.column_stack([0 * K + 0.02, 0 * K - 0.01, 0.001 * K]), abs=1e-7)
    attitude = VectorNavBinary([path], ReadOptions()).attitude()
    assert attitude.heading_deg == pytest.approx((350.0 + K) % 360)
    assert (attitude.pitch_deg[0], attitude.roll_deg[0]) == (1.0, -2.0)
    json.dumps(plain(found.inspect().facts), allow_nan=False)


def test_binary__in_other_groups_and_long(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("furrowmap.core.readers.framed_messages.MESSAGE_CHUNK_BYTES", 5000)
    path = written(tmp_path, b"".join(grouped(k) for k in range(900)))
    track = VectorNavBinary([path], ReadOptions()).inertial()
    assert track.t_s == pytest.approx(BEGIN_S + 0.01 * np.arange(900), abs=1e-6)
    assert track.rate_radps[-1] == pytest.approx([0.1, 0.2, 0.3], abs=1e-7)


GPS_FIELDS = "8s Q H B B 3d 3d 3f 3f 3f f f 2s 7f"
FIELDS = (
    "Q Q Q 3f 4f 3f 3d 3f 3f 6f 5f 7f H I Q",
    "Q Q Q H Q Q bBBBBBH I I B",
    "H 3f 3f 3f f f 4f 3f 3f 3f 3f H 10f",
    GPS_FIELDS,
    "H 3f 4f 9f 3f 3f 3f 3f 3f 3f 7f 6f 3f",
    "H 3d 3d 3f 3f 3f 3f 3f 3f f f 17f 16f",
    GPS_FIELDS,
)
"""Types of the fields of each group, of the manual's tables of binary output."""


@pytest.mark.parametrize("group", range(len(FIELDS)))
def test_binary__fields_are_as_long_as_in_the_manual(group: int) -> None:
    """Of each message with one field, the end is found, and with it the next message."""
    for bit, kind in enumerate(FIELDS[group].split()):
        stream = 2 * message({group: (1 << bit, bytes(range(struct.calcsize(f"<{kind}"))))})
        found = BinaryMessages()
        found.scan(stream)
        assert (list(found.counts.kinds.values()), len(stream)) == ([2], sum(map(len, found.found.values()))), bit
    beyond = BinaryMessages()
    beyond.scan(2 * message({group: (1 << len(FIELDS[group].split()), bytes(8))}))
    assert not beyond.found


def test_binary__damaged_messages_are_counted(tmp_path: Path) -> None:
    content = bytearray(b"".join(common(int(k)) for k in K))
    content[10 * len(common(0)) + 20] ^= 0x40
    reader = VectorNavBinary([written(tmp_path, bytes(content))], ReadOptions())
    assert len(reader.inertial()) == len(K) - 1
    assert [notice.code for notice in reader.notices] == ["sentences-damaged"]


def test_ascii__times_of_a_logger(tmp_path: Path) -> None:
    path = written(tmp_path, b"".join(f"{BEGIN_S + 0.01 * k:.3f},".encode() + vnimu(int(k)) for k in K))
    found = Recognised.by_content(path)
    assert found.reader is VectorNavAscii
    track = VectorNavAscii([path], ReadOptions()).inertial()
    assert track.t_s == pytest.approx(BEGIN_S + 0.01 * K, abs=1e-6)
    assert track.force_mps2 == pytest.approx(np.column_stack([0 * K + 0.1, 0.01 * K, 0 * K - 9.8]))
    assert track.rate_radps == pytest.approx(np.column_stack([0 * K + 0.02, 0 * K - 0.01, 0.001 * K]))
    json.dumps(plain(found.inspect().facts), allow_nan=False)


def test_ascii__times_of_iso_8601(tmp_path: Path) -> None:
    stamps = [f"2026-06-10 09:19:{42 + k / 100:06.3f} " for k in range(60)]
    path = written(tmp_path, b"".join(stamps[k].encode() + vnimu(k) for k in range(60)))
    assert VectorNavAscii([path], ReadOptions()).inertial().t_s == pytest.approx(1_781_083_182.0 + 0.01 * K, abs=1e-6)


def test_ascii__times_of_sentences_between(tmp_path: Path) -> None:
    path = written(tmp_path, b"".join(vnimu(int(k)) + (vnins(int(k)) if k % 4 == 0 else b"") for k in K))
    track = VectorNavAscii([path], ReadOptions()).inertial()
    assert np.abs(track.t_s - (BEGIN_S + 0.01 * np.round(1e3 * track.rate_radps[:, 2]))).max() < 0.011


@pytest.mark.parametrize(
    ("content", "code"),
    [
        (b"".join(vnimu(k) for k in range(9)), "imu-no-times"),
        (sentence("VNYPR,+006.271,+000.031,-002.000") * 9, "imu-no-measurements"),
        (
            b"".join(f"{BEGIN_S + k},".encode() + vnimu(k).replace(b"-09.8", b"-99.8") for k in range(9)),
            "imu-no-measurements",
        ),
        (
            b"".join(f"{BEGIN_S + k},".encode() + sentence(f"VNMAR,0,0,0,0,0,{9e3},0,0,0") for k in range(9)),
            "value-out-of-range",
        ),
    ],
)
def test_faults__are_three_lines(tmp_path: Path, content: bytes, code: str) -> None:
    with pytest.raises(InputError) as caught:
        VectorNavAscii([written(tmp_path, content)], ReadOptions()).inertial()
    assert caught.value.code == code
    assert all(caught.value.lines)


def test_device_without_a_fix__has_no_times_yet(tmp_path: Path) -> None:
    early = bytearray(common(0))
    early[4:12] = bytes(8)
    head, body = bytes(early[1:-2]), early[:-2]
    first = bytes(body) + crc_hqx(head, 0).to_bytes(2, "big")
    reader = VectorNavBinary([written(tmp_path, first * 3 + b"".join(common(int(k)) for k in K))], ReadOptions())
    assert len(reader.inertial()) == len(K)
    assert [notice.code for notice in reader.notices] == ["rows-incomplete"]


@pytest.mark.parametrize(
    ("before", "stamp_s"),
    [
        ("1781083182.25,", 1_781_083_182.25),
        ("1781083182250 ", 1_781_083_182.25),
        ("[2026-06-10T09:19:42.25Z] ", 1_781_083_182.25),
        ("2026-06-10 18:19:42.25+09:00;", 1_781_083_182.25),
        ("600000001,", 600_000_001.0),
        ("599999999,", None),
        ("4999999999,", 4_999_999_999.0),
        ("5000000001,", None),
        ("599999999999,", None),
        ("600000000001,", 600_000_000.001),
        ("12.5,", None),
        ("sensor ", None),
        ("", None),
    ],
)
def test_stamps__are_utc_in_seconds_milliseconds_or_iso_8601(before: str, stamp_s: float | None) -> None:
    found = AsciiSentences()
    found.scan(before.encode() + vnimu(1))
    np.testing.assert_allclose(found.table()[0, 0], np.nan if stamp_s is None else stamp_s, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("body", "rate", "force", "angles"),
    [
        ("VNIMU,1,2,3,4,5,6,7,8,9,10,11", (7, 8, 9), (4, 5, 6), None),
        ("VNIMU,1,2,3,4,5,6,7,8,9,10", None, None, None),
        ("VNYMR,1,2,3,4,5,6,7,8,9,10,11,12", (10, 11, 12), (7, 8, 9), (1, 2, 3)),
        ("VNYMR,1,2,3,4,5,6,7,8,9,10,11", None, None, (1, 2, 3)),
        ("VNMAR,1,2,3,4,5,6,7,8,9", (7, 8, 9), (4, 5, 6), None),
        ("VNMAR,1,2,3,4,5,6,7,8", None, None, None),
        ("VNYPR,1,2,3", None, None, (1, 2, 3)),
        ("VNYPR,1,2", None, None, None),
    ],
)
def test_sentences__have_their_fields_where_the_manual_says(
    body: str, rate: tuple[int, ...] | None, force: tuple[int, ...] | None, angles: tuple[int, ...] | None
) -> None:
    """VN-100 and VN-200 user manuals: VNMAR is magnetic, acceleration, rate; VNYMR has the angles before them."""
    found = AsciiSentences()
    found.scan(sentence(body))
    none = (np.nan,) * 3
    np.testing.assert_array_equal(found.table()[0, 3:], [*(rate or none), *(force or none), *(angles or none)])


@pytest.mark.parametrize(("week", "fields", "is_timed"), [(2422, 15, True), (2422, 14, False), (0, 15, False)])
@pytest.mark.parametrize("kind", ["VNINS", "VNGPS"])
def test_sentences__have_a_time_once_the_week_is_known(kind: str, week: int, fields: int, is_timed: bool) -> None:
    found = AsciiSentences()
    found.scan(sentence(",".join([kind, "1000.5", str(week), "80FE", *["1.0"] * (fields - 3)])))
    assert found.counts.bad == 0
    np.testing.assert_array_equal(found.table()[0, 1], 2422 * 604_800 + 1000.5 if is_timed else np.nan)


@pytest.mark.parametrize(
    ("checksum", "is_intact"), [("XX", True), ("XXXX", True), ("{0:04X}", True), ("123", False), ("00", False)]
)
def test_checksums__of_8_or_16_bits_or_switched_off(checksum: str, is_intact: bool) -> None:
    body = "VNYPR,+006.271,+000.031,-002.000"
    found = AsciiSentences()
    found.scan(f"${body}*{checksum.format(crc_hqx(body.encode(), 0))}\r\n".encode())
    assert (found.counts.bad, found.counts.kinds) == ((0, {"VNYPR": 1}) if is_intact else (1, {}))
