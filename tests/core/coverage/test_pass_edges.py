"""How far the ends of the tool are from the passes beside it, and what is left of a field, against geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from furrowmap.core.coverage.field_left import FieldLeft
from furrowmap.core.coverage.pass_edges import edge_gaps_m
from furrowmap.core.coverage.worked_cells import WorkedCells


def line(heading_rad: float, along_m: float, left_m: float) -> NDArray[np.float64]:
    """Right and left end of a line of 2 m, of a vehicle that drives with a heading in the plane."""
    ahead = np.array([np.cos(heading_rad), np.sin(heading_rad)])
    left = np.array([-ahead[1], ahead[0]])
    return np.array([along_m * ahead + (left_m + side) * left for side in (-1.0, 1.0)])


@pytest.mark.parametrize("heading_rad", [0.0, 2.1])
def test_edges__are_those_of_the_passes_beside(heading_rad: float) -> None:
    cells, way_m = WorkedCells(2.0), 0.0
    for left_m in (-2.1, 2.5):
        for k in range(100):
            way_m += 0.2
            before, after = (line(heading_rad, 0.2 * n, left_m) for n in (k, k + 1))
            cells.add_line(before, after, way_m)
    for off_m, expected in ((0.0, (0.5, 0.1)), (0.23, (0.27, 0.33)), (-0.15, (0.65, -0.05))):
        gaps = edge_gaps_m(cells.swept, line(heading_rad, 10.0, off_m), way_m + 20.0)
        assert gaps == pytest.approx(expected, abs=1e-6)
    assert all(math.isnan(gap) for gap in edge_gaps_m(cells.swept, line(heading_rad, 60.0, 0.0), way_m + 20.0))
    own = WorkedCells(2.0)
    own.add_line(line(heading_rad, 9.5, 0.0), line(heading_rad, 10.0, 0.0), 10.0)
    assert all(math.isnan(gap) for gap in edge_gaps_m(own.swept, line(heading_rad, 10.0, 0.0), 10.0))


def test_field_left__is_what_lies_inside_of_the_boundary() -> None:
    """A strip of 2 m through a field of 20 by 10 m with a pond of 2 by 2 m on its way, from outside to outside."""
    pond = shapely.box(9.0, 0.0, 11.0, 2.0)
    field, cells = FieldLeft(shapely.box(0.0, -5.0, 20.0, 5.0).difference(pond)), WorkedCells(2.0)
    assert field.left_m2 == pytest.approx(196.0)
    field.look_at(cells, cells.add_line(line(0.0, -5.0, 1.0), line(0.0, 25.0, 1.0), 30.0))
    assert field.left_m2 == pytest.approx(196.0 - 36.0, rel=0.005)
    assert sorted(len(ring) for ring in field.rings()) == [5, 5]
    assert all(np.abs(ring[:, 1]).max() <= 4.0 + 1e-9 for ring in field.rings(1.0))
