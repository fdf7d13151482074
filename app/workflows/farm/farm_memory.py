"""What a farm map remembers: fields and their seasons, the history of a field, and traffic."""

import datetime as dt
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from furrowmap.core.runtime.errors import InputError, UsageError
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.exporters.farm.farm_memory_tables import FIELDS_LAYER, MACHINES, SEASONS, VISITS
from furrowmap.exporters.farm.farm_results import TRACKS
from furrowmap.exporters.farm.traffic import write_traffic
from furrowmap.exporters.files.atomic import refuse_existing
from furrowmap.exporters.files.csv_cells import write_csv_table
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.reports.html_pages import write_html
from furrowmap.exporters.reports.season_pages import history_page
from furrowmap.exporters.vectors.field_layers import Layer
from furrowmap.settings import TrafficSettings
from furrowmap.workflows.farm.farm import DB_SCHEMA, FarmEdit, open_edit

_FIELD_FIGURES: Final = (
    "worked_area_m2", "overlap_area_m2", "missed_area_m2", "swept_area_m2", "hours", "work_rate_ha_h", "distance_m",
    "soil_moved_m3", "depth_m",
)  # fmt: skip
_WHOLE: Final = frozenset({"sessions", "season", "times_worked"})
FIELD_COLUMNS: Final = ("field", "name", "area_m2", "sessions", "first_date", "last_date")
SEASON_COLUMNS: Final = (
    "field", "name", "season", "times_worked", "first_date", "last_date", "ground_m2", *_FIELD_FIGURES,
)  # fmt: skip
VISIT_COLUMNS: Final = ("field", "date", "season", "name", "machine", "implement", *_FIELD_FIGURES, "session")
MACHINE_COLUMNS: Final = (
    "machine", "implement", "sessions", "first_date", "last_date", "worked_area_m2", "hours", "work_rate_ha_h",
    "distance_m", "soil_moved_m3",
)  # fmt: skip
HISTORY_SUFFIXES: Final = (".html", ".csv")
"""Of a page with a map, and of a table of the sessions."""


@dataclass(frozen=True)
class FarmMemory:
    """The tables of a farm map, rows by column; values are None where unknown, dates ISO 8601."""

    farm_map: str
    fields: list[dict[str, Any]]
    seasons: list[dict[str, Any]]
    machines: list[dict[str, Any]]


@dataclass(frozen=True)
class FieldHistory:
    """The rows of a field, its seasons and its visits, the last one first; `path` is the page, if it was written."""

    path: Path | None
    field: dict[str, Any]
    seasons: list[dict[str, Any]]
    visits: list[dict[str, Any]]


@dataclass(frozen=True)
class TrafficRaster:
    """A written raster of traffic.

    Attributes:
        crs: of its cells.
        cell_m: length of a cell's sides.
        columns: from west to east.
        rows: from north to south.
        sessions: number of sessions counted.
        passes: number of passes counted.
    """

    path: Path
    crs: str
    cell_m: float
    columns: int
    rows: int
    sessions: int
    passes: int


def farm_memory(farm_map: str | Path, *, schema: str = DB_SCHEMA, progress: Progress = silent) -> FarmMemory:
    """Fields, seasons and machines of a farm map; raises FurrowmapError if it cannot be opened."""
    with open_edit(farm_map, schema=schema, progress=progress) as edit:
        tables = [
            _rows(edit.read(name, columns))
            for name, columns in ((FIELDS_LAYER, FIELD_COLUMNS), (SEASONS, SEASON_COLUMNS), (MACHINES, MACHINE_COLUMNS))
        ]
        return FarmMemory(edit.name(), *tables)


def field_history(
    farm_map: str | Path,
    field: str,
    out: str | Path | None = None,
    *,
    language: str | None = None,
    schema: str = DB_SCHEMA,
    overwrite: bool = False,
    progress: Progress = silent,
) -> FieldHistory:
    """The history of a field: its seasons and sessions, as a page or a table.

    Args:
        farm_map: path of a GeoPackage, or a PostgreSQL connection string.
        field: name or identity of the field, or the beginning of the latter.
        out: `.html` for a page with a map, `.csv` for a table of the sessions; nothing is written without it.
        language: of the page, such as "en"; None for the user's.
        schema: of the tables in a database.

    Raises:
        UsageError: if `out` has another suffix.
        InputError: if the farm map has no such field, or several.
        RefusedError: if the file exists.
    """
    target = Path(out) if out is not None else None
    if target is not None:
        if target.suffix not in HISTORY_SUFFIXES:
            example = target.with_suffix(HISTORY_SUFFIXES[0]).name
            raise UsageError("usage.suffix", path=target, suffixes=HISTORY_SUFFIXES, example=example)
        refuse_existing(target, overwrite=overwrite)
    with open_edit(farm_map, schema=schema, progress=progress) as edit:
        fields = edit.read(FIELDS_LAYER, FIELD_COLUMNS)
        row = _field_row(fields, field, edit.name())
        seasons = edit.read(SEASONS, SEASON_COLUMNS)
        visits = edit.read(VISITS, VISIT_COLUMNS)
    chosen = str(fields.columns["field"][row])
    chosen_row = _rows(fields)[row]
    own_seasons, own_visits = ((layer.columns["field"] == chosen).nonzero()[0] for layer in (seasons, visits))
    own_seasons = own_seasons[np.argsort(-seasons.columns["season"][own_seasons], kind="stable")]
    own_visits = own_visits[np.argsort(visits.columns["date"][own_visits], kind="stable")[::-1]]
    by_season = _rows(seasons, own_seasons)
    by_visit = _rows(visits, own_visits)
    if target is not None and target.suffix == ".csv":
        write_csv_table(target, VISIT_COLUMNS[1:], by_visit)
    elif target is not None:
        page = history_page(chosen_row, fields.shapes[row], by_season, by_visit, visits.shapes[own_visits])
        write_html(target, page, language)
    return FieldHistory(target, chosen_row, by_season, by_visit)


def farm_traffic(
    farm_map: str | Path,
    out: str | Path,
    settings: TrafficSettings = TrafficSettings(),
    *,
    schema: str = DB_SCHEMA,
    overwrite: bool = False,
    progress: Progress = silent,
) -> TrafficRaster:
    """Write how often each spot of a farm was worked and driven on.

    Args:
        farm_map: path of a GeoPackage, or a PostgreSQL connection string.
        out: a cloud-optimised GeoTIFF of 16-bit numbers: times worked, last day worked, passages of wheels.
        schema: of the tables in a database.

    Raises:
        InputError: if the farm map has no such sessions, or cannot be read.
        RefusedError: if the file exists.
    """
    target = Path(out)
    refuse_existing(target, overwrite=overwrite)
    with open_edit(farm_map, schema=schema, progress=progress) as edit:
        name = edit.name()
        crs = edit.crs()
        visits = edit.read(VISITS, ("session", "season"))
        of_season = set(visits.columns["session"][visits.columns["season"] == settings.season].tolist())
        first = settings.since or dt.date.min
        last = settings.until or dt.date.max
        sessions_of = {
            s.session
            for s in edit.sessions()
            if first <= s.date <= last and (settings.season is None or s.session in of_season)
        }
        passes, day, tracks = _traffic(edit, sessions_of)
    if crs is None or not len(tracks):
        raise InputError("no-traffic", name=name)
    origin = Origin("Traffic: times worked and driven on", parameters=settings.plain())
    grid = write_traffic(target, passes, day, tracks, crs, settings.cell_m, settings.wheels, origin, progress)
    counts = (len(tracks), len(passes))
    return TrafficRaster(target, crs.to_string(), settings.cell_m, grid.columns, grid.rows, *counts)


def _traffic(edit: FarmEdit, wanted: set[str]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Where machines worked, on which days, and where the rear axles of sessions drove."""
    passes = edit.read("passes", ("session", "date"))
    overlaps = edit.read("overlaps", ("session", "date", "pass_a", "pass_b"))
    tracks = edit.read(TRACKS, ("session",))
    again = overlaps.columns["pass_a"] == overlaps.columns["pass_b"]
    mine = [np.array([s in wanted for s in layer.columns["session"]], bool) for layer in (passes, overlaps, tracks)]
    mine[1] &= again
    shapes = np.concatenate([passes.shapes[mine[0]], overlaps.shapes[mine[1]]])
    days = np.concatenate([passes.columns["date"][mine[0]], overlaps.columns["date"][mine[1]]])
    return shapes, days.astype("datetime64[D]"), shapely.force_2d(tracks.shapes[mine[2]])


def _field_row(fields: Layer, wanted: str, farm_map: str) -> int:
    """The row of the field that a user means."""
    ids = fields.columns["field"].tolist()
    names = fields.columns["name"].tolist()
    found = [k for k, name in enumerate(names) if name == wanted] or [
        k for k, one in enumerate(ids) if one == wanted or (len(wanted) >= 4 and one.startswith(wanted))
    ]
    if len(found) == 1:
        return found[0]
    listed = ", ".join(f"{ids[k]} ({names[k]})" for k in (found or range(len(ids)))[:5]) or "none"
    raise InputError("no-such-field", farm_map=farm_map, found=bool(found), wanted=wanted, listed=listed)


def _rows(layer: Layer, rows: NDArray[np.intp] | None = None) -> list[dict[str, Any]]:
    """Rows with plain values: None where unknown."""
    picked = np.arange(len(layer.shapes)) if rows is None else rows
    cells = {name: [_plain(value, name) for value in values[picked].tolist()] for name, values in layer.columns.items()}
    return [dict(zip(cells, row, strict=True)) for row in zip(*cells.values(), strict=True)]


def _plain(value: Any, name: str) -> Any:
    if isinstance(value, float):
        if not np.isfinite(value):
            return None
        return int(value) if name in _WHOLE else round(value, 4)
    return value.isoformat() if isinstance(value, dt.date) else value
