"""The products of a season: mosaics of each date, points and trajectories of all sessions, and their catalogue."""

import datetime as dt
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.metadata import version
from importlib.util import find_spec
from itertools import groupby
from pathlib import Path
from typing import Any, Final

import numpy as np
from pyproj import CRS

from furrowmap.core.geodesy.crs_change import crs_change, optional_crs
from furrowmap.core.runtime.errors import (
    FurrowmapError,
    InputError,
    MissingExtraError,
    Notice,
)
from furrowmap.core.runtime.file_names import is_file_name, read_own, resolved
from furrowmap.core.runtime.json_text import json_text
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.values.crs import name_of
from furrowmap.exporters.exchange.stac import (
    CATALOGUE,
    StacItem,
    season_session_item,
    table_item,
    table_properties,
    tile_item,
    write_season_catalogue,
)
from furrowmap.exporters.farm.farm_results import short_hash
from furrowmap.exporters.farm.surface_file import SurfaceFile, same_map, surface_file, unusable
from furrowmap.exporters.farm.surface_mosaic import common_crs, grid_in
from furrowmap.exporters.farm.traffic import WORKED
from furrowmap.exporters.farm.virtual_raster import virtual_raster
from furrowmap.exporters.files.atomic import remove_unfinished
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import FIELD, result_origin
from furrowmap.exporters.files.staging import recover, refuse_products, staged_folder
from furrowmap.exporters.rasters.cog import Band
from furrowmap.exporters.rasters.windows import enclosing, shared_cells
from furrowmap.settings import SeasonSettings
from furrowmap.workflows.batch.engine import ATTEMPTS
from furrowmap.workflows.batch.workforce import Workforce, unprotected
from furrowmap.workflows.season.season_sources import SeasonSession, find_sessions, season_crs
from furrowmap.workflows.season.season_tasks import MosaicTile, Part, SessionTables, write_part
from furrowmap.workflows.share.export import refuse_result

SEASON: Final = "season.json"
MOSAIC_TILE_CELLS: Final = 8192
"""Side length of a tile in cells: 410 m with cells of 5 cm."""
COVERAGE: Final = "coverage"
TITLES: Final = {"dsm": "Surface", "change": "Change of the surface", COVERAGE: "Times worked"}
_CELL_M: Final = 0.05
"""Of a season without surfaces: that of a run."""


@dataclass(frozen=True)
class SeasonPlan:
    """What all parts of a season share; the bands of each mosaic are known when its tiles are planned."""

    staging: Path
    sessions: Sequence[SeasonSession]
    crs: CRS
    bands: dict[str, tuple[Band, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class Planned:
    """A part of a season: its kind, place of its files, key of its content, column and row if it is a tile."""

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
        earlier = json.loads(read_own(folder, SEASON))["parts"]
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
    extents: dict[tuple[int, int], list[Grid]] = {}
    contents: dict[tuple[dt.date, str, tuple[int, int]], list[tuple[SeasonSession, Path]]] = {}
    for session, found in zip(plan.sessions, opened, strict=True):
        grids = [(kind, surface.path, grid_in(surface, crs, cell_m)) for kind, surface in found.items()]
        if session.passes is not None:
            grids.append((COVERAGE, session.folder, Grid.of_bounds(cell_m, _bounds_in(plan.crs, session))))
        for kind, source, grid in grids:
            for tile, part in _tiles(grid):
                extents.setdefault(tile, []).append(part)
                contents.setdefault((session.date, kind, tile), []).append((session, source))
    return dict(
        _plan_tile(plan, key, members, enclosing(extents[key[2]]), crs)
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
        out = plan.staging / place
        part = SessionTables(out, session.name, source, plan.crs, session.crs, spacing_m, most_rows, origin)
        key = _key(plan.crs.to_wkt(), spacing_m, most_rows, place, [_source_key(session, file)])
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
    place = f"mosaics/{date}"
    name = f"{kind}_x{column}_y{row}.tif"
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
    crs = crs if kind != COVERAGE else plan.crs
    sources = tuple(source for _, source in members)
    tile = MosaicTile(plan.staging / place / name, grid, crs, bands, sources, origin)
    files = [source / FIELD if kind == COVERAGE else source for source in sources]
    decisive = [_source_key(session, file) for session, file in zip(sessions, files, strict=True)]
    key = _key(crs.to_wkt(), [grid.cell_m, grid.west, grid.north, *grid.shape], bands, decisive)
    return f"{place}/{name}", Planned(tile, kind, place, key, date, span, (column, row), grid)


def _common_bands(surfaces: Sequence[SurfaceFile]) -> tuple[Band, ...]:
    """The bands that all surfaces have, the latest's first band first."""
    if not surfaces:
        return ()
    last = surfaces[-1].bands
    for surface in surfaces:
        if last[0].description not in {band.description for band in surface.bands}:
            raise unusable(
                surface.path,
                Text("has no band {band!r}, as {other} has", band=last[0].description, other=surfaces[-1].path),
            )
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


def _tiles(grid: Grid) -> Iterator[tuple[tuple[int, int], Grid]]:
    """The tiles that cells lie in, and those in each."""
    side = MOSAIC_TILE_CELLS
    south = grid.north - grid.rows
    east = grid.west + grid.columns
    for column in range(grid.west // side, (east - 1) // side + 1):
        for row in range(south // side, (grid.north - 1) // side + 1):
            part = shared_cells(grid, Grid(grid.cell_m, column * side, (row + 1) * side, (side, side)))
            assert part is not None
            yield (column, row), part


def _source_key(session: SeasonSession, file: Path) -> list[Any]:
    """What tells one content of a session's file from another, without reading it."""
    status = file.stat()
    return [session.name, session.digest, file.name, status.st_size, status.st_mtime_ns]


def _key(*decisive: Any) -> str:
    return short_hash([version("furrowmap"), *decisive])


MOSAICS: Final = "mosaics"
POINTS: Final = "points"
TRAJECTORY_TABLES: Final = "trajectories"
CONTENTS: Final = (MOSAICS, POINTS, TRAJECTORY_TABLES)

Parts = Mapping[str, Planned]
Accounts = Mapping[str, Any]


@dataclass(frozen=True)
class Season:
    """What a season holds.

    Attributes:
        folder: of the products.
        dates: in their order, as ISO 8601.
        tiles: number of rasters.
        points: number of rows.
        poses: number of rows.
        written: number of parts that were made.
        unchanged: number of parts that were there.
    """

    folder: Path
    crs: str
    dates: tuple[str, ...]
    sessions: int
    tiles: int
    points: int
    poses: int
    written: int
    unchanged: int
    notices: tuple[Notice, ...]


def season(
    results: Sequence[str | Path],
    out: str | Path,
    settings: SeasonSettings = SeasonSettings(),
    *,
    overwrite: bool = False,
    say: Callable[[str], None] = lambda _: None,
    progress: Progress = silent,
) -> Season:
    """Write the products of many sessions: mosaics of each date in tiles of one grid, tables of points and poses.

    Parts that a season in the folder has already, of the same results, settings and version, are not made again. All
    products take their places together.

    Args:
        results: folders with results of runs in them, as `furrowmap batch` writes them, or results; surfaces that a
            `furrowmap tie` among them has moved replace those of their results.
        out: folder of the season.
        say: is called with what a user may want to know meanwhile, such as the number of workers.

    Raises:
        UsageError: if a content is unknown.
        InputError: if there are no results, or one is damaged.
        RefusedError: if the sessions have several CRSs or height systems, the folder is occupied, or a package is
            missing.
        FurrowmapError: if a worker is lost several times, or the scheduler cannot be reached.
    """
    folder = Path(out)
    content = _content(settings)
    recover(folder)
    refuse_result(folder)
    if not (folder / SEASON).is_file():
        refuse_products(folder, (CATALOGUE,), overwrite=overwrite)
    sessions, notices = find_sessions([Path(result) for result in results], folder)
    crs, changes = season_crs(sessions, optional_crs(settings.crs))
    force = Workforce(settings.workers, settings.scheduler, say)
    with staged_folder(folder) as staging, force:
        plan = SeasonPlan(resolved(staging), sessions, crs)
        parts: dict[str, Planned] = {}
        if MOSAICS in content:
            parts |= plan_tiles(plan, settings.cell_m)
        if POINTS in content:
            parts |= plan_tables(plan, POINTS, settings.most_rows, settings.spacing_m)
        if TRAJECTORY_TABLES in content:
            parts |= plan_tables(plan, TRAJECTORY_TABLES, settings.most_rows)
        accounts = unchanged_parts(folder, parts)
        unchanged = len(accounts)
        due = [(name, part.part) for name, part in parts.items() if name not in accounts]
        _make(due, accounts, force, progress)
        remove_unfinished(staging)
        put_virtual_mosaics(plan, parts, accounts)
        put_catalogue(plan, parts, accounts, folder)
        _put_record(staging, parts, accounts)
    rows = [sum(rows for name, part in parts.items() for _, rows in accounts[name]["files"] if part.kind == kind)
            for kind in (POINTS, TRAJECTORY_TABLES)]  # fmt: skip
    tiles = sum(len(accounts[name]["files"]) for name, part in parts.items() if part.grid is not None)
    dates = tuple(sorted({session.date.isoformat() for session in sessions}))
    counts = (len(sessions), tiles, rows[0], rows[1], len(due), unchanged)
    return Season(folder, name_of(crs), dates, *counts, (*unprotected(settings.scheduler), *notices, *changes))


def _content(settings: SeasonSettings) -> tuple[str, ...]:
    content = tuple(settings.content) or CONTENTS
    if content != (MOSAICS,) and find_spec("pyarrow") is None:
        raise MissingExtraError(
            "pyarrow", "parquet", Text("GeoParquet is written by it."), otherwise=Text("write the mosaics alone")
        )
    return content


def _make(due: Sequence[tuple[str, Any]], accounts: dict[str, Any], force: Workforce, progress: Progress) -> None:
    """Make parts; their accounts are added to `accounts`."""
    for name, found in force.each(write_part, due, "writing the season", progress):
        if isinstance(found, FurrowmapError):
            raise found
        if not isinstance(found, dict):
            raise _lost(name)
        accounts[name] = found


def _lost(name: str) -> FurrowmapError:
    return FurrowmapError("worker-lost", name=name, attempts=ATTEMPTS, is_session=False)


def _put_record(staging: Path, parts: Mapping[str, Planned], accounts: Mapping[str, Any]) -> None:
    """Write `season.json`: all products, and what each part was made of."""
    kept = {f"{part.place}/{file}" for name, part in parts.items() for file, _ in accounts[name]["files"]}
    written = {path.relative_to(staging).as_posix() for path in staging.rglob("*") if path.is_file()}
    record = {
        "furrowmap": version("furrowmap"),
        "products": sorted({*kept, *written, SEASON}),
        "parts": {name: {"key": part.key, "told": accounts[name]} for name, part in parts.items()},
    }
    (staging / SEASON).write_text(json_text(record), encoding="utf-8")


def put_virtual_mosaics(plan: SeasonPlan, parts: Parts, accounts: Accounts) -> None:
    """Write a virtual raster over the tiles of each mosaic of a date, such as `mosaics/2026-05-01/dsm.vrt`.

    None is written where it would have more cells than a raster may have, as fields far from each other do.
    """
    tiles = [(part.place, part.kind, part, accounts[name]["files"]) for name, part in parts.items() if part.grid]
    tiles = [tile for tile in tiles if tile[3]]
    for (place, kind), group in groupby(sorted(tiles, key=lambda tile: tile[:2]), key=lambda tile: tile[:2]):
        members = [(part, plan.staging / place / files[0][0]) for _, _, part, files in group]
        try:
            whole = enclosing([part.grid for part, _ in members if part.grid is not None])
        except InputError:  # too many cells
            continue
        nodata = None if kind == COVERAGE else float("nan")
        sources = [(path, part.grid, nodata) for part, path in members if part.grid is not None]
        folder = plan.staging / place
        folder.mkdir(parents=True, exist_ok=True)
        origin = Origin(f"{TITLES[kind]}, {members[0][0].date}")
        text = virtual_raster(folder, whole, plan.crs, plan.bands[kind], sources, origin)
        (folder / f"{kind}.vrt").write_text(text, encoding="utf-8")


def put_catalogue(plan: SeasonPlan, parts: Parts, accounts: Accounts, target: Path) -> None:
    """Write the catalogue of a season into its staging folder."""
    sessions = [season_session_item(one.folder, dict(one.report), one.date, target) for one in plan.sessions]
    tiles = list(_tile_items(plan, parts, accounts))
    found: dict[str, tuple[str, list[StacItem], Mapping[str, Any]]] = {
        "sessions": ("Sessions", sessions, {}),
        "mosaics": ("Mosaics of each date, in tiles of one grid", tiles, {}),
    }
    for kind, title in (("points", "Points of all sessions"), ("trajectories", "Poses of all sessions")):
        if any(part.kind == kind and accounts[name]["files"] for name, part in parts.items()):
            from furrowmap.exporters.exchange.partitions import POINT_SCHEMA, POSE_SCHEMA, table_columns

            columns = table_columns(POINT_SCHEMA if kind == "points" else POSE_SCHEMA)
            found[kind] = title, list(_table_items(kind, plan, parts, accounts, columns)), table_properties(columns)
    write_season_catalogue(plan.staging, target, {key: entry for key, entry in found.items() if entry[1]})


def _tile_items(plan: SeasonPlan, parts: Parts, accounts: Accounts) -> Iterator[StacItem]:
    found: dict[tuple[dt.date, tuple[int, int]], list[tuple[Planned, Any]]] = {}
    for name, part in parts.items():
        if part.tile is not None and accounts[name]["files"]:
            found.setdefault((part.date, part.tile), []).append((part, accounts[name]))
    for (date, (column, row)), members in sorted(found.items(), key=lambda item: item[0]):
        rasters = {part.kind: _raster(plan, part, said) for part, said in members}
        grid = members[0][0].grid
        assert grid is not None
        yield tile_item(f"{date}_x{column}_y{row}", date, _span(members), plan.crs, grid, rasters)


def _raster(plan: SeasonPlan, part: Planned, said: Any) -> tuple[str, str, list[Any]]:
    """Path, title and bands."""
    bands = []
    for band, (least, most, cells) in zip(plan.bands[part.kind], said["bands"], strict=True):
        kind = {"data_type": "uint16"} if part.kind == COVERAGE else {"data_type": "float32", "nodata": "nan"}
        assert part.grid is not None
        share = 100.0 * cells / (part.grid.rows * part.grid.columns)
        known = {"minimum": least, "maximum": most} if cells else {}
        statistics = {"statistics": {**known, "valid_percent": round(share, 3)}}
        bands.append({"name": band.description, "unit": band.unit, **kind, **statistics})
    return f"{part.place}/{said['files'][0][0]}", TITLES[part.kind], bands


def _table_items(kind: str, plan: SeasonPlan, parts: Parts, accounts: Accounts, columns: object) -> Iterator[StacItem]:
    own = [(part, accounts[name]) for name, part in parts.items() if part.kind == kind and accounts[name]["files"]]
    for date, group in groupby(sorted(own, key=lambda one: one[0].date), key=lambda one: one[0].date):
        members = list(group)
        bounds = np.array([said["bounds_m"] for _, said in members])
        west, south = bounds[:, :2].min(axis=0).tolist()
        east, north = bounds[:, 2:].max(axis=0).tolist()
        files = {f"{part.place}/{file}": int(rows) for part, said in members for file, rows in said["files"]}
        bounds_m = west, south, east, north
        yield table_item(f"{kind}_{date}", date, _span(members), plan.crs, bounds_m, columns, files)


def _span(members: Sequence[tuple[Planned, Any]]) -> tuple[dt.datetime, dt.datetime]:
    return min(part.span[0] for part, _ in members), max(part.span[1] for part, _ in members)
