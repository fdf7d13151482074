"""A mounting whose angles change slowly during a flight, estimated from ground that is seen at several times.

Scans show the pose of the frame that carries the scanner: errors of the vehicle's pose and turns of the mounting about
the scanner's origin together. GNSS and IMU say how errors of the vehicle's poses go together, and a random walk how the
mounting's angles do; by both, what the scans show is divided. The walk is against its mean, which is the mounting.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from furrowmap.core.estimation.knots import POSE, ROTATION
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.trajectory.pose_errors import PoseErrors, without_errors
from furrowmap.core.values.trajectory import Trajectory


@dataclass(frozen=True)
class MountingWalk:
    """How the angles of a mounting change.

    Attributes:
        carrier: trajectory of the frame that carries the scanner: the vehicle's, turned with the mounting.
        t_s: (m,) times of the nodes.
        angle_deg: (m, 3) rotation vector about the vehicle's axes, against the mean mounting.
        sigma_deg: (m, 3) its standard deviations.
    """

    carrier: Trajectory
    t_s: FloatArray
    angle_deg: FloatArray
    sigma_deg: FloatArray

    def plain(self) -> dict[str, Any]:
        """For `report.json`."""
        return {
            "t_s": np.round(self.t_s, 3).tolist(),
            "angle_deg": np.round(self.angle_deg, 5).tolist(),
            "sigma_deg": np.round(self.sigma_deg, 5).tolist(),
        }


def attitudes_at(trajectory: Trajectory, t_s: FloatArray) -> FloatArray:
    """(m, 3, 3) vehicle to map at the knots beside some times (m,)."""
    nearest = np.minimum(np.searchsorted(trajectory.t_s, np.clip(t_s, *trajectory.span_s)), len(trajectory) - 1)
    out: FloatArray = Rotation.from_quat(trajectory.quaternion[nearest], scalar_first=True).as_matrix()
    return out


def with_walk(
    root: FloatArray, fixed: int, t_s: FloatArray, attitude: FloatArray, lever_m: FloatArray, walk_deg_rts: float
) -> FloatArray:
    """(fixed + 12 m, fixed + 9 m) root of the joint covariance of fixed unknowns, carrier's and vehicle's errors.

    Args:
        root: (fixed + 6 m, fixed + 6 m) of fixed unknowns and of the errors of the vehicle's poses.
        fixed: number of the former.
        t_s: (m,) times of the nodes.
        attitude: (m, 3, 3) vehicle to map at these.
        lever_m: (3,) scanner in the vehicle frame, about which the mounting turns.
        walk_deg_rts: random walk of each angle.
    """
    m = len(t_s)
    steps = np.radians(walk_deg_rts) * np.sqrt(np.diff(t_s, prepend=t_s[0]))
    walk = np.tril(np.broadcast_to(steps, (m, m)))
    walk = walk - walk.mean(axis=0)
    # A turn about the scanner's origin moves that of the vehicle frame.
    moved = np.cross((attitude @ lever_m)[:, :, None], attitude, axis=1)
    by_angle = np.concatenate([moved, attitude], axis=1)
    own = root[fixed:, fixed:]
    turns = np.einsum("iab,ij->iajb", by_angle, walk).reshape(len(own), 3 * m)
    out = np.zeros((fixed + 2 * len(own), fixed + len(own) + 3 * m))
    out[:fixed, :fixed] = root[:fixed, :fixed]
    columns = slice(fixed, fixed + len(own))
    out[columns, columns], out[columns, fixed + len(own) :] = own, turns
    out[fixed + len(own) :, columns] = own
    return out


def mounting_walk(
    trajectory: Trajectory, errors: PoseErrors, off: FloatArray, covariance: FloatArray, fixed: int
) -> MountingWalk:
    """What is found of the mounting's changes.

    Args:
        trajectory: of the vehicle, before the errors were found.
        errors: of its poses before.
        off: (fixed + 12 m,) the unknowns in the order of :func:`with_walk`.
        fixed: number of fixed unknowns.
    """
    m = len(errors.t_s)
    ends = (fixed, fixed + POSE * m, fixed + 2 * POSE * m)
    carrier, vehicle = (slice(a, b) for a, b in pairwise(ends))
    of_carrier = PoseErrors(errors.t_s, off[carrier].reshape(m, POSE), covariance[carrier, carrier])
    across = covariance[carrier, vehicle]
    spread = (of_carrier.covariance + covariance[vehicle, vehicle] - across - across.T).reshape(m, POSE, m, POSE)
    own = spread[np.arange(m), ROTATION:, np.arange(m), ROTATION:]
    attitude = attitudes_at(trajectory, errors.t_s)
    turned = (off[carrier] - off[vehicle]).reshape(m, POSE)[:, ROTATION:]
    # Errors are found minus true: the mounting has turned by their negative.
    angle = -np.einsum("iba,ib->ia", attitude, turned)
    variance = np.einsum("iba,ibc,ica->ia", attitude, own, attitude)
    return MountingWalk(
        without_errors(trajectory, errors, of_carrier),
        errors.t_s,
        np.degrees(angle),
        np.degrees(np.sqrt(np.maximum(variance, 0.0))),
    )
