"""Which topic of a bag is read as a scanner: the one that holds a scanner's data, whoever sends most."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.rosbag.bags import RosBag1, RosBag2
from tests.core.readers.small_bags import T0_NS, Recorded, point_cloud, write_bag2

SCAN = np.dtype([("x", "f4"), ("y", "f4"), ("z", "f4"), ("ring", "u2"), ("time", "f4")])
PLAIN = np.dtype([("x", "f4"), ("y", "f4"), ("z", "f4"), ("intensity", "f4")])
TRACK = np.dtype([("x", "f4"), ("y", "f4"), ("z", "f4"), ("doppler", "f4"), ("rcs", "f4")])
SCANS = 4
POINTS = 1600


def points(dtype: np.dtype[Any], count: int) -> NDArray[Any]:
    found = np.zeros(count, dtype)
    found["x"] = 5.0 + np.arange(count) % 7
    found["y"] = np.linspace(-4.0, 4.0, count)
    if "time" in found.dtype.names:
        found["time"] = np.linspace(0.0, 0.099, count)
        found["ring"] = np.arange(count) % 16
    return found


def clouds(topic: str, dtype: np.dtype[Any], count: int, messages: int = SCANS, frame: str = "lidar") -> list[Recorded]:
    """Messages spread evenly over 0.1 s for each scan."""
    recorded = []
    for k in range(messages):
        at_ns = T0_NS + k * SCANS * 100_000_000 // messages
        message = point_cloud(at_ns, points(dtype, count))
        message.header.frame_id = frame
        recorded.append((topic, at_ns + 1_000_000, message))
    return recorded


OTHERS = {
    "tracks of a radar": clouds("/a/radar", TRACK, 60, 20 * SCANS, "radar"),
    "a radar in the scanner's frame": clouds("/z/radar", TRACK, 60, 20 * SCANS),
    "a copy without rings and times": clouds("/a/filtered", PLAIN, POINTS, 2 * SCANS),
    "a copy in another frame": clouds("/a/in_map", PLAIN, POINTS, 2 * SCANS, "map"),
    "a thinned copy": clouds("/a/thinned", SCAN, POINTS // 3, 2 * SCANS),
    "obstacles with rings": clouds("/a/obstacles", SCAN, 20, 2 * SCANS, "obstacles"),
}


@pytest.mark.parametrize("other", OTHERS)
def test_scanner__is_told_from_what_is_made_of_it(other: str, tmp_path: Path) -> None:
    recorded = sorted([*clouds("/points", SCAN, POINTS), *OTHERS[other]], key=lambda one: one[1])
    reader = RosBag2([write_bag2(tmp_path / "bag", recorded)], ReadOptions())
    assert [len(scan) for scan in reader.scans()] == [POINTS] * SCANS
    facts = reader.inspect().facts["scans"]
    assert facts["topic"] == "/points"
    assert "sensors" not in facts


def test_two_scanners__are_both_listed(tmp_path: Path) -> None:
    recorded = [*clouds("/left", SCAN, POINTS, frame="left"), *clouds("/right", SCAN, POINTS // 2, frame="right")]
    reader = RosBag2([write_bag2(tmp_path / "bag", recorded)], ReadOptions())
    assert reader.inspect().facts["scans"]["sensors"] == ["/left", "/right"]
    assert sum(len(scan) for scan in RosBag2(reader.paths, ReadOptions(source="/right")).scans()) == SCANS * POINTS // 2


def test_only_a_filtered_cloud__is_read(tmp_path: Path) -> None:
    reader = RosBag2([write_bag2(tmp_path / "bag", OTHERS["a copy in another frame"])], ReadOptions())
    assert sum(len(scan) for scan in reader.scans()) == 2 * SCANS * POINTS


def test_ouster__data_packets_are_told_from_inertial_ones(shared_data: Path) -> None:
    """A sensor with an azimuth window sends fewer packets with data than inertial ones."""
    bag = shared_data / "foreign" / "23-ouster-bag-imu-packets" / "window.bag"
    if not bag.is_file():
        pytest.skip("the sample inputs of other software are not beside this checkout")
    reader = RosBag1([bag], ReadOptions())
    facts = reader.inspect().facts["scans"]
    assert (facts["topic"], facts["scans"], facts["data_packets"]) == ("/os_node0/lidar_packets", 1, 8)
    assert "sensors" not in facts
