"""The rasters of clouds: surfaces of their points, tile by tile, and rasters derived from these, window by window."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.pointclouds.joined_clouds import Clouds
from furrowmap.core.pointclouds.spooled_clouds import SpooledClouds
from furrowmap.core.pointclouds.surfaces import GroundMethod, cloud_tiles
from furrowmap.core.readers.geotiff import open_geotiff
from furrowmap.core.readers.las.cloud import Box
from furrowmap.core.readers.vector_file import VectorLayer
from furrowmap.core.runtime.arrays import Float32Array
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.surfaces.gaps import bridged
from furrowmap.core.surfaces.grid import Grid, Surface
from furrowmap.core.surfaces.outliers import filter_tiles
from furrowmap.core.surfaces.statistic import MEDIAN
from furrowmap.core.surfaces.terrain import (
    PLOT_M,
    Depressions,
    find_depressions,
    hillshade,
    random_roughness,
    slope_deg,
)
from furrowmap.exporters.farm.surface_file import unusable
from furrowmap.exporters.files.file_records import FileRecord
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import (
    DSM,
    DTM,
    HEIGHT_ABOVE_GROUND,
    HILLSHADE,
    LOW_SPOT_OUTLINES,
    LOW_SPOTS,
    ROUGHNESS,
    SLOPE,
)
from furrowmap.exporters.files.whole_layers import write_vector_layer
from furrowmap.exporters.rasters.cog import FILLED_BAND, SURFACE_BANDS, Band, Bands, cog_output, surface_arrays
from furrowmap.exporters.rasters.windows import is_last, plots_of, share_done, shared_cells, window, windows
from furrowmap.settings import SurfaceSettings

SURFACE_TITLE: Final = "surface"
"""Title of the raster whose statistic the user chooses."""
MAX_LOW_SPOT_CELLS: Final = 2_000_000
"""Low spots need the whole surface in memory: larger ones are coarsened."""
BRIDGED_M: Final = 1.0
"""Gaps up to this distance from seen heights are interpolated, so that no water runs off through them."""
CELLS_A_PLOT: Final = 5
"""Random roughness needs at least this many cells along a plot's side."""


def cells_of(path: Path, box_m: tuple[float, float, float, float], cell_m: float) -> tuple[Float32Array, Grid]:
    """Every n-th cell of the first band over west, south, east, north, of a size or less; nan where unknown."""
    with open_geotiff(path, unusable) as raster:
        size_m = raster.res[0]
        step = max(1, round(cell_m / size_m))
        grid = Grid.of_bounds(size_m * step, box_m)
        left, top = (round(edge / size_m) for edge in (raster.bounds.left, raster.bounds.top))
        whole = Grid(size_m, left, top, raster.shape)
        part = Grid(size_m, grid.west * step, grid.north * step, (grid.rows * step, grid.columns * step))
        heights = np.full(part.shape, np.nan, np.float32)
        shared = shared_cells(part, whole)
        if shared is not None:
            read = raster.read(1, window=window(shared, whole), masked=True)
            heights[shared.window_in(part)] = read.astype(np.float32).filled(np.nan)
    return heights[::step, ::step], grid


def extent_of(path: Path) -> tuple[float, float, float, float]:
    """West, south, east and north of a raster."""
    with open_geotiff(path, unusable) as raster:
        west, south, east, north = raster.bounds
    return float(west), float(south), float(east), float(north)


@dataclass(frozen=True)
class CloudRasters:
    """Computes and writes the rasters of clouds; `box` is in their CRS, `span_s` the earliest and latest UTC."""

    folder: Path
    clouds: Clouds
    grid: Grid
    settings: SurfaceSettings
    box: Box | None
    method: GroundMethod
    records: Sequence[FileRecord]
    span_s: tuple[float, float] | None

    @property
    def parameters(self) -> dict[str, Any]:
        """Parameters of the surfaces, as `surfaces.json` has them."""
        settings = self.settings
        return {
            "cell_m": self.grid.cell_m,
            "statistic": settings.cell_statistic.name,
            "ground": self.method,
            "outliers": settings.outliers,
            "every": settings.every,
            "fill_m": settings.fill_m,
            "tillage_heading_deg": settings.tillage_heading_deg,
            "classes": sorted(settings.classes) if settings.classes is not None else None,
            "box": list(self.box) if self.box is not None else None,
            "within": self.clouds.area.path.name if self.clouds.area is not None else None,
        }

    @property
    def ground_name(self) -> str:
        """The input of derived rasters: the ground, or the surface where the ground is not classified."""
        return DSM if self.method == "none" else DTM

    def write_surfaces(self, spooled: SpooledClouds, progress: Progress) -> None:
        """Write the surfaces of the points, which are spooled in cells of this size or of a fraction of it."""
        settings = self.settings
        points, ground = (
            filter_tiles(spool, settings.outliers, lambda share: progress("looking for noise", share))
            for spool in (spooled.points, spooled.ground)
        )
        made = cloud_tiles(spooled, self.method, self.grid.cell_m, settings.cell_statistic, (points, ground), progress)
        with ExitStack() as stack:
            put_dsm = stack.enter_context(self._output(_unfilled(DSM, settings), SURFACE_TITLE, SURFACE_BANDS))
            if self.method != "none":
                put_dtm = stack.enter_context(self._output(_unfilled(DTM, settings), "ground", SURFACE_BANDS))
                above = Band("height above ground")
                put_above = stack.enter_context(self._output(HEIGHT_ABOVE_GROUND, "height above ground", [above]))
            for tile in made:
                put_dsm(tile.grid, surface_arrays(tile.dsm))
                if tile.dtm is not None and tile.above_m is not None:
                    put_dtm(tile.grid, surface_arrays(tile.dtm))
                    put_above(tile.grid, [tile.above_m])
        if settings.fill_m > 0:
            for name in (DSM, DTM) if self.method != "none" else (DSM,):
                self._fill(name, progress)

    def write_derived(self, progress: Progress) -> tuple[dict[str, Any], list[Notice]]:
        """Write the rasters derived from the surfaces; returns their figures and notices."""
        grid = self.grid
        cell_m = self.grid.cell_m
        notices: list[Notice] = []
        shade = Band("hillshade", "1", 0)
        steep = Band("slope", "degree", 1024)
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
            notices.append(
                Notice("roughness-too-coarse", cell_m=cell_m, plot_m=PLOT_M, coarsest_m=PLOT_M / CELLS_A_PLOT)
            )
        spots, coarse = self._low_spots(progress)
        if coarse is not None:
            notices.append(coarse)
        with open_geotiff(self.folder / DSM, unusable) as raster:
            seen = sum(int(np.isfinite(raster.read(1, window=block)).sum()) for _, block in raster.block_windows(1))
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
        """Provenance of a raster."""
        stated = {
            name: ",".join(f"{part:.10g}" for part in value) if isinstance(value, list) else value
            for name, value in self.parameters.items()
        }
        statistic = self.settings.cell_statistic if title == SURFACE_TITLE or self.method == "none" else MEDIAN
        units = ", ".join(f"{unit:.10g}" for unit in self.clouds.units_m)
        parameters = {**stated, "statistic": statistic.name, "heights_unit_m": units}
        if self.clouds.crs.is_compound:
            parameters["heights"] = self.clouds.crs.sub_crs_list[1].name
        inputs = [(record.name, record.sha256) for record in self.records]
        return Origin(title, inputs=inputs, span_s=self.span_s, parameters=parameters)

    def _fill(self, name: str, progress: Progress) -> None:
        """Fill the gaps of a surface, window by window with a margin."""
        source = self.folder / _unfilled(name, self.settings)
        reach = self.settings.fill_m / self.grid.cell_m
        title = SURFACE_TITLE if name == DSM else "ground"
        with self._output(name, title, [*SURFACE_BANDS, FILLED_BAND]) as put, open_geotiff(source, unusable) as raster:
            for inner, outer in windows(self.grid, int(2 * reach) + 1):
                bands = raster.read(window=window(outer, self.grid))
                height = bridged(bands[0].astype(np.float64), reach)
                new = np.isfinite(height) & ~np.isfinite(bands[0])
                if (area := self.clouds.area) is not None:
                    beyond = new & ~area.contains(outer.positions_m()).reshape(new.shape)
                    height[beyond] = np.nan
                    new[beyond] = False
                arrays: Bands = [height, *bands[1:], new.astype(np.float32)]
                own = inner.window_in(outer)
                put(inner, [array[own] for array in arrays])
                progress("filling gaps", share_done(inner, self.grid))
        source.unlink()

    def _roughness(self, progress: Progress) -> None:
        """Write random roughness; a plot belongs to the window that contains its corner."""
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
                own = plots_of(inner, plots, last=is_last(inner, self.grid))
                if own is not None:
                    whole = np.full(own.shape, np.nan, np.float32)
                    if (shared := shared_cells(own, there)) is not None:
                        whole[shared.window_in(own)] = rough[shared.window_in(there)]
                    put(own, [whole])

    def _low_spots(self, progress: Progress) -> tuple[Depressions, Notice | None]:
        """Write the low spots of the ground; returns them, and a notice where the surface was coarsened."""
        grid = self.grid
        factor = 1
        while (grid.rows // factor + 1) * (grid.columns // factor + 1) > MAX_LOW_SPOT_CELLS:
            factor += 1
        coarse = grid.coarser(factor)
        total = np.zeros(coarse.shape)
        count = np.zeros(coarse.shape, np.uint32)
        reach = max(self.settings.fill_m, BRIDGED_M) / grid.cell_m
        for inner, outer, found in self._windows(self.ground_name, int(2 * reach) + 1, progress, "finding low spots"):
            # Water would run off through every cell without a point.
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
            columns = {
                "level_m": spots.level_m,
                "depth_m": spots.greatest_depth_m,
                "area_m2": spots.area_m2,
                "volume_m3": spots.volume_m3,
            }
            layer = VectorLayer(np.array(spots.polygons(), object), columns, self.clouds.crs)
            write_vector_layer(self.folder / LOW_SPOT_OUTLINES, layer, "low_spots", "GPKG", origin.metadata)
        if factor == 1:
            return spots, None
        return spots, Notice("low-spots-coarser", cell_m=coarse.cell_m, factor=factor)

    def _windows(
        self, name: str, margin: int, progress: Progress, stage: str
    ) -> Iterator[tuple[Grid, Grid, NDArray[np.float32]]]:
        """Windows of a finished surface that have a height: own cells, cells with a margin, and their heights."""
        with open_geotiff(self.folder / name, unusable) as raster:
            for inner, outer in windows(self.grid, margin):
                height = raster.read(1, window=window(outer, self.grid))
                if np.isfinite(height).any():
                    yield inner, outer, height
                progress(stage, share_done(inner, self.grid))


def _unfilled(name: str, settings: SurfaceSettings) -> str:
    """File of a surface before gaps are filled."""
    return f"unfilled_{name}" if settings.fill_m > 0 else name
