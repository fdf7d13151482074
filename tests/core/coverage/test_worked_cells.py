"""Cells of the ground worked, against areas known from geometry."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.coverage.worked_cells import MISSED, NOT_SEEN, OVERLAP, WORKED, Swept, WorkedCells


def drive(cells: WorkedCells, start_m: tuple[float, float], heading_rad: float, length_m: float, way_m: float) -> float:
    """Work a straight pass of 2 m width in steps of 0.13 m; gives the way at its end."""
    ahead = np.array([np.cos(heading_rad), np.sin(heading_rad)])
    left = np.array([-ahead[1], ahead[0]])
    along = np.append(np.arange(0.0, length_m, 0.13), length_m)
    lines = [np.array([start_m + a * ahead - left, start_m + a * ahead + left]) for a in along]
    for before, after, a in zip(lines[:-1], lines[1:], along[1:], strict=True):
        cells.add_line(before, after, way_m + a)
    cells.end_pass()
    return way_m + length_m


@pytest.mark.parametrize("heading_rad", [0.0, 0.7])
def test_areas__of_two_passes_are_those_of_geometry(heading_rad: float) -> None:
    cells = WorkedCells(2.0)
    left = np.array([-np.sin(heading_rad), np.cos(heading_rad)])
    way = drive(cells, (-3.0, 5.0), heading_rad, 30.0, 0.0)
    assert cells.area_m2(WORKED) == pytest.approx(60.0, rel=0.01)
    assert cells.area_m2(OVERLAP) == 0.0
    # The next pass leaves a strip of 0.4 m; the third one works 0.5 m of the second again.
    way = drive(cells, tuple(np.array([-3.0, 5.0]) + 2.4 * left), heading_rad, 30.0, way)
    drive(cells, tuple(np.array([-3.0, 5.0]) + 3.9 * left), heading_rad, 30.0, way)
    for _ in range(400):
        cells.look_for_misses()
    assert cells.area_m2(WORKED) == pytest.approx(60.0 + 60.0 + 45.0, rel=0.01)
    assert cells.area_m2(OVERLAP) == pytest.approx(15.0, rel=0.03)
    assert cells.area_m2(MISSED) == pytest.approx(12.0, rel=0.05)
    states = np.concatenate([state.ravel() for state in cells.tiles().values()])
    assert np.bincount(states, minlength=5)[1:].tolist() == cells.count[1:].tolist()


def test_misses__are_worked_once_the_tool_comes_back() -> None:
    cells = WorkedCells(2.0)
    way = drive(cells, (0.0, 0.0), 0.0, 10.0, 0.0)
    way = drive(cells, (0.0, 2.5), 0.0, 10.0, way)
    for _ in range(100):
        cells.look_for_misses()
    assert cells.area_m2(MISSED) == pytest.approx(5.0, rel=0.1)
    drive(cells, (0.0, 1.2), 0.0, 10.0, way)
    assert cells.area_m2(MISSED) == pytest.approx(0.0, abs=0.2)


def lines(cells: WorkedCells, north_m: float, first_s: float, *, unseen: tuple[float, float] = (0.0, 0.0)) -> None:
    """A pass of 20 m and 2 m width to the east in 100 s, of which the tool was not seen for a time."""
    for k in range(100):
        before, after = (np.array([[0.2 * n, north_m - 1.0], [0.2 * n, north_m + 1.0]]) for n in (k, k + 1))
        cells.add_line(before, after, 0.2 * (first_s + k + 1), first_s + k + 1, unseen=unseen[0] <= k < unseen[1])
    cells.end_pass()


def test_ground_not_seen__is_neither_worked_nor_missed_and_is_worked_again() -> None:
    """The middle one of three passes was not seen for 30 of 100 s; what is found later makes all as if it had been."""
    whole, cells = WorkedCells(2.0), WorkedCells(2.0)
    for number in range(3):
        lines(whole, 2.2 * number, 100.0 * number)
        lines(cells, 2.2 * number, 100.0 * number, unseen=(40, 70) if number == 1 else (0, 0))
    whole.finish()
    cells.finish()
    assert cells.area_m2(NOT_SEEN) == pytest.approx(12.0, rel=0.01)
    assert cells.area_m2(WORKED) == pytest.approx(108.0, rel=0.01)
    assert 0.0 < cells.area_m2(MISSED) <= whole.area_m2(MISSED)
    found = whole.swept[(whole.swept.t_s > 140.0) & (whole.swept.t_s <= 170.0)]
    changed = cells.replace(140.0, 170.0, found)
    cells.finish()
    assert changed
    assert cells.count[1:].tolist() == whole.count[1:].tolist()
    assert all(np.array_equal(state, cells.tiles()[tile]) for tile, state in whole.tiles().items())
    assert np.all(np.diff(cells.swept.t_s) >= 0.0)


def test_ground_worked_again__may_begin_before_all_that_was_seen() -> None:
    """A page that was begun late gets the first pass from the recording, and the overlap with it."""
    whole, late = WorkedCells(2.0), WorkedCells(2.0)
    lines(whole, 0.0, 0.0)
    lines(whole, 1.5, 100.0)
    lines(late, 1.5, 100.0)
    late.replace(-np.inf, 100.0, whole.swept[whole.swept.t_s <= 100.0])
    assert whole.area_m2(OVERLAP) == pytest.approx(10.0, rel=0.02)
    assert late.count[1:].tolist() == whole.count[1:].tolist()
    late.replace(-np.inf, 100.0, Swept.none())
    assert late.area_m2(WORKED) == pytest.approx(40.0, rel=0.01)
