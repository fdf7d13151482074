"""Ground at breaklines of sparse clouds, on scenes whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.surfaces.breaklines import point_spacing_m, with_breaklines
from furrowmap.core.surfaces.ground_filter import Smrf, classify_ground, ground_cells

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


def places(spacing_m: float, side_m: float = 150.0, seed: int = 5) -> FloatArray:
    """Points (n, 2) of an airborne scanner: a square grid, each a quarter of the spacing off."""
    rng = np.random.default_rng(seed)
    line = np.arange(0.5 * spacing_m, side_m, spacing_m)
    grid = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    return np.asarray(grid + rng.uniform(-0.25, 0.25, grid.shape) * spacing_m)


def quarry(place: FloatArray) -> FloatArray:
    """Terraces that rise by 8 m in steep faces round a pit, on a slope of 20 %."""
    across = np.hypot(place[:, 0] - 75.0, place[:, 1] - 70.0) + 4.0 * np.sin(0.2 * place[:, 0])
    height: FloatArray = 0.2 * place[:, 1] + sum(
        8.0 * np.clip((across - edge) / 2.0, 0.0, 1.0) for edge in (25.0, 45.0)
    )
    return height


@pytest.mark.parametrize("spacing_m", [1.0, 1.5, 2.4])
def test_ground__is_found_at_the_edges_of_a_quarry(spacing_m: float) -> None:
    place = places(spacing_m)
    noise = np.random.default_rng(6).normal(0.0, 0.03, len(place))
    found = classify_ground(np.column_stack([place, quarry(place) + noise]))
    assert found.mean() > 0.97


@pytest.mark.parametrize("spacing_m", [1.0, 1.5, 2.4])
def test_ground__has_neither_bushes_nor_a_bridge(spacing_m: float) -> None:
    """A ditch 8 m deep and 30 m wide with banks of 45°; a deck 10 m wide goes over it on a level with the ground."""
    rng = np.random.default_rng(7)
    place = places(spacing_m)
    ditch = np.clip((np.abs(place[:, 0] - 75.0) - 15.0) / 8.0, -1.0, 0.0)
    z = 8.0 * ditch + rng.normal(0.0, 0.03, len(place))
    deck = (np.abs(place[:, 1] - 75.0) < 5.0) & (np.abs(place[:, 0] - 75.0) < 14.0)
    bush = ~deck & (rng.random(len(place)) < 0.1)
    z = np.where(deck, 0.0, z + bush * rng.uniform(1.0, 4.0, len(place)))
    found = classify_ground(np.column_stack([place, z]))
    assert found[~deck & ~bush].mean() > 0.97
    assert found[deck].mean() < 0.2
    assert found[bush].mean() < 0.12


def test_ground__reaches_the_border_of_a_steep_slope() -> None:
    place = places(1.5)
    found = classify_ground(np.column_stack([place, 0.6 * place[:, 1]]))
    assert found.mean() > 0.99


def test_ground__has_no_clusters_of_returns_from_far_below() -> None:
    place = places(1.5)
    cluster = np.hypot(*(place - [70.0, 60.0]).T) < 3.0
    found = classify_ground(np.column_stack([place, np.where(cluster, -30.0, 0.0)]))
    assert not found[cluster].any()
    assert found[~cluster].mean() > 0.98


def test_dense_clouds__keep_the_ground_of_the_filter() -> None:
    """A plot of wheat whose margins slope down, with two points in a cell of half a metre."""
    place = places(0.35, 60.0)
    stand = np.clip(np.minimum(1.5 - np.abs(place[:, 0] - 30.0), 8.0 - np.abs(place[:, 1] - 30.0)), 0.0, 0.6)
    found = classify_ground(np.column_stack([place, stand]))
    assert found[stand > 0.5].mean() < 0.02
    assert found[stand == 0.0].all()
    assert np.array_equal(with_breaklines(np.zeros((40, 40)), np.eye(40, dtype=bool), 0.5), np.eye(40, dtype=bool))


@pytest.mark.parametrize("spacing_m", [0.75, 1.0, 1.5, 2.4])
def test_spacing__is_that_of_the_points_whatever_the_outline(spacing_m: float) -> None:
    place = places(spacing_m)
    inside = (np.hypot(*(place - 75.0).T) > 40.0) & (place[:, 0] + place[:, 1] < 230.0)
    seen = np.zeros((304, 304), bool)
    seen[tuple(np.floor(place[inside] / 0.5).astype(int).T)] = True
    assert point_spacing_m(seen, 0.5) == pytest.approx(spacing_m, rel=0.15)


def test_ground_cells__of_one_cell_or_a_row_end_well() -> None:
    for shape in ((1, 1), (1, 30), (30, 1)):
        lowest = np.full(shape, np.nan)
        lowest[::3, ::3] = 2.0
        assert ground_cells(lowest, Smrf())[0, 0]
    assert not ground_cells(np.full((4, 4), np.nan), Smrf()).any()
