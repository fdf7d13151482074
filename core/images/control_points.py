"""Surveyed points in images: where they are seen, and which of that to trust."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.images.block_adjustment import AdjustedBlock, Block, Known, adjusted_poses, triangulated
from furrowmap.core.images.plates import plate_middle
from furrowmap.core.images.projection import inside, project
from furrowmap.core.images.ties import Ties
from furrowmap.core.readers.exif import read_pixels
from furrowmap.core.trajectory.pose_errors import PoseErrors
from furrowmap.core.values.images import ImageFile

FloatArray = NDArray[np.float64]

SIGMA_M: Final = 0.005
"""Standard deviation of a surveyed point whose table states none."""
PIXEL: Final = 0.15
"""Standard deviation of the middle of a plate in an image, pixels."""
SIGMAS: Final = 3.0
"""A plate is looked for within so many standard deviations of its place in the image."""
LEAST_REACH_PX: Final = 12.0
MOST_REACH_PX: Final = 250.0
LUMA: Final = np.array([0.299, 0.587, 0.114])
AGREEING_PX: Final = 3.0
"""Views of a point that are further from the others are of something else."""


@dataclass(frozen=True)
class ControlPoints:
    """Surveyed points.

    Attributes:
        name: (c,) of each.
        xyz_m: (c, 3) in the map frame.
        sigma_m: (c, 3) standard deviations; nan where none is stated.
        seen: image's file name, number of the point, column and row of views that are stated; empty where the points
            are looked for in the images.
    """

    name: tuple[str, ...]
    xyz_m: FloatArray
    sigma_m: FloatArray
    seen: tuple[tuple[str, int, float, float], ...] = ()


@dataclass(frozen=True)
class Views:
    """Views of surveyed points.

    Attributes:
        frame: (v,) number of the image.
        number: (v,) of the point.
        pixel: (v, 2) column and row.
    """

    frame: NDArray[np.int64]
    number: NDArray[np.int64]
    pixel: FloatArray


def control_views(
    points: ControlPoints, block: Block, adjusted: AdjustedBlock, paths: Sequence[ImageFile]
) -> tuple[Ties, Known] | None:
    """Views of surveyed points as ties, and what is known of these; None where no point is seen twice.

    Args:
        points: surveyed.
        block: the images.
        adjusted: by ties alone.
        paths: of the images.
    """
    views = _stated(points, paths) if points.seen else _found(points, block, adjusted, paths)
    order = np.lexsort((views.frame, views.number))
    views = Views(views.frame[order], views.number[order], views.pixel[order])
    kept, point = np.unique(views.number, return_inverse=True)
    ties = Ties(views.frame, point.astype(np.int64), views.pixel, np.full(len(views.frame), PIXEL))
    agreeing = _agreeing(block, adjusted, ties)
    chosen = ties.chosen(agreeing)
    if not len(chosen):
        return None
    seen = np.bincount(point[agreeing], minlength=len(kept))
    number = kept[seen >= 2]
    sigma = np.nan_to_num(points.sigma_m[number], nan=SIGMA_M)
    return chosen, Known(np.arange(len(number)), points.xyz_m[number], sigma, tuple(points.name[k] for k in number))


def _stated(points: ControlPoints, paths: Sequence[ImageFile]) -> Views:
    frames = {path.name: k for k, path in enumerate(paths)}
    rows = [(frames[name], k, u, v) for name, k, u, v in points.seen if name in frames]
    table = np.array(rows, np.float64).reshape(-1, 4)
    return Views(table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2:])


def _found(points: ControlPoints, block: Block, adjusted: AdjustedBlock, paths: Sequence[ImageFile]) -> Views:
    """Look for the plates where the adjusted poses expect them."""
    poses, camera = adjusted_poses(block, adjusted), adjusted.camera
    reach_m = SIGMAS * float(np.sqrt(_shift_variance(adjusted.found).max())) + SIGMAS * SIGMA_M
    rows = []
    for k, path in enumerate(paths):
        place = poses.in_frame(k, points.xyz_m)
        pixel = project(camera, place)
        with np.errstate(invalid="ignore"):
            near = np.flatnonzero(
                inside(camera, np.nan_to_num(pixel, nan=-1e9) * 0.9 + 0.05 * np.array([camera.width, camera.height]))
            )
        if not len(near):
            continue
        grey = _grey(path)
        if grey is None:
            continue
        for number in near.tolist():
            reach = np.clip(camera.fx * reach_m / place[number, 2], LEAST_REACH_PX, MOST_REACH_PX)
            middle = plate_middle(grey, pixel[number], float(reach))
            if middle is not None:
                rows.append((k, number, *middle.tolist()))
    table = np.array(rows, np.float64).reshape(-1, 4)
    return Views(table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2:])


def _shift_variance(found: PoseErrors) -> FloatArray:
    """(m, 3) variances of the places at the nodes."""
    variances: FloatArray = np.diag(found.covariance).reshape(-1, 6)[:, :3]
    return variances


def _grey(path: ImageFile) -> NDArray[np.uint8] | None:
    """Grey levels (rows, columns) of an image; None if it cannot be read."""
    try:
        pixels = read_pixels(path, 1)
    except ValueError:
        return None
    grey: NDArray[np.uint8] = np.round(pixels @ LUMA).astype(np.uint8)
    return grey


def _agreeing(block: Block, adjusted: AdjustedBlock, ties: Ties) -> NDArray[np.bool_]:
    """(o,) views that are where the other views of the same point expect it; those that disagree most go first."""
    kept = np.ones(len(ties), np.bool_)
    poses = adjusted_poses(block, adjusted)
    for number in range(ties.points):
        own = np.flatnonzero(ties.point == number)
        while len(own) >= 2:
            part = Ties(ties.frame[own], np.zeros(len(own), np.int64), ties.pixel[own], ties.sigma_px[own])
            place = triangulated(poses, adjusted.camera, part)
            off = np.array(
                [
                    np.linalg.norm(project(adjusted.camera, poses.in_frame(f, place))[0] - pixel)
                    for f, pixel in zip(part.frame.tolist(), part.pixel, strict=True)
                ]
            )
            worst = int(np.argmax(np.nan_to_num(off, nan=np.inf)))
            if off[worst] <= AGREEING_PX:
                break
            own = np.delete(own, worst)
        if len(own) < 2:
            own = own[:0]
        kept[ties.point == number] = False
        kept[own] = True
    return kept


def joined_views(ties: Ties, control: Ties, known: Known) -> tuple[Ties, Known]:
    """Ties with views of surveyed points behind them."""
    first = ties.points
    both = Ties(
        np.concatenate([ties.frame, control.frame]),
        np.concatenate([ties.point, control.point + first]),
        np.concatenate([ties.pixel, control.pixel]),
        np.concatenate([ties.sigma_px, control.sigma_px]),
    )
    return both, replace(known, point=known.point + first)
