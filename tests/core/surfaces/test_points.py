"""Outliers against the plainest way to find them."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from furrowmap.core.surfaces.outliers import (
    NeighbourStatistics,
    mean_distance_to,
    mean_neighbour_distance,
    radius_outliers,
    thin_points,
    tiles,
)


def statistical_outliers(xyz: np.ndarray) -> np.ndarray:
    """Points farther from their eight nearest neighbours than is usual around them."""
    mean_m, usual = mean_neighbour_distance(xyz), NeighbourStatistics()
    usual.add(xyz, mean_m)
    return usual.exceeded(xyz, mean_m)


@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.floats(0.2, 20.0))
def test_radius_outliers__are_those_with_too_few_around(seed: int, fewest: int, radius_m: float) -> None:
    xyz = np.random.default_rng(seed).uniform(-60.0, 60.0, (80, 3)) * (1.0, 1.0, 0.05)
    others = (cdist(xyz, xyz) <= radius_m).sum(axis=1) - 1
    assert np.array_equal(radius_outliers(xyz, radius_m, fewest), others < fewest)


def test_statistical_outliers__are_beyond_the_usual_distance() -> None:
    rng = np.random.default_rng(4)
    xyz = np.concatenate([rng.uniform(0.0, 10.0, (4000, 3)) * (1.0, 1.0, 0.01), [[5.0, 5.0, 1.5], [40.0, 5.0, 0.0]]])
    nearest = np.sort(cdist(xyz, xyz), axis=1)[:, 1:9].mean(axis=1)
    usual = nearest[:-1]
    expected = nearest > usual.mean() + 2.0 * usual.std()
    expected[-1] = True  # nothing within reach
    found = statistical_outliers(xyz)
    assert np.array_equal(found, expected)
    assert found[-2:].all()


def test_outliers__are_points_without_a_place() -> None:
    xyz = np.zeros((12, 3))
    xyz[3, 1] = np.nan
    for find in (radius_outliers, statistical_outliers):
        assert np.flatnonzero(find(xyz)).tolist() == [3]
        assert find(np.full((4, 3), np.nan)).all()
        assert find(np.zeros((0, 3))).shape == (0,)


def test_what_is_usual__does_not_depend_on_how_the_land_is_cut_up() -> None:
    rng = np.random.default_rng(5)
    near, far = rng.uniform(0.0, 60.0, (20_000, 3)), rng.uniform((90.0, 0.0, 0.0), (120.0, 30.0, 30.0), (150, 3))
    xyz = np.concatenate([near, far]) * (1.0, 0.5, 0.01)
    mean_m = mean_neighbour_distance(xyz)
    whole, parts = NeighbourStatistics(), NeighbourStatistics()
    whole.add(xyz, mean_m)
    west = xyz[:, 0] < 37.3
    for part in (west, ~west):
        parts.add(xyz[part], mean_m[part])
    found = whole.exceeded(xyz, mean_m)
    assert np.array_equal(
        found, np.concatenate([parts.exceeded(xyz[k : k + 7], mean_m[k : k + 7]) for k in range(0, len(xyz), 7)])
    )
    sparse = xyz[:, 0] > 60.0  # far apart, as points are there, and farther than is usual in all the land
    assert found[sparse].mean() < 0.1
    assert (mean_m[sparse] > mean_m.mean() + 2.0 * mean_m.std()).all()


def test_few_of_many__do_for_points_that_are_alone() -> None:
    rng = np.random.default_rng(6)
    xyz = np.concatenate([rng.uniform(0.0, 3.0, (4000, 3)), rng.uniform(-4.0, 7.0, (60, 3))])
    few = thin_points(xyz)
    cubes, count = np.unique(np.floor(few / 0.5), axis=0, return_counts=True)
    assert len(cubes) == len(np.unique(np.floor(xyz / 0.5), axis=0))
    assert count.max() == 9
    alone = np.isinf(mean_neighbour_distance(xyz, reach_m=0.4))
    exact = np.sort(cdist(xyz[alone], xyz), axis=1)[:, 1:9].mean(axis=1)
    found = mean_distance_to(xyz[alone], few, 12.0)
    assert (found >= exact - 1e-9).all()
    assert (found - exact).max() < 0.5 * 3**0.5
    sparse = xyz[::40]
    assert np.allclose(mean_distance_to(sparse, thin_points(sparse), 5.0), mean_neighbour_distance(sparse))


@given(st.integers(0, 2**32 - 1), st.floats(0.5, 20.0), st.floats(0.0, 1.0))
def test_tiles__hold_each_point_once_and_all_that_lie_near(seed: int, tile_m: float, share: float) -> None:
    rng = np.random.default_rng(seed)
    xyz = rng.normal(0.0, rng.choice([1.0, 30.0, 1e7]), (50, 3))
    margin_m = share * tile_m
    seen = []
    for tile in tiles(xyz, tile_m, margin_m):
        assert np.array_equal(tile.members[: len(tile.own)], tile.own)
        seen.extend(tile.own.tolist())
        for k in tile.own.tolist():
            near = np.flatnonzero((np.abs(xyz[:, :2] - xyz[k, :2]) < 0.999 * margin_m).all(axis=1))
            assert set(near.tolist()) <= set(tile.members.tolist())
    assert sorted(seen) == list(range(len(xyz)))
