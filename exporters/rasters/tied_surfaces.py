"""The surfaces of several dates as their ties move them, and the changes between them, on one grid."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS
from scipy.ndimage import uniform_filter
from shapely.geometry.base import BaseGeometry

from furrowmap.core.dates.ground_pair import GroundPair
from furrowmap.core.runtime.arrays import Float32Array, FloatArray
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.moved_surface import move_surface, reach_cells
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters.cog import CHANGE_BANDS, HEIGHT_BAND, STANDARD_ERROR_BAND, cog_output
from furrowmap.exporters.rasters.dated_surface import (
    ERROR_INDEX,
    RETURNS_INDEX,
    SPREAD_INDEX,
    OpenSurface,
    cells_inside,
)
from furrowmap.exporters.rasters.windows import shared_cells, windows

PIECE_CELLS: Final = 500
"""Side of the pieces of ground that ties are made of: 25 m, a whole number of patches."""
MAX_PIECES: Final = 64
"""Four hectares show a tie as well as forty do."""
HIDDEN_SHARE: Final = 0.04
"""Tops of clods are seen more than what lies between: heights are off by this share of the relief within cells."""
SHADOW_DEPTH: Final = 0.9
"""Cells in the shadow of relief lie below those in view by this share of its standard deviation, ± half of that."""
SHADOW_STEP: Final = 5
"""Cells over which second differences of height show relief, without slopes."""
VIEW_CELLS: Final = 21
MIN_VIEW_SHARE: Final = 0.3
"""A cell without a height lies in a shadow where more of the cells in a square of a metre have one."""


def ground_pairs(one: OpenSurface, other: OpenSurface, touched: BaseGeometry) -> Iterator[GroundPair]:
    """The ground that two dates have in common, where no tool touched it, in pieces; some where there are many."""
    shared = shared_cells(one.grid, other.grid)
    if shared is None:
        return
    corners = [
        (row, column) for row in range(0, shared.rows, PIECE_CELLS) for column in range(0, shared.columns, PIECE_CELLS)
    ]
    tried = np.linspace(0, len(corners) - 1, min(len(corners), 2 * MAX_PIECES)).round().astype(np.intp).tolist()
    if len(corners) > MAX_PIECES:
        tried = [*tried[::2], *tried[1::2]]  # evenly chosen ones, then those between them
    count = 0
    for row, column in (corners[k] for k in tried):
        shape = min(PIECE_CELLS, shared.rows - row), min(PIECE_CELLS, shared.columns - column)
        piece = Grid(shared.cell_m, shared.west + column, shared.north - row, shape)
        first, second = one.read(piece), other.read(piece)
        off = cells_inside(touched, piece, touched=True)
        first[off] = second[off] = np.nan
        if (np.isfinite(first) & np.isfinite(second)).any() and count < MAX_PIECES:
            west, _, _, north = piece.bounds_m
            count += 1
            yield GroundPair(west, north, piece.cell_m, first, second)


@dataclass(frozen=True)
class Mover:
    """A surface with its move (6,) about `middle_m` (2,)."""

    surface: OpenSurface
    move: FloatArray
    middle_m: FloatArray

    def heights(self, part: Grid) -> Float32Array:
        """Moved heights of cells."""
        margin = reach_cells(self.move, self.surface.grid, self.middle_m)
        around = Grid(
            part.cell_m, part.west - margin, part.north + margin, (part.rows + 2 * margin, part.columns + 2 * margin)
        )
        return move_surface(self.surface.read(around), around, part, self.move, self.middle_m)


def write_moved(path: Path, mover: Mover, grid: Grid, crs: CRS, origin: Origin) -> None:
    """Write a surface as its tie moves it: height and standard error."""
    with cog_output(path, grid, crs, (HEIGHT_BAND, STANDARD_ERROR_BAND), origin) as put:
        for part, _ in windows(grid, 0):
            put(part, (mover.heights(part), mover.surface.read(part, ERROR_INDEX)))


@dataclass(frozen=True)
class ChangeFigures:
    """The change between two dates.

    Attributes:
        worked_m2: ground that a tool worked between them.
        compared_m2: of that, what both dates saw.
        mean_m: mean change of that, upward positive, with what lay in shadows on the first date; nan where nothing was
            compared.
        noise_m: standard deviation of the mean by the noise of the cells.
        unseen_m: standard deviation of the mean of all worked ground by what was not seen on both dates.
        shadow_share: of the worked ground in view on the first date, what lay in shadows of relief.
        hidden_m: standard deviation of the mean by what is hidden within the cells that were seen.
        places_m: (n, 2) some cells compared, evenly chosen.
        untouched_m: (k,) changes of some cells that no tool touched.
    """

    worked_m2: float
    compared_m2: float
    mean_m: float
    noise_m: float
    unseen_m: float
    shadow_share: float
    hidden_m: float
    places_m: FloatArray
    untouched_m: FloatArray


@dataclass(frozen=True)
class ChangedGround:
    """Ground by what tools did to it.

    Attributes:
        worked: between two dates.
        before: on the first of them or earlier; of the worked ground, what lies in it was worked again.
        touched: on either date or between them, with a margin.
    """

    worked: BaseGeometry
    before: BaseGeometry
    touched: BaseGeometry


def write_change(
    path: Path, pair: tuple[Mover, Mover], ground: ChangedGround, crs: CRS, origin: Origin
) -> ChangeFigures | None:
    """Write the change between two dates where both saw the ground; None where they share no cell.

    Ground worked for the first time rises by centimetres, ground worked again hardly, and is better seen, as it lies
    where the earlier drive was. So the mean is that of each kind, weighted by its area (post-stratification).
    """
    one, other = pair
    grid = shared_cells(one.surface.grid, other.surface.grid)
    if grid is None:
        return None
    sums, places, calm = np.zeros((2, 12)), [np.zeros((0, 2))], [np.zeros(0, np.float32)]
    with cog_output(path, grid, crs, CHANGE_BANDS, origin) as put:
        for part, _ in windows(grid, 0):
            first = one.heights(part)
            change = other.heights(part) - first
            error = np.hypot(other.surface.read(part, ERROR_INDEX), one.surface.read(part, ERROR_INDEX))
            put(part, (change, np.where(np.isfinite(change), error, np.float32(np.nan))))
            relief = np.hypot(other.surface.read(part, SPREAD_INDEX), one.surface.read(part, SPREAD_INDEX))
            now, again = (
                cells_inside(ground.worked, part, touched=False),
                cells_inside(ground.before, part, touched=False),
            )
            for kind, of_kind in zip(sums, (now & ~again, now & again), strict=True):
                seen = of_kind & np.isfinite(change)
                moved_m, noise = change[seen].astype(np.float64), error[seen].astype(np.float64)
                kind[:5] += of_kind.sum(), len(moved_m), moved_m.sum(), (moved_m**2).sum(), np.nansum(noise**2)
                kind[5] += np.nansum(relief[seen].astype(np.float64) ** 2)
                kind[6:] += _shadow_sums(first, one.surface.read(part, RETURNS_INDEX), of_kind)
            places.append(part.positions_m()[(now & np.isfinite(change)).ravel()][::20])
            still = np.isfinite(change) & ~cells_inside(ground.touched, part, touched=True)
            calm.append(change[still][::5])
    still_m = np.concatenate(calm).astype(np.float64)
    return ChangeFigures(*_weight_by_kind(sums, grid.cell_area_m2), np.concatenate(places), still_m)


def _shadow_sums(height_m: Float32Array, returns: Float32Array, of_kind: NDArray[np.bool_]) -> FloatArray:
    """Sums (6,) over the cells of a kind, for :func:`_shadows`.

    Cells with a height, without one in view, of one return, of two, second differences of height, and their squares.
    """
    known = np.isfinite(height_m)
    in_view = uniform_filter(known.astype(np.float32), VIEW_CELLS, mode="nearest") > MIN_VIEW_SHARE
    sums = [np.count_nonzero(of_kind & a) for a in (known, in_view & ~known, returns == 1.0, returns == 2.0)]
    bend = [np.zeros(0)]
    for h, kind in ((height_m, of_kind), (height_m.T, of_kind.T)):
        middle = slice(SHADOW_STEP, -SHADOW_STEP)
        bend.append((h[2 * SHADOW_STEP :] + h[: -2 * SHADOW_STEP] - np.float32(2.0) * h[middle])[kind[middle]])
    bends = np.concatenate(bend)
    return np.array([*sums, np.isfinite(bends).sum(), np.nansum(bends**2)], np.float64)


def _shadows(sums: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The share of cells in view that lay in shadows of relief, by kind, and how much lower it makes the mean, in m.

    Of the cells without a height, those that chance left without a return are estimated by the numbers of cells with
    one and with two (Chao 1984, Nonparametric estimation of the number of classes in a population).

    Args:
        sums: (kinds, 6) of :func:`_shadow_sums`.
    """
    known, unseen, one, two, bends, bend = sums.T
    share = np.maximum(unseen - one**2 / np.maximum(2.0 * two, 1.0), 0.0) / np.maximum(known + unseen, 1.0)
    # second differences have six times the variance of heights that are independent at that distance
    return share, SHADOW_DEPTH * share * np.sqrt(bend / np.maximum(6.0 * bends, 1.0))


def _weight_by_kind(sums: FloatArray, area_m2: float) -> tuple[float, float, float, float, float, float, float]:
    """The first seven of :class:`ChangeFigures`.

    Args:
        sums: (kinds, 12) of the cells of each kind: worked, compared, change, its square, squares of its standard error
            and of the spread of returns within cells, and those of :func:`_shadow_sums`.
    """
    worked, compared = sums[:, 0].sum() * area_m2, sums[:, 1].sum() * area_m2
    if (sums[:, 1] == 0).any():  # a kind that is not there, or not seen
        sums = sums.sum(axis=0, keepdims=True)
    cells, count, total, squares, noise, relief = sums[:, :6].T
    if not count.all():
        return worked, compared, np.nan, np.nan, np.nan, np.nan, np.nan
    share = cells / cells.sum()
    in_shadow, lower = _shadows(sums[:, 6:])
    mean = total / count
    # what was not seen lies together: about a square metre is one sample of it
    spread = np.sqrt(np.maximum(squares / count - mean**2, 0.0))
    unseen = (1.0 - count / cells) * spread / np.sqrt(np.maximum(count * area_m2, 1.0))
    off_noise = float(np.linalg.norm(share * np.sqrt(noise) / count))
    off_unseen = float(np.hypot(np.linalg.norm(share * unseen), 0.5 * share @ lower))
    hidden = HIDDEN_SHARE * float(np.sqrt(share @ (relief / count)))
    return worked, compared, float(share @ (mean + lower)), off_noise, off_unseen, float(share @ in_shadow), hidden


def union_shapes(shapes: Sequence[BaseGeometry]) -> BaseGeometry:
    """Ground in any of the shapes."""
    return shapely.union_all(np.asarray([*shapes, shapely.Polygon()], object))
