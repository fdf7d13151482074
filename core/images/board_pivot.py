"""Attitudes of a board that turns about a point: all frames adjusted together.

A mount turns about its pivot, so that where the board is follows from how it is turned. Without that, tilt and place of
a board are nearly the same thing in an image that shows it from the front.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.images.projection import project
from furrowmap.core.values.camera import Camera

FloatArray = NDArray[np.float64]

ITERATIONS: Final = 12
STEP_M: Final = 1e-5
"""For slopes of the projection."""
FEWEST: Final = 4
"""Frames, with which a pivot is looked for."""
WORSE: Final = 1.3
"""Where corners fit so many times worse with a pivot than without one, there is none."""
PRIOR_M: Final = 10.0
"""Standard deviation of the pivot's place, for mounts that hardly turn."""


@dataclass(frozen=True)
class Turned:
    """Poses with a common pivot.

    Attributes:
        rotation: (n, 3, 3) board to optical frame.
        rms_px: (n,) root mean square of the corners' distances.
        sigma_deg: (n,) standard deviation of the attitude, the largest of the three axes.
    """

    rotation: FloatArray
    rms_px: FloatArray
    sigma_deg: FloatArray


def about_pivot(
    rotation: FloatArray, place_m: FloatArray, corners: FloatArray, points_m: FloatArray, camera: Camera
) -> Turned:
    """Gauss-Newton adjustment of all attitudes, of the pivot on the board's frame, and of it in the optical frame.

    A point X of the board is at ``R (X − q) + c``, with q and c the pivot in both frames, the same for all.

    Args:
        rotation: (n, 3, 3) board to optical frame, to begin with.
        place_m: (n, 3) the board's origin in the optical frame, to begin with.
        corners: (n, m, 2) pixels.
        points_m: (m, 3) corners of the board.
        camera: intrinsics.
    """
    count, turned = len(rotation), rotation.copy()
    design = np.concatenate([np.concatenate([np.eye(3), -turn], axis=1) for turn in turned])
    both = np.linalg.lstsq(
        np.concatenate([design, np.eye(6) / PRIOR_M]), np.concatenate([place_m.ravel(), np.zeros(6)]), rcond=None
    )[0]
    for _ in range(ITERATIONS):
        left, own, shared = _linear(turned, both, corners, points_m, camera)
        inner = np.linalg.inv(np.einsum("nkij,nkil->njl", own, own))
        cross = np.einsum("nkij,nkil->njl", own, shared)
        right = np.einsum("nkij,nki->nj", own, left)
        noise = float((left**2).mean())
        prior = np.eye(6) * noise / PRIOR_M**2
        normal = np.einsum("nkij,nkil->jl", shared, shared) + prior
        normal -= np.einsum("nji,njk,nkl->il", cross, inner, cross)
        sums = np.einsum("nkij,nki->j", shared, left) - prior @ both
        sums -= np.einsum("nji,njk,nk->i", cross, inner, right)
        step = np.linalg.solve(normal, sums)
        both = both + step
        turn = np.einsum("nij,nj->ni", inner, right - cross @ step)
        turned = Rotation.from_rotvec(turn).as_matrix() @ turned
    left, _, _ = _linear(turned, both, corners, points_m, camera)
    gain = inner @ cross
    covariance = inner + gain @ np.linalg.inv(normal) @ gain.transpose(0, 2, 1)
    noise = float((left**2).sum() / max(left.size - 3 * count - 6, 1))
    sigma = np.sqrt(noise * np.diagonal(covariance, axis1=1, axis2=2).max(axis=1))
    return Turned(turned, np.sqrt((left**2).sum(axis=2).mean(axis=1)), np.degrees(sigma))


def _linear(
    rotation: FloatArray, both: FloatArray, corners: FloatArray, points_m: FloatArray, camera: Camera
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals (n, m, 2), and slopes of the pixels by the turn (n, m, 2, 3) and by both places (n, m, 2, 6)."""
    arm = np.einsum("nij,mj->nmi", rotation, points_m - both[3:])
    at = arm + both[:3]
    pixels = project(camera, at.reshape(-1, 3)).reshape(corners.shape)
    slopes = np.stack(
        [
            (project(camera, (at + shift).reshape(-1, 3)).reshape(corners.shape) - pixels) / STEP_M
            for shift in STEP_M * np.eye(3)
        ],
        axis=-1,
    )
    own = np.cross(arm[:, :, None, :], slopes)  # the slope by a turn δ is (R (X − q)) × slope
    shared = np.concatenate([slopes, -np.einsum("nmij,njk->nmik", slopes, rotation)], axis=-1)
    return corners - pixels, own, shared
