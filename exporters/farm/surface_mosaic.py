"""The surfaces of several sessions as one raster: the latest session's cells, or the mean."""

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS
from pyproj.crs import CompoundCRS
from rasterio.enums import Resampling
from rasterio.vrt import WarpedVRT

from furrowmap.core.geodesy.crs_change import crs_change, optional_crs
from furrowmap.core.geodesy.measurable_crs import expect_map
from furrowmap.core.readers.geotiff import open_geotiff
from furrowmap.core.readers.raster_heights import plain_heights
from furrowmap.core.runtime.arrays import Float32Array
from furrowmap.core.runtime.errors import Notice, RefusedError
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.values.crs import name_of
from furrowmap.exporters.farm.surface_file import (
    OpenSurface,
    SurfaceFile,
    heights_of,
    horizontal,
    same_map,
    surface_file,
    unusable,
    warp_options,
)
from furrowmap.exporters.farm.virtual_raster import virtual_raster
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.file_records import rooted_records
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters.cog import Band, cog_output
from furrowmap.exporters.rasters.windows import enclosing, windows

VIRTUAL: Final = ".vrt"
SUFFIXES: Final = (VIRTUAL, ".tif", ".tiff")
_INSET_CELLS: Final = 1e-3
"""Share of a surface's cell by which its bounds are reduced, so that rounding adds no row or column of cells."""
MAX_OPEN_SURFACES: Final = 64
"""Surfaces that are open at a time; systems allow a process about a thousand files."""
MIN_MEAN_RATIO: Final = 1.5
"""Ratio of cell sizes from which resampling takes the mean."""


@dataclass(frozen=True)
class Mosaic:
    """A written mosaic."""

    path: Path
    crs: str
    cell_m: float
    columns: int
    rows: int
    surfaces: int
    notices: tuple[Notice, ...]


def write_mosaic(
    paths: Sequence[Path],
    output: Path,
    *,
    crs: CRS | str | None = None,
    cell_m: float | None = None,
    mean: bool = False,
    progress: Progress = silent,
) -> Mosaic:
    """Merge surfaces into one raster.

    Surfaces of the same CRS and cell size are copied cell by cell. Others are resampled: bilinear, in cells whose
    centre lies in a seen cell; coarser cells take the mean of the seen cells in them. All bands of a cell come from one
    session. Raises RefusedError if the surfaces cannot be merged in this way.

    Args:
        paths: of the surfaces in the order of their sessions; the last one is on top.
        output: `.vrt` for a virtual raster, which refers to the heights of the surfaces where they lie; `.tif` for a
            cloud-optimised GeoTIFF of all bands.
        crs: of the cells; None for that of the surfaces.
        cell_m: length of a cell's sides; None for the latest surface's.
        mean: write the mean height of all sessions and their number instead of the latest session's cells.
    """
    surfaces = [surface_file(path) for path in paths]
    if resolved(output) in {surface.path for surface in surfaces}:
        raise RefusedError("output-is-input.part-of-mosaic", output=output)
    target = common_crs(surfaces, optional_crs(crs))
    cell_m = cell_m or surfaces[-1].cell_m
    exact = all(_fits(surface, target, cell_m) for surface in surfaces)
    changed = [surface for surface in surfaces if not same_map(surface.crs, target)]
    places = [(horizontal(one.crs), one.bounds_m) for one in surfaces]
    scale_notices = expect_map(horizontal(target), places)
    changes = [crs_change(horizontal(one.crs), horizontal(target), one.bounds_m) for one in changed]
    told = [scale_notices, *(one.scale.notices for one in surfaces), *(change.notices for change in changes)]
    notices = tuple(dict.fromkeys(notice for some in told for notice in some))
    if output.suffix == VIRTUAL and (mean or not exact or not all(one.scale.plain for one in surfaces)):
        raise RefusedError("mosaic-virtual", output=output.name, has_mean=bool(mean))
    grid = enclosing([grid_in(surface, target, cell_m) for surface in surfaces])
    records = rooted_records([(surface.path, surface.path.parent.parent) for surface in surfaces], progress)
    spans = [surface.span_s for surface in surfaces if surface.span_s is not None]
    heights = heights_of(surfaces[-1].crs)
    origin = Origin(
        "Mosaic of surfaces",
        inputs=[(record.name, record.sha256) for record in records],
        span_s=(min(first for first, _ in spans), max(last for _, last in spans)) if spans else None,
        parameters={"pick": "mean" if mean else "latest", **({"heights": heights} if heights else {})},
    )
    if output.suffix == VIRTUAL:
        sources = [(s.path, s.grid, s.nodata) for s in surfaces if s.grid is not None]
        text = virtual_raster(resolved(output).parent, grid, target, surfaces[-1].bands[:1], sources, origin)
        with atomic_output(output) as unfinished:
            unfinished.write_text(text, encoding="utf-8")
    else:
        count = 1 if mean else min(len(surface.bands) for surface in surfaces)
        bands = (*surfaces[-1].bands[:count], *([Band("sessions", "1", 0)] if mean else []))
        opened = _OpenSurfaces(surfaces, target, cell_m, [range(1, count + 1)] * len(surfaces))
        with closing(opened), cog_output(output, grid, target, bands, origin) as put:
            tiles = [tile for tile, _ in windows(grid, 0)]
            for i, tile in enumerate(tiles):
                progress("writing the mosaic", i / len(tiles))
                put(tile, _mean(opened, tile) if mean else _latest(opened, tile, count))
    return Mosaic(output, name_of(target), cell_m, grid.columns, grid.rows, len(surfaces), notices)


def write_mosaic_part(
    surfaces: Sequence[SurfaceFile], output: Path, grid: Grid, crs: CRS, bands: Sequence[str], origin: Origin
) -> NDArray[np.float64] | None:
    """Write a part of a mosaic as a cloud-optimised GeoTIFF, as :func:`write_mosaic` would fill its cells.

    Returns (bands, 3) least value, greatest value and number of known cells; None if no cell is known, and no file
    written. All surfaces have the bands, whose places in the files may differ; the last surface is on top.
    """
    names = [[band.description for band in surface.bands] for surface in surfaces]
    indexes = [[own.index(name) + 1 for name in bands] for own in names]
    latest = [surfaces[-1].bands[i - 1] for i in indexes[-1]]
    figures = np.array([[np.inf, -np.inf, 0.0]] * len(bands))
    opened = _OpenSurfaces(surfaces, crs, grid.cell_m, indexes)
    with closing(opened), cog_output(output, grid, crs, latest, origin) as put:
        for tile, _ in windows(grid, 0):
            arrays = _latest(opened, tile, len(bands))
            for row, array in zip(figures, arrays, strict=True):
                row[0] = np.fmin(row[0], np.fmin.reduce(array, None))
                row[1] = np.fmax(row[1], np.fmax.reduce(array, None))
                row[2] += np.isfinite(array).sum()
            if np.isfinite(arrays[0]).any():
                put(tile, arrays)
    if figures[0, 2]:
        return figures
    output.unlink()
    return None


def common_crs(surfaces: Sequence[SurfaceFile], wanted: CRS | None) -> CRS:
    """The CRS of a mosaic, with the heights of the surfaces, which must be of one system."""
    kinds = {heights_of(surface.crs) for surface in surfaces}
    if len(kinds) > 1:
        raise RefusedError("results-heights-mixed", kinds=", ".join(sorted(kind or "unknown" for kind in kinds)))
    crs = surfaces[-1].crs
    if wanted is None:
        for surface in surfaces:
            if not same_map(surface.crs, crs):
                names = {"crs": name_of(crs), "other_crs": name_of(surface.crs)}
                raise RefusedError("results-crs-mixed", folder=surfaces[-1].path, other_folder=surface.path, **names)
        return crs
    if same_map(crs, wanted):
        return crs
    flat = wanted.to_2d()
    return CompoundCRS(f"{flat.name} + {heights_of(crs)}", [flat, crs.sub_crs_list[1]]) if crs.is_compound else flat


def _fits(surface: SurfaceFile, crs: CRS, cell_m: float) -> bool:
    return surface.grid is not None and surface.cell_m == cell_m and same_map(surface.crs, crs)


def grid_in(surface: SurfaceFile, crs: CRS, cell_m: float) -> Grid:
    """The cells of a mosaic that a surface may contribute to."""
    if surface.grid is not None and _fits(surface, crs, cell_m):
        return surface.grid
    bounds = surface.bounds_m
    if not same_map(surface.crs, crs):
        change = crs_change(horizontal(surface.crs), horizontal(crs), bounds)
        bounds = change.transformer.transform_bounds(*bounds)
    west, south, east, north = bounds
    inset = _INSET_CELLS * surface.cell_m
    return Grid.of_bounds(cell_m, (west + inset, south + inset, east - inset, north - inset))


@contextmanager
def _opened(surface: SurfaceFile, crs: CRS, cell_m: float) -> Iterator[OpenSurface]:
    grid = grid_in(surface, crs, cell_m)
    with open_geotiff(surface.path, unusable) as raster:
        if _fits(surface, crs, cell_m):
            yield OpenSurface(surface.path, raster, grid, scale=None if surface.scale.plain else surface.scale)
            return
        coarser = cell_m > MIN_MEAN_RATIO * surface.cell_m
        options = warp_options(surface, crs, grid)
        with (
            plain_heights(raster, surface.scale, surface.path) as plain,
            WarpedVRT(plain, resampling=Resampling.average if coarser else Resampling.bilinear, **options) as warped,
            WarpedVRT(plain, resampling=Resampling.nearest, **options) as nearest,
        ):
            yield OpenSurface(surface.path, warped, grid, None if coarser else nearest)


class _OpenSurfaces:
    """Surfaces that are opened where a tile needs them; the number of open files is limited, however many there are."""

    def __init__(
        self, surfaces: Sequence[SurfaceFile], crs: CRS, cell_m: float, indexes: Sequence[Sequence[int]]
    ) -> None:
        self._surfaces = surfaces
        self._crs = crs
        self._cell_m = cell_m
        self._indexes = indexes
        self._tree = shapely.STRtree([shapely.box(*grid_in(surface, crs, cell_m).bounds_m) for surface in surfaces])
        self._open: OrderedDict[int, tuple[ExitStack, OpenSurface]] = OrderedDict()

    def over(self, tile: Grid, *, latest_first: bool) -> Iterator[Float32Array]:
        """The bands (bands, rows, columns) of the surfaces that may cover a tile, by the order of their sessions."""
        rows = np.sort(self._tree.query(shapely.box(*tile.bounds_m))).tolist()
        for row in reversed(rows) if latest_first else rows:
            if row in self._open:
                self._open.move_to_end(row)
            else:
                if len(self._open) >= MAX_OPEN_SURFACES:
                    self._open.popitem(last=False)[1][0].close()
                stack = ExitStack()
                self._open[row] = stack, stack.enter_context(_opened(self._surfaces[row], self._crs, self._cell_m))
            yield self._open[row][1].read_bands(tile, self._indexes[row])

    def close(self) -> None:
        """Close all files."""
        while self._open:
            self._open.popitem()[1][0].close()


def _latest(sources: _OpenSurfaces, tile: Grid, count: int) -> list[Float32Array]:
    values = np.full((count, *tile.shape), np.nan, np.float32)
    for theirs in sources.over(tile, latest_first=True):
        free = np.isnan(values[0]) & ~np.isnan(theirs[0])
        values[:, free] = theirs[:, free]
        if not np.isnan(values[0]).any():
            break
    return list(values)


def _mean(sources: _OpenSurfaces, tile: Grid) -> list[Float32Array]:
    total = np.zeros(tile.shape)
    number = np.zeros(tile.shape, np.float32)
    for theirs in sources.over(tile, latest_first=False):
        known = ~np.isnan(theirs[0])
        total += np.where(known, theirs[0], 0.0)
        number += known
    with np.errstate(invalid="ignore"):
        heights = np.where(number > 0, total / number, np.nan)
    return [heights.astype(np.float32), np.where(number > 0, number, np.float32(np.nan))]
