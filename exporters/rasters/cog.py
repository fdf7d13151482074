"""Rasters as cloud-optimised GeoTIFF."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import rasterio
from numpy.typing import NDArray
from pyproj import CRS
from pyproj.exceptions import ProjError
from rasterio.enums import ColorInterp
from rasterio.errors import CRSError
from rasterio.shutil import copy
from rasterio.windows import Window

from furrowmap.core.runtime.settings import threads
from furrowmap.core.runtime.write_errors import writing
from furrowmap.core.surfaces.grid import Grid, Surface
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters.windows import shared_cells

Bands = Sequence[NDArray[Any]]
"""An array for each band, of the grid's shape; written as float32, nan where unknown."""

COG_BLOCK: Final = 512
STEPS_PER_M: Final = 8192
"""Heights are rounded to 2^-13 m (0.12 mm): the digits below are noise that takes a third of the file."""
_COG_OPTIONS: Final = {
    "driver": "COG",
    "BLOCKSIZE": str(COG_BLOCK),
    "COMPRESS": "DEFLATE",
    "PREDICTOR": "FLOATING_POINT",
    "LEVEL": "1",
    "OVERVIEW_RESAMPLING": "AVERAGE",
    "BIGTIFF": "IF_SAFER",
}
_SCRATCH_PROFILE: Final = {
    "driver": "GTiff", "dtype": "float32", "nodata": float("nan"), "tiled": True, "blockxsize": 256, "blockysize": 256,
    "interleave": "band", "SPARSE_OK": "TRUE", "BIGTIFF": "IF_SAFER",
}  # fmt: skip
_COUNT_PROFILE: Final = {"dtype": "uint16", "nodata": None}
GDAL_CACHE_BYTES: Final = 64 << 20


@dataclass(frozen=True)
class Band:
    """A band of a raster, rounded to multiples of 1 / steps_per_unit.

    For numbers and shades the unit is "1", as GDAL takes an empty one for that of the heights.
    """

    description: str
    unit: str = "m"
    steps_per_unit: int = STEPS_PER_M


HEIGHT_BAND: Final = Band("height")
COUNT_BAND: Final = Band("returns", "1", 0)
SPREAD_BAND: Final = Band("spread")
STANDARD_ERROR_BAND: Final = Band("standard error")
FILLED_BAND: Final = Band("filled", "1", 0)
"""1 where the height is interpolated, else 0."""
CHANGE_BANDS: Final = (Band("change"), STANDARD_ERROR_BAND)
SURFACE_BANDS: Final = (HEIGHT_BAND, COUNT_BAND, SPREAD_BAND, STANDARD_ERROR_BAND)
"""The bands of :func:`surface_arrays`."""


def surface_arrays(surface: Surface) -> Bands:
    """The bands of a surface: height, number of returns, their spread, standard error."""
    return [surface.height_m, surface.count, surface.spread_m, surface.standard_error_m]


@contextmanager
def cog_output(
    path: Path, grid: Grid, crs: CRS, bands: Sequence[Band], origin: Origin, *, counts: bool = False
) -> Iterator[Callable[[Grid, Bands], None]]:
    """Write a raster tile by tile, as a whole or not at all.

    The tiles are kept uncompressed in a scratch file beside `path`, from which GDAL's COG driver writes the file with
    overviews; memory is a hundred megabytes, regardless of the raster's size.

    Args:
        crs: of the map, with or without heights; GDAL reports :func:`reported_crs` of it.
        counts: whether the values are whole numbers from 0 to 65,535, written as such; none of them means unknown.

    Yields:
        A function that takes the bands of a tile with the same cells; parts outside the raster are ignored.
    """
    profile = {**_SCRATCH_PROFILE, **(_COUNT_PROFILE if counts else {}), "count": len(bands), "crs": _raster_crs(crs)}
    version = "AUTO" if reported_crs(crs) == crs else "1.0"
    options = _COG_OPTIONS | ({"PREDICTOR": "STANDARD"} if counts else {}) | {"GEOTIFF_VERSION": version}
    with scratch_raster(path, grid, profile, options, origin) as raster:
        raster.colorinterp = [ColorInterp.gray] + [ColorInterp.undefined] * (len(bands) - 1)
        raster.descriptions = tuple(band.description for band in bands)
        raster.units = tuple(band.unit for band in bands)
        sums = [_Statistics() for _ in bands]

        def write(tile: Grid, arrays: Bands) -> None:
            shared = shared_cells(tile, grid)
            if shared is not None:
                part, place = shared.window_in(tile), shared.window_in(grid)
                values = [_rounded(a[part], band, counts=counts) for a, band in zip(arrays, bands, strict=True)]
                with writing(path):  # what is copied from, and open as well, is not to blame
                    raster.write(np.stack(values), window=Window.from_slices(*place))
                for band_sums, band_values in zip(sums, values, strict=True):
                    band_sums.add(band_values)

        yield write
        for number, band_sums in enumerate(sums, start=1):
            raster.update_tags(number, **band_sums.tags(grid.rows * grid.columns))


@contextmanager
def scratch_raster(
    path: Path, grid: Grid, profile: Mapping[str, Any], options: Mapping[str, Any], origin: Origin
) -> Iterator[Any]:
    """A raster to fill, in a scratch file, of which GDAL's COG driver writes the file at `path` with its options."""
    with atomic_output(path) as unfinished, rasterio.Env(GDAL_CACHEMAX=GDAL_CACHE_BYTES):
        scratch = unfinished.with_name(f"{unfinished.name}.bands")
        place = {"height": grid.rows, "width": grid.columns, "transform": rasterio.Affine(*grid.transform)}
        with rasterio.open(scratch, "w", **profile, **place) as raster:
            raster.update_tags(**tags_of(origin))
            yield raster
        copy(scratch, unfinished, NUM_THREADS=str(threads()), **options)


def with_heights(crs: CRS, heights: str = "ellipsoidal") -> CRS:
    """The map's CRS with the heights of a raster's values.

    ISO 19111 has ellipsoidal heights only as an axis of a three-dimensional CRS, and a GeoTIFF cannot store a projected
    one: GDAL would write it to a second file. So they become a vertical CRS with a telling name, in a compound with the
    map's. For other heights than "ellipsoidal", and where WKT 1 cannot express the CRS, it is returned unchanged.
    """
    if heights != "ellipsoidal" or crs.is_compound:
        return crs
    base = crs.geodetic_crs.name if crs.geodetic_crs is not None else crs.name
    try:
        return CRS.from_wkt(_COMPOUND.format(name=_quoted(crs.name), base=_quoted(base), map=crs.to_wkt("WKT1_GDAL")))
    except ProjError:
        return crs


@lru_cache(maxsize=8)  # PROJ looks through all its codes for 10 ms, for each raster of each session of a batch
def reported_crs(crs: CRS) -> CRS:
    """The CRS that GDAL reports for a raster in `crs`: the horizontal part of a compound without a code, else `crs`.

    QGIS takes a compound without a code for an unknown CRS. For GeoTIFF 1.0 GDAL reports the horizontal part by its
    code, and the compound with `GTIFF_REPORT_COMPD_CS=YES`; both are in the file.
    """
    return crs.sub_crs_list[0] if crs.is_compound and crs.to_epsg() is None else crs


_COMPOUND: Final = (
    'COMPD_CS["{name} + {base} ellipsoidal height",{map},VERT_CS["{base} ellipsoidal height",'
    'VERT_DATUM["{base} ellipsoid",2005],UNIT["metre",1,AUTHORITY["EPSG","9001"]],AXIS["Up",UP]]]'
)


def tags_of(origin: Origin) -> dict[str, str]:
    """GeoTIFF metadata, with TIFF's own tags for some."""
    tags = origin.metadata
    own = {"TIFFTAG_SOFTWARE": tags.pop("SOFTWARE"), "TIFFTAG_IMAGEDESCRIPTION": tags.pop("TITLE")}
    if "TIME_END" in tags:
        own["TIFFTAG_DATETIME"] = tags["TIME_END"][:19].replace("-", ":").replace("T", " ")
    return own | tags


def _quoted(name: str) -> str:
    """A name between the quotation marks of WKT."""
    return name.replace('"', '""')


def _raster_crs(crs: CRS) -> rasterio.CRS:
    """The CRS for GDAL: as WKT 1 where that can express it."""
    try:
        return rasterio.CRS.from_wkt(crs.to_wkt("WKT1_GDAL"))
    except (ProjError, CRSError):
        return rasterio.CRS.from_wkt(crs.to_wkt("WKT2_2019"))


class _Statistics:
    """Statistics of a band, which GDAL and QGIS use instead of reading all of it."""

    def __init__(self) -> None:
        self._count = 0
        self._sum = 0.0
        self._square = 0.0
        self._base = self._least = self._greatest = math.nan

    def add(self, values: NDArray[Any]) -> None:
        """Add the values of a tile."""
        known = values[np.isfinite(values)].astype(np.float32, copy=False)
        if not len(known):
            return
        if not self._count:
            self._base = float(known[0])  # sums of differences keep their digits
        apart = known.astype(np.float64) - self._base
        self._count += len(known)
        self._sum += float(apart.sum())
        self._square += float(apart @ apart)
        self._least = float(np.fmin(self._least, known.min()))
        self._greatest = float(np.fmax(self._greatest, known.max()))

    def tags(self, cells: int) -> dict[str, str]:
        """GDAL's tags; empty for a band without values."""
        if not self._count:
            return {}
        mean = self._sum / self._count
        return {
            "STATISTICS_MINIMUM": repr(self._least),
            "STATISTICS_MAXIMUM": repr(self._greatest),
            "STATISTICS_MEAN": repr(self._base + mean),
            "STATISTICS_STDDEV": repr(math.sqrt(max(0.0, self._square / self._count - mean * mean))),
            "STATISTICS_VALID_PERCENT": f"{100.0 * self._count / cells:.4g}",
        }


def _rounded(array: NDArray[Any], band: Band, *, counts: bool) -> NDArray[Any]:
    if counts:
        return array.astype(np.uint16)
    values = array.astype(np.float32)
    if band.steps_per_unit:
        values = np.rint(values * np.float32(band.steps_per_unit)) / np.float32(band.steps_per_unit)
    return values
