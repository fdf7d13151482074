"""Standard deviations of headings that may be any."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.trajectory.from_gnss import with_vague_headings


def test_headings__beyond_15_degrees_may_be_any() -> None:
    """A heading anywhere within 180° to both sides has the standard deviation of a uniform distribution."""
    sigma = np.tile([0.1, 0.2, 0.05, 1.0, 1.5, 0.0], (4, 1))
    sigma[:, 5] = [0.5, 14.9, 15.1, 150.0]
    found = with_vague_headings(sigma, np.array([1.5, 2.0, 3.0]))
    np.testing.assert_array_equal(found[:2], sigma[:2])
    evenly = np.arange(-180.0, 180.0, 0.01)
    assert found[2:, 5] == pytest.approx([evenly.std(), 150.0], rel=1e-4)
    np.testing.assert_allclose(found[2:, :2], np.hypot(sigma[2:, :2], 2.5))
    np.testing.assert_array_equal(found[:, 2:5], sigma[:, 2:5])
    assert (sigma[:, :2] == [0.1, 0.2]).all()


def test_headings__that_are_known_keep_their_standard_deviations() -> None:
    sigma = np.full((3, 6), 0.3)
    assert with_vague_headings(sigma, np.ones(3)) is sigma
