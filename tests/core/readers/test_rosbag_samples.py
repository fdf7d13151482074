"""Bags as robots recorded them: what each holds, and agreement with other people's readers."""

from __future__ import annotations

import gzip
import itertools
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import dpkt
import numpy as np
import pytest
import velodyne_decoder
from rosbags.rosbag1 import Reader as Rosbags1
from rosbags.rosbag2 import Reader as Rosbags2

from furrowmap.core.readers.reader import Inspection, ReadOptions, Recognised, open_recording
from furrowmap.core.readers.rosbag.bags import BagFiles
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.scan import Clock

POINTS, ODOMETRY, FIX = "/velodyne_points", "/fixposition/odometry_ecef", "/fix"
PACKETS_32 = "/sensing/lidar/front/velodyne_packets"

# As the samples' README lists them: format, messages a topic, first and last reception, scans, their slots, positions.
HELD = {
    "leo_rover_points.bag": ("rosbag1", {POINTS: 5, ODOMETRY: 86, FIX: 86}, 1766566997.950, 1766567002.250, 145888, 86),
    "leo_rover_points_mcap": ("rosbag2", {POINTS: 3, ODOMETRY: 49, FIX: 49}, 1766567004.400, 1766567006.850, 87552, 49),
    "leo_rover_points_db3": ("rosbag2", {POINTS: 2, ODOMETRY: 26, FIX: 26}, 1766567008.250, 1766567009.500, 58368, 26),
    "vlp16_dual_rosbag2": ("rosbag2", {"/velodyne_packets": 4}, 1673400471.838, 1673400472.138, 603, 0),
    "vlp16_dual_packets.bag": ("rosbag1", {"/velodyne_packets": 4}, 1673400471.838, 1673400472.138, 603, 0),
    "vlp32c_single_rosbag2": ("rosbag2", {PACKETS_32: 5}, 1713492677.464, 1713492677.841, 379, 0),
    "husky_imu_odom_fix.bag": (
        "rosbag1",
        {"/imu/data": 11865, "/husky_velocity_controller/odom": 3952, "/fix": 989},
        1432235498.025,
        1432235893.332,
        0,
        989,
    ),
    "foreign_nav2_turtlebot.mcap": (
        "rosbag2",
        {"/odom": 2639, "/tf": 5422, "/tf_static": 1, "/amcl_pose": 135},
        1778234353.383,
        1778234450.738,
        0,
        0,
    ),
}
WHOLE = sorted(HELD)


def inspected(path: Path) -> Inspection:
    return Recognised.by_content(path).inspect()


@contextmanager
def opened_by_rosbags(path: Path) -> Iterator[Any]:
    with (Rosbags1 if path.suffix == ".bag" else Rosbags2)(path) as reader:
        yield reader


@pytest.mark.parametrize("name", WHOLE)
def test_inspect_reports_topics_counts_and_span(shared_data: Path, name: str) -> None:
    form, topics, first_s, last_s, slots, epochs = HELD[name]
    inspection = inspected(shared_data / "rosbag" / name)
    facts = inspection.facts
    assert inspection.format == form
    assert {topic: found["messages"] for topic, found in facts["topics"].items()} == topics
    assert facts["messages"] == sum(topics.values())
    recorder = inspection.clocks[0]
    assert recorder.clock is Clock.RECORDER
    assert (recorder.first_s, recorder.last_s) == pytest.approx((first_s, last_s), abs=6e-4)
    if slots:
        assert slots in (facts["scans"].get("slots"), facts["scans"].get("packets"))
    else:
        assert facts["scans"] == "none"
    assert (facts["positions"]["epochs"] if epochs else facts["positions"]) == (epochs or "none")
    assert not [notice for notice in inspection.notices if notice.code.startswith("bag-")]


def test_inspect_reports_the_models_of_the_packets(shared_data: Path) -> None:
    assert inspected(shared_data / "rosbag" / "vlp16_dual_rosbag2").facts["scans"]["model"] == "VLP-16"
    assert inspected(shared_data / "rosbag" / "vlp32c_single_rosbag2").facts["scans"]["model"] == "VLP-32C"


@pytest.mark.parametrize("name", WHOLE)
def test_messages_are_those_that_rosbags_reads(shared_data: Path, name: str) -> None:
    path = shared_data / "rosbag" / name
    with opened_by_rosbags(path) as reader:
        theirs = Counter((c.topic, c.msgtype, at_ns, bytes(data)) for c, at_ns, data in reader.messages())
    ours = Counter((m.topic, m.type, m.received_ns, m.data) for m in BagFiles([path]).messages())
    assert ours == theirs


def test_an_unindexed_bag_gives_all_16806_messages(shared_data: Path) -> None:
    folder = shared_data / "rosbag"
    files = BagFiles([folder / "damaged_unindexed.bag"])
    recovered = list(files.messages())
    assert recovered == list(BagFiles([folder / "husky_imu_odom_fix.bag"]).messages())
    assert len(recovered) == 16806
    assert [notice.code for notice in files.notices] == ["bag-unindexed"]


@pytest.mark.parametrize(
    ("cut", "whole", "least"),
    [
        ("damaged_truncated.bag", "husky_imu_odom_fix.bag", 0.5),
        ("damaged_truncated.mcap", "leo_rover_points_mcap", 0.45),
    ],
)
def test_a_cut_bag_gives_what_was_written_before(shared_data: Path, cut: str, whole: str, least: float) -> None:
    folder = shared_data / "rosbag"
    files = BagFiles([folder / cut])
    recovered = list(files.messages())
    every = list(BagFiles([folder / whole]).messages())
    assert recovered == every[: len(recovered)]
    assert len(recovered) >= least * len(every)
    texts = {notice.code: notice.text for notice in files.notices}
    assert "are lost" in texts["bag-cut"]


def test_positions_of_a_cut_bag_are_used_and_the_loss_is_reported(shared_data: Path) -> None:
    reader = open_recording([shared_data / "rosbag" / "damaged_truncated.bag"], ReadOptions())
    assert len(reader.track()) == 517
    assert "bag-cut" in {notice.code for notice in reader.notices}


def test_positions_carry_the_stated_quality(shared_data: Path) -> None:
    path = shared_data / "rosbag" / "husky_imu_odom_fix.bag"
    track = open_recording([path], ReadOptions()).track()
    assert len(track) == 989
    assert set(track.fix) == {Fix.DGPS}
    assert track.lat_deg[0] == pytest.approx(42.3758, abs=1e-4)
    assert track.lon_deg[0] == pytest.approx(-71.1474, abs=1e-4)
    # The receiver's own covariance: 0.81 m² in the plane, 3.24 m² in height.
    assert (track.sigma_e_m[0], track.sigma_n_m[0], track.sigma_h_m[0]) == pytest.approx((0.9, 0.9, 1.8))


@pytest.mark.parametrize("what", ["scans", "track"])
def test_a_foreign_bag_is_refused_in_three_sentences(shared_data: Path, what: str) -> None:
    reader = open_recording([shared_data / "rosbag" / "foreign_nav2_turtlebot.mcap"], ReadOptions())
    with pytest.raises(InputError) as refused:
        list(getattr(reader, what)())
    assert all(refused.value.lines)
    assert "/amcl_pose" in refused.value.what


def test_clouds_are_the_same_revolutions_as_in_the_capture(shared_data: Path) -> None:
    """Clouds 40 to 44 against the capture rebuilt from them, decoded by velodyne-decoder, point by point."""
    scans = list(open_recording([shared_data / "rosbag" / "leo_rover_points.bag"], ReadOptions()).scans())
    with gzip.open(shared_data / "rover_real" / "leo_rover_vlp16.pcap.gz") as file:
        records = itertools.islice(dpkt.pcap.Reader(file), 40 * 76, 45 * 76)
        packets = [
            velodyne_decoder.VelodynePacket(float(at_s), np.frombuffer(frame[42:], np.uint8)) for at_s, frame in records
        ]
    config = velodyne_decoder.Config(model=velodyne_decoder.Model.VLP16)
    assert len(scans) == 5
    for k, scan in enumerate(scans):
        decoder = velodyne_decoder.ScanDecoder(config)
        stamp, theirs = decoder.decode(velodyne_decoder.PacketVector(packets[76 * k : 76 * k + 76]), True)
        if k == 3:  # the driver dropped a block where azimuth wraps; the capture has it, without a return
            assert scan.column.max() == theirs["column"].max() - 2
            continue
        mine, its = np.lexsort((scan.laser, scan.column)), np.lexsort((theirs["ring"], theirs["column"]))
        scan_xyz, theirs = scan.xyz_m[mine], theirs[its]
        np.testing.assert_array_equal(scan.laser[mine], theirs["ring"])
        np.testing.assert_array_equal(scan.column[mine], theirs["column"])
        np.testing.assert_array_equal(scan.intensity[mine], theirs["intensity"])
        distance_m = np.linalg.norm(scan_xyz - np.stack([theirs[axis] for axis in "xyz"], axis=1), axis=1)
        assert np.median(distance_m) < 0.003
        # The decoders differ by 3 mm in their geometry; azimuths are rounded to 0.01°, in the bag and in the capture.
        assert (distance_m < 0.003 + np.radians(0.02) * np.linalg.norm(scan_xyz, axis=1)).all()
        delay_s = scan.t_s[mine] - (stamp.host + theirs["time"].astype(np.float64))
        assert np.abs(delay_s).max() < 3e-6


def test_packets_in_a_bag_give_the_same_points_as_in_a_capture(shared_data: Path) -> None:
    captured = list(open_recording([shared_data / "velodyne" / "vlp16_dual.pcap"], ReadOptions()).scans())
    for name in ("vlp16_dual_packets.bag", "vlp16_dual_rosbag2"):
        reader = open_recording([shared_data / "rosbag" / name], ReadOptions())
        bagged = list(reader.scans())
        assert reader.clock is Clock.RECORDER
        assert sum(map(len, bagged)) == 59414
        for ours, theirs in zip(bagged, captured, strict=True):
            for column in ("xyz_m", "intensity", "laser", "column", "return_number", "returns"):
                np.testing.assert_array_equal(getattr(ours, column), getattr(theirs, column))
            np.testing.assert_allclose(ours.t_s, theirs.t_s, rtol=0, atol=1e-6)
