"""The same ground seen by several swaths: their differences come out, relief and noise do not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.spool import TilePoints
from furrowmap.core.surfaces.visits import BINS, SWATH_BLOCK, SwathSums, block_differences

GRID = Grid(0.05, 0, 64, (64, 64))


def swaths(offsets_m: list[float], noise_m: float, pause_s: float, returns: int = 60_000, seed: int = 0) -> TilePoints:
    """Swaths of 5 s, each over the same steep and uneven cells."""
    rng = np.random.default_rng(seed)
    relief = rng.normal(0.0, 0.1, 64 * 64)
    cells, heights, times = [], [], []
    for k, offset_m in enumerate(offsets_m):
        cell = rng.integers(0, 64 * 64, returns)
        cells.append(cell)
        heights.append(relief[cell] + offset_m + rng.normal(0.0, noise_m, returns))
        times.append(k * pause_s + np.sort(rng.uniform(0.0, 5.0, returns)))
    return TilePoints(
        GRID,
        np.concatenate(cells).astype(np.uint16),
        np.concatenate(heights).astype(np.float32),
        np.concatenate(times).astype(np.float32),
        0.0,
        0.0,
    )


def summed(difference_m: NDArray[np.float32]) -> SwathSums:
    sums = SwathSums()
    sums.add(difference_m, (0.05 * SWATH_BLOCK) ** 2)
    return sums


def test_swaths__a_shift_between_two_is_the_mean_and_noise_is_averaged_out() -> None:
    """14 returns a cell of 2 cm noise, 64 cells a block: 20 / √(14 · 64 / 2) = 0.9 mm remain."""
    differences = summed(block_differences(swaths([0.0, 0.03], 0.02, 60.0))).differences()
    assert differences is not None
    assert differences.blocks == 64
    assert differences.area_m2 == pytest.approx(64 * 64 * 0.05**2)
    assert differences.mean_m == pytest.approx(0.03, abs=4e-4)
    assert np.sqrt(differences.rms_m**2 - differences.mean_m**2) == pytest.approx(0.00094, rel=0.3)
    assert differences.histogram.sum() == 64
    assert differences.histogram[BINS + 12 : BINS + 18].sum() == 64
    assert differences.within_m(0.5) == pytest.approx(0.03, abs=1.5e-3)


def test_swaths__of_three_each_is_compared_with_the_one_before() -> None:
    difference = block_differences(swaths([0.0, 0.02, 0.06], 0.0, 60.0))
    np.testing.assert_allclose(difference, 0.03, atol=1e-5)


def test_swaths__without_a_pause_are_one() -> None:
    difference = block_differences(swaths([0.0, 0.02], 0.0, 10.0))
    assert np.isnan(difference).all()
    assert summed(difference).differences() is None


def visited(cells: int, returns: int, pause_s: float, step_m: float = 0.05) -> TilePoints:
    """Two visits of some cells of the first block by some returns each, of which the later ones are higher."""
    cell = np.repeat(np.arange(cells, dtype=np.uint16), returns)
    t_s = np.tile(0.01 * np.arange(returns, dtype=np.float32), cells)
    order = np.argsort(t_s, kind="stable")
    cell, t_s = cell[order], t_s[order]
    height = np.zeros(len(cell), np.float32)
    both = np.concatenate([t_s, np.float32(pause_s) + t_s])
    return TilePoints(GRID, np.tile(cell, 2), np.concatenate([height, height + np.float32(step_m)]), both, 0.0, 0.0)


@pytest.mark.parametrize(
    ("cells", "returns", "pause_s", "known"),
    [(4, 3, 21.0, True), (3, 3, 21.0, False), (4, 2, 21.0, False), (4, 3, 19.0, False), (8, 9, 20.5, True)],
)
def test_difference__needs_four_cells_of_three_returns_and_a_pause_of_20_seconds(
    cells: int, returns: int, pause_s: float, known: bool
) -> None:
    difference = block_differences(visited(cells, returns, pause_s))
    assert difference.shape == (8, 8)
    assert np.flatnonzero(np.isfinite(difference)).tolist() == [0] * known
    if known:
        assert difference[0, 0] == pytest.approx(0.05, abs=1e-6)


def test_figures__are_those_of_the_blocks() -> None:
    """Of five blocks of 0.16 m² one is unknown, one far off; bins are 2 mm wide and end at 10 cm."""
    sums = summed(np.array([[0.0011, -0.0031, np.nan, 0.0051, 0.7]], np.float32))
    found = sums.differences()
    assert found is not None
    plain = found.plain()
    assert plain["blocks"] == 4
    assert plain["area_m2"] == round(4 * 0.4**2, 1)
    assert plain["mean_m"] == pytest.approx((0.0011 - 0.0031 + 0.0051 + 0.7) / 4, abs=1e-4)
    assert plain["rms_m"] == pytest.approx(np.sqrt((0.0011**2 + 0.0031**2 + 0.0051**2 + 0.49) / 4), abs=1e-4)
    edges = plain["histogram_from_m"] + plain["histogram_bin_m"] * np.arange(len(plain["histogram"]) + 1)
    assert edges[[0, -1]] == pytest.approx((-0.1, 0.1))
    counted = {round(float(edges[k]), 3): n for k, n in enumerate(plain["histogram"]) if n}
    assert counted == {-0.004: 1, 0.0: 1, 0.004: 1, 0.098: 1}
    # One within 2 mm, two within 4, three within 6, and one beyond all.
    assert plain["half_within_m"] == pytest.approx(0.004)
    assert found.within_m(0.7) == pytest.approx(0.0056)
    assert plain["p95_within_m"] == pytest.approx(0.0996, abs=1e-4)


def test_swaths__too_few_returns_say_nothing() -> None:
    assert np.isnan(block_differences(swaths([0.0, 0.02], 0.0, 60.0, returns=400))).all()


@given(st.integers(-9_999, 9_999), st.integers(-9_999, 9_999), st.integers(1, 99), st.integers(1, 99))
def test_coarser_grid__covers_the_cells_with_no_block_to_spare(west: int, north: int, rows: int, columns: int) -> None:
    cells = Grid(0.05, west, north, (rows, columns))
    blocks = cells.coarser(SWATH_BLOCK)
    inner, outer = np.array(cells.bounds_m), np.array(blocks.bounds_m)
    beyond = (inner - outer) * (1, 1, -1, -1)
    assert blocks.cell_m == pytest.approx(SWATH_BLOCK * 0.05)
    assert (beyond > -1e-6).all()
    assert (beyond < blocks.cell_m - 1e-6).all()


def test_sums__do_not_depend_on_how_the_land_is_cut_and_keep_far_ones() -> None:
    difference = np.random.default_rng(1).normal(0.0, 0.2, (40, 40)).astype(np.float32)
    one, parts = summed(difference).differences(), SwathSums()
    for part in np.array_split(difference, 7):
        parts.add(part, (0.05 * SWATH_BLOCK) ** 2)
    other = parts.differences()
    assert one is not None
    assert other is not None
    assert other.rms_m == pytest.approx(one.rms_m, rel=1e-9)
    np.testing.assert_array_equal(other.histogram, one.histogram)
    assert one.histogram.sum() == 1600
