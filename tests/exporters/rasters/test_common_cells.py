"""Cells that two grids share, against sets of cells."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.rasters.windows import shared_cells

GRIDS = st.builds(
    lambda west, north, rows, columns: Grid(0.5, west, north, (rows, columns)),
    st.integers(-6, 6), st.integers(-6, 6), st.integers(1, 7), st.integers(1, 7),
)  # fmt: skip


def cells(grid: Grid | None) -> set[tuple[int, int]]:
    if grid is None:
        return set()
    return {(grid.west + i, grid.north - j) for i in range(grid.columns) for j in range(grid.rows)}


@given(GRIDS, GRIDS)
def test_common__is_the_intersection(one: Grid, other: Grid) -> None:
    assert cells(shared_cells(one, other)) == cells(one) & cells(other)


def test_common__of_cells_of_different_sizes_is_refused() -> None:
    with pytest.raises(ValueError, match=r"cells of 0\.5 m and cells of 0\.25 m"):
        shared_cells(Grid(0.5, 0, 0, (2, 2)), Grid(0.25, 0, 0, (2, 2)))
