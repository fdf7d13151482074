"""Poses, tool and ground while a recording comes in, against the truth of simulated drives."""

from __future__ import annotations

import numpy as np

from furrowmap.core.pipeline.live_poses import LivePose, LivePoses
from furrowmap.core.readers.reader import GivesTrack

from ..conftest import Recording


def poses_of(recording: Recording, outage_s: tuple[float, float] = (np.inf, np.inf)) -> list[LivePose]:
    """Poses as they would come: each scan when its last return is there, each position 50 ms late."""
    reader = recording.opened.positions()
    assert isinstance(reader, GivesTrack)
    track, live, given = reader.track(), LivePoses(recording.session, recording.opened.frame), 0
    out = []
    for scan in recording.scans():
        come = int(np.searchsorted(track.t_s, scan.t_s[-1] - 0.05))
        new = track[given:come]
        live.add_track(new[(new.t_s < outage_s[0]) | (new.t_s > outage_s[1])])
        given = come
        out.append(live.add_scan(scan))
    return [pose for pose in out if pose is not None]


def test_poses__are_right_as_they_come(straight: Recording) -> None:
    poses = [pose for pose in poses_of(straight) if pose.speed_mps > 0.3]
    poses = poses[len(poses) // 2 :]  # the first metres show the heading badly
    t_s = np.array([pose.t_s for pose in poses])
    truth = straight.truth.at(t_s)
    off = np.array([pose.xyz_m for pose in poses]) - truth.xyz_m
    assert len(poses) >= 15
    # The antenna's own errors are in it, and until the first turn nothing shows how the ground slopes across.
    assert np.sqrt((off[:, :2] ** 2).sum(axis=1).mean()) < 0.05


def test_poses__without_positions_say_so(straight: Recording) -> None:
    begin_s = straight.truth.span_s[1] - 3.5
    poses = poses_of(straight, (begin_s, begin_s + 2.0))
    before = [pose for pose in poses if pose.t_s < begin_s]
    late = [pose for pose in poses if begin_s + 1.5 < pose.t_s < begin_s + 1.9]
    assert max(pose.position_age_s for pose in before) < 0.2
    assert min(pose.position_age_s for pose in late) > 1.3
    assert min(pose.sigma[0] for pose in late) > 2.0 * max(pose.sigma[0] for pose in before[-5:])
    off = [straight.truth.at(pose.t_s).xyz_m[0] - pose.xyz_m for pose in late]
    assert all(np.hypot(*o[:2]) < 3.0 * np.hypot(*pose.sigma[:2]) for o, pose in zip(off, late, strict=True))
