"""The surfaces of several dates as their ties move them, and the changes between them, on one grid."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS
from shapely.geometry.base import BaseGeometry

from furrowmap.core.dates.ground_pair import GroundPair
from furrowmap.core.dates.moved_surface import moved, reach_cells
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters.cog import HEIGHT, STANDARD_ERROR, Band, cog_output
from furrowmap.exporters.rasters.dated_surface import OpenSurface, inside
from furrowmap.exporters.rasters.windows import common, windows

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]

PIECE_CELLS: Final = 500
"""Side of the pieces of ground that ties are made of: 25 m, a whole number of patches."""
MOST_PIECES: Final = 64
"""Four hectares show a tie as well as forty do."""
CHANGE_BANDS: Final = (Band("change"), STANDARD_ERROR)


def ground_pairs(one: OpenSurface, other: OpenSurface, touched: BaseGeometry) -> Iterator[GroundPair]:
    """The ground that two dates have in common, where no tool touched it, in pieces; some where there are many."""
    shared = common(one.grid, other.grid)
    if shared is None:
        return
    pieces = [
        Grid(shared.cell_m, shared.west + column, shared.north - row, (rows, columns))
        for row in range(0, shared.rows, PIECE_CELLS)
        for column in range(0, shared.columns, PIECE_CELLS)
        for rows, columns in [(min(PIECE_CELLS, shared.rows - row), min(PIECE_CELLS, shared.columns - column))]
    ]
    count = 0
    for piece in islice(pieces, 0, None, max(1, len(pieces) // MOST_PIECES)):
        first, second = one.read(piece), other.read(piece)
        off = inside(touched, piece, touched=True)
        first[off] = second[off] = np.nan
        if (np.isfinite(first) & np.isfinite(second)).any() and count < MOST_PIECES:
            west, _, _, north = piece.bounds_m
            count += 1
            yield GroundPair(west, north, piece.cell_m, first, second)


@dataclass(frozen=True)
class Mover:
    """A surface with its move.

    Attributes:
        surface: as measured.
        move: (6,).
        middle_m: (2,) that it is about.
    """

    surface: OpenSurface
    move: FloatArray
    middle_m: FloatArray

    def heights(self, part: Grid) -> Float32Array:
        """Moved heights of cells."""
        margin = reach_cells(self.move, self.surface.grid, self.middle_m)
        around = Grid(
            part.cell_m, part.west - margin, part.north + margin, (part.rows + 2 * margin, part.columns + 2 * margin)
        )
        return moved(self.surface.read(around), around, part, self.move, self.middle_m)


def write_moved(path: Path, mover: Mover, grid: Grid, crs: CRS, origin: Origin) -> None:
    """Write a surface as its tie moves it: height and standard error.

    Raises:
        OSError: if the file cannot be written.
    """
    with cog_output(path, grid, crs, (HEIGHT, STANDARD_ERROR), origin) as put:
        for part, _ in windows(grid, 0):
            put(part, (mover.heights(part), mover.surface.standard_error(part)))


@dataclass(frozen=True)
class ChangeFigures:
    """The change between two dates.

    Attributes:
        worked_m2: ground that a tool worked between them.
        compared_m2: of that, what both dates saw.
        mean_m: mean change of that, upward positive; nan where nothing was compared.
        noise_m: standard deviation of the mean by the noise of the cells.
        unseen_m: standard deviation of the mean of all worked ground by what was not seen on both dates.
        places_m: (n, 2) some cells compared, evenly chosen.
        untouched_m: (k,) changes of some cells that no tool touched.
    """

    worked_m2: float
    compared_m2: float
    mean_m: float
    noise_m: float
    unseen_m: float
    places_m: FloatArray
    untouched_m: FloatArray


def write_change(
    path: Path, pair: tuple[Mover, Mover], ground: tuple[BaseGeometry, BaseGeometry], crs: CRS, origin: Origin
) -> ChangeFigures | None:
    """Write the change between two dates where both saw the ground; None where they share no cell.

    Args:
        path: of the file.
        pair: the surfaces with their moves.
        ground: worked between the dates, and touched by a tool of either.
        crs: of the map.
        origin: provenance.

    Raises:
        OSError: if the file cannot be written.
    """
    one, other = pair
    grid = common(one.surface.grid, other.surface.grid)
    if grid is None:
        return None
    worked, touched = ground
    cells, sums, places, calm = 0, np.zeros(4), [np.zeros((0, 2))], [np.zeros(0, np.float32)]
    with cog_output(path, grid, crs, CHANGE_BANDS, origin) as put:
        for part, _ in windows(grid, 0):
            change = other.heights(part) - one.heights(part)
            error = np.hypot(other.surface.standard_error(part), one.surface.standard_error(part))
            put(part, (change, np.where(np.isfinite(change), error, np.float32(np.nan))))
            now = inside(worked, part, touched=False)
            seen = now & np.isfinite(change)
            cells += int(now.sum())
            moved_m, noise = change[seen].astype(np.float64), error[seen].astype(np.float64)
            sums += seen.sum(), moved_m.sum(), np.nansum(noise**2), (moved_m**2).sum()
            places.append(part.positions_m()[seen.ravel()][::20])
            still = np.isfinite(change) & ~inside(touched, part, touched=True)
            calm.append(change[still][::5])
    count, total, squares, products = sums.tolist()
    mean, noise, unseen = np.nan, np.nan, np.nan
    area = grid.cell_area_m2
    if count:
        mean, noise = total / count, squares**0.5 / count
        # shadows lie together: about a square metre is one sample of what was not seen
        spread = max(products / count - mean**2, 0.0) ** 0.5
        unseen = (1.0 - count / cells) * spread / max(count * area, 1.0) ** 0.5
    still_m = np.concatenate(calm).astype(np.float64)
    return ChangeFigures(cells * area, count * area, mean, noise, unseen, np.concatenate(places), still_m)


def union(shapes: Sequence[BaseGeometry]) -> BaseGeometry:
    """Ground in any of the shapes."""
    return shapely.union_all(np.asarray([*shapes, shapely.Polygon()], object))
