"""Points that are seen in several images."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from furrowmap.core.images.image_frames import FramePoses
from furrowmap.core.images.pinhole import inside, project, unproject
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.values.camera import Camera

OVERLAP_GRID: Final = (9, 7)
"""Pixels of an image, in columns and rows, that are looked for in another one."""
MIN_OVERLAP: Final = 0.1
MAX_NEIGHBOURS: Final = 10
"""Other images with which one is matched: those that show most of the same."""


def overlapping(poses: FramePoses, camera: Camera, depth_m: float) -> list[tuple[int, int]]:
    """Pairs of images that see the same of a surface at a depth along the view, by poses that need not be exact."""
    columns, rows = (np.linspace(0.0, size - 1.0, cells) for size, cells in zip(
        (camera.width, camera.height), OVERLAP_GRID, strict=True
    ))  # fmt: skip
    corners = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    rays = unproject(camera, corners)
    rays = rays[np.isfinite(rays[:, 0])] * depth_m
    stretch = np.array([poses.scale, poses.scale, 1.0])
    middle = poses.xyz_m + stretch * (poses.rotation[:, :, 2] * depth_m)
    reach = 2.0 * float(np.linalg.norm(rays[:, :2], axis=1).max())
    near = cKDTree(middle).query_pairs(reach, output_type="ndarray")
    shares = np.array([inside(camera, seen_in(poses, camera, a, b, rays)).mean() for a, b in near.tolist()])
    kept = shares >= MIN_OVERLAP
    return _best_pairs(near[kept], shares[kept], len(poses))


def seen_in(poses: FramePoses, camera: Camera, a: int, b: int, points_m: FloatArray) -> FloatArray:
    """Pixels (n, 2) in image b, nan where there are none, of points (n, 3) in the optical frame of image a."""
    offset = np.array([poses.scale, poses.scale, 1.0]) * (points_m @ poses.rotation[a].T)
    return project(camera, poses.in_frame(b, poses.xyz_m[a] + offset))


def _best_pairs(pairs: NDArray[np.intp], shares: FloatArray, count: int) -> list[tuple[int, int]]:
    """The pairs that are among the MOST of either image."""
    met = np.zeros(count, np.int64)
    out = []
    for a, b in pairs[np.argsort(-shares, kind="stable")].tolist():
        if met[a] < MAX_NEIGHBOURS or met[b] < MAX_NEIGHBOURS:
            met[a] += 1
            met[b] += 1
            out.append((min(a, b), max(a, b)))
    return sorted(out)


TIE_GRID: Final = (12, 9)
"""Cells of an image over which ties are spread, in columns and rows."""
MAX_TIES_PER_CELL: Final = 3
"""Points of a cell that are enough: more add little, as their errors go together."""


@dataclass(frozen=True)
class Ties:
    """Observations of points in images, those of a point one after another.

    Attributes:
        frame: (o,) number of the image.
        point: (o,) number of the point, not decreasing, without gaps.
        pixel: (o, 2) column and row; (0, 0) is the middle of the top left pixel.
        sigma_px: (o,) standard deviations of column and row.
    """

    frame: IntArray
    point: IntArray
    pixel: FloatArray
    sigma_px: FloatArray

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def points(self) -> int:
        """Number of points."""
        return int(self.point[-1]) + 1 if len(self.point) else 0

    def chosen(self, which: NDArray[np.bool_]) -> "Ties":
        """Some of the observations (o,), of points that are still seen at least twice."""
        seen = np.bincount(self.point[which], minlength=self.points)
        keep = which & (seen[self.point] >= 2)
        _, point = np.unique(self.point[keep], return_inverse=True)
        return Ties(self.frame[keep], point.astype(np.int64), self.pixel[keep], self.sigma_px[keep])


def tracks(keypoints: Mapping[int, FloatArray], matches: Mapping[tuple[int, int], IntArray]) -> Ties:
    """The points that matched keypoints of several images belong to.

    What is linked by matches is one point. A point that would be seen at two places of one image is left out: one of
    its matches is wrong. `keypoints` (k, 3) are column, row and standard deviation of both by image; `matches` (m, 2)
    numbers of keypoints, by two images.
    """
    frames = sorted(keypoints)
    first = dict(zip(frames, np.cumsum([0, *(len(keypoints[f]) for f in frames)])[:-1].tolist(), strict=True))
    if not matches:
        none = np.zeros(0, np.int64)
        return Ties(none, none, np.zeros((0, 2)), np.zeros(0))
    links = np.concatenate([m + np.array([first[a], first[b]]) for (a, b), m in matches.items()]).astype(np.int64)
    owner = np.repeat(np.array(frames, np.int64), [len(keypoints[f]) for f in frames])
    root = _roots(links, len(owner))
    used = np.flatnonzero(np.bincount(root, minlength=len(owner))[root] >= 2)
    order = used[np.lexsort((owner[used], root[used]))]
    twice = np.flatnonzero((np.diff(root[order]) == 0) & (np.diff(owner[order]) == 0))
    order = order[~np.isin(root[order], root[order][twice])]
    _, point = np.unique(root[order], return_inverse=True)
    seen = np.concatenate([keypoints[f] for f in frames])[order]
    return Ties(owner[order], point.astype(np.int64), np.ascontiguousarray(seen[:, :2]), seen[:, 2].copy())


def thin_ties(ties: Ties, size: tuple[int, int]) -> Ties:
    """Ties spread evenly over the images: of each cell the points that most images show, the sharpest of these."""
    views = np.bincount(ties.point, minlength=ties.points)
    blur = np.bincount(ties.point, ties.sigma_px, minlength=ties.points) / views
    order = np.lexsort((blur, -views))
    begin = np.searchsorted(ties.point, np.arange(ties.points + 1))
    place = np.clip((ties.pixel / np.array(size) * TIE_GRID).astype(np.int64), 0, np.array(TIE_GRID) - 1)
    cell = (ties.frame * TIE_GRID[0] + place[:, 0]) * TIE_GRID[1] + place[:, 1]
    return ties.chosen(_spread(order, begin, cell, MAX_TIES_PER_CELL)[ties.point])


@kernel()
def _spread(order, begin, cell, most):  # type: ignore[no-untyped-def]
    """Which points are taken: each that is among the first `most` of any of the cells where it is seen."""
    taken = np.zeros(len(order), np.bool_)
    filled = np.zeros(cell.max() + 1 if len(cell) else 1, np.int64)
    for p in order:
        for o in range(begin[p], begin[p + 1]):
            taken[p] |= filled[cell[o]] < most
        if taken[p]:
            for o in range(begin[p], begin[p + 1]):
                filled[cell[o]] += 1
    return taken


@kernel()
def _roots(links, count):  # type: ignore[no-untyped-def]
    """Root of each of some things (count,) that links (m, 2) join: union-find with path halving."""
    root = np.arange(count)
    for k in range(len(links)):
        a = links[k, 0]
        b = links[k, 1]
        while root[a] != a:
            root[a] = root[root[a]]
            a = root[a]
        while root[b] != b:
            root[b] = root[root[b]]
            b = root[b]
        if a != b:
            root[max(a, b)] = min(a, b)
    for k in range(count):
        a = k
        while root[a] != a:
            a = root[a]
        root[k] = a
    return root
