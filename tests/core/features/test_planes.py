"""Planes in voxels on a grid, whose cells, share of filled cells and purity are closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.features.eigenfeatures import Eigenfeatures
from furrowmap.core.features.planes import Plane, find_planes

FloatArray = NDArray[np.float64]

CELL_M = 0.1
FLAT = (1.0, 1.0, 1e-4)
SCATTERED = (1.0, 1.0, 1.0)


def grid(columns: int, rows: int, along_m: float, aside_m: float) -> FloatArray:
    """Voxels of a level rectangle."""
    x, y = np.meshgrid(along_m * np.arange(columns), aside_m * np.arange(rows), indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 1.0)])


def found(
    flat_m: FloatArray,
    scattered_m: FloatArray | None = None,
    cell_m: float = CELL_M,
    fill: tuple[float, float] = (0.0, math.inf),
) -> list[Plane]:
    """Planes in voxels whose neighbourhoods are level planes, among others whose neighbourhoods have no shape."""
    others = np.zeros((0, 3)) if scattered_m is None else scattered_m
    xyz = np.concatenate([flat_m, others])
    up = np.tile(np.array([0.0, 0.0, 1.0], np.float32), (len(xyz), 1))
    side = np.tile(np.array([1.0, 0.0, 0.0], np.float32), (len(others), 1))
    value = np.array([FLAT] * len(flat_m) + [SCATTERED] * len(others), np.float32)
    normal = np.concatenate([up[: len(flat_m)], side])
    shape = Eigenfeatures(value, normal, np.zeros_like(normal), np.full(len(xyz), 9, np.int32))
    return find_planes(xyz, shape, cell_m, 0.05, 0.5, fill)


@pytest.mark.parametrize(
    ("along", "aside", "side"),
    [
        (1.0, 1.0, 2.0),
        (1.3, 1.3, 2.0),
        (1.4, 1.4, 2.1),
        (1.6, 1.6, 2.4),
        (1.3, 1.9, 2.85),
        (1.9, 1.9, 2.85),
        (2.6, 2.6, 3.0),
    ],
)
def test_area__is_of_cells_half_as_wide_again_as_the_fourth_neighbour_is_away(
    along: float, aside: float, side: float
) -> None:
    """Two voxels at least, and three at most; all distances in voxels. The cells are all filled."""
    columns, rows = 30, 24
    (plane,) = found(grid(columns, rows, along * CELL_M, aside * CELL_M))
    cells = [int((count - 1) * step / side + 1e-6) + 1 for count, step in ((columns, along), (rows, aside))]
    assert plane.area_m2 == pytest.approx(cells[0] * cells[1] * (side * CELL_M) ** 2, rel=1e-6)


def test_fill__is_the_share_of_filled_cells_around_those_of_a_plane() -> None:
    """Of n x m filled cells, (3n - 2) (3m - 2) pairs are neighbours or the same."""
    voxels = grid(20, 12, CELL_M, CELL_M)
    share = ((3 * 10 - 2) * (3 * 6 - 2) / 60 - 1.0) / 8.0
    assert len(found(voxels, fill=(share - 1e-6, share + 1e-6))) == 1
    assert not found(voxels, fill=(share + 1e-6, math.inf))
    assert not found(voxels, fill=(0.0, share - 1e-6))


@pytest.mark.parametrize(
    ("columns", "rows", "step", "is_plane"),
    [
        (12, 8, 0.5, False),  # 3 x 2 cells of 0.04 m2
        (16, 8, 0.5, True),
        (4, 3, 3.0, True),  # cells of 0.09 m2
    ],
)
def test_a_plane__has_a_quarter_of_a_square_metre(columns: int, rows: int, step: float, is_plane: bool) -> None:
    assert bool(found(grid(columns, rows, step * CELL_M, step * CELL_M))) == is_plane


@pytest.mark.parametrize(("rows", "is_plane"), [(5, False), (6, True)])
def test_a_strip__narrower_than_a_quarter_of_a_metre_is_no_plane(rows: int, is_plane: bool) -> None:
    """n rows 0.05 m apart are as wide as a full strip of 0.05 m times the root of n^2 - 1."""
    assert (0.05 * math.sqrt(rows**2 - 1) > 0.25) == is_plane
    assert bool(found(grid(80, rows, 0.05, 0.05))) == is_plane


@pytest.mark.parametrize(("count", "is_plane"), [(11, False), (12, True)])
def test_a_plane__has_twelve_voxels(count: int, is_plane: bool) -> None:
    assert bool(found(grid(4, 3, 0.25, 0.25)[:count])) == is_plane


@pytest.mark.parametrize(("above_m", "counts"), [(0.06, True), (0.29, True), (-0.29, True), (0.31, False)])
def test_purity__is_the_share_of_what_lies_within_30_cm_that_is_on_the_plane(above_m: float, counts: bool) -> None:
    own, beside = grid(20, 20, CELL_M, CELL_M), np.add(grid(5, 5, 0.3, 0.3), (0.2, 0.2, above_m))
    (plane,) = found(own, beside)
    assert plane.purity == pytest.approx(400 / 425 if counts else 1.0)
    assert plane.members.tolist() == list(range(400))


@pytest.mark.parametrize(
    ("x_m", "y_m", "belongs"),
    [
        (1.05, 0.5, True),
        (1.15, 0.5, True),
        (1.22, 0.5, False),
        (-0.15, 0.5, True),
        (-0.22, 0.5, False),
        (0.5, 1.15, True),
        (0.5, 1.22, False),
        (0.5, -0.15, True),
        (0.5, -0.22, False),
        (1.05, 1.05, True),
        (1.15, 1.15, False),
    ],
)
def test_members__are_also_voxels_on_the_plane_up_to_two_cells_beyond(x_m: float, y_m: float, belongs: bool) -> None:
    """Cells of 0.1 m end at 0 and at 1 m; the normal at an edge is that of no plane. Across a corner, one each way."""
    own = grid(20, 20, 0.05, 0.05)
    (plane,) = found(own, np.array([[x_m, y_m, 1.0]]), cell_m=0.05)
    assert plane.members.tolist() == list(range(401 if belongs else 400))
