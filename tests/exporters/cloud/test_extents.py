"""What a batch of points states of itself, in any order of its points."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.exporters.cloud.point_batches import pack_points


@given(st.permutations(range(9)), st.integers(1, 15))
def test_packed_points__extents_are_those_of_all_points(order: list[int], number: int) -> None:
    n = len(order)
    place = np.array(order, np.float64)
    xyz_m = np.column_stack([place, -2.0 * place, 0.5 * place])
    t_s = 1.75e9 - 100.0 * place  # never in the order of the points alone
    x, y, z = (np.empty(n, np.int32) for _ in range(3))
    numbers, bits, time = np.full(n, number, np.uint8), np.empty(n, np.uint8), np.empty(n)
    by_return = np.zeros(16, np.int64)
    refused, low, high, ends_s = pack_points(
        xyz_m, 1000.0, t_s, 16.0, numbers, numbers, (x, y, z, bits, time), by_return
    )
    assert refused == -1
    assert (low, high) == ((0, -16_000, 0), (8000, 0, 4000))
    assert ends_s == (1.75e9 - 800.0, 1.75e9)
    assert by_return.tolist() == [n if k == number else 0 for k in range(16)]
    np.testing.assert_array_equal(time, t_s + 16.0)
    np.testing.assert_array_equal(bits, number | number << 4)
    np.testing.assert_array_equal(np.column_stack([x, y, z]), xyz_m * 1000.0)
