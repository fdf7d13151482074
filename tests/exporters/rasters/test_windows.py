"""Windows of a large raster, against sets of cells: each cell and each plot is worked on once."""

from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.rasters import windows as module
from furrowmap.exporters.rasters.windows import is_last, plots_of, share_done, window, windows

GRIDS = st.builds(
    lambda west, north, rows, columns: Grid(0.5, west, north, (rows, columns)),
    st.integers(-30, 30), st.integers(-30, 30), st.integers(1, 25), st.integers(1, 25),
)  # fmt: skip


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "WINDOW_CELLS", 8)


def cells(grid: Grid) -> set[tuple[int, int]]:
    return {(grid.west + i, grid.north - j) for i in range(grid.columns) for j in range(grid.rows)}


def around(inner: Grid, margin: int) -> set[tuple[int, int]]:
    near = range(-margin, margin + 1)
    return {(east + i, north + j) for east, north in cells(inner) for i in near for j in near}


@given(GRIDS, st.integers(0, 5))
def test_windows__hold_each_cell_once_with_all_that_is_near(grid: Grid, margin: int) -> None:
    found = list(windows(grid, margin))
    counted = Counter(cell for inner, _ in found for cell in cells(inner))
    assert counted == Counter(cells(grid))
    assert all(cells(outer) == around(inner, margin) & cells(grid) for inner, outer in found)
    assert max(max(inner.shape) for inner, _ in found) <= 8
    places = [(-inner.north, inner.west) for inner, _ in found]
    assert places == sorted(places)  # from north to south, west to east
    shares = [share_done(inner, grid) for inner, _ in found]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    last = [is_last(inner, grid) for inner, _ in found]
    assert [south for south, _ in last] == [inner.north - inner.rows == grid.north - grid.rows for inner, _ in found]
    assert sum(both == (True, True) for both in last) == 1
    for inner, outer in found:
        part = window(outer, grid)
        assert (part.col_off, part.row_off) == (outer.west - grid.west, grid.north - outer.north)
        assert (part.width, part.height) == (outer.columns, outer.rows)
        assert cells(inner) <= cells(outer)


@given(GRIDS, st.integers(1, 9))
def test_plots__each_belongs_to_the_window_with_its_corner(grid: Grid, cells_a_plot: int) -> None:
    """Plots lie on multiples of their own size, and those at the edges reach beyond the grid."""
    west, north = grid.west // cells_a_plot, -(-grid.north // cells_a_plot)
    east = -(-(grid.west + grid.columns) // cells_a_plot)
    south = (grid.north - grid.rows) // cells_a_plot
    plots = Grid(0.5 * cells_a_plot, west, north, (north - south, east - west))
    counted: Counter[tuple[int, int]] = Counter()
    for inner, _ in windows(grid, 0):
        mine = plots_of(inner, plots, is_last(inner, grid))
        counted.update(cells(mine) if mine is not None else ())
    assert counted == Counter(cells(plots))
