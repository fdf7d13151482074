"""The bare ground: what is filled is flagged, and heights above it are exact on a plane."""

from __future__ import annotations

import numpy as np

from furrowmap.core.surfaces.dtm import height_above_ground, with_gaps_filled
from furrowmap.core.surfaces.grid import Grid, Surface

GRID = Grid(0.5, 200, -400, (30, 40))
EAST, NORTH = np.meshgrid(*GRID.centres_m())
PLANE = 20.0 + 0.04 * EAST - 0.02 * NORTH


def gappy() -> Surface:
    """A plane with a gap of 10 by 8 cells."""
    height = PLANE.astype(np.float32)
    height[10:18, 20:30] = np.nan
    nothing = np.full(GRID.shape, np.nan, np.float32)
    return Surface(GRID, height, np.isfinite(height).astype(np.uint32), nothing, nothing)


def test_with_gaps_filled__flags_what_it_fills_and_measures_nothing_new() -> None:
    surface = gappy()
    whole = with_gaps_filled(surface, 10.0)
    np.testing.assert_allclose(whole.height_m, PLANE, atol=1e-4)
    assert whole.filled is not None
    assert np.array_equal(whole.filled, surface.count == 0)
    assert np.array_equal(whole.count, surface.count)
    partly = with_gaps_filled(surface, 1.0)
    assert np.isnan(partly.height_m[14, 25])
    assert np.isfinite(partly.height_m[11, 25])


def test_height_above_ground__is_exact_over_a_plane_and_unknown_beyond_it() -> None:
    rng = np.random.default_rng(2)
    west, south, east, north = GRID.bounds_m
    e, n = rng.uniform((west + 0.25, south + 0.25), (east - 0.25, north - 0.25), (500, 2)).T
    above = rng.uniform(-1.0, 5.0, 500)
    xyz = np.column_stack([e, n, 20.0 + 0.04 * e - 0.02 * n + above])
    whole = with_gaps_filled(gappy(), 10.0)
    np.testing.assert_allclose(height_above_ground(xyz, whole), above, atol=1e-4)
    outside = [[west - 0.1, south + 1.0, 0.0], [east + 0.1, north, 0.0], [west + 1.0, north + 0.1, 0.0]]
    assert np.isnan(height_above_ground(outside, whole)).all()
    assert np.isnan(height_above_ground([[EAST[14, 25], NORTH[14, 25], 0.0]], gappy())).all()
