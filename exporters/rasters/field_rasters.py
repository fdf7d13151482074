"""Rasters of a run: surfaces and their change; of a flight ground, density and overlap of strips."""

import math
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from pyproj import CRS

from furrowmap.core.coverage.field_surfaces import FieldPoints, FieldTile, SoilMoved, SoilSums, tool_passages
from furrowmap.core.coverage.strip_outlines import StripGround, StripOutlines
from furrowmap.core.coverage.tool_edges import ToolEdges
from furrowmap.core.pipeline.run_result import RunResult
from furrowmap.core.pointclouds.surfaces import cloud_tiles
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.mean_change import MeanChange
from furrowmap.core.surfaces.statistic import MEDIAN
from furrowmap.core.surfaces.visits import SWATH_BLOCK, SwathDifferences, SwathSums
from furrowmap.core.values.session import Implement
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import (
    CHANGE,
    DENSITY,
    DSM,
    DSM_BEFORE,
    DTM,
    HEIGHT_ABOVE_GROUND,
    STRIP_OVERLAP,
    SWATHS,
)
from furrowmap.exporters.rasters.cog import (
    CHANGE_BANDS,
    SURFACE_BANDS,
    Band,
    Bands,
    cog_output,
    surface_arrays,
    with_heights,
)
from furrowmap.exporters.vectors.qgis_styles import write_raster_style

STYLES: Final = {
    DSM: "dsm.qml",
    DSM_BEFORE: "dsm.qml",
    CHANGE: "change.qml",
    SWATHS: "swaths.qml",
    DTM: "dsm.qml",
    HEIGHT_ABOVE_GROUND: "height_above_ground.qml",
    DENSITY: "density.qml",
    STRIP_OVERLAP: "strip_overlap.qml",
}
SWATH_BANDS: Final = (Band("difference of swaths"),)
DENSITY_BANDS: Final = (Band("points a square metre", "1/m2", 0),)
OVERLAP_BANDS: Final = (Band("strips", "1", 0),)
_RASTER_TITLES: Final = {
    DSM: "Surface as left at the end",
    DSM_BEFORE: "Surface before the implement passed",
    CHANGE: "Change of the surface: after less before",
    SWATHS: "Agreement of swaths: height in a swath less that in the one before it",
    DTM: "Terrain model",
    HEIGHT_ABOVE_GROUND: "Height above ground",
    DENSITY: "Points a square metre",
    STRIP_OVERLAP: "Number of strips that cover the ground",
}
_GROUND: Final = {DTM: SURFACE_BANDS, HEIGHT_ABOVE_GROUND: (Band("height above ground"),)}
_RASTER_STATISTICS: Final = {SWATHS: "mean", DENSITY: "count", STRIP_OVERLAP: "count"}


@dataclass(frozen=True)
class RasterFigures:
    """Figures of the surfaces for the report.

    `seen_m2` has a height in `dsm.tif`; `moved` and `swaths` are None where no work is known or no ground was seen
    twice; `strips` are of a flight; `notices` say what the surfaces contradict.
    """

    cell_m: float
    seen_m2: float
    moved: SoilMoved | None
    swaths: SwathDifferences | None
    strips: tuple[StripGround, ...] = ()
    notices: tuple[Notice, ...] = ()

    def plain(self) -> dict[str, Any]:
        """As in `report.json`."""
        figures: dict[str, Any] = {"dsm_cell_m": self.cell_m, "dsm_area_m2": round(self.seen_m2, 1)}
        if self.moved is None:
            return figures
        passes = [{"pass": number, **_moved(moved)} for number, moved in self.moved.passes.items()]
        beside = {"area_m2": round(self.moved.beside_m2, 2), "mean_change_m": _known(self.moved.beside_m)}
        return figures | {"soil_moved": {**_moved(self.moved.worked), "beside_passes": beside, "passes": passes}}


def write_rasters(
    folder: Path, land: FieldPoints, found: RunResult, origin: Origin, progress: Progress
) -> RasterFigures | None:
    """Write the rasters of a run; None, and no file, where there are no points on the ground."""
    grid = land.grid
    if grid is None:
        return None
    passages = tool_passages(found.located.trajectory, found.work, found.session.implement)
    blocks = grid.coarser(SWATH_BLOCK)
    kinds = {DSM: (grid, SURFACE_BANDS), SWATHS: (blocks, SWATH_BANDS)}
    if passages:
        kinds |= {DSM_BEFORE: (grid, SURFACE_BANDS), CHANGE: (grid, CHANGE_BANDS)}
    if found.strips:
        kinds |= {DENSITY: (blocks, DENSITY_BANDS), STRIP_OVERLAP: (blocks, OVERLAP_BANDS)}
    crs = with_heights(found.frame.whole_crs, found.session.crs.heights)
    sums = SoilSums()
    swaths = SwathSums()
    outlines = StripOutlines()
    seen = 0
    implement = found.session.implement
    edges = None
    if passages and implement is not None:
        edges = ToolEdges.of_work(found.located.trajectory, found.work, implement)
    across: list[FloatArray] = []
    with ExitStack() as stack:
        write = {
            name: stack.enter_context(cog_output(folder / name, cells, crs, bands, _raster_origin(origin, name)))
            for name, (cells, bands) in kinds.items()
        }
        for number, tile in enumerate(land.tiles(passages, MEDIAN, found.strips, edges), start=1):
            for name, put in write.items():
                put(*_arrays(tile, name))
            sums.add_tile(tile)
            across += [tile.across] if tile.across is not None else []
            swaths.add(tile.swaths_m, blocks.cell_area_m2)
            if tile.coverage is not None:
                outlines.add(tile.coverage)
            seen += int(tile.after.seen.sum())
            progress("making surfaces", number / max(land.tile_count, 1))
    if found.strips:
        _write_ground(folder, land, crs, origin)
    differences = swaths.differences()
    if differences is None:
        (folder / SWATHS).unlink()
        del kinds[SWATHS]
    for name in (*kinds, *(_GROUND if found.strips else ())):
        write_raster_style(folder / name, STYLES[name])
    moved = sums.moved(grid.cell_area_m2) if passages else None
    grounds = tuple(outlines.grounds(found.strips))
    notices = _tool_notices(across, edges, implement)
    return RasterFigures(grid.cell_m, seen * grid.cell_area_m2, moved, differences, grounds, notices)


def _tool_notices(
    across: Sequence[FloatArray], edges: ToolEdges | None, implement: Implement | None
) -> tuple[Notice, ...]:
    """Whether the soil changes where the session states the tool."""
    if not across or edges is None or implement is None:
        return ()
    return edges.ends(np.sum(across, axis=0)).notices(implement)


def _write_ground(folder: Path, land: FieldPoints, crs: CRS, origin: Origin) -> None:
    """Write terrain model and height above ground, which a flight over crops needs."""
    assert land.grid is not None
    with ExitStack() as stack:
        put = [
            stack.enter_context(cog_output(folder / name, land.grid, crs, bands, _raster_origin(origin, name)))
            for name, bands in _GROUND.items()
        ]
        for tile in cloud_tiles(land.spooled, "smrf", land.grid.cell_m):
            assert tile.dtm is not None
            assert tile.above_m is not None
            put[0](tile.grid, surface_arrays(tile.dtm))
            put[1](tile.grid, (tile.above_m,))


def _arrays(tile: FieldTile, name: str) -> tuple[Grid, Bands]:
    """What a tile has for a raster."""
    if name in (DENSITY, STRIP_OVERLAP):
        assert tile.coverage is not None
        return tile.coverage.grid, (tile.coverage.density_m2 if name == DENSITY else tile.coverage.strips,)
    if name == SWATHS:
        return tile.grid.coarser(SWATH_BLOCK), (tile.swaths_m,)
    if name == CHANGE:
        return tile.grid, (tile.change_m, tile.change_error_m)
    return tile.grid, surface_arrays(tile.after if name == DSM else tile.before)


def _raster_origin(origin: Origin, name: str) -> Origin:
    statistic = _RASTER_STATISTICS.get(name, MEDIAN.name)
    return replace(origin, title=_RASTER_TITLES[name], parameters={**origin.parameters, "statistic": statistic})


def _moved(moved: MeanChange) -> dict[str, float | None]:
    return {
        "volume_m3": _known(moved.mean_m * moved.area_m2),
        "volume_sigma_m3": _known(moved.sigma_m * moved.area_m2),
        "mean_change_m": _known(moved.mean_m),
        "mean_change_sigma_m": _known(moved.sigma_m),
        "shadow_share": _known(moved.shadow_share),
        "area_m2": round(moved.area_m2, 2),
        "compared_m2": round(moved.compared_m2, 2),
    }


def _known(value: float) -> float | None:
    return round(value, 4) if math.isfinite(value) else None
