"""The logistic response: against scipy's least squares, statsmodels, closed forms and known truth."""

from __future__ import annotations

import datetime as dt
import sys

import numpy as np
import pytest
from scipy.optimize import curve_fit

from furrowmap.core.crops.growth import growth_of
from furrowmap.core.crops.response import (
    Observations,
    analysis_of_variance,
    fit_logistic,
    fit_response,
    p_of_no_response,
)
from furrowmap.core.runtime.errors import InputError

RATES = np.array([0.0, 50.0, 100.0, 150.0, 200.0, 250.0, 300.0])
DOSE = np.tile(RATES, 4)
BLOCK = np.repeat(np.arange(4), 7)


def curve(dose: np.ndarray, lower: float, rise: float, gradient: float, midpoint: float) -> np.ndarray:
    return lower + rise / (1.0 + np.exp(-gradient * (dose - midpoint)))


TRUTH = (0.34, 0.24, 0.028, 85.0)


def heights(seed: int, sigma_m: float = 0.015) -> np.ndarray:
    return curve(DOSE, *TRUTH) + np.random.default_rng(seed).normal(0.0, sigma_m, len(DOSE))


def test_fit__is_the_least_squares_of_scipy() -> None:
    height = heights(3)
    found = fit_logistic(DOSE, height, np.zeros(len(DOSE), np.intp))
    best, _ = curve_fit(curve, DOSE, height, TRUTH)
    values = (found.lower.value, found.rise.value, found.gradient.value, found.midpoint.value)
    residual = height - curve(DOSE, *values)
    assert residual @ residual == pytest.approx(((height - curve(DOSE, *best)) ** 2).sum(), rel=1e-3)
    assert values == pytest.approx(best, rel=0.02)
    assert found.sigma == pytest.approx(np.sqrt(residual @ residual / (len(DOSE) - 4)), rel=1e-6)
    assert found.plateau.value == pytest.approx(values[3] + np.log(19.0) / values[2])


def test_interval__is_where_the_profile_of_the_sum_of_squares_meets_the_limit_of_t() -> None:
    """The profile of the rise by scipy: all other parameters fitted at each end of the interval."""
    height = heights(5)
    found = fit_logistic(DOSE, height, np.zeros(len(DOSE), np.intp))
    least = found.sigma**2 * found.freedom
    for end in (found.rise.low, found.rise.high):
        others, _ = curve_fit(lambda x, a, k, m, rise=end: curve(x, a, rise, k, m), DOSE, height, (0.34, 0.028, 85.0))
        raised = ((height - curve(DOSE, others[0], end, *others[1:])) ** 2).sum()
        assert np.sqrt((raised / least - 1.0) * found.freedom) == pytest.approx(2.064, rel=0.03)  # t of 24 at 97.5 %


def test_offsets_of_blocks__are_found_and_do_not_move_the_curve() -> None:
    height, offset = heights(7), np.array([0.03, -0.05, 0.04, -0.02])
    bare = fit_logistic(DOSE, height, BLOCK)
    shifted = fit_logistic(DOSE, height + offset[BLOCK], BLOCK)
    assert shifted.offsets - bare.offsets == pytest.approx(offset, abs=1e-4)
    assert shifted.rise.value == pytest.approx(bare.rise.value, rel=1e-6)
    assert shifted.lower.value == pytest.approx(bare.lower.value, abs=1e-6)
    assert abs(bare.offsets.mean()) < 1e-12


@pytest.mark.parametrize("unit", [0.01, 100.0])
def test_fit__does_not_depend_on_the_unit_of_heights(unit: float) -> None:
    height = heights(7)
    metres, others = fit_logistic(DOSE, height, BLOCK), fit_logistic(DOSE, unit * height, BLOCK)
    assert 0.9 < metres.r2 < 1.0
    assert others.r2 == pytest.approx(metres.r2, abs=1e-9)
    assert others.sigma == pytest.approx(unit * metres.sigma)
    for name, factor in (("lower", unit), ("rise", unit), ("gradient", 1.0), ("midpoint", 1.0), ("plateau", 1.0)):
        one, two = getattr(metres, name), getattr(others, name)
        assert (two.low, two.value, two.high) == pytest.approx(
            (factor * one.low, factor * one.value, factor * one.high)
        )


def test_sums__are_those_of_the_observations() -> None:
    height = heights(11)
    seen = Observations.sum_up(DOSE, height, BLOCK)
    means = np.array([height[k == BLOCK].mean() for k in range(4)])
    assert seen.squares == pytest.approx(((height - means[BLOCK]) ** 2).sum())
    assert seen.freedom == 28 - 4 - 3


def test_without_noise__the_truth_is_found_and_the_intervals_close() -> None:
    found = fit_logistic(DOSE, curve(DOSE, *TRUTH), BLOCK)
    for name, truth in zip(("lower", "rise", "gradient", "midpoint"), TRUTH, strict=True):
        estimate = getattr(found, name)
        assert estimate.value == pytest.approx(truth, rel=1e-3)
        assert estimate.high - estimate.low < 0.01 * truth


def test_a_straight_line__leaves_the_plateau_open() -> None:
    height = 0.3 + 0.001 * DOSE + np.random.default_rng(2).normal(0.0, 0.01, len(DOSE))
    found = fit_response(DOSE, height, unit="kg/ha")
    assert found.curve is not None
    assert not found.plateau_shown
    assert np.isinf(found.curve.rise.high)
    assert "300 kg/ha" in found.words


def test_what_holds_no_curve__says_so() -> None:
    flat = fit_response(DOSE, 0.45 + np.random.default_rng(8).normal(0.0, 0.015, len(DOSE)))
    assert flat.curve is None
    assert flat.p is not None
    assert flat.p > 0.05
    assert "no curve" in flat.words
    few = fit_response(np.tile([0.0, 100.0, 200.0], 4), heights(1)[:12])
    assert few.curve is None
    assert few.p is None
    assert "needs 4 doses" in few.words


def test_response__of_the_truth_is_certain_and_levels_off_where_it_does() -> None:
    value = heights(4)
    value[3] = np.nan
    found = fit_response(DOSE, value, [str(k) for k in BLOCK], "kg/ha")
    assert found.parcels == 27
    assert found.blocks == ("0", "1", "2", "3")
    assert found.p == 1 / 2000
    assert found.curve is not None
    assert found.plateau_shown
    assert found.curve.plateau.low <= 85.0 + np.log(19.0) / 0.028 <= found.curve.plateau.high
    assert f"Beyond {found.curve.plateau.value:.0f} kg/ha" in found.words
    assert ((found.curve.band_low <= found.curve.fitted) & (found.curve.fitted <= found.curve.band_high)).all()


def test_probability_without_effect__is_uniform() -> None:
    """A permutation test holds its level: of 120 trials without an effect, about a tenth have p ≤ 0.1."""
    rng = np.random.default_rng(6)
    p = [p_of_no_response(DOSE, rng.normal(0.4, 0.01, len(DOSE)), BLOCK, trials=99) for _ in range(120)]
    assert 3 <= sum(each <= 0.1 for each in p) <= 25
    assert 35 <= sum(each <= 0.5 for each in p) <= 85


def test_variance__of_a_complete_design_is_that_of_the_textbook() -> None:
    """Randomised complete blocks: sums of squares of the means, in closed form."""
    height = heights(9) + np.array([0.02, 0.0, -0.02, 0.0])[BLOCK]
    found = analysis_of_variance(height, [f"N{x:.0f}" for x in DOSE], [str(k) for k in BLOCK])
    assert found is not None
    table = height.reshape(4, 7)
    mean = table.mean()
    treatment = 4 * ((table.mean(axis=0) - mean) ** 2).sum()
    block = 7 * ((table.mean(axis=1) - mean) ** 2).sum()
    rest = ((table - mean) ** 2).sum() - treatment - block
    rows = {row.source: row for row in found.rows}
    assert {name: row.freedom for name, row in rows.items()} == {"treatment": 6, "block": 3, "residual": 18}
    assert rows["treatment"].sum_squares == pytest.approx(treatment)
    assert rows["block"].sum_squares == pytest.approx(block)
    assert rows["treatment"].f == pytest.approx((treatment / 6) / (rest / 18))
    assert rows["residual"].f is None
    assert found.means[0].treatment == "N0"
    assert found.means[0].mean == pytest.approx(table[:, 0].mean())
    assert found.means[0].high - found.means[0].mean == pytest.approx(2.101 * np.sqrt(rest / 18 / 4), rel=1e-3)


def test_variance__without_anything_left_over_is_none() -> None:
    assert analysis_of_variance(np.array([1.0, 2.0, 3.0]), ["a", "b", "c"]) is None


def test_variance__needs_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "statsmodels.formula.api", None)
    with pytest.raises(InputError, match="statsmodels, which is not installed") as refused:
        analysis_of_variance(heights(1), [str(x) for x in DOSE])
    assert refused.value.code == "extra-missing"


def test_growth__is_the_slope_over_the_days() -> None:
    days = [dt.date(2026, 5, 1), dt.date(2026, 5, 11), dt.date(2026, 5, 21)]
    flights = [{"1": 0.20, "2": 0.30}, {"1": 0.31, "2": np.nan, "3": 0.4}, {"1": 0.40, "2": 0.50}]
    found = growth_of(days, flights, [{"1": 0.01, "2": 0.01}] * 3)
    assert [(each.id, each.days) for each in found] == [("1", 3), ("2", 2)]
    assert found[0].rate_m_day == pytest.approx(0.01)
    assert found[1].rate_m_day == pytest.approx(0.01)
    assert found[1].sigma_m_day == pytest.approx(0.01 * np.sqrt(2.0) / 20.0)
    with pytest.raises(ValueError, match="same day"):
        growth_of([days[0], days[0]], flights[:2])
