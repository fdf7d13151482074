"""Polygons fit for a map."""

from __future__ import annotations

import shapely

from furrowmap.core.work.shapes import areal


def test_areal__keeps_the_polygons_of_what_also_touches_in_lines() -> None:
    square, beside = shapely.box(0, 0, 1, 1), shapely.box(2, 0, 3, 1)
    mixed = shapely.GeometryCollection([square, shapely.LineString([(1, 0), (1, 1)]), shapely.Point(5, 5), beside])
    assert areal(mixed) == shapely.MultiPolygon([square, beside])
    assert areal(mixed).intersection(square).area == 1.0


def test_areal__of_polygons_is_what_it_was() -> None:
    square = shapely.box(0, 0, 1, 1)
    assert areal(square) is square
    assert areal(shapely.GeometryCollection([shapely.Point(0, 0)])).is_empty
