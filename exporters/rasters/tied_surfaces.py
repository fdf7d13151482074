"""The surfaces of several dates, as they are and as their ties move them, and the changes between them."""

import datetime as dt
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from zoneinfo import ZoneInfo

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS
from rasterio.enums import Resampling
from rasterio.features import geometry_mask
from rasterio.transform import Affine
from rasterio.vrt import WarpedVRT
from shapely.geometry.base import BaseGeometry

from furrowmap.core.coregistration.pair_tie import GroundPair, PairTie
from furrowmap.core.coverage.field_surfaces import BESIDE_M
from furrowmap.core.readers.geotiff import open_geotiff
from furrowmap.core.readers.raster_heights import plain_heights
from furrowmap.core.runtime.arrays import Float32Array, FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.mean_change import ChangeSums, MeanChange
from furrowmap.core.surfaces.moved_surface import move_surface, reach_cells
from furrowmap.exporters.farm.surface_file import OpenSurface, SurfaceFile, height_surface, unusable, warp_options
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import DSM, DSM_BEFORE, ResultFolder
from furrowmap.exporters.rasters.cog import CHANGE_BANDS, HEIGHT_BAND, STANDARD_ERROR_BAND, cog_output
from furrowmap.exporters.rasters.windows import shared_cells, windows
from furrowmap.exporters.vectors.field_layers import Columns, Layer, geometry_array, numbers, texts

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
    after = height_surface(result.folder / DSM, unusable)
    before = height_surface(result.folder / DSM_BEFORE, unusable) if (result.folder / DSM_BEFORE).is_file() else after
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


@contextmanager
def resample_surface(file: SurfaceFile, grid: Grid) -> Iterator[OpenSurface]:
    """Open a surface on other cells of its CRS, bilinear."""
    with (
        open_geotiff(file.path, unusable) as raster,
        plain_heights(raster, file.scale, file.path) as plain,
        WarpedVRT(plain, resampling=Resampling.bilinear, **warp_options(file, file.crs, grid)) as warped,
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


def tie_layers(
    outlines: Sequence[Any],
    dates: Sequence[Mapping[str, Any]],
    ties: Mapping[tuple[int, int], PairTie],
    rows: Sequence[Mapping[str, Any]],
) -> list[Layer]:
    """The layers of `tie.gpkg`, the topmost first."""
    number = np.concatenate([np.full(len(tie.departures), k) for k, tie in enumerate(ties.values())] or [np.zeros(0)])
    places = np.concatenate([np.zeros((0, 2)), *[tie.departures.xy_m for tie in ties.values()]])
    off = np.concatenate([np.zeros(0), *[tie.departures.height_m for tie in ties.values()]])
    of_tie = number.astype(np.intp)
    pairs = np.array(list(ties), np.int32).reshape(-1, 2) + 1
    patches: Columns = {"date_a": pairs[of_tie, 0], "date_b": pairs[of_tie, 1], "departure_m": off}
    layers = [
        Layer("patches", "Point", "Patches of common ground: what they depart from their tie",
              geometry_array(shapely.points(places)), patches),
        Layer("ties", "MultiPoint", "Ties: two dates, and the patches of ground that tie them",
              geometry_array([shapely.MultiPoint(tie.departures.xy_m) for tie in ties.values()]), _columns(rows)),
        Layer("dates", "Polygon", "Dates: what moves each surface", geometry_array(list(outlines)), _columns(dates)),
    ]  # fmt: skip
    return [layer for layer in layers if len(layer.shapes)]


def _columns(rows: Sequence[Mapping[str, Any]]) -> Columns:
    """Fields of figures; what is not known is nan or empty."""
    columns: Columns = {}
    for name in rows[0] if rows else ():
        values = [row[name] for row in rows]
        if all(isinstance(value, str) for value in values):
            columns[name] = texts(values)
        elif all(isinstance(value, (bool, np.bool_)) for value in values):
            columns[name] = np.array(values, np.int8)
        elif all(isinstance(value, int) for value in values):
            columns[name] = np.array(values, np.int64)
        else:
            columns[name] = numbers(math.nan if value is None else float(value) for value in values)
    return columns


PIECE_CELLS: Final = 500
"""Side of the pieces of ground that ties are made of: 25 m, a whole number of patches."""
MAX_PIECES: Final = 64
"""Four hectares show a tie as well as forty do."""


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
        first = one.read(piece)
        second = other.read(piece)
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
    """The change between two dates: where tools worked, at some cells (n, 2), and at cells that no tool touched."""

    moved: MeanChange
    places_m: FloatArray
    untouched_m: FloatArray


def write_change(
    path: Path,
    pair: tuple[Mover, Mover],
    crs: CRS,
    origin: Origin,
    *,
    worked: BaseGeometry,
    before: BaseGeometry,
    touched: BaseGeometry,
) -> ChangeFigures | None:
    """Write the change between two dates where both saw the ground; None where they share no cell.

    `worked` is the ground that tools worked between the dates, `before` on the first or earlier, `touched` on either or
    between, with a margin.

    Ground worked for the first time rises by centimetres, ground worked again hardly, and is better seen, as it lies
    where the earlier drive was: they are two kinds.
    """
    one, other = pair
    grid = shared_cells(one.surface.grid, other.surface.grid)
    if grid is None:
        return None
    sums = ChangeSums()
    places = [np.zeros((0, 2))]
    calm = [np.zeros(0, np.float32)]
    with cog_output(path, grid, crs, CHANGE_BANDS, origin) as put:
        for part, _ in windows(grid, 0):
            first = one.heights(part)
            change = other.heights(part) - first
            error = np.hypot(other.surface.read(part, ERROR_INDEX), one.surface.read(part, ERROR_INDEX))
            put(part, (change, np.where(np.isfinite(change), error, np.float32(np.nan))))
            relief = np.hypot(other.surface.read(part, SPREAD_INDEX), one.surface.read(part, SPREAD_INDEX))
            now = cells_inside(worked, part, touched=False)
            again = cells_inside(before, part, touched=False)
            sums.add(now * (1 + again), change, error, relief, first, one.surface.read(part, RETURNS_INDEX))
            places.append(part.positions_m()[(now & np.isfinite(change)).ravel()][::20])
            still = np.isfinite(change) & ~cells_inside(touched, part, touched=True)
            calm.append(change[still][::5])
    still_m = np.concatenate(calm).astype(np.float64)
    return ChangeFigures(sums.mean(grid.cell_area_m2, (1, 2)), np.concatenate(places), still_m)


def union_shapes(shapes: Sequence[BaseGeometry]) -> BaseGeometry:
    """Ground in any of the shapes."""
    return shapely.union_all(np.asarray([*shapes, shapely.Polygon()], object))
