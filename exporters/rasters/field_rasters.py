"""The rasters of a run: `dsm.tif`, `dsm_before.tif`, `change.tif`, `swaths.tif`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from furrowmap.core.surfaces.statistic import MEDIAN
from furrowmap.core.surfaces.visits import BLOCK, SwathDifferences, SwathSums
from furrowmap.core.values.progress import Progress
from furrowmap.core.work.field_surfaces import FieldPoints, FieldTile, tool_passages
from furrowmap.core.work.run_result import RunResult
from furrowmap.core.work.soil_moved import Moved, SoilMoved, SoilSums
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import CHANGE, DSM, DSM_BEFORE, SWATHS, packaged_style, style_of
from furrowmap.exporters.rasters.cog import (
    STANDARD_ERROR,
    SURFACE_BANDS,
    Band,
    Bands,
    cog_output,
    surface_arrays,
    with_heights,
)

STYLES: Final = {DSM: "dsm.qml", DSM_BEFORE: "dsm.qml", CHANGE: "change.qml", SWATHS: "swaths.qml"}
CHANGE_BANDS: Final = (Band("change"), STANDARD_ERROR)
SWATH_BANDS: Final = (Band("difference of swaths"),)
_TITLES: Final = {
    DSM: "Surface as left at the end",
    DSM_BEFORE: "Surface before the implement passed",
    CHANGE: "Change of the surface: after less before",
    SWATHS: "Agreement of swaths: height in a swath less that in the one before it",
}


@dataclass(frozen=True)
class RasterFigures:
    """Figures of the surfaces for the report.

    Attributes:
        cell_m: length of a cell's sides.
        seen_m2: area with a height in `dsm.tif`.
        moved: soil moved; None where work is unknown.
        swaths: differences between swaths; None where no ground was seen twice.
    """

    cell_m: float
    seen_m2: float
    moved: SoilMoved | None
    swaths: SwathDifferences | None

    def plain(self) -> dict[str, Any]:
        """As in `report.json`."""
        figures: dict[str, Any] = {"dsm_cell_m": self.cell_m, "dsm_area_m2": round(self.seen_m2, 1)}
        if self.moved is None:
            return figures
        passes = [{"pass": number, **_moved(moved)} for number, moved in self.moved.passes.items()]
        beside = {"area_m2": round(self.moved.beside.area_m2, 2), "mean_change_m": _rounded(self.moved.beside.mean_m)}
        return figures | {"soil_moved": {**_moved(self.moved.worked), "beside_passes": beside, "passes": passes}}


def write_rasters(
    folder: Path, land: FieldPoints, found: RunResult, origin: Origin, progress: Progress
) -> RasterFigures | None:
    """Write the rasters of a run; None, and no file, where there are no points on the ground.

    Args:
        folder: to write to.
        land: the points.
        found: result of the run.
        origin: provenance of its products.
        progress: receives the stage "making surfaces".

    Raises:
        OSError: if they cannot be written.
    """
    grid = land.grid
    if grid is None:
        return None
    passages = tool_passages(found.located.trajectory, found.work, found.session.implement)
    bands = {DSM: SURFACE_BANDS} | ({DSM_BEFORE: SURFACE_BANDS, CHANGE: CHANGE_BANDS} if passages else {})
    blocks = grid.coarser(BLOCK)
    crs = with_heights(found.frame.whole_crs, found.session.crs.heights)
    sums, swaths, seen = SoilSums(), SwathSums(), 0
    with ExitStack() as stack:
        write = {
            name: stack.enter_context(cog_output(folder / name, grid, crs, held, _of(origin, name)))
            for name, held in bands.items()
        }
        put_swaths = stack.enter_context(cog_output(folder / SWATHS, blocks, crs, SWATH_BANDS, _of(origin, SWATHS)))
        for tile in _with_progress(land, land.tiles(passages, MEDIAN), progress):
            arrays = _arrays(tile)
            for name, put in write.items():
                put(tile.grid, arrays[name])
            sums.add(tile)
            put_swaths(tile.grid.coarser(BLOCK), (tile.swaths_m,))
            swaths.add(tile.swaths_m, blocks.cell_area_m2)
            seen += int(tile.after.seen.sum())
    differences = swaths.differences()
    if differences is None:
        (folder / SWATHS).unlink()
    for name in (*bands, *([SWATHS] if differences is not None else [])):
        (folder / style_of(name)).write_text(packaged_style(STYLES[name]), encoding="utf-8")
    return RasterFigures(grid.cell_m, seen * grid.cell_area_m2, sums.moved() if passages else None, differences)


def _arrays(tile: FieldTile) -> dict[str, Bands]:
    return {
        DSM: surface_arrays(tile.after),
        DSM_BEFORE: surface_arrays(tile.before),
        CHANGE: (tile.change_m, tile.change_error_m),
    }


def _with_progress(land: FieldPoints, tiles: Iterator[FieldTile], progress: Progress) -> Iterator[FieldTile]:
    """The tiles, with their progress."""
    count = max(land.tile_count, 1)
    for number, tile in enumerate(tiles, start=1):
        yield tile
        progress("making surfaces", number / count)


def _of(origin: Origin, name: str) -> Origin:
    statistic = "mean" if name == SWATHS else MEDIAN.name
    return replace(origin, title=_TITLES[name], parameters={**origin.parameters, "statistic": statistic})


def _moved(moved: Moved) -> dict[str, float | None]:
    return {
        "volume_m3": _rounded(moved.volume_m3),
        "mean_change_m": _rounded(moved.mean_m),
        "area_m2": round(moved.area_m2, 2),
        "compared_m2": round(moved.compared_m2, 2),
    }


def _rounded(value: float) -> float | None:
    return round(value, 4) if value == value else None
