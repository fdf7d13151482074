"""Wheel passages against areas in closed form: straight, round, back and forth."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.coverage.wheel_traffic import wheel_passages
from furrowmap.core.surfaces.grid import Grid

GRID = Grid.of_bounds(0.1, (0.0, 0.0, 60.0, 60.0))
TRACK_M, TYRE_M = 1.5, 0.42


def path(xy: NDArray[np.float64], driven_m: float = 0.0) -> NDArray[np.float64]:
    steps = np.hypot(*np.diff(xy, axis=0).T)
    return np.column_stack([xy, driven_m + np.concatenate([[0.0], np.cumsum(steps)])])


def straight(angle_deg: float, length_m: float = 40.0) -> NDArray[np.float64]:
    along = np.linspace(-0.5, 0.5, 9)[:, np.newaxis] * length_m
    return 30.0 + along * (np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg)))


@pytest.mark.parametrize("angle_deg", [17.0, 68.0, 121.0])
def test_straight__covers_two_tyres_and_twice_when_driven_back(angle_deg: float) -> None:
    there = path(straight(angle_deg))
    once = wheel_passages(GRID, [there], TRACK_M, TYRE_M)
    assert once.max() == 1
    assert once.sum() * 0.01 == pytest.approx(2 * TYRE_M * 40.0, rel=0.005)
    back = np.concatenate([there[:, :2], there[-2::-1, :2]])
    twice = wheel_passages(GRID, [path(back)], TRACK_M, TYRE_M)
    assert twice.max() == 2
    assert twice.sum() * 0.01 == pytest.approx(2 * TYRE_M * (80.0 - 1.0), rel=0.005)  # the last metre is one passage


def test_circle__has_two_rings() -> None:
    angle = np.linspace(0.0, 2 * np.pi, 200)
    ring = 30.0 + 10.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    counts = wheel_passages(GRID, [path(ring)], TRACK_M, TYRE_M)
    assert counts.sum() * 0.01 == pytest.approx(2 * np.pi * 10.0 * 2 * TYRE_M, rel=0.005)
    three = np.concatenate([ring, ring[1:], ring[1:]])
    assert wheel_passages(GRID, [path(three)], TRACK_M, TYRE_M).sum() == pytest.approx(3 * counts.sum(), rel=0.002)


def test_standing__is_one_passage_and_pieces_apart_are_several() -> None:
    rng = np.random.default_rng(3)
    trembling = np.concatenate([straight(30.0)[:5], 30.0 + rng.normal(0.0, 0.005, (50, 2)), straight(30.0)[5:]])
    assert wheel_passages(GRID, [path(trembling)], TRACK_M, TYRE_M).max() == 1
    pieces = [path(straight(30.0)), path(straight(30.0), 500.0)]
    assert wheel_passages(GRID, pieces, TRACK_M, TYRE_M).max() == 2


def test_tiles__have_what_the_whole_has() -> None:
    there = path(straight(40.0))
    whole = wheel_passages(GRID, [there], TRACK_M, TYRE_M)
    west = Grid(GRID.cell_m, GRID.west, GRID.north, (GRID.rows, 300))
    east = Grid(GRID.cell_m, GRID.west + 300, GRID.north, (GRID.rows, GRID.columns - 300))
    parts = [wheel_passages(part, [there], TRACK_M, TYRE_M) for part in (west, east)]
    assert np.array_equal(np.hstack(parts), whole)
