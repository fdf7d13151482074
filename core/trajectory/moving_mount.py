"""The trajectory of a mount that turns against the vehicle."""

from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from furrowmap.core.readers.mount_csv import read_mount
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.trajectory.located import Located
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.pose_track import MountMotion
from furrowmap.core.values.session import Session
from furrowmap.core.values.trajectory import Trajectory, same_hemisphere

MIN_KNOT_DISTANCE_S: Final = 1e-4
"""Knots nearer to each other than this are one."""


def carrier_of(located: Located, session: Session, file: Path | None) -> tuple[Trajectory | None, list[Notice]]:
    """The trajectory of the frame that carries the scanner, and notices about its file; None for a rigid mount.

    Args:
        file: that this names, if it does.

    Raises:
        InputError: if the file cannot be read, or the scans are to be matched to the ground.
    """
    if session.mount is None or file is None:
        return None, []
    if located.antenna is not None:
        raise InputError("mount-moves", file=file)
    motion, notices = read_mount(file, float(np.mean(located.trajectory.span_s)))
    begin_s, end_s = located.trajectory.span_s
    known_s = np.concatenate([[begin_s], motion.t_s[(motion.t_s > begin_s) & (motion.t_s < end_s)], [end_s]])
    length = np.diff(known_s)
    wide = length > located.trajectory.max_gap_s
    if wide.any():
        longest = int(np.argmax(np.where(wide, length, 0.0)))
        notices.append(
            Notice(
                "mount-gaps",
                file=file,
                missing_s=length[wide].sum(),
                end_s=end_s - begin_s,
                wide=int(wide.sum()),
                longest_s=length[longest],
                longest_begins=iso_utc(float(known_s[longest])),
            )
        )
    pivot_m = session.mount.xyz_m if session.mount.xyz_m is not None else session.lidar.mounting.xyz_m
    return mount_trajectory(located.trajectory, motion, pivot_m), notices


def mount_trajectory(trajectory: Trajectory, motion: MountMotion, pivot_m: tuple[float, float, float]) -> Trajectory:
    """The poses of the mount's frame: the vehicle's, turned about the pivot (in the vehicle frame).

    Its knots are those of the trajectory and the samples of the mount together, so that interpolation between knots
    follows both. There is no pose before the first sample and after the last, nor in gaps of either.

    Raises:
        InputError: if they have no time in common.
    """
    begin_s = max(trajectory.t_s[0], motion.t_s[0])
    end_s = min(trajectory.t_s[-1], motion.t_s[-1])
    times = np.union1d(trajectory.t_s, motion.t_s)
    times = times[(times >= begin_s) & (times <= end_s)]
    times = times[np.diff(times, prepend=-np.inf) > MIN_KNOT_DISTANCE_S]
    before = np.clip(np.searchsorted(motion.t_s, times, side="right") - 1, 0, len(motion.t_s) - 2)
    seldom = np.diff(motion.t_s)[before] > trajectory.max_gap_s
    times = times[~seldom | np.isin(times, motion.t_s)]
    poses = trajectory.at(times) if len(times) else None
    known = np.isfinite(poses.quaternion[:, 0]) if poses is not None else np.zeros(0, bool)
    if poses is None or known.sum() < 2:
        raise InputError("no-common-time.of-mount")
    times = times[known]
    vehicle = Rotation.from_quat(poses.quaternion[known], scalar_first=True)
    turned = Slerp(motion.t_s, Rotation.from_quat(motion.quaternion, scalar_first=True))(times)
    pivot = np.asarray(pivot_m, np.float64)
    nearest = trajectory.interval(times)
    index = nearest[0] + (nearest[1] > 0.5)
    columns = ("speed_mps", "motion", "fix", "sigma", "heading_from", "position_from", "height_from", "level_from")
    return replace(
        trajectory,
        t_s=times,
        xyz_m=poses.xyz_m[known] + vehicle.apply(pivot - turned.apply(pivot)),
        quaternion=same_hemisphere((vehicle * turned).as_quat(scalar_first=True)),
        **{name: getattr(trajectory, name)[index] for name in columns},
    )
