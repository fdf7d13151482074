"""Bounds of points and the cells that hold any, against numpy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from furrowmap.core.runtime.record_spool import square_keys
from furrowmap.core.values import extents
from furrowmap.core.values.extents import bounds, cells_with_points


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31), st.integers(1, 200), st.sampled_from([0.1, 0.5, 3.0]))
def test_bounds_and_cells__are_those_of_the_points(seed: int, count: int, cell_m: float) -> None:
    rng = np.random.default_rng(seed)
    records = np.zeros(count, [("other", "u1"), ("xyz_m", "<f8", 3)])
    records["xyz_m"] = rng.normal(0.0, 5.0, (count, 3)).round(1) + np.array([-20_000.0, 4_000_000.0, 50.0])
    xyz = records["xyz_m"]  # strided, as the spools give them
    low, high = bounds(xyz)
    np.testing.assert_array_equal([low, high], [xyz.min(axis=0), xyz.max(axis=0)])
    np.testing.assert_array_equal(
        cells_with_points(xyz, cell_m), np.unique(square_keys(*np.floor(xyz[:, :2].T / cell_m)))
    )


def test_points_far_apart__and_none(monkeypatch: pytest.MonkeyPatch) -> None:
    xyz = np.array([[0.0, 0.0, 0.0], [7.0, 9.0, 0.0], [0.5, 0.5, 1.0]])
    near = cells_with_points(xyz, 1.0)
    monkeypatch.setattr(extents, "MAX_RASTER_CELLS", 4)
    np.testing.assert_array_equal(near, cells_with_points(xyz, 1.0))
    assert len(cells_with_points(xyz[:0], 1.0)) == 0
    with pytest.raises(ValueError, match="no points"):
        bounds(xyz[:0])
