"""Poses, tool and ground while a recording comes in, against the truth of simulated drives."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice, takewhile
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import furrowmap
from furrowmap.core.live.drive import LivePose
from furrowmap.core.live.poses import LivePoses
from furrowmap.core.readers.reader import GivesPoses, GivesTrack, ReadOptions, open_recording
from furrowmap.core.session.opened import OpenSession, open_session
from furrowmap.core.trajectory.from_poses import trajectory_from_poses
from furrowmap.core.trajectory.vehicle_motion import STANDING_MPS
from furrowmap.core.values.rotation import wrap_deg
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.trajectory import Trajectory

from ..conftest import Recording

SMOOTH = """
seed = 310
[soil]
kind = "{ground}"
worked = "same"
[implement]
shape = "mower"
[lidar]
max_range_m = 25.0
[drive]
pass_m = [4.0]
passes = 2
spacing_m = 1.5
speed_work_mps = 1.5
speed_turn_mps = 1.5
"""


def poses_of(
    opened: OpenSession,
    scans: Iterable[Scan],
    outage_s: tuple[float, float] = (np.inf, np.inf),
    late_s: float = 0.05,
    every: int = 1,
) -> list[LivePose]:
    """Poses as they would come: each scan when its last return is there, each position a little later."""
    reader = opened.positions()
    assert isinstance(reader, GivesTrack)
    track, live, given = reader.track()[::every], LivePoses(opened.session, opened.frame), 0
    out = []
    for scan in scans:
        come = int(np.searchsorted(track.t_s, scan.t_s[-1] - late_s))
        new = track[given:come]
        live.add_track(new[(new.t_s < outage_s[0]) | (new.t_s > outage_s[1])])
        given = come
        out.append(live.add_scan(scan))
    return [pose for pose in out if pose is not None]


def off_deg(poses: list[LivePose], truth: Trajectory) -> NDArray[np.float64]:
    """Headings less the true ones."""
    true_deg = truth.at(np.array([pose.t_s for pose in poses])).attitude_deg()[2]
    off: NDArray[np.float64] = wrap_deg(np.array([pose.attitude_deg[2] for pose in poses]) - true_deg)
    return off


@pytest.mark.slow
def test_poses__are_right_as_they_come(straight: Recording) -> None:
    """The drive's last metre has a kink, in which the vehicle turns by 2° in a scan: it is found again."""
    poses = poses_of(straight.opened, straight.scans())
    way_m = np.linalg.norm(straight.truth.xyz_m - straight.truth.xyz_m[0], axis=1)
    assert poses[0].t_s - straight.truth.t_s[np.argmax(way_m > 0.05)] < 2.3  # after 1.5 m
    off_m = np.array([pose.xyz_m for pose in poses]) - straight.truth.at(np.array([pose.t_s for pose in poses])).xyz_m
    # The antenna's own errors are in it, and until the first turn nothing shows how the ground slopes across.
    assert np.sqrt((off_m[:, :2] ** 2).sum(axis=1).mean()) < 0.07
    off = off_deg(poses, straight.truth)
    normed = np.abs(off) / [pose.sigma[5] for pose in poses]
    late = off[len(off) // 2 :]  # the first metres show the heading badly
    assert np.sqrt((late**2).mean()) < 0.6
    assert np.abs(late[-10:]).max() < 0.5
    assert (normed < 3.0).mean() > 0.95


def begin_of(
    folder: Path, lasts_s: float, late_s: float = 0.05, first: int = 0, every: int = 1
) -> tuple[list[LivePose], Trajectory]:
    """Poses of the first seconds of a recording, looked at from a scan on, and the truth."""
    opened = open_session(folder / "session.toml")
    reader = open_recording([folder / "truth" / "trajectory.csv"], ReadOptions())
    assert isinstance(reader, GivesPoses)
    truth = trajectory_from_poses(reader.poses(), opened.frame)
    begin_s = truth.span_s[0]
    scans = takewhile(lambda scan: scan.t_s[-1] < begin_s + lasts_s, opened.lidar(begin_s).scans())
    return poses_of(opened, islice(scans, first, None), late_s=late_s, every=every), truth


def test_headings__hold_while_the_vehicle_rocks_in_a_turn(shared_data: Path) -> None:
    """In the scan at 20.6 s the heights fit better 2.4° off, until the vehicle's tilt is found as well."""
    poses, truth = begin_of(shared_data / "tractor_loop", 23.0, late_s=0.1)
    in_turn = [pose for pose in poses if pose.t_s > truth.span_s[0] + 15.0]
    assert len(in_turn) > 70
    assert np.abs(off_deg(in_turn, truth)).max() < 0.5


def test_the_first_headings__hold_while_the_vehicle_starts(shared_data: Path) -> None:
    """The first scans wait for the scanner's clock, and positions are ahead of them: it was off by 3.9 and 4.9°."""
    for late_s in (-0.6, -1.2):
        poses, truth = begin_of(shared_data / "tractor_loop", 8.0, late_s, first=8)
        assert len(poses) > 25
        assert np.abs(off_deg(poses, truth)).max() < 1.2
        assert (np.abs(off_deg(poses, truth)) < [3.0 * pose.sigma[5] for pose in poses]).all()


def test_headings__hold_in_turns_and_in_reverse(shared_data: Path) -> None:
    """A fishtail turn: forward, reverse, forward, with an antenna ahead of the axle, whose course shows little."""
    poses, truth = begin_of(shared_data / "tractor_fishtail", 24.0)
    begin_s = truth.span_s[0]
    off, reverse = off_deg(poses, truth), np.array([pose.speed_mps < -STANDING_MPS for pose in poses])
    assert reverse.sum() > 40
    assert np.sqrt((off**2).mean()) < 0.3
    assert np.sqrt((off[reverse] ** 2).mean()) < 0.3
    assert (np.abs(off) < [3.0 * pose.sigma[5] for pose in poses]).mean() > 0.99
    # From the first turn on it is known what is level: until then nothing shows the slope across.
    late = [pose for pose in poses if pose.t_s > begin_s + 12.0]
    true = truth.at(np.array([pose.t_s for pose in late]))
    off_m = np.array([pose.xyz_m for pose in late]) - true.xyz_m
    assert np.sqrt((off_m[:, :2] ** 2).sum(axis=1).mean()) < 0.03
    off_deg_of = np.array([pose.attitude_deg for pose in late]).T - np.array(true.attitude_deg())
    assert np.sqrt((off_deg_of[:2] ** 2).mean()) < 0.25
    for k in (3, 4):
        assert (np.abs(off_deg_of[k - 3]) < [3.0 * pose.sigma[k] for pose in late]).mean() > 0.97


@pytest.mark.parametrize("ground", ["asphalt", "lawn", "maize"])
def test_headings__hold_on_ground_that_does_not_show_the_turn(ground: str, tmp_path: Path) -> None:
    """Slopes of noise, which the scanner takes along, would show that the vehicle goes straight on.

    Asphalt is flat, grass and snow almost; maize hides the ground.
    """
    (tmp_path / "scenario.toml").write_text(SMOOTH.format(ground=ground))
    folder = furrowmap.simulate(tmp_path / "scenario.toml", tmp_path / "drive").folder
    poses, truth = begin_of(folder, 60.0)
    assert truth.span_s[1] - poses[0].t_s > 15.0
    turned_deg = np.abs(np.diff(truth.attitude_deg()[2]))
    assert turned_deg[turned_deg < 180.0].sum() > 150.0
    off = off_deg(poses, truth)
    assert np.sqrt((off**2).mean()) < 1.0
    assert np.sqrt(((off / [pose.sigma[5] for pose in poses]) ** 2).mean()) < 1.5


@pytest.mark.parametrize(("every", "late_s"), [(1, 0.3), (5, 0.05), (10, 0.05)])
def test_poses__hold_where_positions_come_late_or_seldom(every: int, late_s: float, shared_data: Path) -> None:
    """Positions of 10, 2 and 1 Hz, through the turns of a fishtail."""
    poses, truth = begin_of(shared_data / "tractor_fishtail", 24.0, late_s, every=every)
    late = [pose for pose in poses if pose.t_s > truth.span_s[0] + 12.0]
    assert len(late) > 110
    assert not any(pose.is_guess for pose in poses)
    assert np.sqrt((off_deg(late, truth) ** 2).mean()) < 0.3
    off_m = np.array([pose.xyz_m for pose in late]) - truth.at(np.array([pose.t_s for pose in late])).xyz_m
    assert np.sqrt((off_m[:, :2] ** 2).sum(axis=1).mean()) < 0.04


@pytest.mark.parametrize("begin_s", [14.0, 19.0])
def test_gap_of_4_s__with_a_stop_and_reverse_is_bridged_by_scans(begin_s: float, shared_data: Path) -> None:
    """In both the tractor stops and changes its direction; at the speed before the gap it would be 4.8 m off."""
    opened = open_session(shared_data / "tractor_fishtail" / "session.toml")
    reader = open_recording([shared_data / "tractor_fishtail" / "truth" / "trajectory.csv"], ReadOptions())
    assert isinstance(reader, GivesPoses)
    truth = trajectory_from_poses(reader.poses(), opened.frame)
    gap_s = truth.span_s[0] + begin_s, truth.span_s[0] + begin_s + 4.0
    scans = takewhile(lambda scan: scan.t_s[-1] < gap_s[1], opened.lidar(truth.span_s[0]).scans())
    poses = [pose for pose in poses_of(opened, scans, gap_s) if pose.is_guess]
    assert poses[-1].position_age_s > 3.7
    speed_mps = np.array([pose.speed_mps for pose in poses])
    assert speed_mps.min() < -STANDING_MPS
    assert speed_mps.max() > STANDING_MPS
    off_m = np.array([pose.xyz_m for pose in poses]) - truth.at(np.array([pose.t_s for pose in poses])).xyz_m
    apart_m = np.hypot(*off_m[:, :2].T)
    assert apart_m.max() < 0.15
    assert (apart_m < [3.0 * float(np.hypot(*pose.sigma[:2])) for pose in poses]).all()
    assert np.abs(off_deg(poses, truth)).max() < 1.0


def test_poses__without_positions_say_so(straight: Recording) -> None:
    begin_s = straight.truth.span_s[1] - 3.5
    poses = poses_of(straight.opened, straight.scans(), (begin_s, begin_s + 2.0))
    before = [pose for pose in poses if pose.t_s < begin_s]
    late = [pose for pose in poses if begin_s + 1.5 < pose.t_s < begin_s + 1.9]
    assert max(pose.position_age_s for pose in before) < 0.2
    assert min(pose.position_age_s for pose in late) > 1.3
    assert all(pose.is_guess for pose in late)
    assert min(pose.sigma[0] for pose in late) > 2.0 * max(pose.sigma[0] for pose in before[-5:])
    off = [straight.truth.at(pose.t_s).xyz_m[0] - pose.xyz_m for pose in late]
    assert all(np.hypot(*o[:2]) < 3.0 * np.hypot(*pose.sigma[:2]) for o, pose in zip(off, late, strict=True))
