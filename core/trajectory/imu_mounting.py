"""Whether an IMU is mounted as stated: vehicles are upright, and most of the time move forward.

The first guess of the attitude assumes neither, so an IMU that is turned by 90° or 180° against its stated mounting
turns the whole vehicle: on its side, upside down, or across its course.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.mounting import Mounting
from furrowmap.core.values.rotation import quaternion_to_matrix
from furrowmap.core.values.trajectory import Trajectory

FloatArray = NDArray[np.float64]

MOVING_MPS: Final = 0.5
LEAST_MOVING_S: Final = 5.0
STEADY: Final = 0.9
"""Length of the mean course, a vector of length 1: beyond it the course hardly turns, less than 25° to both sides."""
NEAR_DEG: Final = 25.0
"""A mean attitude so near to a quarter turn is one."""
_QUARTERS: Final = Rotation.create_group("O")
"""The 24 turns by quarters about the axes."""


def check_mounting(trajectory: Trajectory, mounting: Mounting, name: str, *, on_wheels: bool) -> list[Notice]:
    """Compare the attitude of the vehicle with upright and with its course.

    A drone may fly sideways or backwards. That its nose belongs along its course shows only where the course turns
    and the nose turns with it; that a vehicle on wheels moves along its nose needs no showing.

    Args:
        trajectory: of the vehicle, with attitudes by the IMU.
        mounting: of the IMU, as stated.
        name: of the IMU, for messages.
        on_wheels: whether the vehicle is.

    Raises:
        InputError: if the vehicle would be on its side or upside down.
    """
    turned = quaternion_to_matrix(trajectory.quaternion)
    step_s = np.diff(trajectory.t_s, append=trajectory.t_s[-1])
    velocity = np.gradient(trajectory.xyz_m[:, :2], trajectory.t_s, axis=0) if len(trajectory) > 2 else turned[:, :2, 0]
    speed = np.hypot(*velocity.T)
    moving = (speed > MOVING_MPS) & (step_s < trajectory.max_gap_s)
    if step_s[moving].sum() < LEAST_MOVING_S:
        return _tilted(turned, mounting, name)
    along = np.zeros((int(moving.sum()), 3))
    along[:, :2] = velocity[moving] / speed[moving, None]
    course = np.stack(
        [along, np.column_stack([-along[:, 1], along[:, 0], 0 * along[:, 0]]), 0 * along + (0, 0, 1)], axis=2
    )
    mean = _mean(np.einsum("kji,kjl->kil", course, turned[moving]), step_s[moving])
    if mean is None:
        return _tilted(turned, mounting, name)
    nearest = _QUARTERS[int(np.argmin((_QUARTERS.inv() * mean).magnitude()))]
    off_deg = float(np.degrees((nearest.inv() * mean).magnitude()))
    if off_deg > NEAR_DEG or nearest.magnitude() < 0.1:
        return _tilted(turned, mounting, name)
    right = Mounting.from_rotation(mounting.xyz_m, nearest.as_matrix() @ mounting.rotation)
    if nearest.as_matrix()[2, 2] < 0.5:
        raise InputError("imu-turned.forward", name=name, right=_words(right))
    steadiness = float(np.hypot(*(step_s[moving] @ along[:, :2])) / step_s[moving].sum())
    if not on_wheels and steadiness > STEADY:
        return []
    yaw_deg = float(np.degrees(np.arctan2(*nearest.as_matrix()[[1, 0], 0])))
    return [Notice("imu-turned", name=name, yaw_deg=abs(yaw_deg), right=_words(right))]


def _mean(relative: FloatArray, weight: FloatArray) -> Rotation | None:
    """The mean rotation (n, 3, 3); None where they differ too much to have one."""
    left, size, right = np.linalg.svd(np.einsum("k,kij->ij", weight, relative) / weight.sum())
    if size[1] < 0.7:
        return None
    return Rotation.from_matrix(left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right)


def _tilted(turned: FloatArray, mounting: Mounting, name: str) -> list[Notice]:
    """The check of the tilt alone, for a vehicle that shows no course."""
    up = turned[:, 2, :].mean(axis=0)  # the map's up in the vehicle frame
    axis = int(np.argmax(np.abs(up)))
    if np.linalg.norm(up) < 0.7 or (axis == 2 and up[2] > 0):
        return []
    from_up, to_up = np.eye(3)[axis] * np.sign(up[axis]), np.array([0.0, 0.0, 1.0])
    across = np.cross(from_up, to_up)
    turn = Rotation.from_rotvec(across * 0.5 * np.pi if axis != 2 else [np.pi, 0.0, 0.0])
    right = Mounting.from_rotation(mounting.xyz_m, turn.as_matrix() @ mounting.rotation)
    raise InputError("imu-turned.upright", name=name, right=_words(right))


def _words(mounting: Mounting) -> str:
    angles = (180.0 - (180.0 - angle) % 360.0 + 0.0 for angle in np.round(mounting.rpy_deg, 1).tolist())
    return f"[{', '.join(f'{angle:.1f}' for angle in angles)}]"
