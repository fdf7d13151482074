"""Which images show the same ground."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from furrowmap.core.images.frame_poses import FramePoses
from furrowmap.core.images.projection import inside, project, unproject
from furrowmap.core.values.camera import Camera

FloatArray = NDArray[np.float64]

GRID: Final = (9, 7)
"""Pixels of an image, in columns and rows, that are looked for in another one."""
LEAST_OVERLAP: Final = 0.1
MOST: Final = 10
"""Other images with which one is matched: those that show most of the same."""


def overlapping(poses: FramePoses, camera: Camera, depth_m: float) -> list[tuple[int, int]]:
    """Pairs of images that see the same of a surface at a depth, by poses that need not be exact.

    Args:
        poses: of all images.
        camera: that took them.
        depth_m: of the surface along the view.
    """
    columns, rows = (np.linspace(0.0, size - 1.0, cells) for size, cells in zip(
        (camera.width, camera.height), GRID, strict=True
    ))  # fmt: skip
    corners = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    rays = unproject(camera, corners)
    rays = rays[np.isfinite(rays[:, 0])] * depth_m
    stretch = np.array([poses.scale, poses.scale, 1.0])
    middle = poses.xyz_m + stretch * (poses.rotation[:, :, 2] * depth_m)
    reach = 2.0 * float(np.linalg.norm(rays[:, :2], axis=1).max())
    near = cKDTree(middle).query_pairs(reach, output_type="ndarray")
    shares = np.empty(len(near))
    for k, (a, b) in enumerate(near.tolist()):
        ground = poses.xyz_m[a] + stretch * (rays @ poses.rotation[a].T)
        seen = project(camera, poses.in_frame(b, ground))
        shares[k] = inside(camera, np.nan_to_num(seen, nan=-1.0)).mean()
    kept = shares >= LEAST_OVERLAP
    return _most_shared(near[kept], shares[kept], len(poses))


def _most_shared(pairs: NDArray[np.intp], shares: FloatArray, count: int) -> list[tuple[int, int]]:
    """The pairs that are among the MOST of either image."""
    met, out = np.zeros(count, np.int64), []
    for a, b in pairs[np.argsort(-shares, kind="stable")].tolist():
        if met[a] < MOST or met[b] < MOST:
            met[a] += 1
            met[b] += 1
            out.append((min(a, b), max(a, b)))
    return sorted(out)
