"""From clouds to a folder of surfaces."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import rasterio
from numpy.typing import NDArray
from pyproj import CRS
from rasterio.windows import Window
from scipy.ndimage import distance_transform_edt

from furrowmap.core.cloud_surfaces import GroundMethod, SpooledClouds, cell_for, cloud_tiles, spool_clouds
from furrowmap.core.clouds import Clouds, open_clouds
from furrowmap.core.readers.las.cloud import Box
from furrowmap.core.surfaces.accompanied import Outliers
from furrowmap.core.surfaces.depressions import Depressions, find_depressions
from furrowmap.core.surfaces.gaps import filled
from furrowmap.core.surfaces.grid import Grid, Surface
from furrowmap.core.surfaces.spool import PointSpool
from furrowmap.core.surfaces.statistic import MEDIAN, Statistic
from furrowmap.core.surfaces.terrain import PLOT_M, hillshade, random_roughness, slope_deg
from furrowmap.core.values.crs_name import name_of
from furrowmap.core.values.errors import InputError, Notice, RefusedError
from furrowmap.core.values.progress import Progress, silent
from furrowmap.exporters.cog import FILLED, SURFACE_BANDS, Band, Bands, cog_output, surface_arrays
from furrowmap.exporters.json_text import json_text, plain
from furrowmap.exporters.provenance import Origin
from furrowmap.exporters.report import FileRecord, file_records
from furrowmap.exporters.staging import recover, refuse_products, staged_folder

DSM: Final = "dsm.tif"
DTM: Final = "dtm.tif"
ABOVE: Final = "height_above_ground.tif"
HILLSHADE: Final = "hillshade.tif"
SLOPE: Final = "slope.tif"
ROUGHNESS: Final = "roughness.tif"
LOW_SPOTS: Final = "low_spots.tif"
LOW_SPOT_OUTLINES: Final = "low_spots.gpkg"
ACCOUNT: Final = "surfaces.json"
PRODUCTS: Final = (DSM, DTM, ABOVE, HILLSHADE, SLOPE, ROUGHNESS, LOW_SPOTS, LOW_SPOT_OUTLINES, ACCOUNT)
RUN_REPORT: Final = "report.json"
SURFACE: Final = "surface"
"""Title of the raster whose statistic is of the user's choice."""
CACHE_BYTES: Final = 64 << 20
WINDOW: Final = 1024
"""Cells a side of the squares in which finished surfaces are read again."""
MOST_LOW_SPOT_CELLS: Final = 2_000_000
"""Water finds its way over the whole land at once: larger surfaces are coarsened for it."""
BRIDGED_M: Final = 1.0
"""Gaps up to so far from seen heights let no water through."""
CELLS_A_PLOT: Final = 5
"""Random roughness needs cells of a fifth of its plots at most."""
MANY_CELLS: Final = 10_000_000
"""Cells that take half a minute or more, of which nobody wants to wait for the empty ones."""
SPARSE_SHARE: Final = 0.05
"""Points a cell below which most of a grid stays empty: cells of a fair size hold four points where there are any."""


def unheard(notice: Notice) -> None:
    """A listener to warnings who does not listen."""


@dataclass(frozen=True)
class CloudSettings:
    """What surfaces are asked for.

    Attributes:
        cell_m: length of a cell's sides; None for one that the density of the points asks for.
        box: west, south, east, north in the CRS of the surfaces; None for all.
        box_crs: of the box, if that is another one.
        classes: of points that are wanted; None for all but noise, and in furrowmap's own clouds vehicle and implement.
        statistic: what stands for the points of a cell.
        ground: how the ground is told; "auto" for the files' own classes where they have them, else "smrf".
        outliers: how points that are alone are told.
        every: every so many-th point is taken.
        fill_m: gaps are filled in which no place is farther than this from a seen height; 0 for none.
        tillage_heading_deg: direction of tillage, clockwise from grid north: random roughness is without its marks.
        crs: of files that state none.
        dst_crs: of the surfaces; None for the files' own.
    """

    cell_m: float | None = None
    box: Box | None = None
    box_crs: CRS | None = None
    classes: frozenset[int] | None = None
    statistic: Statistic = MEDIAN
    ground: GroundMethod | Literal["auto"] = "auto"
    outliers: Outliers = "none"
    every: int = 1
    fill_m: float = 0.0
    tillage_heading_deg: float | None = None
    crs: CRS | None = None
    dst_crs: CRS | None = None


def write_cloud_surfaces(
    paths: Sequence[Path],
    folder: Path,
    settings: CloudSettings,
    *,
    overwrite: bool = False,
    progress: Progress = silent,
    warn: Callable[[Notice], None] = unheard,
) -> dict[str, Any]:
    """Make the surfaces of clouds and put them into a folder, all together or none.

    Args:
        paths: of LAS, LAZ or COPC files.
        folder: made if it is not there.
        settings: what is asked for.
        overwrite: replace earlier surfaces in the folder.
        progress: is told of the stages.
        warn: is told each warning once, those of the clouds and of long work before that begins.

    Returns:
        The content of `surfaces.json`.

    Raises:
        InputError: if a cloud cannot be read, their CRS do not fit, or no point is left.
        RefusedError: if there are surfaces in the folder already, or it is that of a run.
        OSError: if the folder cannot be written to.
    """
    _refuse_occupied(folder, overwrite=overwrite)
    clouds = open_clouds(paths, settings.crs, settings.dst_crs)
    box = box_in(clouds, settings.box, settings.box_crs)
    warnings: list[Notice] = []

    def tell(notices: Sequence[Notice]) -> None:
        for notice in notices:
            if notice not in warnings:
                warnings.append(notice)
                warn(notice)

    # GDAL would keep a twentieth of the computer's memory of what it has read.
    with staged_folder(folder) as staging, rasterio.Env(GDAL_CACHEMAX=CACHE_BYTES):
        cell_m = settings.cell_m
        if cell_m is None:
            cell_m = cell_for(clouds, box, settings.classes, progress)
        with PointSpool(cell_m, folder=staging) as points, PointSpool(cell_m, folder=staging) as ground:
            spooled = spool_clouds(clouds, points, ground, box, settings.classes, settings.every, progress)
            grid = points.grid
            if grid is None:
                raise nothing_left(clouds, box)
            method = _method(settings, spooled)
            tell([*clouds.notices, *spooled.notices, *_mostly_empty(grid, spooled.count)])
            records = [file_records([path], path.parent, progress)[0] for path in paths]
            work = _Work(staging, clouds, grid, settings, box, method, records, spooled.span_s)
            work.surfaces(spooled, progress)
        figures, notices = work.derived(progress)
        tell(notices)
        account = {
            "furrowmap": version("furrowmap"),
            "inputs": [
                {"name": record.name, "format": file.format, "points": file.points, "sha256": record.sha256}
                for record, file in zip(records, clouds.files, strict=True)
            ],
            "crs": name_of(clouds.crs),
            "parameters": work.parameters,
            "figures": {
                "points": spooled.count,
                "cell_m": cell_m,
                "columns": grid.columns,
                "rows": grid.rows,
                **figures,
            },
            "warnings": warnings,
            "products": sorted([*(path.name for path in staging.iterdir()), ACCOUNT]),
        }
        (staging / ACCOUNT).write_text(json_text(account), encoding="utf-8")
    return dict(plain(account))


@dataclass(frozen=True)
class _Work:
    """Where the surfaces of clouds go, and what is told of them."""

    folder: Path
    clouds: Clouds
    grid: Grid
    settings: CloudSettings
    box: Box | None
    method: GroundMethod
    records: Sequence[FileRecord]
    span_s: tuple[float, float] | None

    @property
    def parameters(self) -> dict[str, Any]:
        settings = self.settings
        return {
            "cell_m": self.grid.cell_m,
            "statistic": settings.statistic.name,
            "ground": self.method,
            "outliers": settings.outliers,
            "every": settings.every,
            "fill_m": settings.fill_m,
            "tillage_heading_deg": settings.tillage_heading_deg,
            "classes": sorted(settings.classes) if settings.classes is not None else None,
            "box": list(self.box) if self.box is not None else None,
        }

    @property
    def ground_name(self) -> str:
        """The surface that is shaded, measured and flooded: the ground, or all where that is not told."""
        return DSM if self.method == "none" else DTM

    def surfaces(self, spooled: SpooledClouds, progress: Progress) -> None:
        """The surfaces that come from the points themselves."""
        settings = self.settings
        with ExitStack() as stack:
            put_dsm = stack.enter_context(self._output(_unfilled(DSM, settings), SURFACE, SURFACE_BANDS))
            if self.method != "none":
                put_dtm = stack.enter_context(self._output(_unfilled(DTM, settings), "ground", SURFACE_BANDS))
                above = Band("height above ground")
                put_above = stack.enter_context(self._output(ABOVE, "height above ground", [above]))
            for tile in cloud_tiles(spooled, self.method, settings.statistic, settings.outliers, progress):
                put_dsm(tile.grid, surface_arrays(tile.dsm))
                if tile.dtm is not None and tile.above_m is not None:
                    put_dtm(tile.grid, surface_arrays(tile.dtm))
                    put_above(tile.grid, [tile.above_m])
        if settings.fill_m > 0:
            for name in (DSM, DTM) if self.method != "none" else (DSM,):
                self._fill(name, progress)

    def derived(self, progress: Progress) -> tuple[dict[str, Any], list[Notice]]:
        """The surfaces that come from finished ones; figures and notices of them."""
        grid, cell_m = self.grid, self.grid.cell_m
        notices: list[Notice] = []
        shade, steep = Band("hillshade", "1", 0), Band("slope", "degree", 1024)
        with (
            self._output(HILLSHADE, "hillshade of the ground", [shade]) as put_shade,
            self._output(SLOPE, "slope of the ground", [steep]) as put_slope,
        ):
            for inner, outer, height in self._windows(self.ground_name, 1, progress, "shading"):
                own = inner.window_in(outer)
                light = hillshade(height, cell_m).astype(np.float32)
                light[light == 0] = np.nan
                put_shade(inner, [light[own]])
                put_slope(inner, [slope_deg(height, cell_m)[own]])
        if CELLS_A_PLOT * cell_m <= PLOT_M:
            self._roughness(progress)
        else:
            text = (
                f"Cells of {cell_m:g} m are too coarse for random roughness, which is told of plots of {PLOT_M:g} m: "
                f"there is none. It takes cells of {PLOT_M / CELLS_A_PLOT:g} m or less."
            )
            notices.append(Notice("roughness-too-coarse", text))
        spots, coarse = self._low_spots(progress)
        if coarse is not None:
            notices.append(coarse)
        seen = self._seen()
        figures = {
            "area_m2": round(seen * grid.cell_area_m2, 2),
            "low_spots": len(spots),
            "low_spots_area_m2": round(float(spots.area_m2.sum()), 2),
            "low_spots_volume_m3": round(float(spots.volume_m3.sum()), 4),
        }
        return figures, notices

    def _output(self, name: str, title: str, bands: Sequence[Band]) -> Any:
        return cog_output(self.folder / name, self.grid, self.clouds.crs, bands, self._origin(title))

    def _origin(self, title: str) -> Origin:
        """What is told inside a raster."""
        stated = {name: _text(value) for name, value in self.parameters.items() if value is not None}
        statistic = self.settings.statistic if title == SURFACE or self.method == "none" else MEDIAN
        parameters = {**stated, "statistic": statistic.name, "heights_unit_m": f"{self.clouds.unit_m:.10g}"}
        if self.clouds.crs.is_compound:
            parameters["heights"] = self.clouds.crs.sub_crs_list[1].name
        inputs = [(record.name, record.sha256) for record in self.records]
        return Origin(title, inputs=inputs, span_s=self.span_s, parameters=parameters)

    def _fill(self, name: str, progress: Progress) -> None:
        """Fill the gaps of a surface, window by window, each with what lies round it."""
        source = self.folder / _unfilled(name, self.settings)
        reach = self.settings.fill_m / self.grid.cell_m
        title = SURFACE if name == DSM else "ground"
        with self._output(name, title, [*SURFACE_BANDS, FILLED]) as put, rasterio.open(source) as raster:
            for inner, outer in _windows(self.grid, int(2 * reach) + 1):
                bands = raster.read(window=_window(outer, self.grid))
                height = bridged(bands[0].astype(np.float64), reach)
                new = np.isfinite(height) & ~np.isfinite(bands[0])
                arrays: Bands = [height, *bands[1:], new.astype(np.float32)]
                own = inner.window_in(outer)
                put(inner, [array[own] for array in arrays])
                progress("filling gaps", _share(inner, self.grid))
        source.unlink()

    def _roughness(self, progress: Progress) -> None:
        west, south, east, north = self.grid.bounds_m
        inset = 0.5 * self.grid.cell_m
        plots = Grid.of_bounds(PLOT_M, (west + inset, south + inset, east - inset, north - inset))
        origin = self._origin("random roughness")
        margin = int(np.ceil(PLOT_M / self.grid.cell_m)) + 1
        with cog_output(self.folder / ROUGHNESS, plots, self.clouds.crs, [Band("random roughness")], origin) as put:
            for inner, outer, height in self._windows(self.ground_name, margin, progress, "measuring roughness"):
                count = np.isfinite(height).astype(np.uint32)
                surface = Surface(outer, height, count, height, height)
                there, rough = random_roughness(surface, tillage_heading_deg=self.settings.tillage_heading_deg)
                own = _plots_of(inner, plots, last=_last(inner, self.grid))
                if own is not None:
                    rows, columns = _common(own, there)
                    whole = np.full(own.shape, np.nan, np.float32)
                    whole[rows[0], columns[0]] = rough[rows[1], columns[1]]
                    put(own, [whole])

    def _low_spots(self, progress: Progress) -> tuple[Depressions, Notice | None]:
        grid = self.grid
        factor = 1
        while (grid.rows // factor + 1) * (grid.columns // factor + 1) > MOST_LOW_SPOT_CELLS:
            factor += 1
        coarse = Grid(
            grid.cell_m * factor,
            grid.west // factor,
            -(-grid.north // factor),
            (
                -(-grid.north // factor) - (grid.north - grid.rows) // factor,
                -(-(grid.west + grid.columns) // factor) - grid.west // factor,
            ),
        )
        total, count = np.zeros(coarse.shape), np.zeros(coarse.shape, np.uint32)
        reach = max(self.settings.fill_m, BRIDGED_M) / grid.cell_m
        for inner, outer, found in self._windows(self.ground_name, int(2 * reach) + 1, progress, "finding low spots"):
            # Water would run off through every cell that happens to have no point in it.
            height = bridged(found.astype(np.float64), reach)[inner.window_in(outer)]
            row = coarse.north - 1 - (inner.north - 1 - np.arange(inner.rows)) // factor
            column = (inner.west + np.arange(inner.columns)) // factor - coarse.west
            at = np.ix_(row, column)
            known = np.isfinite(height)
            np.add.at(total, at, np.where(known, height, 0.0))
            np.add.at(count, at, known.astype(np.uint32))
        height = np.divide(total, count, out=np.full(coarse.shape, np.nan), where=count > 0)
        spots = find_depressions(height, coarse)
        origin = self._origin("low spots")
        with cog_output(self.folder / LOW_SPOTS, coarse, self.clouds.crs, [Band("depth of water")], origin) as put:
            put(coarse, [spots.depth_m])
        if len(spots):
            _write_outlines(self.folder / LOW_SPOT_OUTLINES, spots, self.clouds.crs, origin)
        if factor == 1:
            return spots, None
        text = (
            f"Low spots are looked for in cells of {coarse.cell_m:g} m, means of {factor} x {factor} of the surface's: "
            "water finds its way over the whole land at once, which must fit into memory."
        )
        return spots, Notice("low-spots-coarser", text)

    def _seen(self) -> int:
        with rasterio.open(self.folder / DSM) as raster:
            return sum(int(np.isfinite(raster.read(1, window=window)).sum()) for _, window in raster.block_windows(1))

    def _windows(
        self, name: str, margin: int, progress: Progress, stage: str
    ) -> Iterator[tuple[Grid, Grid, NDArray[np.float32]]]:
        """Squares of a finished surface: each one's own cells, those with a margin round them, and their heights.

        Squares without any height are passed over.
        """
        with rasterio.open(self.folder / name) as raster:
            for inner, outer in _windows(self.grid, margin):
                height = raster.read(1, window=_window(outer, self.grid))
                if np.isfinite(height).any():
                    yield inner, outer, height
                progress(stage, _share(inner, self.grid))


def bridged(height_m: NDArray[np.float64], reach: float) -> NDArray[np.float64]:
    """Heights with the gaps filled in which no cell is farther than `reach` cells from a seen one, and nothing outside.

    What is filled is where a disk of that radius cannot stand without touching seen cells (their morphological
    closing), so that nothing grows beyond the border of what was seen.
    """
    seen = np.isfinite(height_m)
    if seen.all() or not seen.any():
        return height_m
    rim = int(np.ceil(reach)) + 1
    near = distance_transform_edt(~np.pad(seen, rim)) <= reach
    closed = np.asarray(distance_transform_edt(near))[rim:-rim, rim:-rim] > reach
    return np.where(closed | seen, filled(height_m, reach), np.nan)


def _unfilled(name: str, settings: CloudSettings) -> str:
    return f"unfilled_{name}" if settings.fill_m > 0 else name


def _windows(grid: Grid, margin: int) -> Iterator[tuple[Grid, Grid]]:
    """Squares of a grid, and the same with a margin as far as the grid reaches; north first, then west."""
    for row in range(0, grid.rows, WINDOW):
        for column in range(0, grid.columns, WINDOW):
            rows, columns = min(WINDOW, grid.rows - row), min(WINDOW, grid.columns - column)
            top, left = max(0, row - margin), max(0, column - margin)
            bottom, right = min(grid.rows, row + rows + margin), min(grid.columns, column + columns + margin)
            inner = Grid(grid.cell_m, grid.west + column, grid.north - row, (rows, columns))
            yield inner, Grid(grid.cell_m, grid.west + left, grid.north - top, (bottom - top, right - left))


def _window(part: Grid, whole: Grid) -> Window:
    return Window(part.west - whole.west, whole.north - part.north, part.columns, part.rows)


def _share(inner: Grid, whole: Grid) -> float:
    return (whole.north - inner.north + inner.rows) / whole.rows


def _last(inner: Grid, whole: Grid) -> tuple[bool, bool]:
    """Whether a window is the southernmost, and whether the easternmost."""
    south = inner.north - inner.rows == whole.north - whole.rows
    return south, inner.west + inner.columns == whole.west + whole.columns


def _plots_of(inner: Grid, plots: Grid, last: tuple[bool, bool]) -> Grid | None:
    """The plots whose north-west corner lies in a window, so that each is one window's; None where there are none."""
    cell = inner.cell_m / plots.cell_m
    west, east = np.floor(inner.west * cell), np.floor((inner.west + inner.columns) * cell)
    north, south = np.ceil(inner.north * cell), np.ceil((inner.north - inner.rows) * cell)
    west, north = max(int(west), plots.west), min(int(north), plots.north)
    east = plots.west + plots.columns if last[1] else int(east)
    south = plots.north - plots.rows if last[0] else int(south)
    return Grid(plots.cell_m, west, north, (north - south, east - west)) if north > south and east > west else None


def _common(own: Grid, there: Grid) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Rows, and columns, that two grids have in common, in the first and in the second."""
    top, bottom = min(own.north, there.north), max(own.north - own.rows, there.north - there.rows)
    left, right = max(own.west, there.west), min(own.west + own.columns, there.west + there.columns)
    rows = slice(own.north - top, own.north - bottom), slice(there.north - top, there.north - bottom)
    return rows, (slice(left - own.west, right - own.west), slice(left - there.west, right - there.west))


def _write_outlines(path: Path, spots: Depressions, crs: CRS, origin: Origin) -> None:
    import geopandas

    frame = geopandas.GeoDataFrame(
        {
            "level_m": spots.level_m,
            "depth_m": spots.greatest_depth_m,
            "area_m2": spots.area_m2,
            "volume_m3": spots.volume_m3,
        },
        geometry=spots.polygons(),
        crs=crs,
    )
    frame.to_file(path, layer="low_spots", driver="GPKG", engine="pyogrio", dataset_metadata=origin.told)


def _method(settings: CloudSettings, spooled: SpooledClouds) -> GroundMethod:
    """How the ground is told.

    Raises:
        InputError: if by the files' classes, and they have none.
    """
    if settings.ground == "class" and not spooled.ground_count:
        raise InputError(
            "Ground by 'class': no point of the clouds has the class 2, ground.",
            "Nobody has told the ground from what stands on it in these files, or those points are left out.",
            "Choose --ground-method smrf.",
            code="no-ground-class",
        )
    if settings.ground == "auto":
        return "class" if spooled.classified else "smrf"
    return settings.ground


def _text(value: object) -> str:
    return ",".join(f"{part:.10g}" for part in value) if isinstance(value, list) else str(value)


def box_in(clouds: Clouds, box: Box | None, box_crs: CRS | None) -> Box | None:
    """A box in the CRS in which the points of clouds are given out."""
    if box is None or box_crs is None:
        return box
    from pyproj import Transformer

    change = Transformer.from_crs(box_crs.to_2d(), clouds.crs.to_2d(), always_xy=True)
    west, south, east, north = change.transform_bounds(*box)
    return west, south, east, north


def nothing_left(clouds: Clouds, box: Box | None) -> InputError:
    """What to say where no point of clouds is wanted."""
    within = f" within {', '.join(f'{value:g}' for value in box)}" if box is not None else ""
    return InputError(
        f"Of {clouds.points:,} points in {len(clouds.files)} file(s) none is left{within}.",
        "All lie outside the box, or are of other classes, or the files hold none.",
        "`furrowmap inspect` says where the points lie and which classes they have.",
        code="no-points-left",
    )


def _mostly_empty(grid: Grid, points: int) -> list[Notice]:
    """What is to be known of a long wait for cells without points, before it begins."""
    cells = grid.rows * grid.columns
    if cells < MANY_CELLS or points >= SPARSE_SHARE * cells:
        return []
    text = (
        f"{points:,} points lie in a grid of {grid.columns:,} x {grid.rows:,} = {cells:,} cells of {grid.cell_m:g} m, "
        "so most of it stays empty and making it takes minutes. Choose larger cells (--cell; without it their density "
        "chooses), a box (--bbox), or leave out points that lie far away from the others."
    )
    return [Notice("cells-mostly-empty", text)]


def _refuse_occupied(folder: Path, *, overwrite: bool) -> None:
    """Keep what is in the folder.

    Raises:
        RefusedError: if it holds surfaces that may not be replaced, or the products of a run.
    """
    if not folder.is_dir():
        return
    recover(folder)
    if (folder / RUN_REPORT).exists():
        raise RefusedError(
            f"{folder} holds the products of a run.",
            "Its own dsm.tif would be replaced by another one.",
            "Choose another folder with -o.",
            code="output-is-run",
        )
    refuse_products(folder, PRODUCTS, overwrite=overwrite)
