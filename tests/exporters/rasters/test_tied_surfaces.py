"""The mean change of ground of which unlike shares were seen."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from furrowmap.exporters.rasters.tied_surfaces import HIDDEN_SHARE, _shadow_sums, _weight_by_kind


def sums(
    cells: int,
    changes: np.ndarray,
    error_m: float,
    spread_m: float = 0.0,
    shadow: tuple[float, ...] = 6 * (0.0,),
) -> list[float]:
    count = len(changes)
    return [cells, count, changes.sum(), (changes**2).sum(), count * error_m**2, count * spread_m**2, *shadow]


def test_mean__is_that_of_all_ground_though_less_of_one_kind_was_seen() -> None:
    """Of what rose by 40 mm a half was seen, of what was worked again all: their mean is 20 mm, that of the seen 13."""
    fresh, again = np.full(400, 0.040), np.zeros(800)
    kinds = np.array([sums(800, fresh, 0.01, 0.01), sums(800, again, 0.02, 0.03)])
    worked, compared, mean, noise, unseen, shadow, hidden = _weight_by_kind(kinds, 0.0025)
    assert (worked, compared) == pytest.approx((4.0, 3.0))
    assert mean == pytest.approx(0.020)
    assert noise == pytest.approx(0.5 * np.hypot(0.01 / np.sqrt(400), 0.02 / np.sqrt(800)))
    assert unseen == pytest.approx(0.0, abs=1e-9)
    assert shadow == 0.0
    assert hidden == pytest.approx(HIDDEN_SHARE * np.sqrt((0.01**2 + 0.03**2) / 2))


def test_mean__of_what_was_not_seen_is_as_uncertain_as_the_seen_differs() -> None:
    changes = np.tile([0.02, 0.06], 1000)
    kinds = np.array([sums(2500, changes, 0.0), sums(0, np.zeros(0), 0.0)])
    _, _, mean, _, unseen, _, _ = _weight_by_kind(kinds, 0.0025)
    assert mean == pytest.approx(0.04)
    assert unseen == pytest.approx(0.2 * 0.02 / np.sqrt(5.0))


def test_mean__of_a_kind_that_nobody_saw_is_that_of_the_others() -> None:
    kinds = np.array([sums(100, np.full(50, 0.03), 0.01), sums(20, np.zeros(0), 0.0)])
    assert _weight_by_kind(kinds, 0.0025)[2] == pytest.approx(0.03)
    nothing = np.array([sums(100, np.zeros(0), 0.0), sums(0, np.zeros(0), 0.0)])
    assert np.isnan(_weight_by_kind(nothing, 0.0025)[2])


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
    shadow = _shadow_sums(height, returns.astype(np.float32), np.ones(height.shape, bool))
    change = -height[np.isfinite(height)].astype(np.float64)
    kinds = np.array([sums(height.size, change, 0.0, 0.0, tuple(shadow)), sums(0, np.zeros(0), 0.0)])
    _, _, mean, _, sigma, share, _ = _weight_by_kind(kinds, 0.0025)
    assert share == pytest.approx(np.isnan(height).mean(), rel=0.2)
    assert abs(mean + relief.mean()) < 0.35 * abs(change.mean() + relief.mean())
    assert abs(mean + relief.mean()) < sigma


def test_mean__takes_cells_that_chance_left_without_a_return_for_no_shadow() -> None:
    """Returns on even chance, three to a cell: 5 % of the cells of rough ground have none."""
    rng = np.random.default_rng(7)
    relief = 0.03 * rng.standard_normal((400, 400))
    returns = rng.poisson(3.0, relief.shape).astype(np.float32)
    height = np.where(returns > 0.0, relief, np.nan).astype(np.float32)
    known, unseen, *_ = shadow = _shadow_sums(height, returns, np.ones(relief.shape, bool))
    assert unseen / (known + unseen) == pytest.approx(np.exp(-3.0), rel=0.05)
    kinds = np.array([sums(relief.size, -height[returns > 0.0], 0.0, 0.0, tuple(shadow)), sums(0, np.zeros(0), 0.0)])
    assert _weight_by_kind(kinds, 0.0025)[5] < 0.003
