"""Ground seen before: kept where the vehicle is, dropped where it is not, and no more of it however far it drives."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.matching.rolling_base import MOST_WEIGHT, SQUARE, RollingBase
from furrowmap.core.matching.surface import TILE

CELL_M = 0.15
SIDE_M = TILE * CELL_M


def height_at(base: RollingBase, x: float, y: float) -> tuple[float, float]:
    """Height and weight of the nearest node."""
    tiles = base.surface.tiles
    column, row = round(x / CELL_M), round(y / CELL_M)
    tile = tiles.number[row // TILE - tiles.south, column // TILE - tiles.west]
    return tuple(float(a[tile, 0, row % TILE, column % TILE]) for a in (base.surface.height_m, base.surface.weight))


def with_point(base: RollingBase, x: float, y: float, z: float, times: int = 1) -> None:
    count = np.full(times, 0, np.uint8)
    base.add(np.tile([x, y, z], (times, 1)), np.ones(times, bool), count, np.full(times, 255, np.uint8))


@given(st.floats(-500, 500), st.floats(-500, 500), st.floats(-1, 1), st.floats(-1, 1))
def test_what_is_near_stays_when_the_vehicle_moves(x: float, y: float, dx: float, dy: float) -> None:
    base = RollingBase(np.array([x, y]), CELL_M)
    node = np.round(np.array([x, y]) / CELL_M) * CELL_M
    with_point(base, *node, 0.25)
    base.follow(np.array([x + dx * SIDE_M, y + dy * SIDE_M]))
    assert height_at(base, *node) == pytest.approx((0.25, 1.0), abs=1e-3)


def test_what_is_far_is_dropped_and_memory_stays() -> None:
    base = RollingBase(np.zeros(2), CELL_M)
    size = base.surface.weight.nbytes
    for x in np.arange(0.0, 1000.0, 1.0):
        with_point(base, x, 0.0, 0.1)
        base.follow(np.array([x, 0.0]))
    assert base.surface.weight.nbytes == size
    assert sorted(base.surface.tiles.number.ravel().tolist()) == list(range(SQUARE**2))
    west_m = base.surface.tiles.west * SIDE_M
    assert 999.0 - west_m < SQUARE * SIDE_M
    base.follow(np.zeros(2))
    assert base.surface.weight.max() == 0.0


def test_new_returns_keep_counting() -> None:
    base = RollingBase(np.zeros(2), CELL_M)
    with_point(base, 0.0, 0.0, 0.0, times=1000)
    with_point(base, 0.0, 0.0, 0.1, times=20)
    height, weight = height_at(base, 0.0, 0.0)
    assert weight == MOST_WEIGHT
    assert height > 0.05


def test_soil_under_the_implement_is_forgotten_and_no_more() -> None:
    base = RollingBase(np.zeros(2), CELL_M)
    nodes = CELL_M * np.arange(-20, 21)
    for y in nodes:
        with_point(base, 0.0, float(y), 0.3)
    base.forget(np.array([[0.0, 0.0]]), np.array([[0.0, 1.0]]), 1.0)
    for y in nodes:
        assert (height_at(base, 0.0, float(y))[1] == 0.0) == (abs(y) < 1.0 + 0.5 * CELL_M)


def test_a_copy_is_its_own() -> None:
    base = RollingBase(np.zeros(2), CELL_M)
    base.copy().weight[:] = 1.0
    assert base.surface.weight.max() == 0.0
