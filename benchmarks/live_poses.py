"""Poses of `furrowmap live` against the truth: positions that come late, seldom, or not for four seconds.

    python benchmarks/live_poses.py SESSION...

The sessions are simulated, with their truth beside them. Gaps begin every two seconds, each in a copy of the state.
"""

from __future__ import annotations

import copy
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from furrowmap.core.live.drive import LivePose
from furrowmap.core.live.poses import LivePoses
from furrowmap.core.readers.reader import GivesPoses, GivesTrack, ReadOptions, open_recording
from furrowmap.core.session.opened import open_session
from furrowmap.core.trajectory.from_poses import trajectory_from_poses
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.rotation import wrap_deg
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.trajectory import Trajectory

CASES: Final = {"10 Hz": (1, 0.05), "0.3 s late": (1, 0.3), "2 Hz": (5, 0.05), "1 Hz": (10, 0.05)}
"""Of positions that are recorded at 10 Hz: which of them come, and how late."""
SETTLED_S: Final = 12.0
GAP_S: Final = 4.0
GAP_EVERY_S: Final = 2.0


def fed(live: LivePoses, scans: list[Scan], track: GnssTrack, late_s: float) -> Iterator[tuple[int, LivePose]]:
    """The poses of scans, with the number of the scan."""
    given = 0
    for number, scan in enumerate(scans):
        come = int(np.searchsorted(track.t_s, scan.t_s[-1] - late_s))
        live.add_track(track[given:come])
        given = come
        pose = live.add_scan(scan)
        if pose is not None:
            yield number, pose


def errors(poses: list[LivePose], truth: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Errors of places (m, in plan) and headings (degrees)."""
    true = truth.at(np.array([pose.t_s for pose in poses]))
    off_m = (np.array([pose.xyz_m for pose in poses]) - true.xyz_m)[:, :2]
    off_deg = np.asarray(wrap_deg(np.array([pose.attitude_deg[2] for pose in poses]) - true.attitude_deg()[2]))
    return np.hypot(off_m[:, 0], off_m[:, 1]), off_deg


def main(paths: list[str]) -> None:
    for path in map(Path, paths):
        folder = path if path.is_dir() else path.parent
        opened = open_session(folder / "session.toml")
        reader = open_recording([folder / "truth" / "trajectory.csv"], ReadOptions())
        positions = opened.positions()
        assert isinstance(reader, GivesPoses)
        assert isinstance(positions, GivesTrack)
        truth = trajectory_from_poses(reader.poses(), opened.frame)
        begin_s, end_s = truth.span_s
        track = positions.track()
        scans = [scan for scan in opened.lidar(begin_s).scans() if scan.t_s[-1] < end_s]
        print(folder.name)
        for name, (every, late_s) in CASES.items():
            poses = [pose for _, pose in fed(LivePoses(opened.session, opened.frame), scans, track[::every], late_s)]
            settled = [pose for pose in poses if pose.t_s > begin_s + SETTLED_S]
            if not settled:
                print(f"  {name}: no pose")
                continue
            place_m, heading_deg = errors(settled, truth)
            rms = np.sqrt((place_m**2).mean()), np.sqrt((heading_deg**2).mean())
            print(
                f"  {name}: first pose after {poses[0].t_s - begin_s:.1f} s, RMS {rms[0]:.3f} m and {rms[1]:.3f}°, "
                f"at most {place_m.max():.3f} m and {np.abs(heading_deg).max():.2f}°"
            )
        print_gaps(LivePoses(opened.session, opened.frame), scans, track, truth)


def print_gaps(live: LivePoses, scans: list[Scan], track: GnssTrack, truth: Trajectory) -> None:
    """Errors at the end of gaps, and by how many standard deviations."""
    begin_s, end_s = truth.span_s
    next_s = begin_s + 8.0
    ends: list[tuple[float, float]] = []
    for number, _ in fed(live, scans, track, 0.05):
        gap_s = float(scans[number].t_s[-1])
        if gap_s < next_s or gap_s > end_s - GAP_S - 1.0 or not live.direction_is_certain:
            continue
        next_s = gap_s + GAP_EVERY_S
        rest = [scan for scan in scans[number + 1 :] if scan.t_s[-1] < gap_s + GAP_S]
        poses = [pose for _, pose in fed(copy.deepcopy(live), rest, track[:0], 0.0)]
        last = [pose for pose in poses if pose.is_guess][-1:]
        if last:
            place_m = float(errors(last, truth)[0][0])
            ends.append((place_m, place_m / float(np.hypot(last[0].sigma[0], last[0].sigma[1]))))
    found = np.array(ends)
    median_m = float(np.median(found[:, 0]))
    most_m = float(found[:, 0].max())
    ratio = float(np.sqrt((found[:, 1] ** 2).mean()))
    print(
        f"  {len(found)} gaps of {GAP_S:.0f} s: median {median_m:.3f} m, at most {most_m:.3f} m; {ratio:.2f} sigma RMS"
    )


if __name__ == "__main__":
    main(sys.argv[1:])
