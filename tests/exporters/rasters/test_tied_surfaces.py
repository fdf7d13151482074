"""The mean change of ground of which unlike shares were seen."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.exporters.rasters.tied_surfaces import HIDDEN_SHARE, _weight_by_kind


def sums(cells: int, changes: np.ndarray, error_m: float, spread_m: float = 0.0) -> list[float]:
    count = len(changes)
    return [cells, count, changes.sum(), (changes**2).sum(), count * error_m**2, count * spread_m**2]


def test_mean__is_that_of_all_ground_though_less_of_one_kind_was_seen() -> None:
    """Of what rose by 40 mm a half was seen, of what was worked again all: their mean is 20 mm, that of the seen 13."""
    fresh, again = np.full(400, 0.040), np.zeros(800)
    kinds = np.array([sums(800, fresh, 0.01, 0.01), sums(800, again, 0.02, 0.03)])
    worked, compared, mean, noise, unseen, hidden = _weight_by_kind(kinds, 0.0025)
    assert (worked, compared) == pytest.approx((4.0, 3.0))
    assert mean == pytest.approx(0.020)
    assert noise == pytest.approx(0.5 * np.hypot(0.01 / np.sqrt(400), 0.02 / np.sqrt(800)))
    assert unseen == pytest.approx(0.0, abs=1e-9)
    assert hidden == pytest.approx(HIDDEN_SHARE * np.sqrt((0.01**2 + 0.03**2) / 2))


def test_mean__of_what_was_not_seen_is_as_uncertain_as_the_seen_differs() -> None:
    changes = np.tile([0.02, 0.06], 1000)
    _, _, mean, _, unseen, _ = _weight_by_kind(np.array([sums(2500, changes, 0.0), sums(0, np.zeros(0), 0.0)]), 0.0025)
    assert mean == pytest.approx(0.04)
    assert unseen == pytest.approx(0.2 * 0.02 / np.sqrt(5.0))


def test_mean__of_a_kind_that_nobody_saw_is_that_of_the_others() -> None:
    kinds = np.array([sums(100, np.full(50, 0.03), 0.01), sums(20, np.zeros(0), 0.0)])
    assert _weight_by_kind(kinds, 0.0025)[2] == pytest.approx(0.03)
    nothing = np.array([sums(100, np.zeros(0), 0.0), sums(0, np.zeros(0), 0.0)])
    assert np.isnan(_weight_by_kind(nothing, 0.0025)[2])
