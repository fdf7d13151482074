"""What is wrong in a recording is said of a part of it too: cut by `from` and `to`, or only glanced at."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.readers.reader import GivesScans, ReadOptions, open_recording
from furrowmap.core.session.opened import LidarRecording
from tests.core.readers import hesai_packets as hesai
from tests.core.readers.osf_files import osf_of
from tests.core.readers.small_bags import T0_NS, point_cloud, revolution, velodyne_scan, write_bag2
from tests.core.readers.test_line_scanners import laser_scan
from tests.core.readers.test_ouster import recorded, stamps
from tests.core.readers.velodyne_packets import (
    LAST,
    STRONGEST,
    Frame,
    frame,
    frames,
    position_packet,
    rmc,
    turning,
    write_pcap,
)

T0_S = 1_781_141_021.0
PACKETS = 1500
"""Of a made capture: 2 s, which is less than a block that is read at once."""


@cache
def all_turned(mode: int) -> tuple[Frame, ...]:
    """The frames of a VLP-16 that its recorder got in time."""
    return tuple(frames(turning(PACKETS, (T0_S % 3600) * 1e6, mode=mode), T0_S))


def turned(mode: int = STRONGEST, first: int = 0, count: int = PACKETS) -> list[Frame]:
    """A part of these frames."""
    return list(all_turned(mode)[first : first + count])


def positions(pps: int = 2, status: str = "A") -> list[Frame]:
    """Position packets every quarter of a second."""
    said = [
        position_packet((T0_S % 3600 + k / 4) * 1e6, rmc(f"0123{41 + k // 4}", status=status), pps if k else 2)
        for k in range(8)
    ]
    return [(T0_S + k / 4, frame(packet, port=8308)) for k, packet in enumerate(said)]


def captured(folder: Path, *parts: list[Frame]) -> Path:
    """A capture of frames in the order of their times."""
    return write_pcap(folder / "drive.pcap", sorted((f for part in parts for f in part), key=lambda f: f[0]))


def with_damage(path: Path, every: int = 40_000) -> Path:
    """The capture with bytes between its records that belong to none."""
    data = path.read_bytes()
    out = bytearray()
    at = 24
    next_at = every
    out += data[:24]
    while at < len(data):
        size = 16 + int.from_bytes(data[at + 8 : at + 12], "little")
        out += data[at : at + size]
        at += size
        if at > next_at:
            out += b"\xff" * 37
            next_at += every
    path.write_bytes(out)
    return path


def hesai_capture(folder: Path, *, returns: int = 1, left_out: int = 0) -> Path:
    packets = hesai.turning("PandarXT-32", 4000, T0_S, returns=returns)
    kept = [(T0_S + k * 4e-4, frame(p)) for k, p in enumerate(packets) if not left_out or k % left_out]
    return captured(folder, kept)


def ouster_capture(folder: Path, change: Callable[[list[bytes]], list[bytes]]) -> Path:
    """A capture of 16 turns whose records are changed."""
    path = recorded(folder, 16.0)
    data = path.read_bytes()
    size = 16 + 42 + 6400
    records = [data[24 + size * k : 24 + size * (k + 1)] for k in range(16 * 64)]
    path.write_bytes(data[:24] + b"".join(change(records)))
    return path


def set_clock(folder: Path) -> Path:
    path = recorded(folder, 16.0)
    data = bytearray(path.read_bytes())
    stamps(data)["ns"][100:] -= 1_000_000_000
    stamps(data)["number"][::60, 3] = 5000
    path.write_bytes(data)
    return path


def osf(folder: Path) -> Path:
    path = recorded(folder, 16.0, return_mode="dual")
    data = path.read_bytes()
    size = (len(data) - 24) // (16 * 64)
    kept = [data[24 + size * k : 24 + size * (k + 1)] for k in range(16 * 64) if k % 50]
    path.write_bytes(data[:24] + b"".join(kept))
    whole = bytearray(osf_of([path]))
    path.unlink()
    whole[whole.index(b"OSF!") + 900] ^= 255  # in the first chunk
    target = folder / "drive.osf"
    target.write_bytes(whole)
    return target


def packet_bag(folder: Path) -> Path:
    packets = [p for k, p in enumerate(turning(3000, (T0_S % 3600) * 1e6)) if k % 60]
    parts = [packets[k : k + 75] for k in range(0, len(packets), 75)]
    messages = [(T0_NS + k * 100_000_000, velodyne_scan(T0_NS + k * 100_000_000, part)) for k, part in enumerate(parts)]
    return write_bag2(folder / "bag", [("/packets", at_ns, message) for at_ns, message in messages])


def cloud_bag(folder: Path) -> Path:
    recorded_ns = [T0_NS + k * 100_000_000 for k in range(20)]
    messages = []
    for k, at_ns in enumerate(recorded_ns):
        points = revolution(64, k)
        points["x"][:5] = 1e6
        message = point_cloud(at_ns - (200_000_000 if k == 3 else 0), points)
        if k == 2:
            message.row_step = 1  # damaged
        messages.append(("/points", at_ns, message))
    return write_bag2(folder / "bag", messages)


def sweep_bag(folder: Path) -> Path:
    ranges = np.full(100, 4.0)
    at_ns = [T0_NS + k * 25_000_000 for k in range(60)]
    late = {5: 100_000_000}
    messages = [laser_scan(ns - late.get(k, 0), ranges, each_s=0.0 if k % 2 else 5e-5) for k, ns in enumerate(at_ns)]
    return write_bag2(folder / "bag", [("/scan", ns, m) for ns, m in zip(at_ns, messages, strict=True)])


def line_table(folder: Path) -> Path:
    rows = [
        f"{T0_S + 1e-3 * (k - (50 if k % 1000 == 500 else 0)):.6f},{k % 181 - 90},{9000 if k % 50 == 0 else 5}"
        for k in range(4000)
    ]
    path = folder / "line.csv"
    path.write_text("\n".join(["time_unix_s,angle_deg,range_m", *rows, ""]), encoding="utf-8")
    return path


@dataclass(frozen=True)
class Sample:
    """A recording with faults in its first half, and what is said of it."""

    make: Callable[[Path], Path]
    codes: frozenset[str]
    model: str | None = None


def said(*codes: str) -> frozenset[str]:
    return frozenset(codes)


SAMPLES = {
    "velodyne, return mode": Sample(
        lambda folder: captured(folder, turned(STRONGEST, 0, 300), turned(LAST, 300)), said("return-mode-changed")
    ),
    "velodyne, model": Sample(lambda folder: captured(folder, turned()), said("model-differs"), "Puck Hi-Res"),
    "velodyne, pulse": Sample(lambda folder: captured(folder, turned(), positions(1)), said("pps-unlocked")),
    "velodyne, void": Sample(
        lambda folder: captured(folder, turned(), positions(), positions(status="V")), said("gprmc-void")
    ),
    "velodyne, other traffic": Sample(
        lambda folder: captured(folder, turned(), [(T0_S + k / 50, frame(b"x" * 99, port=53)) for k in range(90)]),
        said("other-traffic"),
    ),
    "velodyne, lost": Sample(
        lambda folder: captured(folder, [f for k, f in enumerate(turned()) if k % 30]), said("lost-packets")
    ),
    "velodyne, repeated": Sample(
        lambda folder: captured(folder, [f for f in turned() for _ in range(2)]), said("repeated-packets")
    ),
    "velodyne, damaged": Sample(lambda folder: with_damage(captured(folder, turned())), said("damaged-records")),
    "hesai, lost": Sample(lambda folder: hesai_capture(folder, left_out=30), said("lost-packets", "angles-of-model")),
    "hesai, damaged": Sample(
        lambda folder: with_damage(hesai_capture(folder)), said("damaged-records", "angles-of-model")
    ),
    "ouster, lost and repeated": Sample(
        lambda folder: ouster_capture(
            folder, lambda records: [r for k, r in enumerate(records) for _ in range(1 + (k % 40 == 5)) if k % 40]
        ),
        said("lost-packets", "repeated-packets"),
    ),
    "ouster, clock": Sample(set_clock, said("clock-jumps", "ouster-bad-columns")),
    "ouster, damaged": Sample(
        lambda folder: with_damage(ouster_capture(folder, lambda records: records)), said("damaged-records")
    ),
    "osf": Sample(osf, said("osf-damaged", "lost-packets")),
    "bag of packets": Sample(packet_bag, said("lost-packets", "model-differs"), "Puck Hi-Res"),
    "bag of clouds": Sample(cloud_bag, said("points-invalid", "clouds-late", "bag-messages-damaged")),
    "bag of sweeps": Sample(sweep_bag, said("clouds-late", "no-point-times")),
    "table of a line scanner": Sample(line_table, said("time-runs-back", "points-invalid")),
}


def recording_of(path: Path, model: str | None, span_s: tuple[float, float], glance_s: float | None) -> LidarRecording:
    reader = open_recording([path], ReadOptions(model=model, near_s=T0_S, glance_s=glance_s))
    assert isinstance(reader, GivesScans)
    return LidarRecording(reader, 0.25, span_s)


def codes(recording: LidarRecording) -> frozenset[str]:
    assert recording.clocks  # complete
    return frozenset(notice.code for notice in recording.notices)


Whole = Callable[[str], tuple[Path, NDArray[np.float64]]]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Whole:
    """A sample's recording and the times of its returns, read as a whole once."""

    @cache
    def of(name: str) -> tuple[Path, NDArray[np.float64]]:
        sample = SAMPLES[name]
        path = sample.make(tmp_path_factory.mktemp("sample"))
        recording = recording_of(path, sample.model, (-math.inf, math.inf), None)
        times_s = np.concatenate([scan.t_s for scan in recording.scans()])
        assert sample.codes <= codes(recording)
        return path, times_s

    return of


@pytest.mark.parametrize("part", ["whole", "to", "from", "from and to", "preview", "preview to"])
@pytest.mark.parametrize("name", SAMPLES)
def test_promise_05__faults_are_said_of_every_part(name: str, part: str, whole: Whole) -> None:
    sample = SAMPLES[name]
    path, times_s = whole(name)
    first_s, half_s = np.quantile(times_s, [0.3, 0.6])
    span_s = (first_s if "from" in part else -math.inf, half_s if "to" in part else math.inf)
    recording = recording_of(path, sample.model, span_s, 0.25 if "preview" in part else None)
    read_s = np.concatenate([scan.t_s for scan in recording.scans()])
    assert sample.codes <= codes(recording)
    assert read_s.min() >= span_s[0]
    assert read_s.max() <= span_s[1]
