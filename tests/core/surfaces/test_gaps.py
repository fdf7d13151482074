"""Filled gaps against closed forms and a direct solution of Laplace's equation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.sparse import lil_matrix
from scipy.sparse.linalg import spsolve

from furrowmap.core.surfaces.gaps import filled


def test_filled__gaps_of_a_plane_fill_to_the_plane() -> None:
    row, column = np.indices((40, 60))
    plane = 271.4 + 0.03 * row - 0.011 * column
    gappy = plane.copy()
    gappy[5:25, 10:50] = np.nan
    gappy[30:, :7] = np.nan
    np.testing.assert_allclose(filled(gappy), plane, atol=1e-9)


def test_filled__is_near_the_soap_film_over_the_rim() -> None:
    row, column = np.indices((32, 32))
    height = np.sin(row / 5.0) + np.cos(column / 7.0)
    gap = np.zeros(height.shape, bool)
    gap[8:20, 6:26] = True
    places = np.argwhere(gap)
    number = {tuple(place): k for k, place in enumerate(places.tolist())}
    matrix, right = lil_matrix((len(places), len(places))), np.zeros(len(places))
    for (i, j), k in number.items():
        matrix[k, k] = 4.0
        for a, b in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)):
            if (a, b) in number:
                matrix[k, number[a, b]] = -1.0
            else:
                right[k] += height[a, b]
    film = spsolve(matrix.tocsr(), right)
    found = filled(np.where(gap, np.nan, height))[gap]
    assert np.abs(found - film).max() < 0.03 * np.ptp(height)


@given(
    arrays(np.float64, (9, 7), elements=st.floats(-5.0, 5.0)),
    arrays(np.bool_, (9, 7)),
    st.floats(1.0, 4.0),
)
def test_filled__keeps_what_is_there_and_goes_no_farther_than_asked(
    height: np.ndarray, gap: np.ndarray, reach: float
) -> None:
    gappy = np.where(gap, np.nan, height)
    out = filled(gappy, reach)
    assert np.array_equal(out[~gap], height[~gap])
    there = np.argwhere(~gap)
    for place in np.argwhere(gap):
        distance = np.hypot(*(there - place).T).min(initial=np.inf)
        assert np.isfinite(out[tuple(place)]) == (distance <= reach)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (3, 3)])
def test_filled__of_nothing_is_nothing(shape: tuple[int, int]) -> None:
    assert np.isnan(filled(np.full(shape, np.nan))).all()
