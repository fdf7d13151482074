"""What a farm map remembers of fields and machines: tables computed from the sessions in it.

The tables depend on nothing but the sessions, so the order in which these were added, or added again, does not matter.
"""

import datetime as dt
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.geometry.base import BaseGeometry

from furrowmap.exporters.vectors.field_layers import Columns, Layer, geometry_array

FIELDS_LAYER: Final = "fields"
VISITS: Final = "visits"
SEASONS: Final = "seasons"
MACHINES: Final = "machines"
DERIVED: Final = frozenset({FIELDS_LAYER, VISITS, SEASONS, MACHINES})
"""Tables that are computed again after every change of the sessions."""

MIN_INSIDE_SHARE: Final = 0.5
"""A session's ground belongs to a known field from this share of it inside the field."""
MIN_VISIT_SHARE: Final = 0.01
"""Less of a session's ground in a second field is the edge of a neighbour."""
CLOSED_GAP_M: Final = 3.0
"""Gaps up to twice as wide within the worked ground belong to the field."""

_SESSION_NUMBERS: Final = (
    "worked_area_m2", "overlap_area_m2", "missed_area_m2", "hours", "distance_m", "soil_moved_m3", "swept_area_m2",
)  # fmt: skip
SESSION_COLUMNS: Final = ("session", "name", "date", "start", "implement", "machine", "field_name", *_SESSION_NUMBERS)
GROUND_COLUMNS: Final = ("session",)
PASS_COLUMNS: Final = ("session", "depth_m", "area_m2")
"""Columns of `sessions`, of ground, and of `passes` that the tables are computed from."""


_DTYPES: Final[Mapping[str, Any]] = {
    **dict.fromkeys(("field", "session", "name", "implement", "machine"), object),
    **dict.fromkeys(("date", "first_date", "last_date"), "datetime64[D]"),
    **dict.fromkeys(("season", "sessions", "times_worked"), np.int64),
    "surveyed": bool,
}
"""Types of the columns of the tables; all others are numbers."""
_FIELDS_COLUMNS: Final = ("field", "name", "surveyed", "area_m2", "sessions", "first_date", "last_date")
_VISIT_COLUMNS: Final = (
    "field", "session", "name", "date", "season", "implement", "machine", *_SESSION_NUMBERS, "depth_m",
    "work_rate_ha_h",
)  # fmt: skip
_SEASON_COLUMNS: Final = (
    "field", "name", "season", "times_worked", "first_date", "last_date", "ground_m2", *_SESSION_NUMBERS, "depth_m",
    "work_rate_ha_h",
)  # fmt: skip
_MACHINE_NUMBERS: Final = ("worked_area_m2", "hours", "distance_m", "soil_moved_m3")
_MACHINE_COLUMNS: Final = (
    "machine", "implement", "sessions", "first_date", "last_date", *_MACHINE_NUMBERS, "work_rate_ha_h",
)  # fmt: skip
Row = dict[str, Any]
"""Values of a table by column, and the geometry as `ground`."""


@dataclass(frozen=True)
class _Field:
    id: str
    name: str
    outline: BaseGeometry
    surveyed: bool


@dataclass(frozen=True)
class Sessions:
    """Layers that the tables of a farm map are computed from, with a column `session`; `sessions` in order of time."""

    sessions: Layer
    coverage: Layer
    boundary: Layer
    overlaps: Layer
    misses: Layer
    passes: Layer


def season_of(date: dt.date, start: tuple[int, int]) -> int:
    """The year in which the season of a date begins, for seasons that begin at a month and day of each year."""
    return date.year if (date.month, date.day) >= start else date.year - 1


def memory_layers(known: Sessions, season_start: tuple[int, int]) -> list[Layer]:
    """The tables of fields, visits, seasons (from a month and day on) and machines.

    A field is the boundary that a session states, or the ground that sessions worked and that overlaps by half of it or
    more. A session that worked in several fields is divided: ground, overlap and missed ground by where they lie; time,
    distance and soil by the worked ground. A session without worked ground counts for its machine only.
    """
    fields = _find_fields(known)
    visits = list(_divide_sessions(known, fields, season_start))
    rows: list[Row] = []
    for field in fields:
        dates = [visit["date"] for visit in visits if visit["field"] == field.id]
        about = {"field": field.id, "name": field.name, "surveyed": field.surveyed, "sessions": len(dates)}
        days = {"first_date": min(dates, default=None), "last_date": max(dates, default=None)}
        rows.append({**about, **days, "area_m2": field.outline.area, "ground": field.outline})
    text = "Fields: the boundary that sessions state, or the ground that they worked"
    seasons = "The work of each season in each field; areas are sums over the sessions, ground_m2 counts ground once"
    machines = "Machines, and what each did"
    return [
        _table(FIELDS_LAYER, text, _FIELDS_COLUMNS, rows),
        _table(VISITS, "The work of each session in each field", _VISIT_COLUMNS, visits),
        _table(SEASONS, seasons, _SEASON_COLUMNS, list(_season_rows(fields, visits))),
        _table(MACHINES, machines, _MACHINE_COLUMNS, list(_machine_rows(known.sessions.columns)), kind=""),
    ]


def _table(name: str, text: str, columns: Sequence[str], rows: Sequence[Row], kind: str = "MultiPolygon") -> Layer:
    shapes = [shapely.MultiPolygon(_polygons(row["ground"])) if kind else None for row in rows]
    values = {column: np.array([row[column] for row in rows], _DTYPES.get(column, np.float64)) for column in columns}
    return Layer(name, kind, text, geometry_array(shapes), values)


def _polygons(shape: BaseGeometry) -> list[shapely.Polygon]:
    return [part for part in shapely.get_parts(shape) if isinstance(part, shapely.Polygon)]


def _by_session(layer: Layer) -> dict[str, NDArray[np.intp]]:
    """Rows of each session."""
    sessions = layer.columns.get("session", np.empty(0, object))
    order = np.argsort(sessions.astype(str), kind="stable")
    names, first = np.unique(sessions[order].astype(str), return_index=True)
    return dict(zip(names.tolist(), np.split(order, first[1:]), strict=True)) if len(order) else {}


def _united(layer: Layer) -> dict[str, BaseGeometry]:
    """The shapes of each session as one."""
    return {
        session: shapely.union_all(shapely.make_valid(shapely.force_2d(layer.shapes[rows])))
        for session, rows in _by_session(layer).items()
    }


def _find_fields(known: Sessions) -> list[_Field]:
    """The fields in the order of the first session in each."""
    ground = _united(known.coverage)
    stated = _united(known.boundary)
    columns = known.sessions.columns
    fields: list[_Field] = []
    for session, name, named in zip(columns["session"], columns["name"], columns["field_name"], strict=True):
        boundary = stated.get(session)
        worked = ground.get(session)
        shape = boundary if boundary is not None else worked
        if shape is None or shape.is_empty:
            continue
        surveyed = boundary is not None
        place = _place_of(fields, shape, surveyed=surveyed)
        if place is None:
            outline = shape if surveyed else _closed(shape)
            fields.append(_Field(str(session), str(named or name or session), outline, surveyed))
        elif surveyed and not fields[place].surveyed:
            fields[place] = replace(fields[place], outline=shape, surveyed=True)
        elif not fields[place].surveyed:
            fields[place] = replace(fields[place], outline=_closed(shapely.union(fields[place].outline, shape)))
    return fields


def _place_of(fields: Sequence[_Field], shape: BaseGeometry, *, surveyed: bool) -> int | None:
    """The field that a session's boundary or ground belongs to."""
    shares = []
    for field in fields:
        common = shapely.area(shapely.intersection(field.outline, shape))
        least = min(field.outline.area, shape.area) if surveyed or not field.surveyed else shape.area
        shares.append(common / max(least, 1e-9))
    if not shares or max(shares) < MIN_INSIDE_SHARE:
        return None
    return int(np.argmax(shares))


def _closed(shape: BaseGeometry) -> BaseGeometry:
    """Ground with its gaps closed."""
    wide = shapely.buffer(shape, CLOSED_GAP_M, join_style="mitre")
    filled = shapely.union_all([shapely.Polygon(part.exterior) for part in _polygons(wide)])
    return shapely.union(shapely.buffer(filled, -CLOSED_GAP_M, join_style="mitre"), shape)


def _divide_sessions(known: Sessions, fields: Sequence[_Field], season_start: tuple[int, int]) -> Iterator[Row]:
    """The work of each session in each field."""
    ground = _united(known.coverage)
    columns = known.sessions.columns
    overlaps, misses, passes = (_by_session(layer) for layer in (known.overlaps, known.misses, known.passes))
    tree = shapely.STRtree([field.outline for field in fields])
    for row, session in enumerate(columns["session"].tolist()):
        worked = ground.get(session)
        if worked is None or worked.is_empty or not fields:
            continue
        parts = [(fields[k], shapely.intersection(worked, fields[k].outline)) for k in sorted(tree.query(worked))]
        parts = [(field, part) for field, part in parts if part.area / worked.area >= MIN_VISIT_SHARE]
        whole = len(parts) == 1  # a field's edge, surveyed or not, takes nothing away from the only field
        date = columns["date"][row].astype("datetime64[D]").item()
        for field, part in parts:
            share = 1.0 if whole else part.area / worked.area
            figures = {name: share * float(columns[name][row]) for name in _SESSION_NUMBERS}
            if not whole:
                figures["overlap_area_m2"] *= _share_inside(known.overlaps, overlaps.get(session), field) / share
                figures["missed_area_m2"] *= _share_inside(known.misses, misses.get(session), field) / share
            yield {
                "field": field.id,
                "session": session,
                "name": str(columns["name"][row]),
                "date": date,
                "season": season_of(date, season_start),
                "implement": columns["implement"][row],
                "machine": _machine(columns, row),
                "ground": worked if whole else part,
                "depth_m": _depth_m(known.passes, passes.get(session), None if whole else field.outline),
                "work_rate_ha_h": _rate_ha_h([figures["worked_area_m2"]], [figures["hours"]]),
                **figures,
            }


def _share_inside(layer: Layer, rows: NDArray[np.intp] | None, field: _Field) -> float:
    """Share (0 to 1) of the area of polygons that lies in a field."""
    if rows is None:
        return 0.0
    shapes = shapely.make_valid(layer.shapes[rows])
    whole = float(shapely.area(shapes).sum())
    return float(shapely.area(shapely.intersection(shapes, field.outline)).sum()) / whole if whole else 0.0


def _depth_m(passes: Layer, rows: NDArray[np.intp] | None, outline: BaseGeometry | None) -> float:
    """Mean depth by area; nan where unknown."""
    if rows is None:
        return float("nan")
    depth = passes.columns["depth_m"][rows]
    area = passes.columns["area_m2"][rows]
    if outline is not None:
        shapes = shapely.make_valid(passes.shapes[rows])
        area = shapely.area(shapely.intersection(shapes, outline))
    return _mean_depth_m(depth, area)


def _mean_depth_m(depth_m: ArrayLike, area_m2: ArrayLike) -> float:
    """Mean by area; nan where no depth is known."""
    depth = np.asarray(depth_m, np.float64)
    area = np.asarray(area_m2, np.float64)
    known = np.isfinite(depth) & (area > 0)
    return float(np.average(depth[known], weights=area[known])) if known.any() else float("nan")


def _machine(columns: Columns, row: int) -> str:
    return str(columns["machine"][row] or columns["implement"][row] or "unnamed")


def _season_rows(fields: Sequence[_Field], visits: Sequence[Row]) -> Iterator[Row]:
    for field in fields:
        for season in sorted({visit["season"] for visit in visits if visit["field"] == field.id}):
            own = [visit for visit in visits if (visit["field"], visit["season"]) == (field.id, season)]
            ground = shapely.union_all([visit["ground"] for visit in own])
            values = {name: [visit[name] for visit in own] for name in (*_SESSION_NUMBERS, "date", "depth_m")}
            yield {
                "field": field.id,
                "name": field.name,
                "season": season,
                "times_worked": len({visit["session"] for visit in own}),
                "first_date": min(values["date"]),
                "last_date": max(values["date"]),
                "ground": ground,
                "ground_m2": ground.area,
                "depth_m": _mean_depth_m(values["depth_m"], values["worked_area_m2"]),
                "work_rate_ha_h": _rate_ha_h(values["worked_area_m2"], values["hours"]),
                **{name: _sum(values[name]) for name in _SESSION_NUMBERS},
            }


def _machine_rows(columns: Columns) -> Iterator[Row]:
    machine = np.array([_machine(columns, row) for row in range(len(columns["session"]))], object)
    days = columns["date"].astype("datetime64[D]")
    for name in dict.fromkeys(machine.tolist()):
        rows = np.flatnonzero(machine == name)
        yield {
            "machine": name,
            "implement": ", ".join(dict.fromkeys(str(kind) for kind in columns["implement"][rows] if kind)),
            "sessions": len(rows),
            "first_date": days[rows].min(),
            "last_date": days[rows].max(),
            "work_rate_ha_h": _rate_ha_h(columns["worked_area_m2"][rows], columns["hours"][rows]),
            **{number: _sum(columns[number][rows].tolist()) for number in _MACHINE_NUMBERS},
        }


def _rate_ha_h(area_m2: ArrayLike, hours: ArrayLike) -> float:
    """Work rate of those whose area and hours are both known; nan where there are none."""
    area = np.asarray(area_m2, np.float64)
    time = np.asarray(hours, np.float64)
    known = np.isfinite(area) & np.isfinite(time)
    total_h = float(sum(time[known]))
    return float(sum(area[known])) / 10_000.0 / total_h if total_h > 0 else float("nan")


def _sum(values: Iterable[float]) -> float:
    """Of the known values; nan where none is known."""
    known = [value for value in values if np.isfinite(value)]
    return float(sum(known)) if known else float("nan")
