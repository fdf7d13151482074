"""What a farm map remembers of fields and machines: tables computed from the sessions in it.

The tables depend on nothing but the sessions, so the order in which these were added, or added again, does not matter.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from furrowmap.exporters.vectors.field_layers import Columns, Layer, geometry_array

FIELDS: Final = "fields"
VISITS: Final = "visits"
SEASONS: Final = "seasons"
MACHINES: Final = "machines"
DERIVED: Final = frozenset({FIELDS, VISITS, SEASONS, MACHINES})
"""Tables that are computed again after every change of the sessions."""

INSIDE: Final = 0.5
"""A session's ground belongs to a known field from this share of it inside the field."""
LEAST_SHARE: Final = 0.01
"""Less of a session's ground in a second field is the edge of a neighbour."""
CLOSE_M: Final = 3.0
"""Gaps up to twice as wide within the worked ground belong to the field."""

_SESSION_NUMBERS: Final = (
    "worked_area_m2", "overlap_area_m2", "missed_area_m2", "hours", "distance_m", "soil_moved_m3", "swept_area_m2",
)  # fmt: skip
SESSION_COLUMNS: Final = ("session", "name", "date", "start", "implement", "machine", "field_name", *_SESSION_NUMBERS)
GROUND_COLUMNS: Final = ("session",)
PASS_COLUMNS: Final = ("session", "depth_m", "area_m2")
"""Columns of `sessions`, of ground, and of `passes` that the tables are computed from."""


@dataclass(frozen=True)
class Visit:
    """The work of a session in a field.

    Attributes:
        field: identity of the field.
        session: identity of the session.
        name: of the session.
        date: of the session.
        season: the year in which the season begins.
        implement: kind of implement; None where unknown.
        ground: worked in the field.
        worked_area_m2: ground worked, counted once; likewise overlap, missed, swept; nan where unknown.
        hours: from the first pass to the end of the last.
        distance_m: driven.
        soil_moved_m3: volume of the change of the surface on the worked ground.
        depth_m: mean working depth by area.
    """

    field: str
    session: str
    name: str
    date: dt.date
    season: int
    implement: str | None
    machine: str
    ground: BaseGeometry
    worked_area_m2: float
    overlap_area_m2: float
    missed_area_m2: float
    swept_area_m2: float
    hours: float
    distance_m: float
    soil_moved_m3: float
    depth_m: float


@dataclass(frozen=True)
class _Field:
    id: str
    name: str
    outline: BaseGeometry
    surveyed: bool


@dataclass(frozen=True)
class Sessions:
    """Layers of a farm map that its tables are computed from; each has a column `session`.

    Attributes:
        sessions: with :data:`SESSION_COLUMNS`, in order of time.
        coverage: ground worked by each.
        boundary: of the field, of sessions that know it.
        overlaps: ground worked twice.
        misses: ground between passes that was left out.
        passes: with depths.
    """

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
    """The tables of fields, visits, seasons and machines.

    A field is the boundary that a session states, or the ground that sessions worked and that overlaps by half of it or
    more. A session that worked in several fields is divided: ground, overlap and missed ground by where they lie; time,
    distance and soil by the worked ground. A session without worked ground counts for its machine only.

    Args:
        known: the layers of the farm map.
        season_start: month and day on which a season begins.
    """
    fields = _fields(known)
    visits = list(_visits(known, fields, season_start))
    return [
        _field_layer(fields, visits),
        _visit_layer(visits),
        _season_layer(fields, visits),
        _machine_layer(known.sessions),
    ]


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


def _fields(known: Sessions) -> list[_Field]:
    """The fields in the order of the first session in each."""
    ground, stated = _united(known.coverage), _united(known.boundary)
    columns = known.sessions.columns
    fields: list[_Field] = []
    for session, name, named in zip(columns["session"], columns["name"], columns["field_name"], strict=True):
        boundary, worked = stated.get(session), ground.get(session)
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
    if not shares or max(shares) < INSIDE:
        return None
    return int(np.argmax(shares))


def _closed(shape: BaseGeometry) -> BaseGeometry:
    """Ground with its gaps closed."""
    wide = shapely.buffer(shape, CLOSE_M, join_style="mitre")
    polygons = [shapely.Polygon(part.exterior) for part in shapely.get_parts(wide) if part.geom_type == "Polygon"]
    return shapely.union(shapely.buffer(shapely.union_all(polygons), -CLOSE_M, join_style="mitre"), shape)


def _visits(known: Sessions, fields: Sequence[_Field], season_start: tuple[int, int]) -> Iterable[Visit]:
    ground, columns = _united(known.coverage), known.sessions.columns
    overlaps, misses = (_Shares(layer) for layer in (known.overlaps, known.misses))
    passes = _by_session(known.passes)
    tree = shapely.STRtree([field.outline for field in fields])
    for row, session in enumerate(columns["session"].tolist()):
        worked = ground.get(session)
        if worked is None or worked.is_empty or not fields:
            continue
        candidates = sorted(tree.query(worked).tolist())
        parts = [(fields[k], shapely.intersection(worked, fields[k].outline)) for k in candidates]
        shares = [(field, part, part.area / worked.area) for field, part in parts]
        shares = [entry for entry in shares if entry[2] >= LEAST_SHARE]
        whole = len(shares) == 1  # a field's edge, surveyed or not, takes nothing away from the only field
        for field, part, portion in shares:
            share = 1.0 if whole else portion
            date = columns["date"][row].astype("datetime64[D]").item()
            figures = {name: share * float(columns[name][row]) for name in _SESSION_NUMBERS}
            if not whole:
                figures["overlap_area_m2"] *= overlaps.inside(session, field.outline) / share
                figures["missed_area_m2"] *= misses.inside(session, field.outline) / share
            yield Visit(
                field=field.id,
                session=session,
                name=str(columns["name"][row]),
                date=date,
                season=season_of(date, season_start),
                implement=columns["implement"][row],
                machine=_machine(columns, row),
                ground=worked if whole else part,
                depth_m=_depth_m(known.passes, passes.get(session), None if whole else field.outline),
                **figures,
            )


class _Shares:
    """How much of the polygons of a session lies in a field."""

    def __init__(self, layer: Layer) -> None:
        self._shapes, self._rows = layer.shapes, _by_session(layer)

    def inside(self, session: str, outline: BaseGeometry) -> float:
        """Share of their area (0 to 1)."""
        rows = self._rows.get(session)
        if rows is None:
            return 0.0
        shapes = shapely.make_valid(self._shapes[rows])
        whole = float(shapely.area(shapes).sum())
        return float(shapely.area(shapely.intersection(shapes, outline)).sum()) / whole if whole else 0.0


def _depth_m(passes: Layer, rows: NDArray[np.intp] | None, outline: BaseGeometry | None) -> float:
    """Mean depth by area; nan where unknown."""
    if rows is None:
        return float("nan")
    depth, area = passes.columns["depth_m"][rows], passes.columns["area_m2"][rows]
    if outline is not None:
        shapes = shapely.make_valid(passes.shapes[rows])
        area = shapely.area(shapely.intersection(shapes, outline))
    known = np.isfinite(depth) & (area > 0)
    return float(np.average(depth[known], weights=area[known])) if known.any() else float("nan")


def _machine(columns: Columns, row: int) -> str:
    return str(columns["machine"][row] or columns["implement"][row] or "unnamed")


def _field_layer(fields: Sequence[_Field], visits: Sequence[Visit]) -> Layer:
    own = [[v for v in visits if v.field == field.id] for field in fields]
    shapes = geometry_array([_multi(field.outline) for field in fields])
    columns: Columns = {
        "field": _texts(field.id for field in fields),
        "name": _texts(field.name for field in fields),
        "surveyed": np.array([field.surveyed for field in fields], bool),
        "area_m2": np.array([field.outline.area for field in fields], np.float64),
        "sessions": np.array([len(mine) for mine in own], np.int64),
        "first_date": _dates(min((v.date for v in mine), default=None) for mine in own),
        "last_date": _dates(max((v.date for v in mine), default=None) for mine in own),
    }
    text = "Fields: the boundary that sessions state, or the ground that they worked"
    return Layer(FIELDS, "MultiPolygon", text, shapes, columns)


def _visit_layer(visits: Sequence[Visit]) -> Layer:
    columns: Columns = {
        "field": _texts(v.field for v in visits),
        "session": _texts(v.session for v in visits),
        "name": _texts(v.name for v in visits),
        "date": _dates(v.date for v in visits),
        "season": np.array([v.season for v in visits], np.int64),
        "implement": _texts(v.implement for v in visits),
        "machine": _texts(v.machine for v in visits),
        **{name: _numbers(getattr(v, name) for v in visits) for name in _SESSION_NUMBERS},
        "depth_m": _numbers(v.depth_m for v in visits),
        "work_rate_ha_h": _numbers(rate_ha_h(v.worked_area_m2, v.hours) for v in visits),
    }
    text = "The work of each session in each field"
    return Layer(VISITS, "MultiPolygon", text, geometry_array([_multi(v.ground) for v in visits]), columns)


def _season_layer(fields: Sequence[_Field], visits: Sequence[Visit]) -> Layer:
    names = {field.id: field.name for field in fields}
    groups: dict[tuple[str, int], list[Visit]] = {}
    for visit in visits:
        groups.setdefault((visit.field, visit.season), []).append(visit)
    keys = sorted(groups, key=lambda group: (list(names).index(group[0]), group[1]))
    grounds = [shapely.union_all([v.ground for v in groups[key]]) for key in keys]
    totals = {name: [_sum(getattr(v, name) for v in groups[key]) for key in keys] for name in _SESSION_NUMBERS}
    ground_m2 = np.array([ground.area for ground in grounds], np.float64)
    columns: Columns = {
        "field": _texts(field for field, _ in keys),
        "name": _texts(names[field] for field, _ in keys),
        "season": np.array([season for _, season in keys], np.int64),
        "times_worked": np.array([len({v.session for v in groups[key]}) for key in keys], np.int64),
        "first_date": _dates(min(v.date for v in groups[key]) for key in keys),
        "last_date": _dates(max(v.date for v in groups[key]) for key in keys),
        "ground_m2": ground_m2,
        **{name: _numbers(values) for name, values in totals.items()},
        "depth_m": _numbers(_mean_depth_m(groups[key]) for key in keys),
        "work_rate_ha_h": _numbers(_mean_rate_ha_h(groups[key]) for key in keys),
    }
    text = "The work of each season in each field; areas are sums over the sessions, ground_m2 counts ground once"
    return Layer(SEASONS, "MultiPolygon", text, geometry_array([_multi(ground) for ground in grounds]), columns)


def _machine_layer(sessions: Layer) -> Layer:
    columns = sessions.columns
    machine = np.array([_machine(columns, row) for row in range(len(sessions.shapes))], object)
    names = list(dict.fromkeys(machine.tolist()))
    rows = [np.flatnonzero(machine == name) for name in names]
    days = columns["date"].astype("datetime64[D]")
    found: Columns = {
        "machine": _texts(names),
        "implement": _texts(", ".join(dict.fromkeys(str(x) for x in columns["implement"][r] if x)) for r in rows),
        "sessions": np.array([len(r) for r in rows], np.int64),
        "first_date": _dates(days[r].min().item() for r in rows),
        "last_date": _dates(days[r].max().item() for r in rows),
        **{
            name: _numbers(_sum(columns[name][r].tolist()) for r in rows)
            for name in ("worked_area_m2", "hours", "distance_m", "soil_moved_m3")
        },
    }
    area, hours = columns["worked_area_m2"], columns["hours"]
    both = [r[np.isfinite(area[r]) & np.isfinite(hours[r])] for r in rows]
    found["work_rate_ha_h"] = _numbers(rate_ha_h(float(area[r].sum()), float(hours[r].sum())) for r in both)
    return Layer(MACHINES, "", "Machines, and what each did", geometry_array([None] * len(names)), found)


def rate_ha_h(area_m2: float, hours: float) -> float:
    """Work rate; nan where it is unknown."""
    return area_m2 / 10_000.0 / hours if hours > 0 else float("nan")


def _mean_rate_ha_h(visits: Sequence[Visit]) -> float:
    """Of the visits whose area and hours are both known."""
    known = [v for v in visits if np.isfinite(v.worked_area_m2) and np.isfinite(v.hours)]
    return rate_ha_h(sum(v.worked_area_m2 for v in known), sum(v.hours for v in known))


def _mean_depth_m(visits: Sequence[Visit]) -> float:
    known = [v for v in visits if np.isfinite(v.depth_m) and v.worked_area_m2 > 0]
    total = sum(v.worked_area_m2 for v in known)
    return sum(v.depth_m * v.worked_area_m2 for v in known) / total if total else float("nan")


def _sum(values: Iterable[float]) -> float:
    """Of the known values; nan where none is known."""
    known = [value for value in values if np.isfinite(value)]
    return float(sum(known)) if known else float("nan")


def _multi(shape: BaseGeometry) -> shapely.MultiPolygon:
    parts = [part for part in shapely.get_parts(shape) if isinstance(part, shapely.Polygon)]
    return shapely.MultiPolygon(parts)


def _texts(values: Iterable[Any]) -> NDArray[np.object_]:
    return np.array(list(values), dtype=object)


def _numbers(values: Iterable[float]) -> NDArray[np.float64]:
    return np.array(list(values), np.float64)


def _dates(values: Iterable[dt.date | None]) -> NDArray[np.datetime64]:
    return np.array(list(values), "datetime64[D]")
