"""VectorNav logs: examples of the manual and of real sensors, and what was written comes out."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.readers.reader import ReadOptions, Recognised
from furrowmap.core.readers.vectornav import binary, sentences
from furrowmap.core.readers.vectornav.log import VectorNavAscii, VectorNavBinary
from furrowmap.core.values.clock import gps_to_utc_s
from furrowmap.core.values.errors import InputError
from furrowmap.core.values.json_text import plain
from tests.core.readers.vectornav_logs import TOW_S, WEEK, common, grouped, sentence, vnimu, vnins

BEGIN_S = float(gps_to_utc_s(604_800 * WEEK + TOW_S))
K = np.arange(60)


def written(folder: Path, content: bytes) -> Path:
    (folder / "vn.log").write_bytes(content)
    return folder / "vn.log"


def test_example_of_the_manual__is_its_yaw_pitch_roll() -> None:
    found = binary.Messages()
    found.add(iter([bytes.fromhex("fa010800 93502e42 833ef13f 48b504bb 9288")]))
    (header,) = found.found
    assert found.column(header, found.layouts[header].offset[0, 3], "<f4", 3)[0] == pytest.approx(
        [43.578686, 1.884720, -0.002025], abs=1e-5
    )


def test_sentences_of_real_sensors__are_intact() -> None:
    found = sentences.Sentences()
    found.add(
        iter([
            b"$VNIMU,-00.0350,+00.4222,-00.6643,-00.015,+00.019,+09.948,+00.002066,-00.008442,-00.044656,+20.7,+084.322*66\r\n"
            b"$VNINS,224159.474991,2048,8085,-149.042,+013.639,+010.915,+40.09623362,-088.20139124,+00204.179,"
            b"+000.023,+000.007,-000.248,20.5,02.5,0.20*6F\r\n"
        ])
    )  # fmt: skip
    assert found.bad == 0
    measured, timed = found.table()
    assert measured[3:9].tolist() == [0.002066, -0.008442, -0.044656, -0.015, 0.019, 9.948]
    assert timed[1] == pytest.approx(2048 * 604_800 + 224_159.474991)


def test_binary__gives_what_was_written(tmp_path: Path) -> None:
    noise = b"\xfa\x01\x00\x02hello\xfa"
    path = written(tmp_path, noise + b"".join(common(int(k)) + noise[: k % 9] for k in K))
    found = Recognised.of(path)
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
    monkeypatch.setattr("furrowmap.core.readers.vectornav.log.PIECE_BYTES", 5000)
    path = written(tmp_path, b"".join(grouped(k) for k in range(900)))
    track = VectorNavBinary([path], ReadOptions()).inertial()
    assert track.t_s == pytest.approx(BEGIN_S + 0.01 * np.arange(900), abs=1e-6)
    assert track.rate_radps[-1] == pytest.approx([0.1, 0.2, 0.3], abs=1e-7)


def test_binary__damaged_messages_are_counted(tmp_path: Path) -> None:
    content = bytearray(b"".join(common(int(k)) for k in K))
    content[10 * len(common(0)) + 20] ^= 0x40
    reader = VectorNavBinary([written(tmp_path, bytes(content))], ReadOptions())
    assert len(reader.inertial()) == len(K) - 1
    assert [notice.code for notice in reader.notices] == ["sentences-damaged"]


def test_ascii__times_of_a_logger(tmp_path: Path) -> None:
    path = written(tmp_path, b"".join(f"{BEGIN_S + 0.01 * k:.3f},".encode() + vnimu(int(k)) for k in K))
    found = Recognised.of(path)
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
    from binascii import crc_hqx

    first = bytes(body) + crc_hqx(head, 0).to_bytes(2, "big")
    reader = VectorNavBinary([written(tmp_path, first * 3 + b"".join(common(int(k)) for k in K))], ReadOptions())
    assert len(reader.inertial()) == len(K)
    assert [notice.code for notice in reader.notices] == ["rows-incomplete"]
