"""The trajectory of an implement that follows a vehicle, mounted rigidly or drawn by a joint."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.rotation import attitude_to_quaternion
from furrowmap.core.values.sections import Link
from furrowmap.core.values.trajectory import Trajectory, same_hemisphere


def towed(trajectory: Trajectory, links: Sequence[Link]) -> Trajectory:
    """The trajectory of the last body of a train, level, with motion, speed and sigmas of the first.

    A drawn body has an axle at its origin that does not slip sideways: it follows a tractrix of its joint. After a gap,
    and at the beginning, it stands behind the body that draws it.
    """
    if not links:
        return trajectory
    q = trajectory.quaternion
    yaw = np.arctan2(2.0 * (q[:, 0] * q[:, 3] + q[:, 1] * q[:, 2]), 1.0 - 2.0 * (q[:, 2] ** 2 + q[:, 3] ** 2))
    place = trajectory.xyz_m[:, :2].copy()
    gap = np.append(True, np.diff(trajectory.t_s) > trajectory.max_gap_s)
    for link in links:
        x_m, y_m = link.joint_m
        cos = np.cos(yaw)
        sin = np.sin(yaw)
        place += np.column_stack([x_m * cos - y_m * sin, x_m * sin + y_m * cos])
        if link.drawbar_m > 0.0:
            yaw = _drawn_yaw(place, yaw, gap.tolist(), link.drawbar_m)
            place -= link.drawbar_m * np.column_stack([np.cos(yaw), np.sin(yaw)])
    heading_deg = 90.0 - np.degrees(yaw)
    zero = np.zeros(len(yaw))
    return replace(
        trajectory,
        xyz_m=np.column_stack([place, trajectory.xyz_m[:, 2]]),
        quaternion=same_hemisphere(attitude_to_quaternion(zero, zero, heading_deg)),
    )


def _drawn_yaw(joint_m: FloatArray, yaw: FloatArray, gap: Sequence[bool], drawbar_m: float) -> FloatArray:
    """Directions (n,) of a body whose joint moves along places (n, 2), straight from one to the next.

    Over a straight step of length s in the direction θ the body's direction φ turns by
    ``tan((φ′ − θ) / 2) = tan((φ − θ) / 2) exp(−s / L)``, the tractrix in closed form.
    """
    out = yaw.copy()
    step = np.diff(joint_m, axis=0)
    lengths_m = np.hypot(step[:, 0], step[:, 1]).tolist()
    directions = np.arctan2(step[:, 1], step[:, 0]).tolist()
    own = float(yaw[0])
    for k, (length_m, direction) in enumerate(zip(lengths_m, directions, strict=True), start=1):
        if gap[k]:
            own = float(yaw[k])
        elif length_m > 0.0:
            off = math.remainder(own - direction, 2.0 * math.pi)
            own = direction + 2.0 * math.atan(math.tan(0.5 * off) * math.exp(-length_m / drawbar_m))
        out[k] = own
    return out
