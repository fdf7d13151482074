"""Heights of cells against numpy and pandas, cell by cell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from furrowmap.core.runtime.errors import InputError, UsageError
from furrowmap.core.surfaces.grid import Grid, Surface
from furrowmap.core.surfaces.spool import PointSpool
from furrowmap.core.surfaces.statistic import NMAD, TRIM_NMADS, Statistic, cell_surface

GRID = Grid(0.5, -3, 4, (7, 5))
NAMES = ["median", "trimmed", "mean", "min", "max", "p0", "p37.5", "p90"]


def expected(name: str, heights: NDArray[np.float64]) -> tuple[float, float]:
    """Height and spread of a cell, by numpy."""
    median = np.median(heights)
    nmad = NMAD * np.median(abs(heights - median))
    deviation = float(np.std(heights, ddof=1)) if len(heights) > 1 else np.nan
    if name == "mean":
        return float(heights.mean()), deviation
    if name in {"min", "max"}:
        return float(heights.min() if name == "min" else heights.max()), deviation
    spread = float(nmad) if len(heights) > 1 else np.nan
    if name == "trimmed":
        return float(heights[abs(heights - median) <= TRIM_NMADS * nmad * (1 + 1e-6) + 1e-9].mean()), spread
    return float(np.percentile(heights, Statistic.parse(name).percent)), spread


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("points", "decimals"), [(1, 9), (40, 9), (3000, 9), (3000, 1), (3000, 0)])
def test_cell_surface__is_what_numpy_makes_of_each_cell(name: str, points: int, decimals: int) -> None:
    rng = np.random.default_rng(points)
    cell = rng.integers(0, 35, points).astype(np.uint16)
    height = rng.normal(0.0, 0.3, points).round(decimals).astype(np.float32)
    surface = cell_surface(GRID, cell, height, 250.0, Statistic.parse(name))
    for k in range(35):
        heights = height[cell == k].astype(np.float64)
        row, column = divmod(k, 5)
        assert surface.count[row, column] == len(heights)
        if not len(heights):
            assert np.isnan(surface.height_m[row, column])
            continue
        wanted, spread = expected(name, heights)
        assert surface.height_m[row, column] == pytest.approx(250.0 + wanted, abs=3e-5)
        assert surface.spread_m[row, column] == pytest.approx(spread, abs=1e-5, nan_ok=True)


@pytest.mark.parametrize("name", ["mean", "min", "max"])
def test_sums__are_those_of_pandas_far_above_the_sea(name: str) -> None:
    rng = np.random.default_rng(1)
    cell = rng.integers(0, 35, 5000).astype(np.uint16)
    height = (rng.uniform(0.0, 1.0, 5000) + 4000.0).astype(np.float32)
    surface = cell_surface(GRID, cell, height, 0.0, Statistic.parse(name))
    table = pd.Series(height.astype(np.float64)).groupby(cell)
    assert np.allclose(surface.height_m.ravel(), table.agg(name), atol=3e-4)
    assert np.allclose(surface.spread_m.ravel(), table.std(), atol=1e-6)
    assert np.array_equal(surface.count.ravel(), table.count())


@settings(max_examples=60)
@given(arrays(np.float32, st.integers(1, 80), elements=st.floats(-50.0, 50.0, width=32)), st.sampled_from(NAMES))
def test_every_statistic__lies_among_the_heights(heights: NDArray[np.float32], name: str) -> None:
    cell = np.zeros(len(heights), np.uint16)
    surface = cell_surface(Grid(1.0, 0, 1, (1, 1)), cell, heights, 0.0, Statistic.parse(name))
    assert heights.min() - 1e-5 <= surface.height_m[0, 0] <= heights.max() + 1e-5
    shuffled = np.random.default_rng(0).permutation(heights)
    again = cell_surface(Grid(1.0, 0, 1, (1, 1)), cell, shuffled, 0.0, Statistic.parse(name))
    assert again.height_m[0, 0] == pytest.approx(surface.height_m[0, 0], abs=1e-5)


@pytest.mark.parametrize("name", ["median", "trimmed", "mean", "p90"])
def test_standard_errors__are_those_of_repeated_cells(name: str) -> None:
    rng = np.random.default_rng(7)
    cells, each = 4000, 40
    grid = Grid(1.0, 0, 40, (40, 100))
    cell = np.repeat(np.arange(cells, dtype=np.uint16), each)
    heights = rng.normal(0.0, 0.01, cells * each).astype(np.float32)
    surface = cell_surface(grid, cell, heights, 0.0, Statistic.parse(name))
    told = float(np.sqrt(np.mean(surface.standard_error_m**2)))
    assert surface.height_m.std() == pytest.approx(told, rel=0.12)


def test_statistics__of_no_known_name_are_refused() -> None:
    for name in ("mode", "p101", "p-1", ""):
        with pytest.raises(UsageError) as refused:
            Statistic.parse(name)
        assert refused.value.code == "unknown-statistic"


def test_spool__gives_back_every_point_in_its_tile(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("furrowmap.core.surfaces.spool.HELD", 1000)
    rng = np.random.default_rng(3)
    xyz = rng.uniform([-30.0, -20.0, 100.0], [30.0, 20.0, 101.0], (5500, 3))
    xyz[7] = np.nan
    t_s = 1.7e9 + np.arange(5500) * 0.01
    kept = rng.random(5500) < 0.8
    with PointSpool(0.05, base_m=100.0, folder=tmp_path) as spool:
        for part in np.array_split(np.arange(5500), 7):
            spool.add(xyz[part] - (10.0, -20.0, 50.0), t_s[part], kept[part], (10.0, -20.0, 50.0))
        kept[7] = False
        assert spool.grid is not None
        index, inside = spool.grid.cells_of(xyz[kept, 0], xyz[kept, 1])
        assert inside.all()
        surfaces = [
            (tile.grid, tile.t_s, cell_surface(tile.grid, tile.cell, tile.height_m, 100.0, Statistic.parse("max")))
            for tile in spool
        ]
        table = pd.Series(xyz[kept, 2]).groupby(index).agg("max")
        assert sum(len(t) for _, t, _ in surfaces) == kept.sum()
        assert np.allclose(np.sort(np.concatenate([t for _, t, _ in surfaces])), t_s[kept] - t_s[0], atol=1e-4)
        whole = spool.grid
    seen = np.full(whole.rows * whole.columns, np.nan)
    for grid, _, surface in surfaces:
        there = surface.seen
        e, n = np.meshgrid(*grid.centres_m())
        cells, within = whole.cells_of(e[there], n[there])
        assert within.all()
        seen[cells] = surface.height_m[there]
    assert np.flatnonzero(np.isfinite(seen)).tolist() == table.index.tolist()
    assert np.allclose(seen[table.index], table.to_numpy(), atol=3e-5)


def test_spool__refuses_a_stray_point_that_no_raster_reaches(tmp_path: Path) -> None:
    with PointSpool(0.05, folder=tmp_path) as spool:
        spool.add(np.array([[0.0, 0.0, 0.0], [5e6, 5e6, 0.0]]))
        with pytest.raises(InputError) as refused:
            _ = spool.grid
    assert refused.value.code == "grid-too-large"


def test_surface__has_bands_of_its_grid() -> None:
    band = np.zeros((2, 2), np.float32)
    with pytest.raises(ValueError, match="other shapes"):
        Surface(GRID, band, band.astype(np.uint32), band, band)
