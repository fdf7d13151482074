"""Surveyed points in images: where they are seen, and which of that to trust."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.images.block_adjustment import AdjustedBlock, ImageBlock, Known, adjusted_poses, triangulate
from furrowmap.core.images.pinhole import inside, project
from furrowmap.core.images.ties import Ties
from furrowmap.core.readers.image_pixels import read_pixels
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.images import ImageFile

RADII_PX: Final = (4, 6, 9)
"""Of the circles around a plate's middle on which black and white change four times."""
PLATE_SAMPLES: Final = 16
MIN_PLATE_SHARE: Final = 0.65
"""Of the grey levels' variance on a circle that has two periods a turn: 0.81 for four equal quadrants."""
MIN_PLATE_CONTRAST: Final = 35.0
"""Half the difference between white and black, in grey levels of 255."""
REFINED_PX: Final = 6
"""Half the width of the window in which the middle is refined."""


def plate_middle(grey: NDArray[np.uint8], expected: FloatArray, reach_px: float) -> FloatArray | None:
    """The middle of a plate of black and white quadrants; None if there is none.

    A plate must be wider than twice the largest of RADII_PX. Its middle is where grey levels on circles around it have
    two periods a turn; it is refined by the gradients around it (Förstner and Gülch 1987, as in OpenCV).

    Args:
        grey: (rows, columns).
        expected: (2,) column and row.
        reach_px: half the width of the window in which it is looked for.

    Returns:
        (2,) column and row; (0, 0) is the middle of the top left pixel.
    """
    import cv2

    margin = max(RADII_PX) + 1
    first = np.maximum(np.floor(expected - reach_px).astype(int), margin)
    last = np.minimum(np.ceil(expected + reach_px).astype(int), np.array(grey.shape[::-1]) - 1 - margin)
    if (last <= first).any():
        return None
    score = _score(grey.astype(np.float32), first, last)
    row, column = np.unravel_index(int(np.argmax(score)), score.shape)
    if score[row, column] <= 0.0:
        return None
    start = np.array([[first[0] + column, first[1] + row]], np.float32).reshape(-1, 1, 2)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 0.001)
    refined = cv2.cornerSubPix(np.ascontiguousarray(grey), start.copy(), (REFINED_PX, REFINED_PX), (-1, -1), stop)
    if float(np.abs(refined - start).max()) > REFINED_PX:
        return None
    out: FloatArray = refined.reshape(2).astype(np.float64)
    return out


def _score(grey: NDArray[np.float32], first: NDArray[np.int_], last: NDArray[np.int_]) -> FloatArray:
    """Contrast of the quadrants around each pixel of a window; 0 where there are none."""
    height = last[1] - first[1] + 1
    width = last[0] - first[0] + 1
    angle = 2.0 * np.pi * np.arange(PLATE_SAMPLES) / PLATE_SAMPLES
    turn = np.exp(-2j * angle).astype(np.complex64)
    out = np.full((height, width), np.inf)
    phases = []
    for radius in RADII_PX:
        steps = np.round(radius * np.column_stack([np.cos(angle), np.sin(angle)])).astype(int)
        ring = np.stack(
            [grey[first[1] + dy : first[1] + dy + height, first[0] + dx : first[0] + dx + width] for dx, dy in steps]
        )
        ring = ring - ring.mean(axis=0)
        power = (ring**2).mean(axis=0)
        twice = np.tensordot(turn, ring, axes=1) * (2.0 / PLATE_SAMPLES)
        share = 0.5 * np.abs(twice) ** 2 / np.maximum(power, 1e-6)
        clear = (share >= MIN_PLATE_SHARE) & (power >= MIN_PLATE_CONTRAST**2)
        out = np.minimum(out, np.where(clear, share * np.sqrt(power), 0.0))
        phases.append(twice)
    for other in phases[1:]:
        # The quadrants of all circles lie alike.
        out[(phases[0] * other.conj()).real < 0.5 * np.abs(phases[0] * other)] = 0.0
    return out


SIGMA_M: Final = 0.005
"""Standard deviation of a surveyed point whose table states none."""
PLATE_SIGMA_PX: Final = 0.15
"""Standard deviation of the middle of a plate in an image, pixels."""
CONTROL_SIGMAS: Final = 3.0
"""A plate is looked for within so many standard deviations of its place in the image."""
MIN_REACH_PX: Final = 12.0
MAX_REACH_PX: Final = 250.0
LUMA: Final = np.array([0.299, 0.587, 0.114])
MAX_DISAGREEMENT_PX: Final = 3.0
"""Views of a point that are further from the others are of something else."""


@dataclass(frozen=True)
class ControlPoints:
    """Surveyed points.

    Attributes:
        xyz_m: (c, 3) in the map frame.
        sigma_m: (c, 3) standard deviations; nan where none is stated.
        seen: image's file name, number of the point, column and row of views that are stated; empty where the points
            are looked for in the images.
    """

    name: tuple[str, ...]
    xyz_m: FloatArray
    sigma_m: FloatArray
    seen: tuple[tuple[str, int, float, float], ...] = ()


def control_views(
    points: ControlPoints, block: ImageBlock, adjusted: AdjustedBlock, paths: Sequence[ImageFile]
) -> tuple[Ties, Known] | None:
    """Views of surveyed points as ties, and what is known of these; None where no point is seen twice."""
    if points.seen:
        frames = {path.name: k for k, path in enumerate(paths)}
        views = [(frames[name], k, u, v) for name, k, u, v in points.seen if name in frames]
    else:
        views = _find_plates(points, block, adjusted, paths)
    table = np.array(views, np.float64).reshape(-1, 4)
    table = table[np.lexsort((table[:, 0], table[:, 1]))]
    kept, point = np.unique(table[:, 1].astype(np.int64), return_inverse=True)
    ties = Ties(table[:, 0].astype(np.int64), point.astype(np.int64), table[:, 2:], np.full(len(table), PLATE_SIGMA_PX))
    agreeing = _agreeing(block, adjusted, ties)
    chosen = ties.chosen(agreeing)
    if not len(chosen):
        return None
    seen = np.bincount(point[agreeing], minlength=len(kept))
    number = kept[seen >= 2]
    sigma = np.nan_to_num(points.sigma_m[number], nan=SIGMA_M)
    return chosen, Known(np.arange(len(number)), points.xyz_m[number], sigma, tuple(points.name[k] for k in number))


def _find_plates(
    points: ControlPoints, block: ImageBlock, adjusted: AdjustedBlock, paths: Sequence[ImageFile]
) -> list[tuple[int, int, float, float]]:
    """Number of the image, number of the point, column and row of the plates where the adjusted poses expect them."""
    poses = adjusted_poses(block, adjusted)
    camera = adjusted.camera
    variances: FloatArray = np.diag(adjusted.found.covariance).reshape(-1, 6)[:, :3]
    reach_m = CONTROL_SIGMAS * float(np.sqrt(variances.max())) + CONTROL_SIGMAS * SIGMA_M
    found = []
    for k, path in enumerate(paths):
        place = poses.in_frame(k, points.xyz_m)
        pixel = project(camera, place)
        with np.errstate(invalid="ignore"):
            near = np.flatnonzero(
                inside(camera, np.nan_to_num(pixel, nan=-1e9) * 0.9 + 0.05 * np.array([camera.width, camera.height]))
            )
        if not len(near):
            continue
        try:
            grey: NDArray[np.uint8] = np.round(read_pixels(path, 1) @ LUMA).astype(np.uint8)
        except ValueError:
            continue
        for number in near.tolist():
            reach = np.clip(camera.fx * reach_m / place[number, 2], MIN_REACH_PX, MAX_REACH_PX)
            middle = plate_middle(grey, pixel[number], float(reach))
            if middle is not None:
                found.append((k, number, float(middle[0]), float(middle[1])))
    return found


def _agreeing(block: ImageBlock, adjusted: AdjustedBlock, ties: Ties) -> NDArray[np.bool_]:
    """(o,) views that are where the other views of the same point expect it; those that disagree most go first."""
    kept = np.ones(len(ties), np.bool_)
    poses = adjusted_poses(block, adjusted)
    for number in range(ties.points):
        own = np.flatnonzero(ties.point == number)
        while len(own) >= 2:
            part = Ties(ties.frame[own], np.zeros(len(own), np.int64), ties.pixel[own], ties.sigma_px[own])
            place = triangulate(poses, adjusted.camera, part)
            off = np.array(
                [
                    np.linalg.norm(project(adjusted.camera, poses.in_frame(f, place))[0] - pixel)
                    for f, pixel in zip(part.frame.tolist(), part.pixel, strict=True)
                ]
            )
            worst = int(np.argmax(np.nan_to_num(off, nan=np.inf)))
            if off[worst] <= MAX_DISAGREEMENT_PX:
                break
            own = np.delete(own, worst)
        if len(own) < 2:
            own = own[:0]
        kept[ties.point == number] = False
        kept[own] = True
    return kept


def join_views(ties: Ties, control: Ties, known: Known) -> tuple[Ties, Known]:
    """Ties with views of surveyed points behind them."""
    first = ties.points
    both = Ties(
        np.concatenate([ties.frame, control.frame]),
        np.concatenate([ties.point, control.point + first]),
        np.concatenate([ties.pixel, control.pixel]),
        np.concatenate([ties.sigma_px, control.sigma_px]),
    )
    return both, replace(known, point=known.point + first)
