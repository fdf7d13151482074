"""Surfaces in GeoTIFFs: their metadata, and their values on the cells of a grid."""

import datetime as dt
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from pyproj import CRS
from rasterio.errors import RasterioError
from rasterio.transform import Affine

from furrowmap.core.readers.geotiff import expect_crs, open_geotiff
from furrowmap.core.readers.raster_heights import HeightScale, expect_known_heights, height_scale
from furrowmap.core.runtime.arrays import Float32Array
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.languages.texts import Text, Words, reason
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.rasters.cog import Band
from furrowmap.exporters.rasters.windows import shared_cells, window

Unusable = Callable[[Path, Words], InputError]
"""The error of a file, from what is wrong with it."""
_OFF_CELLS: Final = 1e-3
"""Tolerance of a raster's bounds in cells, as its numbers are rounded."""


@dataclass(frozen=True)
class SurfaceFile:
    """A surface of a session.

    Attributes:
        crs: of its cells, with heights where the file states them.
        bounds_m: west, south, east, north.
        grid: its cells; None where their edges are not multiples of the cell size from the CRS's 0, 0.
        bands: description and unit of each, the height first.
        nodata: of each band; None for no such value, or where `scale` changes the numbers.
        span_s: UTC of the first and the last measurement; None where unknown.
        scale: what the numbers of the first band mean.
    """

    path: Path
    crs: CRS
    cell_m: float
    bounds_m: tuple[float, float, float, float]
    grid: Grid | None
    bands: tuple[Band, ...]
    nodata: float | None
    span_s: tuple[float, float] | None
    scale: HeightScale


def surface_file(path: Path) -> SurfaceFile:
    """Read the metadata of a GeoTIFF with a CRS and square, north-up cells, whatever its bands are."""
    return _surface_file(path, unusable, lambda raster, place, _: expect_crs(raster, place))


def height_surface(path: Path, unusable: Unusable) -> SurfaceFile:
    """As :func:`surface_file`, of heights above a datum; errors as :func:`.expect_known_heights`, too."""
    return _surface_file(path, unusable, expect_known_heights)


def _surface_file(path: Path, unusable: Unusable, expect: Callable[[Any, Path, Unusable], None]) -> SurfaceFile:
    with open_geotiff(path, unusable) as raster:
        expect(raster, path, unusable)
        width, skew, _, skew2, height = raster.transform[:5]
        if skew or skew2 or height >= 0 or abs(width + height) > 1e-9 * width:
            raise unusable(path, Text("has cells that are not square and north-up"))
        bands = tuple(
            Band(description or f"band {i}", unit or "", 0)
            for i, (description, unit) in enumerate(zip(raster.descriptions, raster.units, strict=True), start=1)
        )
        scale = height_scale(raster, path)
        assert scale.crs is not None
        west = raster.bounds.left / width
        north = raster.bounds.top / width
        anchored = max(abs(west - round(west)), abs(north - round(north))) <= _OFF_CELLS
        grid = Grid(width, round(west), round(north), raster.shape) if anchored else None
        span_s = None
        with suppress(KeyError, ValueError):
            first, last = (dt.datetime.fromisoformat(raster.tags()[name]) for name in ("TIME_START", "TIME_END"))
            span_s = first.timestamp(), last.timestamp()
        if scale.unit_m != 1.0:
            bands = (replace(bands[0], unit="m"), *bands[1:])
        nodata = raster.nodata if scale.plain else None
        return SurfaceFile(resolved(path), scale.crs, width, tuple(raster.bounds), grid, bands, nodata, span_s, scale)


@dataclass(frozen=True)
class OpenSurface:
    """An open surface in the cells of a grid: its own, or resampled; `nearest` masks the cells of a bilinear one.

    `scale` is that of the numbers of its first band; None where they are heights in metres.
    """

    path: Path
    raster: Any
    grid: Grid
    nearest: Any = None
    scale: HeightScale | None = None

    def read(self, part: Grid, band: int = 1) -> Float32Array:
        """A band, by default the heights, on the cells of `part`: nan beside the raster, and without such a band."""
        found = self.read_bands(part, [band]) if band <= self.raster.count else np.full(part.shape, np.nan, np.float32)
        return found.reshape(part.shape)

    def read_bands(self, part: Grid, bands: Sequence[int]) -> Float32Array:
        """Bands (bands, rows, columns) on the cells of `part`, nan where there is no value."""
        out = np.full((len(bands), *part.shape), np.nan, np.float32)
        shared = shared_cells(part, self.grid)
        if shared is not None:
            options = {"window": window(shared, self.grid), "masked": True, "out_dtype": "float32"}
            try:
                values = self.raster.read(list(bands), **options).filled(np.nan)
                if self.scale is not None and 1 in bands:
                    numbers = self.raster.read(1, window=options["window"], masked=True)
                    values[list(bands).index(1)] = self.scale.heights_m(numbers)
                if self.nearest is not None:
                    values[:, np.isnan(self.nearest.read(bands[0], **options).filled(np.nan))] = np.nan
            except RasterioError as error:
                raise unusable(self.path, Text("is damaged ({why})", why=reason(error))) from None
            out[:, *shared.window_in(part)] = values
        return out


@contextmanager
def open_surface(file: SurfaceFile) -> Iterator[OpenSurface]:
    """Open a surface whose cells are anchored."""
    assert file.grid is not None
    with open_geotiff(file.path, unusable) as raster:
        yield OpenSurface(file.path, raster, file.grid, scale=None if file.scale.plain else file.scale)


def warp_options(file: SurfaceFile, crs: CRS, grid: Grid) -> dict[str, Any]:
    """Options of rasterio's WarpedVRT that give a surface the cells of a grid in a CRS, with nan for no value."""
    return {
        "src_crs": horizontal(file.crs).to_wkt(),
        "crs": horizontal(crs).to_wkt(),
        "transform": Affine(*grid.transform),
        "width": grid.columns,
        "height": grid.rows,
        "src_nodata": math.nan if file.nodata is None else file.nodata,
        "nodata": math.nan,
        "dtype": "float32",
        "UNIFIED_SRC_NODATA": "NO",  # else a cell next to nodata in any band would become nodata
    }


def unusable(path: Path, why: Words) -> InputError:
    """The error of a file that a mosaic cannot be made of."""
    return InputError("surface-unusable", path=path, why=why)


def heights_of(crs: CRS) -> str:
    """The name of a CRS's heights; empty where it has none."""
    return crs.sub_crs_list[1].name if crs.is_compound else ""


def horizontal(crs: CRS) -> CRS:
    """A CRS without its heights."""
    return crs.sub_crs_list[0] if crs.is_compound else crs.to_2d()


def same_map(one: CRS, other: CRS) -> bool:
    """Whether two CRSs are horizontally the same."""
    return horizontal(one).equals(horizontal(other), ignore_axis_order=True)
