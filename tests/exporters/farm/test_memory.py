"""Tables of fields, seasons and machines against rectangles whose areas are known."""

from __future__ import annotations

import datetime as dt
import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from furrowmap.exporters.farm.farm_memory_tables import SESSION_COLUMNS, Sessions, memory_layers, season_of
from furrowmap.exporters.vectors.field_layers import Layer, geometry_array

TEXTS = {"session", "name", "implement", "machine", "field_name"}
Row = dict[str, object]


def layer(name: str, rows: list[tuple[str, shapely.Geometry]], **columns: list[float]) -> Layer:
    sessions = np.array([session for session, _ in rows], object)
    more = {key: np.array(values, np.float64) for key, values in columns.items()}
    return Layer(name, "Polygon", "", geometry_array([shape for _, shape in rows]), {"session": sessions, **more})


def known(
    rows: list[Row],
    ground: dict[str, shapely.Geometry],
    boundary: dict[str, shapely.Geometry] | None = None,
    overlaps: dict[str, shapely.Geometry] | None = None,
) -> Sessions:
    """Layers of sessions on given days; figures that a row does not have are unknown."""
    columns = {}
    for name in SESSION_COLUMNS:
        values = [row.get(name, None if name in TEXTS else math.nan) for row in rows]
        dates = name in ("date", "start")
        kind = object if name in TEXTS else "datetime64[D]" if dates else np.float64
        columns[name] = np.array([row["date"] for row in rows] if dates else values, kind)
    sessions = Layer("sessions", "Polygon", "", geometry_array([None] * len(rows)), columns)
    passes = layer("passes", [*ground.items()], depth_m=[0.1] * len(ground), area_m2=[g.area for g in ground.values()])
    return Sessions(
        sessions,
        layer("coverage", [*ground.items()]),
        layer("boundary", [*(boundary or {}).items()]),
        layer("overlaps", [*(overlaps or {}).items()]),
        layer("misses", []),
        passes,
    )


def tables(sessions: Sessions) -> list[Layer]:
    """The tables, for seasons that are calendar years."""
    return memory_layers(sessions, (1, 1))


def row(session: str, day: str, area_m2: float, hours: float = 1.0, **more: object) -> Row:
    figures = {"worked_area_m2": area_m2, "hours": hours, "overlap_area_m2": 0.0, "missed_area_m2": 0.0}
    date = dt.date.fromisoformat(day)
    return {"session": session, "name": session.upper(), "date": date, "machine": "tiller", **figures, **more}


def test_sessions_of_one_ground__are_one_field_and_their_figures_add_up() -> None:
    ground = {"a": shapely.box(0, 0, 100, 50), "b": shapely.box(0, 0, 100, 40), "c": shapely.box(300, 0, 400, 50)}
    rows = [
        row("a", "2026-04-02", 5000.0, 2.0, soil_moved_m3=30.0),
        row("b", "2026-05-02", 4000.0, 1.0),
        row("c", "2027-01-02", 5000.0, 1.0, machine="plough"),
    ]
    fields, visits, seasons, machines = tables(known(rows, ground))
    assert fields.columns["name"].tolist() == ["A", "C"]
    assert fields.columns["area_m2"] == pytest.approx([5000.0, 5000.0])
    assert visits.columns["field"].tolist() == ["a", "a", "c"]
    first = {name: values[0] for name, values in seasons.columns.items()}
    assert (first["season"], first["times_worked"], first["first_date"]) == (2026, 2, np.datetime64("2026-04-02"))
    assert first["ground_m2"] == pytest.approx(5000.0)
    assert (first["worked_area_m2"], first["hours"], first["soil_moved_m3"]) == (9000.0, 3.0, 30.0)
    assert first["work_rate_ha_h"] == pytest.approx(0.3)
    assert first["depth_m"] == pytest.approx(0.1)
    assert machines.columns["machine"].tolist() == ["tiller", "plough"]
    assert machines.columns["sessions"].tolist() == [2, 1]
    assert machines.columns["work_rate_ha_h"] == pytest.approx([0.3, 0.5])


def test_session_in_two_fields__is_divided_where_its_ground_lies() -> None:
    west, east = shapely.box(0, 0, 100, 50), shapely.box(100, 0, 200, 50)
    ground = {"a": shapely.box(10, 10, 90, 40), "b": shapely.box(110, 10, 190, 40), "c": shapely.box(20, 10, 160, 20)}
    rows = [row("a", "2026-04-02", 2400.0), row("b", "2026-04-03", 2400.0)]
    rows.append(row("c", "2026-04-04", 1400.0, 2.0, overlap_area_m2=50.0))
    twice = {"c": shapely.box(20, 10, 30, 15)}  # all of it in the western field
    _, visits, seasons, _ = tables(known(rows, ground, {"a": west, "b": east}, twice))
    assert seasons.columns["worked_area_m2"] == pytest.approx([3200.0, 3000.0])
    assert seasons.columns["overlap_area_m2"] == pytest.approx([50.0, 0.0])
    assert seasons.columns["hours"] == pytest.approx([1 + 2 * 8 / 14, 1 + 2 * 6 / 14])
    assert seasons.columns["times_worked"].tolist() == [2, 2]
    assert len(visits.shapes) == 4


def test_boundary__of_a_later_session_becomes_the_fields() -> None:
    ground = {"a": shapely.box(10, 10, 90, 40), "b": shapely.box(10, 10, 90, 40)}
    boundary = {"b": shapely.box(0, 0, 100, 50)}
    rows = [row("a", "2026-04-02", 2400.0, field_name="Nakada"), row("b", "2026-04-03", 2400.0)]
    fields, _, _, _ = tables(known(rows, ground, boundary))
    assert (fields.columns["name"].tolist(), fields.columns["area_m2"].tolist()) == (["Nakada"], [5000.0])
    assert fields.columns["surveyed"].tolist() == [True]


def test_what_is_unknown__adds_nothing_and_no_ground_makes_no_field() -> None:
    rows = [row("a", "2026-04-02", 2400.0), row("b", "2026-04-03", math.nan, math.nan), row("c", "2026-04-03", 7.0)]
    ground = {"a": shapely.box(10, 10, 90, 40), "b": shapely.box(10, 10, 90, 40)}
    fields, visits, seasons, machines = tables(known(rows, ground))
    assert (len(fields.shapes), len(visits.shapes)) == (1, 2)
    assert seasons.columns["worked_area_m2"].tolist() == [2400.0]
    assert seasons.columns["work_rate_ha_h"] == pytest.approx([0.24])
    assert math.isnan(seasons.columns["missed_area_m2"][0]) is False
    assert machines.columns["sessions"].tolist() == [3]
    empty = tables(known([], {}))
    assert [len(table.shapes) for table in empty] == [0, 0, 0, 0]


@settings(max_examples=100)
@given(st.dates(dt.date(1990, 1, 1), dt.date(2100, 1, 1)), st.integers(1, 12), st.integers(1, 28))
def test_season__begins_on_its_day_and_lasts_a_year(date: dt.date, month: int, day: int) -> None:
    begin = dt.date(season_of(date, (month, day)), month, day)
    assert begin <= date < begin.replace(year=begin.year + 1)
