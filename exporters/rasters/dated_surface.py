"""The surfaces of a result as ties of dates need them: what was measured when, and where a tool worked."""

import datetime as dt
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from zoneinfo import ZoneInfo

import numpy as np
import shapely
from numpy.typing import NDArray
from rasterio.enums import Resampling
from rasterio.errors import RasterioError
from rasterio.features import geometry_mask
from rasterio.transform import Affine
from rasterio.vrt import WarpedVRT
from shapely.geometry.base import BaseGeometry

from furrowmap.core.readers.geotiff import open_geotiff
from furrowmap.core.runtime.arrays import Float32Array, FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.work.field_surfaces import BESIDE_M
from furrowmap.exporters.farm.surface_file import SurfaceFile, surface_file, unusable, warp_options
from furrowmap.exporters.files.result_folder import DSM, DSM_BEFORE, ResultFolder
from furrowmap.exporters.rasters.windows import shared_cells, window

MIN_MOVE_SIGMA: Final = np.array([0.01, 0.01, 0.02, 1e-3, 1e-3, 2e-3])
"""Standard deviations of a session's move before any tie at least: east, north, height (m), tilts, turn (rad)."""
_SIGMA_COLUMNS: Final = (
    "sigma_e_m",
    "sigma_n_m",
    "sigma_h_m",
    "sigma_pitch_deg",
    "sigma_roll_deg",
    "sigma_heading_deg",
)
_UNKNOWN_SIGMA: Final = np.array([0.05, 0.05, 0.1, 5e-3, 5e-3, 1e-2])
HEIGHT_INDEX: Final = 1
RETURNS_INDEX: Final = 2
SPREAD_INDEX: Final = 3
ERROR_INDEX: Final = 4
"""Bands of a surface's file, as :data:`~furrowmap.exporters.rasters.cog.SURFACE_BANDS`."""


@dataclass(frozen=True)
class DatedSurface:
    """The surfaces of a session.

    Attributes:
        zone: time zone of the field; UTC for a result that states none.
        after: `dsm.tif`.
        before: `dsm_before.tif`, or `after` where no work is known.
        worked: ground that the tool worked; empty for none.
        work_known: whether that is known; a flight has no tool.
        sigma: (6,) standard deviations of the move that its surface may need, by its positions and attitude.
    """

    name: str
    start: dt.datetime
    zone: ZoneInfo
    folder: Path
    after: SurfaceFile
    before: SurfaceFile
    worked: BaseGeometry
    work_known: bool
    sigma: FloatArray

    @property
    def touched(self) -> BaseGeometry:
        """Ground where the tool worked or threw soil."""
        return self.worked.buffer(BESIDE_M)


def dated_surface(result: ResultFolder) -> DatedSurface:
    """The surfaces of a result; InputError if it has none, or a file is damaged."""
    if not (result.folder / DSM).is_file():
        raise InputError("tie-no-surface", folder=result.folder, dsm=DSM)
    after = surface_file(result.folder / DSM)
    before = surface_file(result.folder / DSM_BEFORE) if (result.folder / DSM_BEFORE).is_file() else after
    known = "coverage" in result.layer_names
    shapes: Any = result.layer("coverage").shapes if known else []
    start = dt.datetime.fromisoformat(result.report["figures"]["start"])
    tool = result.report["session"].get("implement")
    worked = shapely.union_all(shapely.make_valid(np.asarray(shapes, object)))
    known = known or not tool
    return DatedSurface(result.name, start, result.zone, result.folder, after, before, worked, known, _sigma(result))


def _sigma(result: ResultFolder) -> FloatArray:
    """Medians over the session, no smaller than :data:`MIN_MOVE_SIGMA`."""
    poses = result.layer("trajectory").columns
    known = [poses[name][np.isfinite(poses[name])] for name in _SIGMA_COLUMNS]
    found = np.array([float(np.median(values)) if len(values) else np.nan for values in known])
    found[3:] = np.radians(found[3:])
    found[3:5] = np.hypot(*found[3:5])  # roll and pitch are of the vehicle, whatever its heading
    out: FloatArray = np.maximum(np.where(np.isfinite(found), found, _UNKNOWN_SIGMA), MIN_MOVE_SIGMA)
    return out


@dataclass(frozen=True)
class OpenSurface:
    """An open raster of one grid."""

    path: Path
    raster: Any
    grid: Grid

    def read(self, part: Grid, band: int = HEIGHT_INDEX) -> Float32Array:
        """A band on the cells of `part`: nan beside the raster, and everywhere where the file has no such band."""
        out = np.full(part.shape, np.nan, np.float32)
        shared = shared_cells(part, self.grid)
        if shared is not None and band <= self.raster.count:
            try:
                values = self.raster.read(band, window=window(shared, self.grid), masked=True, out_dtype="float32")
            except RasterioError as error:
                raise unusable(self.path, f"is damaged ({error})") from None
            out[shared.window_in(part)] = values.filled(np.nan)
        return out


@contextmanager
def open_surface(file: SurfaceFile) -> Iterator[OpenSurface]:
    """Open a surface whose cells are anchored."""
    assert file.grid is not None
    with open_geotiff(file.path, unusable) as raster:
        yield OpenSurface(file.path, raster, file.grid)


@contextmanager
def resample_surface(file: SurfaceFile, grid: Grid) -> Iterator[OpenSurface]:
    """Open a surface on other cells of its CRS, bilinear."""
    with (
        open_geotiff(file.path, unusable) as raster,
        WarpedVRT(raster, resampling=Resampling.bilinear, **warp_options(file, file.crs, grid)) as warped,
    ):
        yield OpenSurface(file.path, warped, grid)


def cells_inside(shape: BaseGeometry, grid: Grid, *, touched: bool) -> NDArray[np.bool_]:
    """Which cells lie in a shape: by their middles, or all that it touches."""
    if shape.is_empty or not shape.intersects(shapely.box(*grid.bounds_m)):
        return np.zeros(grid.shape, np.bool_)
    mask: NDArray[np.bool_] = geometry_mask(
        [shape], grid.shape, Affine(*grid.transform), all_touched=touched, invert=True
    )
    return mask
