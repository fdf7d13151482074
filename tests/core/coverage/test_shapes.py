"""Polygons fit for a map."""

from __future__ import annotations

import pytest
import shapely

from furrowmap.core.coverage.shapes import areal, parts


def test_areal__keeps_the_polygons_of_what_also_touches_in_lines() -> None:
    square, beside = shapely.box(0, 0, 1, 1), shapely.box(2, 0, 3, 1)
    mixed = shapely.GeometryCollection([square, shapely.LineString([(1, 0), (1, 1)]), shapely.Point(5, 5), beside])
    assert areal(mixed) == shapely.MultiPolygon([square, beside])
    assert areal(mixed).intersection(square).area == 1.0


def test_areal__of_polygons_is_what_it_was() -> None:
    square = shapely.box(0, 0, 1, 1)
    assert areal(square) is square
    assert areal(shapely.GeometryCollection([shapely.Point(0, 0)])).is_empty


def test_parts__of_a_ring_that_crosses_itself_by_a_hair_are_valid() -> None:
    crossed = shapely.Polygon([(0, 0), (10, 0), (10, 10), (5.1, 10), (5, -1e-10), (4.9, 10), (0, 10)])
    assert not crossed.is_valid
    found = parts(shapely.MultiPolygon([crossed]))
    assert len(found) == 2
    assert all(part.is_valid for part in found)
    assert sum(part.area for part in found) == pytest.approx(99.0)
