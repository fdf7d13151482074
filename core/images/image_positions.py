"""Positions of images with standard deviations, as drones with RTK write them, beside a trajectory.

They are compared with the places of the camera along the trajectory. Where they are clearly more accurate than these,
and both agree within what is known of them, they are observations of the poses: a linear update of the joint covariance
of the errors of the poses (Kalman; in the form of Joseph, which stays positive). Else they are only a check. Positions
of one receiver err alike from image to image, so that their mean counts for little more than one of them; and the delay
of the shutter, which shifts all of them along the way, is an unknown.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.knots import POSE
from furrowmap.core.adjustment.preintegration import cross_matrix
from furrowmap.core.images.image_frames import frame_poses
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.trajectory.located import Located
from furrowmap.core.trajectory.pose_errors import PoseErrors, without_errors
from furrowmap.core.values.camera import Camera
from furrowmap.core.values.images import Images
from furrowmap.core.values.trajectory import Trajectory

ALIKE_SHARE: Final = 0.5
"""Share of the variance of the positions that all of them have in common."""
TIME_SIGMA_S: Final = 0.05
"""Of the times of all exposures, before they are compared."""
BETTER_SHARE: Final = 0.7
"""Positions are used where their standard deviations are less than this share of the trajectory's."""
MAX_OFF_SIGMAS: Final = 4.0
"""Mean differences beyond are a contradiction."""
MOST_POSITIONS: Final = 800
_VELOCITY_STEP_S: Final = 0.05


@dataclass(frozen=True)
class _Compared:
    """Positions (n, 3) of images minus the camera's places along the trajectory, and what is known of both.

    Attributes:
        design: (3 n, 6 m) derivatives of the places by the errors of the poses at the nodes.
        noise: (3 n, 3 n) covariance of the positions and of the times.
        sigma_m: (n, 3) of the positions.
        velocity_mps: (n, 3) in the map.
    """

    off_m: FloatArray
    design: FloatArray
    noise: FloatArray
    sigma_m: FloatArray
    velocity_mps: FloatArray


def held_against_images(
    located: Located, images: Images, camera: Camera, placed_m: FloatArray, scale: float
) -> tuple[Located, list[Notice]]:
    """The trajectory with the positions of images, where they make it better; as it was where not; what was found.

    `placed_m` (n, 3) are these positions on the map, nan where there is none.
    """
    known = np.isfinite(placed_m).all(axis=1) & np.isfinite(images.sigma_m).all(axis=1)
    begin_s, end_s = located.trajectory.span_s
    exposed_s = images.t_s + camera.shutter_delay_s
    known &= (exposed_s > begin_s + _VELOCITY_STEP_S) & (exposed_s < end_s - _VELOCITY_STEP_S)
    known &= np.isfinite(frame_poses(located.trajectory, camera, images.t_s, scale).xyz_m[:, 0])
    chosen = np.flatnonzero(known)
    if len(chosen) < 2 or located.pose_errors is None:
        return located, []
    count = len(chosen)
    chosen = chosen[np.unique(np.linspace(0, count - 1, min(count, MOST_POSITIONS)).astype(np.int64))]
    own = images.chosen(chosen)
    errors = located.pose_errors(own.t_s + camera.shutter_delay_s)
    found = _compared(located.trajectory, errors, own, camera, placed_m[chosen], scale)
    spread = found.design @ errors.covariance @ found.design.T
    mean_m = found.off_m.mean(axis=0)
    n = len(own)
    share = np.kron(np.full((1, n), 1.0 / n), np.eye(3))
    mean_sigma_m = np.sqrt(np.diag(share @ (spread + found.noise) @ share.T))
    poses_sigma_m = np.sqrt(np.diag(spread)).reshape(-1, 3)
    across, up = (0, 1), (2,)
    figures = {
        "images": count,
        "count": len(images),
        "sigma_m": float(np.median(found.sigma_m)),
        "across_m": float(np.hypot(*mean_m[:2])),
        "up_m": float(mean_m[2]),
    }
    if (np.abs(mean_m) > MAX_OFF_SIGMAS * mean_sigma_m).any():
        late_s = _late_s(found)
        along = {"is_time": late_s is not None, "late_s": late_s or 0.0}
        return located, [Notice("images-placed.contradict", **figures, **along)]
    better = [
        float(np.median(found.sigma_m[:, axes])) < BETTER_SHARE * float(np.median(poses_sigma_m[:, axes]))
        for axes in (across, up)
    ]
    if not any(better):
        return located, [Notice("images-placed", **figures)]
    after = _updated(errors, found, spread)
    trajectory = without_errors(located.trajectory, errors, after)
    left = PoseErrors(after.t_s, np.zeros_like(after.value), after.covariance)
    kept = tuple(notice for notice in located.notices if notice.code != "gnss-quality")
    used = replace(located, trajectory=trajectory, notices=kept, pose_errors=lambda _: left)
    now_m = float(np.median(np.sqrt(np.diag(found.design @ after.covariance @ found.design.T))))
    before_m = float(np.median(poses_sigma_m))
    return used, [Notice("images-placed.used", **figures, before_m=before_m, after_m=now_m)]


def _compared(
    trajectory: Trajectory, errors: PoseErrors, images: Images, camera: Camera, placed_m: FloatArray, scale: float
) -> _Compared:
    n = len(images)
    poses = frame_poses(trajectory, camera, images.t_s, scale)
    early, late = (trajectory.at(poses.t_s + step).xyz_m for step in (-_VELOCITY_STEP_S, _VELOCITY_STEP_S))
    velocity = np.nan_to_num((late - early) / (2.0 * _VELOCITY_STEP_S))
    node = np.clip(np.searchsorted(errors.t_s, poses.t_s, side="right") - 1, 0, len(errors.t_s) - 2)
    share = np.clip((poses.t_s - errors.t_s[node]) / (errors.t_s[node + 1] - errors.t_s[node]), 0.0, 1.0)
    turn = Rotation.from_quat(trajectory.at(poses.t_s).quaternion, scalar_first=True).as_matrix()
    lever = turn @ np.asarray(camera.xyz_m)
    one = np.concatenate([np.tile(np.eye(3), (n, 1, 1)), -cross_matrix(lever)], axis=2)
    design = np.zeros((n, 3, len(errors.t_s), POSE))
    rows = np.arange(n)
    design[rows, :, node] = (1.0 - share)[:, None, None] * one
    design[rows, :, node + 1] += share[:, None, None] * one
    stretch = np.array([scale, scale, 1.0])
    sigma = images.sigma_m * stretch
    noise = (1.0 - ALIKE_SHARE) * np.diag(sigma.ravel() ** 2)
    for axis in np.eye(3):
        alike = np.sqrt(ALIKE_SHARE) * (sigma * axis).ravel()
        noise += np.outer(alike, alike)
    timed = TIME_SIGMA_S * velocity.ravel()
    noise += np.outer(timed, timed)
    return _Compared(placed_m - poses.xyz_m, design.reshape(3 * n, -1), noise, sigma, velocity)


def _updated(errors: PoseErrors, found: _Compared, spread: FloatArray) -> PoseErrors:
    """The errors of the poses as the positions show them, and what is left of their covariance."""
    gain = np.linalg.solve(spread + found.noise, found.design @ errors.covariance).T
    # Errors are found minus true, the differences are true minus found.
    value = -(gain @ found.off_m.ravel()).reshape(-1, POSE)
    left = np.eye(len(errors.covariance)) - gain @ found.design
    covariance = left @ errors.covariance @ left.T + gain @ found.noise @ gain.T
    return PoseErrors(errors.t_s, value, 0.5 * (covariance + covariance.T))


def _late_s(found: _Compared) -> float | None:
    """By how much the images' times are too early, where the differences lie along the way and nothing else."""
    square = float((found.velocity_mps**2).sum())
    if square <= 0.0:
        return None
    late_s = float((found.off_m * found.velocity_mps).sum()) / square
    rest = found.off_m - late_s * found.velocity_mps
    return late_s if np.abs(rest.mean(axis=0)).max() < 0.2 * np.abs(found.off_m).mean(axis=0).max() else None
