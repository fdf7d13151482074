"""The parts of a season: tiles of its mosaics and tables of its sessions, each with a key of its content."""

import datetime as dt
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from pyproj import CRS

from furrowmap.core.geodesy.crs_change import crs_change
from furrowmap.core.runtime.file_names import is_file_name
from furrowmap.core.runtime.settings import Settings
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.farm.mosaic import common_crs, grid_in
from furrowmap.exporters.farm.results import short_hash
from furrowmap.exporters.farm.surface_file import SurfaceFile, same_map, surface_file, unusable
from furrowmap.exporters.farm.traffic import WORKED
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import FIELD, result_origin
from furrowmap.exporters.rasters.cog import Band
from furrowmap.workflows.season.sources import SeasonSession
from furrowmap.workflows.season.tasks import MosaicTile, Part, SessionTables

SEASON: Final = "season.json"
MOSAIC_TILE_CELLS: Final = 8192
"""Side length of a tile in cells: 410 m with cells of 5 cm."""
COVERAGE: Final = "coverage"
TITLES: Final = {"dsm": "Surface", "change": "Change of the surface", COVERAGE: "Times worked"}
_CELL_M: Final = 0.05
"""Of a season without surfaces: that of a run."""
_Extent = tuple[int, int, int, int]
"""West, south, east, north in cells from the CRS's origin."""


@dataclass(frozen=True)
class SeasonPlan:
    """What all parts of a season share; the bands of each mosaic are known when its tiles are planned."""

    staging: Path
    sessions: Sequence[SeasonSession]
    crs: CRS
    process: Settings
    bands: dict[str, tuple[Band, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class Planned:
    """A part of a season.

    Attributes:
        kind: "dsm", "change", "coverage", "points" or "trajectories".
        place: of its files, relative to the season's folder.
        key: of all that decides its content.
        tile: column and row of a tile; None for a table.
    """

    part: Part
    kind: str
    place: str
    key: str
    date: dt.date
    span: tuple[dt.datetime, dt.datetime]
    tile: tuple[int, int] | None = None
    grid: Grid | None = None


def unchanged_parts(folder: Path, parts: Mapping[str, Planned]) -> dict[str, Any]:
    """The accounts of the parts that an earlier season in a folder has already, with the same keys, by name."""
    accounts: dict[str, Any] = {}
    try:
        earlier = json.loads((folder / SEASON).read_bytes())["parts"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return accounts
    for name, part in parts.items():
        with suppress(KeyError, TypeError, ValueError):
            account = earlier[name]["told"]
            files = [str(file) for file, _ in account["files"]]
            there = all(is_file_name(file) and (folder / part.place / file).is_file() for file in files)
            if there and earlier[name]["key"] == part.key:
                accounts[name] = account
    return accounts


def plan_tiles(plan: SeasonPlan, cell_m: float | None) -> dict[str, Planned]:
    """The tiles of all mosaics, by name; tiles of one place have one grid on all dates.

    The bands of the mosaics are added to the plan. Cells have the size of the latest surface's if none is given.
    """
    opened = [{key: surface_file(path) for key, path in session.surfaces.items()} for session in plan.sessions]
    surfaces = [surface for found in opened for surface in found.values()]
    crs = common_crs(surfaces, plan.crs) if surfaces else plan.crs
    cell_m = cell_m or (surfaces[-1].cell_m if surfaces else _CELL_M)
    for kind in ("dsm", "change"):
        plan.bands[kind] = _common_bands([found[kind] for found in opened if kind in found])
    plan.bands[COVERAGE] = (WORKED,)
    extents: dict[tuple[int, int], _Extent] = {}
    contents: dict[tuple[dt.date, str, tuple[int, int]], list[tuple[SeasonSession, Path]]] = {}
    for session, found in zip(plan.sessions, opened, strict=True):
        grids = [(kind, surface.path, grid_in(surface, crs, cell_m)) for kind, surface in found.items()]
        if session.passes is not None:
            grids.append((COVERAGE, session.folder, Grid.of_bounds(cell_m, _bounds_in(plan.crs, session))))
        for kind, source, grid in grids:
            for tile, extent in _tiles(grid):
                west, south, east, north = extents.get(tile, extent)
                extents[tile] = (
                    min(west, extent[0]),
                    min(south, extent[1]),
                    max(east, extent[2]),
                    max(north, extent[3]),
                )
                contents.setdefault((session.date, kind, tile), []).append((session, source))
    return dict(
        _plan_tile(plan, key, members, _grid(cell_m, extents[key[2]]), crs)
        for key, members in sorted(contents.items(), key=lambda item: item[0])
    )


def plan_tables(plan: SeasonPlan, kind: str, most_rows: int, spacing_m: float = 0.0) -> dict[str, Planned]:
    """The points or the trajectory (`kind`) of each session, by name; a spacing of 0 keeps all points."""
    found = {}
    for session in plan.sessions:
        source, file = (session.cloud, session.cloud) if kind == "points" else (session.folder, session.folder / FIELD)
        if source is None or file is None:
            continue
        place = f"{kind}/date={session.date}"
        origin = result_origin(dict(session.report), session.name)
        wkt, own = plan.crs.to_wkt(), session.crs.to_wkt()
        out = plan.staging / place
        part = SessionTables(out, session.name, source, wkt, own, spacing_m, most_rows, origin, plan.process)
        key = _key(wkt, spacing_m, most_rows, place, [_source_key(session, file)])
        found[f"{place}/{session.name}"] = Planned(part, kind, place, key, session.date, session.span)
    return found


def _plan_tile(
    plan: SeasonPlan,
    of: tuple[dt.date, str, tuple[int, int]],
    members: Sequence[tuple[SeasonSession, Path]],
    grid: Grid,
    crs: CRS,
) -> tuple[str, Planned]:
    date, kind, (column, row) = of
    place, name = f"mosaics/{date}", f"{kind}_x{column}_y{row}.tif"
    heights = members[-1][0].heights
    sessions = [session for session, _ in members]
    span = min(session.span[0] for session in sessions), max(session.span[1] for session in sessions)
    origin = Origin(
        f"{TITLES[kind]}, {date}",
        inputs=[(f"{session.name}/report.json", session.digest) for session in sessions],
        span_s=(span[0].timestamp(), span[1].timestamp()),
        parameters={"pick": "latest", "heights": heights} if kind != COVERAGE else {},
    )
    bands = tuple(band.description for band in plan.bands[kind]) if kind != COVERAGE else ()
    wkt = (crs if kind != COVERAGE else plan.crs).to_wkt()
    sources = tuple(source for _, source in members)
    tile = MosaicTile(plan.staging / place / name, grid, wkt, bands, sources, origin, plan.process)
    files = [source / FIELD if kind == COVERAGE else source for source in sources]
    decisive = [_source_key(session, file) for session, file in zip(sessions, files, strict=True)]
    key = _key(wkt, [grid.cell_m, grid.west, grid.north, *grid.shape], bands, decisive)
    return f"{place}/{name}", Planned(tile, kind, place, key, date, span, (column, row), grid)


def _common_bands(surfaces: Sequence[SurfaceFile]) -> tuple[Band, ...]:
    """The bands that all surfaces have, the latest's first band first."""
    if not surfaces:
        return ()
    last = surfaces[-1].bands
    for surface in surfaces:
        if last[0].description not in {band.description for band in surface.bands}:
            raise unusable(surface.path, f"has no band '{last[0].description}', as {surfaces[-1].path} has")
    names = [{band.description for band in surface.bands} for surface in surfaces]
    return tuple(band for band in last if all(band.description in own for own in names))


def _bounds_in(crs: CRS, session: SeasonSession) -> tuple[float, float, float, float]:
    """The bounds of a session's worked ground in a CRS."""
    assert session.passes is not None
    if same_map(session.crs, crs):
        return session.passes
    west, south, east, north = crs_change(session.crs, crs, session.passes).transformer.transform_bounds(
        *session.passes
    )
    return west, south, east, north


def _tiles(grid: Grid) -> Iterator[tuple[tuple[int, int], _Extent]]:
    """The tiles that cells lie in, and the extent of those in each."""
    west, south, east, north = grid.west, grid.north - grid.rows, grid.west + grid.columns, grid.north
    for column in range(west // MOSAIC_TILE_CELLS, (east - 1) // MOSAIC_TILE_CELLS + 1):
        for row in range(south // MOSAIC_TILE_CELLS, (north - 1) // MOSAIC_TILE_CELLS + 1):
            left, bottom = column * MOSAIC_TILE_CELLS, row * MOSAIC_TILE_CELLS
            right, top = left + MOSAIC_TILE_CELLS, bottom + MOSAIC_TILE_CELLS
            own = (max(west, left), max(south, bottom), min(east, right), min(north, top))
            yield (column, row), own


def _grid(cell_m: float, extent: _Extent) -> Grid:
    west, south, east, north = extent
    return Grid(cell_m, west, north, (north - south, east - west))


def _source_key(session: SeasonSession, file: Path) -> list[Any]:
    """What tells one content of a session's file from another, without reading it."""
    status = file.stat()
    return [session.name, session.digest, file.name, status.st_size, status.st_mtime_ns]


def _key(*decisive: Any) -> str:
    return short_hash([version("furrowmap"), *decisive])
