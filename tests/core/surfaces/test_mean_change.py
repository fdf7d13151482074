"""The mean change of ground of which unlike shares were seen."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from furrowmap.core.surfaces.mean_change import HIDDEN_SHARE, SAMPLE_M2, ChangeSums, MeanChange


def sums(cells: int, changes: np.ndarray, error_m: float, spread_m: float = 0.0) -> list[float]:
    count = len(changes)
    return [cells, count, changes.sum(), (changes**2).sum(), count * error_m**2, count * spread_m**2, *6 * (0.0,)]


def mean_of(*kinds: list[float]) -> MeanChange:
    found = ChangeSums()
    found.sums = np.array([12 * [0.0], *kinds])
    return found.mean(0.0025, range(1, 1 + len(kinds)))


def levelled(height_m: np.ndarray, returns: np.ndarray) -> MeanChange:
    """The change of rough ground that becomes a plane at 0 m."""
    found, none = ChangeSums(), np.full(height_m.shape, np.nan, np.float32)
    found.add(np.ones(height_m.shape, np.int32), -height_m, none, none, height_m, returns)
    return found.mean(0.0025, (1,))


def test_mean__is_that_of_all_ground_though_less_of_one_kind_was_seen() -> None:
    """Of what rose by 40 mm a half was seen, of what was worked again all: their mean is 20 mm, that of the seen 13."""
    fresh, again = np.full(400, 0.040), np.zeros(800)
    found = mean_of(sums(800, fresh, 0.01, 0.01), sums(800, again, 0.02, 0.03))
    assert (found.area_m2, found.compared_m2) == pytest.approx((4.0, 3.0))
    assert found.mean_m == pytest.approx(0.020)
    noise = 0.5 * np.hypot(0.01 / np.sqrt(400), 0.02 / np.sqrt(800))
    hidden = HIDDEN_SHARE * np.sqrt((0.01**2 + 0.03**2) / 2)
    assert found.sigma_m == pytest.approx(np.hypot(noise, hidden))
    assert found.shadow_share == 0.0


def test_mean__of_what_was_not_seen_is_as_uncertain_as_the_seen_differs() -> None:
    changes = np.tile([0.02, 0.06], 1000)
    found = mean_of(sums(2500, changes, 0.0), sums(0, np.zeros(0), 0.0))
    assert found.mean_m == pytest.approx(0.04)
    assert found.sigma_m == pytest.approx(0.2 * 0.02 / np.sqrt(5.0 / SAMPLE_M2))


def test_mean__of_a_kind_that_nobody_saw_is_that_of_the_others_and_less_sure() -> None:
    seen = sums(2000, np.tile([0.02, 0.06], 1000), 0.0)
    found = mean_of(seen, sums(2000, np.zeros(0), 0.0))
    assert (found.area_m2, found.mean_m) == pytest.approx((10.0, 0.04))
    assert found.sigma_m == pytest.approx(0.5 * 0.02 / np.sqrt(5.0 / SAMPLE_M2))
    assert np.isnan(mean_of(sums(100, np.zeros(0), 0.0), sums(0, np.zeros(0), 0.0)).mean_m)


@pytest.mark.parametrize(
    ("clods_m", "furrows_m", "down"),
    [(0.032, 0.03, 0.5), (0.032, 0.0, 0.2), (0.014, 0.0, 0.2), (0.014, 0.0, 0.1)],
)
def test_mean__has_what_lay_in_shadows_of_the_relief(clods_m: float, furrows_m: float, down: float) -> None:
    """Ploughed and tilled ground, seen from the west: points below a ray over a crest, 12.5 mm apart, are hidden.

    The tool leaves even ground.
    """
    noise = gaussian_filter(np.random.default_rng(5).standard_normal((1600, 1600)), 5.6, mode="wrap")
    along = 0.0125 * np.arange(1600)
    relief = clods_m * noise / noise.std() + furrows_m * np.sin(2.0 * np.pi * along / 0.35)[:, None]
    rays = relief + down * along
    seen = rays >= np.maximum.accumulate(rays, axis=1)
    returns, total = (a.reshape(400, 4, 400, 4).sum(axis=(1, 3)) for a in (seen, np.where(seen, relief, 0.0)))
    height = np.where(returns > 0, total / np.maximum(returns, 1), np.nan).astype(np.float32)
    found = levelled(height, returns)
    plain_m = -np.nanmean(height)
    assert found.shadow_share == pytest.approx(np.isnan(height).mean(), rel=0.2)
    assert abs(found.mean_m + relief.mean()) < 0.35 * abs(plain_m + relief.mean())
    assert abs(found.mean_m + relief.mean()) < found.sigma_m


def test_mean__takes_cells_that_chance_left_without_a_return_for_no_shadow() -> None:
    """Returns on even chance, three to a cell: 5 % of the cells of rough ground have none."""
    rng = np.random.default_rng(7)
    relief = 0.03 * rng.standard_normal((400, 400))
    returns = rng.poisson(3.0, relief.shape).astype(np.float32)
    height = np.where(returns > 0.0, relief, np.nan).astype(np.float32)
    assert np.isnan(height).mean() == pytest.approx(np.exp(-3.0), rel=0.05)
    assert levelled(height, returns).shadow_share < 0.003
