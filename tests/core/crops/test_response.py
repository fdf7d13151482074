"""The response to a dose: against published trials, scipy's least squares, Fieller's theorem, statsmodels and truth."""

from __future__ import annotations

import csv
import datetime as dt
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy import special, stats
from scipy.optimize import curve_fit, minimize
from statsmodels.formula.api import ols
from statsmodels.tools.eval_measures import aicc

from furrowmap.core.crops.dose_response import fit_response
from furrowmap.core.crops.growth_between import growth_of
from furrowmap.core.crops.permuted_response import p_of_no_response
from furrowmap.core.crops.response_models import MODEL_NAMES, ModelName
from furrowmap.core.crops.response_profile import Observations, fit_model
from furrowmap.core.crops.response_values import Response, ResponseQuestion

FloatArray = NDArray[np.float64]
RATES = np.array([0.0, 50.0, 100.0, 150.0, 200.0, 250.0, 300.0])
DOSE = np.tile(RATES, 4)
BLOCK = np.repeat(np.arange(4), 7)
LABELS = [f"B{k}" for k in BLOCK]
RATIO = 0.006


def quadratic(x: FloatArray, a: float, b: float, c: float) -> FloatArray:
    return a + b * x + c * x**2


def quadratic_plateau(x: FloatArray, a: float, rise: float, join: float) -> FloatArray:
    part = np.minimum(x / join, 1.0)
    return a + rise * part * (2.0 - part)


def linear_plateau(x: FloatArray, a: float, rise: float, join: float) -> FloatArray:
    return a + rise * np.minimum(x / join, 1.0)


def mitscherlich(x: FloatArray, a: float, rise: float, rate: float) -> FloatArray:
    return a + rise * (1.0 - np.exp(-rate * x))


def logistic(x: FloatArray, a: float, rise: float, gradient: float, midpoint: float) -> FloatArray:
    return a + rise * special.expit(gradient * (x - midpoint))


SHAPES: dict[ModelName, tuple[Callable[..., FloatArray], tuple[float, ...], float]] = {
    "quadratic": (quadratic, (4.0, 0.035, -0.0000777), (0.035 - RATIO) / (2 * 0.0000777)),
    "quadratic-plateau": (quadratic_plateau, (4.0, 4.0, 190.0), 190.0 * (1.0 - RATIO * 190.0 / 8.0)),
    "linear-plateau": (linear_plateau, (4.0, 4.0, 140.0), 140.0),
    "mitscherlich": (mitscherlich, (4.0, 4.2, 0.014), np.log(4.2 * 0.014 / RATIO) / 0.014),
    "logistic": (logistic, (3.6, 4.4, 0.035, 100.0), 0.0),
}


def yields(shape: ModelName, seed: int, sigma: float = 0.3) -> FloatArray:
    curve, truth, _ = SHAPES[shape]
    return curve(DOSE, *truth) + np.random.default_rng(seed).normal(0.0, sigma, len(DOSE))


def table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def column(rows: list[dict[str, str]], name: str) -> FloatArray:
    return np.array([float(row[name]) for row in rows])


def engelstad(folder: Path, location: str, year: int, question: ResponseQuestion) -> Response:
    rows = [r for r in table(folder / "engelstad.csv") if r["location"] == location and r["year"] == str(year)]
    return fit_response(column(rows, "n_kg_ha"), column(rows, "yield_dt_ha"), question=question)


def test_low_zone__has_the_published_optimum_and_interval(shared_data: Path) -> None:
    """Bachmaier 2009: 199 kg/ha, 173 to 260 (Fieller), quadratic without blocks."""
    rows = table(shared_data / "trials" / "bachmaier_low.csv")
    question = ResponseQuestion("quadratic", 0.60 / 110.0, "kg/ha")
    found = fit_response(column(rows, "n_kg_ha"), column(rows, "yield_t_ha"), question=question)
    assert found.economic is not None
    assert found.economic.value == pytest.approx(199.08, abs=0.05)
    assert (found.economic.low, found.economic.high) == pytest.approx((173.1, 260.0), abs=0.5)
    assert found.models[0].lack_of_fit_p == pytest.approx(0.58, abs=0.01)


def test_jackson_1962__has_the_published_plateau_and_optimum(shared_data: Path) -> None:
    """Schabenberger and Pierce 2002, p. 254: plateau from 225 kg/ha; 140 kg/ha at 0.11 $/kg and 1.15 $/dt."""
    found = engelstad(shared_data / "trials", "Jackson", 1962, ResponseQuestion("quadratic-plateau", 0.11 / 1.15))
    assert found.agronomic is not None
    assert found.economic is not None
    assert found.agronomic.value == pytest.approx(225.3, abs=0.1)
    assert found.economic.value == pytest.approx(140.8, abs=0.1)
    compared = engelstad(shared_data / "trials", "Jackson", 1962, ResponseQuestion(ratio=0.11 / 1.15))
    assert compared.economic is not None
    assert compared.economic.low < 140.0 < compared.economic.high


@pytest.mark.parametrize("year", [1965, 1966])
def test_knoxville__shows_no_response_in_its_last_years(shared_data: Path, year: int) -> None:
    found = engelstad(shared_data / "trials", "Knoxville", year, ResponseQuestion(ratio=0.1))
    assert found.words.startswith("No response shown")
    assert not found.models
    assert found.economic is None


@pytest.mark.parametrize("shape", SHAPES)
def test_fit__is_the_least_squares_of_scipy(shape: ModelName) -> None:
    curve, truth, optimum = SHAPES[shape]
    value = yields(shape, 3)
    found = fit_response(DOSE, value, None, ResponseQuestion(shape, RATIO))
    best, _ = curve_fit(curve, DOSE, value, truth)
    (model,) = found.models
    assert model.sum_squares == pytest.approx(((value - curve(DOSE, *best)) ** 2).sum(), rel=1e-4)
    assert model.fitted == pytest.approx(curve(found.dose, *best), abs=0.02)
    assert model.sigma == pytest.approx(np.sqrt(model.sum_squares / (len(DOSE) - len(best))))
    assert found.economic is not None
    if shape != "logistic":
        assert found.economic.low <= optimum <= found.economic.high


def test_interval__of_a_parabola_is_that_of_fieller() -> None:
    """The roots of (b + 2 c x − ratio)² = t² · variance, in closed form."""
    value = yields("quadratic", 5)
    found = fit_response(DOSE, value, LABELS, ResponseQuestion("quadratic", RATIO)).economic
    design = np.column_stack([(BLOCK[:, None] == np.arange(4)).astype(float), DOSE, DOSE**2])
    inverse = np.linalg.inv(design.T @ design)
    b = inverse @ design.T @ value
    residual = value - design @ b
    freedom = len(value) - 6
    c = inverse * (residual @ residual) / freedom * stats.t.ppf(0.975, freedom) ** 2
    roots = np.roots([4 * (b[5] ** 2 - c[5, 5]), 4 * ((b[4] - RATIO) * b[5] - c[4, 5]), (b[4] - RATIO) ** 2 - c[4, 4]])
    assert found is not None
    assert sorted(roots) == pytest.approx([found.low, found.high], abs=0.3)
    assert found.value == pytest.approx((RATIO - b[4]) / (2 * b[5]), abs=0.01)


@pytest.mark.parametrize("shape", ["quadratic-plateau", "mitscherlich"])
def test_interval__is_where_the_profile_of_the_sum_of_squares_meets_the_limit_of_t(shape: ModelName) -> None:
    """All parameters by scipy, with the rise that makes the end of the interval the optimum."""
    curve, truth, _ = SHAPES[shape]
    value = yields(shape, 11)
    found = fit_response(DOSE, value, None, ResponseQuestion(shape, RATIO))
    assert found.economic is not None
    for end in (found.economic.low, found.economic.high):

        def raised(free: FloatArray, end: float = end) -> float:
            lower, last = free
            slope = 2.0 * (1.0 - end / last) / last if shape == "quadratic-plateau" else last * np.exp(-last * end)
            return float(((value - curve(DOSE, lower, RATIO / slope, last)) ** 2).sum()) if slope > 0.0 else np.inf

        start = [truth[0], truth[2] if shape == "mitscherlich" else 1.2 * end]
        least = minimize(raised, start, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-10, "maxiter": 4000})
        model = found.models[0]
        t = np.sqrt((least.fun / model.sum_squares - 1.0) * model.freedom)
        assert t == pytest.approx(stats.t.ppf(0.975, model.freedom), rel=0.02)


def test_criterion_and_lack_of_fit__are_those_of_statsmodels() -> None:
    value = yields("quadratic", 8)
    found = {each.name: each for each in fit_response(DOSE, value, LABELS).models}
    data = pd.DataFrame({"y": value, "x": DOSE, "b": LABELS})
    whole = ols("y ~ C(x) + C(b)", data).fit()
    for name, terms in (("linear", "x"), ("quadratic", "x + I(x**2)")):
        other = ols(f"y ~ {terms} + C(b)", data).fit()
        # statsmodels counts no variance and keeps constants: differences are compared
        expected = aicc(other.llf, len(value), other.df_model + 2)
        constant = len(value) * (1.0 + np.log(2.0 * np.pi))
        assert found[name].aicc == pytest.approx(expected - constant, abs=1e-4)
        assert found[name].lack_of_fit_p == pytest.approx(whole.compare_f_test(other)[1], rel=1e-3)
    weights = np.array([each.weight for each in found.values()])
    criteria = np.array([each.aicc for each in found.values()], float)
    assert weights.sum() == pytest.approx(1.0)
    kept = weights > 0.0
    assert np.log(weights[kept]) - np.log(weights[0]) == pytest.approx(0.5 * (criteria[0] - criteria[kept]), abs=1e-6)


def test_blocks_and_other_effects__do_not_move_the_curve() -> None:
    """The least sum of squares is found to the root of the precision of its values: 1e-8 of the dose."""
    value = yields("mitscherlich", 7)
    bare = fit_response(DOSE, value, LABELS, ResponseQuestion(ratio=RATIO))
    offset = np.array([0.3, -0.5, 0.4, -0.2])[BLOCK]
    beside = np.random.default_rng(4).normal(0.0, 1.0, (len(DOSE), 1))
    shifted = fit_response(DOSE, value + offset, LABELS, ResponseQuestion(ratio=RATIO))
    assert shifted.economic is not None
    assert bare.economic is not None
    assert shifted.economic.value == pytest.approx(bare.economic.value, rel=1e-7)
    assert shifted.residual == pytest.approx(bare.residual, abs=1e-9)
    one = fit_response(DOSE, value, LABELS, ResponseQuestion(ratio=RATIO), beside)
    other = fit_response(DOSE, value + 3.0 * beside[:, 0], LABELS, ResponseQuestion(ratio=RATIO), beside)
    assert one.economic is not None
    assert other.economic is not None
    assert other.economic.low == pytest.approx(one.economic.low, rel=1e-7)


@pytest.mark.parametrize(("dose_unit", "yield_unit"), [(0.01, 1.0), (1.0, 100.0), (2.2, 0.4)])
def test_answer__does_not_depend_on_the_units(dose_unit: float, yield_unit: float) -> None:
    value = yields("quadratic-plateau", 7)
    first = fit_response(DOSE, value, LABELS, ResponseQuestion(ratio=RATIO))
    other = fit_response(
        dose_unit * DOSE, yield_unit * value, LABELS, ResponseQuestion(ratio=RATIO * yield_unit / dose_unit)
    )
    assert first.economic is not None
    assert other.economic is not None
    for name in ("low", "value", "high"):
        assert getattr(other.economic, name) == pytest.approx(dose_unit * getattr(first.economic, name), rel=1e-6)
    assert [each.weight for each in other.models] == pytest.approx([each.weight for each in first.models], abs=1e-9)


@pytest.mark.slow
def test_intervals__hold_the_truth_and_end_within_the_doses() -> None:
    """A smaller benchmarks/response_curve.py: 100 trials of five shapes."""
    held = 0
    right = []
    for number in range(100):
        shape = list(SHAPES)[number % 5]
        curve, truth, _ = SHAPES[shape]
        fine = np.linspace(0.0, 300.0, 3001)
        optimum = fine[np.argmax(curve(fine, *truth) - RATIO * fine)]
        found = fit_response(DOSE, yields(shape, 100 + number), LABELS, ResponseQuestion(ratio=RATIO))
        assert found.economic is not None
        for each in (found.economic, found.agronomic, *(model.economic for model in found.models)):
            assert each is not None
            assert 0.0 <= each.low <= each.value <= each.high <= 300.0
        held += found.economic.low - 0.1 <= optimum <= found.economic.high + 0.1
        if found.models[0].weight > 0.9:
            right.append(found.models[0].name == shape)
    assert held >= 88
    assert np.mean(right) >= 0.8


def test_without_noise__the_truth_is_found() -> None:
    for shape, (curve, truth, optimum) in SHAPES.items():
        found = fit_response(DOSE, curve(DOSE, *truth), LABELS, ResponseQuestion(ratio=RATIO))
        assert found.models[0].name == shape
        if shape != "logistic":
            assert found.economic is not None
            assert found.economic.value == pytest.approx(optimum, abs=0.3)
    midpoint = found.models[0].coefficients
    assert midpoint == pytest.approx({"lower": 3.6, "rise": 4.4, "gradient": 0.035, "midpoint": 100.0}, rel=1e-3)


def test_yield_and_gain__are_those_of_the_curve() -> None:
    found = fit_response(DOSE, yields("quadratic", 2), LABELS, ResponseQuestion("quadratic", RATIO, "kg/ha"))
    assert found.best is not None
    assert found.gain is not None
    (model,) = found.models
    a, b, c = model.coefficients.values()
    at = found.best.dose
    assert found.best.value == pytest.approx(quadratic(np.array(at), a, b, c), abs=1e-6)
    assert found.gain.until - found.gain.dose == 10.0
    assert found.gain.value == pytest.approx(b * 10.0 + c * ((at + 10.0) ** 2 - at**2), abs=1e-6)
    assert found.gain.low < found.gain.value < found.gain.high
    design = np.column_stack([(BLOCK[:, None] == np.arange(4)).astype(float), DOSE, DOSE**2])
    line = np.array([0.25, 0.25, 0.25, 0.25, at, at**2])
    half = stats.t.ppf(0.975, 22) * model.sigma * np.sqrt(line @ np.linalg.inv(design.T @ design) @ line)
    assert found.best.high - found.best.value == pytest.approx(half, rel=0.02)
    assert [each.dose for each in found.gains] == RATES[:-1].tolist()


def test_a_straight_line__is_not_said_to_level_off() -> None:
    value = 3.0 + 0.01 * DOSE + np.random.default_rng(2).normal(0.0, 0.1, len(DOSE))
    found = fit_response(DOSE, value, question=ResponseQuestion(ratio=RATIO, unit="kg/ha"))
    assert found.agronomic is not None
    assert found.agronomic.high_open
    assert found.agronomic.high == 300.0
    assert "300 kg/ha" in found.words
    dear = fit_response(DOSE, value, question=ResponseQuestion(ratio=0.02, unit="kg/ha"))
    assert dear.economic is not None
    assert dear.economic.value == 0.0
    assert "No dose pays" in dear.words


def test_what_shows_no_response__says_so() -> None:
    flat = fit_response(DOSE, 0.45 + np.random.default_rng(8).normal(0.0, 0.015, len(DOSE)))
    assert not flat.models
    assert flat.p is not None
    assert flat.p > 0.05
    assert "No response shown" in flat.words
    for few in (fit_response(np.tile([0.0, 100.0], 6), yields("quadratic", 1)[:12]), fit_response(DOSE, DOSE * np.nan)):
        assert not few.models
        assert few.p is None
        assert "needs three doses" in few.words


def test_five_plots_that_level_off__are_not_a_straight_line() -> None:
    """One plot for each dose: AICc does not exist for a curve, and the line is ruled out."""
    found = fit_response(RATES[:5], np.array([2.0, 6.0, 8.0, 8.05, 8.02]), question=ResponseQuestion(ratio=RATIO))
    assert found.p_straight is not None
    assert found.p_straight <= 0.05
    assert found.models[0].name != "linear"
    assert found.models[0].aicc is None
    assert found.models[-1].weight == 0.0


def test_falling_yields__are_best_at_the_lowest_dose() -> None:
    value = 8.0 - 0.01 * DOSE + np.random.default_rng(3).normal(0.0, 0.1, len(DOSE))
    found = fit_response(DOSE, value, question=ResponseQuestion(ratio=RATIO))
    assert found.economic is not None
    assert (found.economic.value, found.economic.low) == (0.0, 0.0)
    assert "gains nothing" in found.words


def test_unknown_values__are_left_out() -> None:
    value = yields("mitscherlich", 4)
    value[3] = np.nan
    found = fit_response(DOSE, value, LABELS, ResponseQuestion(unit="kg/ha"))
    assert found.parcels == 27
    assert found.blocks == ("B0", "B1", "B2", "B3")
    assert found.p == 1 / 2000
    assert np.isnan(found.residual[3])
    assert found.expected + found.residual == pytest.approx(value, nan_ok=True)
    fitted = found.models[0].fitted
    assert ((found.band_low <= fitted) & (fitted <= found.band_high)).all()


def test_probability_without_effect__is_uniform() -> None:
    """A permutation test holds its level: of 120 trials without an effect, about a tenth have p ≤ 0.1."""
    rng = np.random.default_rng(6)
    effects = np.eye(4)[BLOCK]
    p = [p_of_no_response(DOSE, rng.normal(0.4, 0.01, len(DOSE)), BLOCK, effects, trials=99) for _ in range(120)]
    assert 3 <= sum(each <= 0.1 for each in p) <= 25
    assert 35 <= sum(each <= 0.5 for each in p) <= 85


@pytest.mark.parametrize("name", MODEL_NAMES)
def test_a_shape__needs_enough(name: ModelName) -> None:
    few = np.array([0.0, 1.0])
    with pytest.raises(ValueError, match="more observations than parameters"):
        fit_model(name, Observations.sum_up(few, few, np.ones((2, 1))))


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
