"""Recordings of IMUs, of attitudes and of line scanners."""

from __future__ import annotations

import json
from collections import deque
from pathlib import Path

from furrowmap.cli.session_commands import _inspection_value
from furrowmap.core.readers.imu_csv import QUANTITIES, ImuCsv
from furrowmap.core.readers.reader import ReadOptions, Recognised
from furrowmap.core.runtime.json_text import plain
from tests.core.readers.inertial_bags import sentences, turning_imu
from tests.core.readers.small_bags import ROS1, T0_NS, write_bag1, write_bag2
from tests.core.readers.test_line_scanners import laser_scan
from tests.core.readers.vectornav_logs import common, grouped, vnimu, vnins
from tests.fuzz.mutations import Files
from tests.fuzz.positions import nmea
from tests.fuzz.reading import EACH_WAY, OPTIONS
from tests.fuzz.trials import Entry


def bag_seeds(folder: Path) -> list[Files]:
    """An IMU and sentences, in a ROS 1 bag and an MCAP file."""
    first = write_bag1(folder / "imu.bag", [*turning_imu(12, ROS1), *sentences(nmea(3), ROS1)])
    (second,) = write_bag2(folder / "imu", [*turning_imu(12), *sentences(nmea(3))]).glob("*.mcap")
    return [{"imu.bag": first.read_bytes()}, {"imu.mcap": second.read_bytes()}]


def read_bag(path: Path) -> None:
    """All but scans, of which it has none."""
    found = Recognised.by_content(path)
    json.dumps(plain(_inspection_value(found.inspect(OPTIONS))), allow_nan=False)
    reader = found.open(OPTIONS)
    for give in ("inertial", "track"):
        if hasattr(reader, give):
            getattr(reader, give)()


def ahrs() -> bytes:
    head = "time_gps_s,roll_deg,pitch_deg,heading_true_deg"
    rows = [f"{194530.8 + k / 50:.4f},{0.1 * k},-0.5,{3 * k}" for k in range(20)]
    return "\n".join([head, *rows, ""]).encode()


def line_seeds(folder: Path) -> list[Files]:
    """Sweeps of a line scanner in a bag, and in CSV."""
    recorded = [("/scan", T0_NS + 10**8 * k, laser_scan(T0_NS + 10**8 * k, range(1, 20))) for k in range(6)]
    (bag,) = write_bag2(folder / "line", recorded).glob("*.mcap")
    rows = [f"{194530.8 + k / 1000:.4f},{k % 20 - 10},{4 + k % 3},{k}" for k in range(60)]
    return [
        {"line.mcap": bag.read_bytes()},
        {"line.csv": "\n".join(["time_gps_s,angle_deg,range_m,intensity", *rows, ""]).encode()},
    ]


def read_line(path: Path) -> None:
    """The sweeps, and what `inspect` reports."""
    found = Recognised.by_content(path)
    json.dumps(plain(_inspection_value(found.inspect(OPTIONS))), allow_nan=False)
    reader = found.open(OPTIONS)
    if hasattr(reader, "scans"):
        deque(reader.scans(), maxlen=0)


def vectornav_seeds(folder: Path) -> list[Files]:
    """Binary messages of two layouts, and sentences with times between them."""
    mixed = b"".join(common(k) + grouped(k) for k in range(12))
    return [
        {"vn.bin": mixed},
        {"vn.txt": b"".join(vnimu(k) + vnins(k) for k in range(12))},
        {"stamped.txt": b"".join(f"{1.7e9 + k} ".encode() + vnimu(k) for k in range(12))},
    ]


STATED = {name: (name, "deg/s" if name.startswith("gyro") else "g", 1.0) for name in QUANTITIES[1:]}
OWN_CLOCK = ReadOptions(columns={"clock": ("time", "s", 1.0), "date": ("utc", "iso", 1.0), **STATED})


def dji_log() -> bytes:
    rows = [f"{0.1 * k:.1f},2026-05-23 09:41:{12 + k // 10}.5Z,1,2,3,0,0,-1" for k in range(60)]
    return "\n".join([",".join(["clock", "date", *QUANTITIES[1:]]), *rows, ""]).encode()


def read_stated_columns(path: Path) -> None:
    """A CSV whose columns the session states."""
    ImuCsv([path], OWN_CLOCK).inertial()


INERTIAL = (
    Entry("rosbag-imu", bag_seeds, read_bag, trials=60),
    Entry("line-scanner", line_seeds, read_line, trials=60),
    Entry("vectornav", vectornav_seeds, EACH_WAY, trials=150),
    Entry("imu-csv-iso", lambda folder: [{"dji.csv": dji_log()}], read_stated_columns, trials=60),
    Entry("attitude-csv", lambda folder: [{"ahrs.csv": ahrs()}], EACH_WAY, trials=60),
)
