"""Cells of a cube hold the points whose codes name them, also after the cube has grown."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from furrowmap.exporters.cloud.cube import DEPTH, Cube, codes_of
from furrowmap.exporters.cloud.records import Chosen, Records

steps = st.tuples(*[st.integers(-(2**31), 2**31 - 1)] * 3)
clouds = st.lists(steps, min_size=1, max_size=20).map(lambda points: np.array(points, np.int64))


def records_at(points: NDArray[np.int64]) -> Records:
    records: Records = np.zeros(len(points), [("X", "<i4"), ("Y", "<i4"), ("Z", "<i4"), ("more", "u1")])
    records["X"], records["Y"], records["Z"] = points.T
    return records


@given(points=clouds, depth=st.integers(0, DEPTH))
def test_cells__hold_their_points(points: NDArray[np.int64], depth: int) -> None:
    cube = Cube.around(points.min(axis=0), points.max(axis=0))
    codes, counts = codes_of(Chosen.all_of(records_at(points)), cube, depth)
    for point, code in zip(points, codes.tolist(), strict=True):
        cell = cube.cell(depth, code)
        assert cell.side * 2**depth == cube.side
        assert cell.holds(point, point)
    assert counts.tolist() == np.bincount(codes, minlength=8**depth).tolist()


@given(points=clouds, depth=st.integers(1, DEPTH))
def test_codes__without_their_last_three_bits_are_those_a_level_up(points: NDArray[np.int64], depth: int) -> None:
    cube = Cube.around(points.min(axis=0), points.max(axis=0))
    fine, _ = codes_of(Chosen.all_of(records_at(points)), cube, depth)
    coarse, _ = codes_of(Chosen.all_of(records_at(points)), cube, depth - 1)
    assert (fine >> 3).tolist() == coarse.tolist()


@given(points=clouds, outside=steps)
def test_doubled__until_it_holds_a_point_outside(points: NDArray[np.int64], outside: tuple[int, int, int]) -> None:
    """Codes follow by arithmetic from those before: what the file of a long recording relies on."""
    cube = Cube.around(points.min(axis=0), points.max(axis=0))
    codes = codes_of(Chosen.all_of(records_at(points)), cube, DEPTH)[0].astype(np.int64)
    reach = np.minimum(points.min(axis=0), outside), np.maximum(points.max(axis=0), outside)
    while not cube.holds(*reach):
        cube, octant = cube.doubled(reach[0])
        codes = (octant << 3 * (DEPTH - 1)) | (codes >> 3)
        assert cube.bits <= 33, "of a cube as large as the coordinates' range and another beside it"
    assert codes.tolist() == codes_of(Chosen.all_of(records_at(points)), cube, DEPTH)[0].tolist()
