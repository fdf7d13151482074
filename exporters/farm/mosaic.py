"""The surfaces of several sessions as one raster: the latest session's, or their mean."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import rasterio
from numpy.typing import NDArray
from pyproj import CRS
from pyproj.crs import CompoundCRS
from rasterio.enums import Resampling
from rasterio.vrt import WarpedVRT
from rasterio.windows import Window

from furrowmap.core.geodesy.crs_change import crs_change
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.values.crs_name import name_of
from furrowmap.core.values.errors import Notice, RefusedError
from furrowmap.core.values.progress import Progress, silent
from furrowmap.exporters.farm.surface_file import SurfaceFile, heights_of, horizontal, same_map, surface_file
from furrowmap.exporters.farm.virtual_raster import virtual_raster
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters.cog import Band, cog_output
from furrowmap.exporters.reports.report import file_records

VIRTUAL: Final = ".vrt"
SUFFIXES: Final = (VIRTUAL, ".tif", ".tiff")
_TILE: Final = 1024
_EDGE: Final = 1e-3
"""Cells of which a surface covers less than this share of one of its own have no part in it."""
COARSER: Final = 1.5
"""Cells that are so many times as large are made of the cells in them."""


@dataclass(frozen=True)
class Mosaic:
    """What was made.

    Attributes:
        path: of the raster.
        crs: of its cells.
        cell_m: length of a cell's sides.
        columns: from west to east.
        rows: from north to south.
        surfaces: of how many sessions.
        notices: what a user should know.
    """

    path: Path
    crs: str
    cell_m: float
    columns: int
    rows: int
    surfaces: int
    notices: tuple[Notice, ...]


def mosaic(
    paths: Sequence[Path],
    output: Path,
    *,
    crs: CRS | None = None,
    cell_m: float | None = None,
    mean: bool = False,
    progress: Progress = silent,
) -> Mosaic:
    """Put surfaces together into one raster.

    Cells that overlay exactly are taken as they are. A surface of another CRS or cell size is resampled: bilinear, in
    cells whose middle lies in a seen one; coarser cells have the mean of the seen ones in them. A cell's bands come
    from one session together.

    Args:
        paths: of the surfaces, in the order of their sessions, the latest last: it wins where they overlap.
        output: `.vrt` for a virtual raster of the heights, which refers to the surfaces where they lie and has nothing
            of its own; `.tif` for a cloud-optimised GeoTIFF of all bands.
        crs: of the cells; None for that of the surfaces.
        cell_m: length of a cell's sides; None for the latest surface's.
        mean: the mean height of all sessions instead, and how many there were.
        progress: is told of the stage "writing the mosaic".

    Raises:
        InputError: if a surface cannot be read.
        RefusedError: if they cannot be put together that way.
        OSError: if the raster cannot be written.
    """
    surfaces = [surface_file(path) for path in paths]
    if output.resolve() in {surface.path for surface in surfaces}:
        raise RefusedError(
            f"{output} is one of the surfaces that the mosaic is made of.",
            "It would be lost, so nothing was done.",
            "Choose another name with -o.",
            code="output-is-input",
        )
    target = _target_crs(surfaces, crs)
    cell_m = cell_m or surfaces[-1].cell_m
    exact = all(_fits(surface, target, cell_m) for surface in surfaces)
    notices = [] if exact else _checked_changes(surfaces, target)
    if output.suffix == VIRTUAL and (mean or not exact):
        raise RefusedError(
            f"{output.name} would have to compute its cells: "
            f"{'a mean is asked for' if mean else 'not all surfaces have the CRS and the cells that it is to have'}.",
            "A virtual raster only refers to cells as they are, so nothing was done.",
            "Name an output with .tif, which is computed once.",
            code="mosaic-virtual",
        )
    grid = _whole_grid(surfaces, target, cell_m)
    origin = _origin(surfaces, mean=mean, progress=progress)
    if output.suffix == VIRTUAL:
        sources = [(s.path, s.grid, s.nodata) for s in surfaces if s.grid is not None]
        text = virtual_raster(output.resolve().parent, grid, target, surfaces[-1].bands[:1], sources, origin)
        with atomic_output(output) as unfinished:
            unfinished.write_text(text, encoding="utf-8")
    else:
        _compute(surfaces, output, grid, target, origin, mean=mean, progress=progress)
    size = {"columns": grid.columns, "rows": grid.rows}
    return Mosaic(output, name_of(target), cell_m, **size, surfaces=len(surfaces), notices=tuple(notices))


def _target_crs(surfaces: Sequence[SurfaceFile], wanted: CRS | None) -> CRS:
    """The CRS of the mosaic, with the heights of the surfaces.

    Raises:
        RefusedError: if nobody has said which of several, or heights are of several kinds.
    """
    kinds = {heights_of(surface.crs) for surface in surfaces}
    if len(kinds) > 1:
        raise RefusedError(
            f"The surfaces' heights are of several kinds: {', '.join(sorted(kind or 'not told' for kind in kinds))}.",
            "Tens of metres may lie between them, so nothing was done.",
            "Run the sessions with the same heights, or make a mosaic of each kind.",
            code="mosaic-heights",
        )
    crs = surfaces[-1].crs
    if wanted is None:
        for surface in surfaces:
            if not same_map(surface.crs, crs):
                raise RefusedError(
                    f"{surfaces[-1].path} is in {name_of(crs)}, {surface.path} in {name_of(surface.crs)}.",
                    "Nobody has said which of them the mosaic is to have, so nothing was done.",
                    "Name one with --dst-crs.",
                    code="mosaic-crs",
                )
        return crs
    if same_map(crs, wanted):
        return crs
    wanted = wanted.to_2d()
    return (
        CompoundCRS(f"{wanted.name} + {heights_of(crs)}", [wanted, crs.sub_crs_list[1]]) if crs.is_compound else wanted
    )


def _fits(surface: SurfaceFile, crs: CRS, cell_m: float) -> bool:
    return surface.grid is not None and surface.cell_m == cell_m and same_map(surface.crs, crs)


def _checked_changes(surfaces: Sequence[SurfaceFile], target: CRS) -> list[Notice]:
    """What is to be known of the ways into the target's CRS; refused where PROJ cannot vouch for one."""
    notices: dict[Notice, None] = {}
    for surface in surfaces:
        if not same_map(surface.crs, target):
            change = crs_change(horizontal(surface.crs), horizontal(target), surface.bounds_m)
            notices |= dict.fromkeys(change.notices)
    return list(notices)


def _whole_grid(surfaces: Sequence[SurfaceFile], crs: CRS, cell_m: float) -> Grid:
    grids = [_grid_in(surface, crs, cell_m) for surface in surfaces]
    west, north = min(grid.west for grid in grids), max(grid.north for grid in grids)
    east = max(grid.west + grid.columns for grid in grids)
    south = min(grid.north - grid.rows for grid in grids)
    return Grid(cell_m, west, north, (north - south, east - west))


def _grid_in(surface: SurfaceFile, crs: CRS, cell_m: float) -> Grid:
    """The cells of the mosaic that a surface may have a part in."""
    if surface.grid is not None and _fits(surface, crs, cell_m):
        return surface.grid
    bounds = surface.bounds_m
    if not same_map(surface.crs, crs):
        change = crs_change(horizontal(surface.crs), horizontal(crs), bounds)
        bounds = change.transformer.transform_bounds(*bounds)
    west, south, east, north = bounds
    inset = _EDGE * surface.cell_m
    return Grid.of_bounds(cell_m, (west + inset, south + inset, east - inset, north - inset))


def _origin(surfaces: Sequence[SurfaceFile], *, mean: bool, progress: Progress) -> Origin:
    records = [file_records([surface.path], surface.path.parent.parent, progress)[0] for surface in surfaces]
    spans = [surface.span_s for surface in surfaces if surface.span_s is not None]
    heights = heights_of(surfaces[-1].crs)
    return Origin(
        "Mosaic of surfaces",
        inputs=[(record.name, record.sha256) for record in records],
        span_s=(min(first for first, _ in spans), max(last for _, last in spans)) if spans else None,
        parameters={"pick": "mean" if mean else "latest", **({"heights": heights} if heights else {})},
    )


def _compute(
    surfaces: Sequence[SurfaceFile],
    output: Path,
    grid: Grid,
    crs: CRS,
    origin: Origin,
    *,
    mean: bool,
    progress: Progress,
) -> None:
    count = 1 if mean else min(len(surface.bands) for surface in surfaces)
    bands = (*surfaces[-1].bands[:count], *([Band("sessions", "1", 0)] if mean else []))
    with ExitStack() as stack:
        sources = [stack.enter_context(_opened(surface, crs, grid.cell_m, count)) for surface in surfaces]
        put = stack.enter_context(cog_output(output, grid, crs, bands, origin))
        tiles = list(_tiles(grid))
        for i, tile in enumerate(tiles):
            progress("writing the mosaic", i / len(tiles))
            put(tile, _mean(sources, tile) if mean else _latest(sources, tile, count))


@dataclass(frozen=True)
class _Source:
    """A surface in cells of the mosaic: its own, or resampled into them, and then as its nearest cells are or None."""

    raster: Any
    nearest: Any
    grid: Grid
    bands: int

    def read(self, tile: Grid) -> tuple[tuple[slice, slice], NDArray[np.float32]] | None:
        """Rows and columns of the tile that it covers, and its bands (bands, rows, columns) there, nan for none."""
        top = max(tile.north - self.grid.north, 0)
        left = max(self.grid.west - tile.west, 0)
        bottom = min(tile.north - (self.grid.north - self.grid.rows), tile.rows)
        right = min(self.grid.west + self.grid.columns - tile.west, tile.columns)
        if bottom <= top or right <= left:
            return None
        row, column = self.grid.north - tile.north + top, tile.west - self.grid.west + left
        window = Window(column, row, right - left, bottom - top)
        values = _values(self.raster, self.bands, window)
        if self.nearest is not None:
            values[:, np.isnan(_values(self.nearest, 1, window)[0])] = np.nan
        return (slice(top, bottom), slice(left, right)), values


def _values(raster: Any, bands: int, window: Window) -> NDArray[np.float32]:
    read = raster.read(list(range(1, bands + 1)), window=window, masked=True, out_dtype="float32")
    values: NDArray[np.float32] = read.filled(np.nan)
    return values


@contextmanager
def _opened(surface: SurfaceFile, crs: CRS, cell_m: float, bands: int) -> Iterator[_Source]:
    grid = _grid_in(surface, crs, cell_m)
    with rasterio.open(surface.path, driver="GTiff") as raster:
        if _fits(surface, crs, cell_m):
            yield _Source(raster, None, grid, bands)
            return
        coarser = cell_m > COARSER * surface.cell_m
        options = {
            "src_crs": horizontal(surface.crs).to_wkt(),
            "crs": horizontal(crs).to_wkt(),
            "transform": rasterio.Affine(*grid.transform),
            "width": grid.columns,
            "height": grid.rows,
            "src_nodata": np.nan if surface.nodata is None else surface.nodata,
            "nodata": np.nan,
            "dtype": "float32",
            "UNIFIED_SRC_NODATA": "NO",  # else a cell beside a hole, or one of a single return, would be one more hole
        }
        with (
            WarpedVRT(raster, resampling=Resampling.average if coarser else Resampling.bilinear, **options) as warped,
            WarpedVRT(raster, resampling=Resampling.nearest, **options) as nearest,
        ):
            yield _Source(warped, None if coarser else nearest, grid, bands)


def _tiles(grid: Grid) -> Iterator[Grid]:
    for top in range(0, grid.rows, _TILE):
        for left in range(0, grid.columns, _TILE):
            shape = (min(_TILE, grid.rows - top), min(_TILE, grid.columns - left))
            yield Grid(grid.cell_m, grid.west + left, grid.north - top, shape)


def _latest(sources: Sequence[_Source], tile: Grid, count: int) -> list[NDArray[np.float32]]:
    values = np.full((count, *tile.shape), np.nan, np.float32)
    for source in reversed(sources):
        found = source.read(tile)
        if found is not None:
            place, theirs = found
            mine = values[:, place[0], place[1]]
            free = np.isnan(mine[0]) & ~np.isnan(theirs[0])
            mine[:, free] = theirs[:, free]
    return list(values)


def _mean(sources: Sequence[_Source], tile: Grid) -> list[NDArray[np.float32]]:
    total, number = np.zeros(tile.shape), np.zeros(tile.shape, np.float32)
    for source in sources:
        found = source.read(tile)
        if found is not None:
            place, theirs = found
            known = ~np.isnan(theirs[0])
            total[place] += np.where(known, theirs[0], 0.0)
            number[place] += known
    with np.errstate(invalid="ignore"):
        heights = np.where(number > 0, total / number, np.nan)
    return [heights.astype(np.float32), np.where(number > 0, number, np.float32(np.nan))]
