"""The response of a quantity to a dose: shapes compared, optima with intervals, and what the trial cannot show.

Intervals are averaged over the shapes (model-averaged tail areas; Turek and Fletcher 2012, Comput. Stat. Data Anal.
56:2809-2815), since those of the one chosen are too short: the same data chose it. So did they make the weights: tail
areas are averaged by these to the power DOUBT, without which 93 instead of 95 % of the intervals hold the truth.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import special

from furrowmap.core.crops.permuted_response import p_of_no_response
from furrowmap.core.crops.response_models import MODEL_NAMES, ModelName
from furrowmap.core.crops.response_profile import DOSE_STEPS, VALUE_STEPS, Observations, ProfiledModel, fit_model
from furrowmap.core.crops.response_values import Estimate, FittedModel, Gain, Response, ResponseQuestion
from furrowmap.core.crops.response_words import MAX_P, response_words
from furrowmap.core.runtime.arrays import BoolArray, FloatArray, IntArray

MIN_DOSES: Final = 3
BAND_STEPS: Final = 61
GAIN_STEP: Final = 10.0
"""By how much the dose is raised to say what more of it brings."""
LIMIT_P: Final = 0.975
DOUBT: Final = 2.0 / 3.0
"""Power of the weights by which intervals are averaged (docs/decisions/trial-response.md)."""
UNSEEN: Final = 0.2
"""Share of the least step of doses in which the end of an interval is that of the search."""


def fit_response(
    dose: FloatArray,
    value: FloatArray,
    block: Sequence[str | None] | None = None,
    question: ResponseQuestion = ResponseQuestion(),
    covariates: FloatArray | None = None,
) -> Response:
    """The response of a value (n,) of parcels to their dose (n,); those without either (nan) are left out.

    `block` (n,) are labels; parcels without one are a block of their own. `covariates` (n, k) are other effects; a
    parcel without one of them (nan) is left out.
    """
    known = np.isfinite(dose) & np.isfinite(value)
    if covariates is not None:
        known &= np.isfinite(covariates).all(axis=1)
    names = [str(name or "") for name, kept in zip(block or [""] * len(dose), known, strict=True) if kept]
    labels = tuple(dict.fromkeys(names))
    index = np.array([labels.index(name) for name in names], np.int64)
    effects = np.eye(len(labels))[index]
    if covariates is not None and len(index):
        effects = np.column_stack([effects, covariates[known] - covariates[known].mean(axis=0)])
    return _DoseTrial(dose[known], value[known], index, effects, known, labels, question).response()


@dataclass(frozen=True)
class _DoseTrial:
    """Observations (n,), their effects beside the dose (n, p), and the rows of the table (all,) that they are."""

    dose: FloatArray
    value: FloatArray
    block: IntArray
    effects: FloatArray
    known: BoolArray
    labels: tuple[str, ...]
    question: ResponseQuestion

    @property
    def lowest(self) -> float:
        """Of the doses; nan without any."""
        return float(self.dose.min()) if len(self.dose) else np.nan

    @property
    def span(self) -> float:
        """Of the doses, above zero."""
        return float(np.ptp(self.dose)) or 1.0 if len(self.dose) else 1.0

    def response(self) -> Response:
        """What they show."""
        p = self._p()
        nothing = np.full(len(self.known), np.nan)
        none = np.zeros(0)
        found = Response(
            parcels=len(self.dose),
            doses=len(np.unique(self.dose)),
            lowest=self.lowest,
            highest=self.lowest + self.span if len(self.dose) else np.nan,
            blocks=self.labels,
            p=p,
            p_straight=None,
            models=(),
            agronomic=None,
            economic=None,
            best=None,
            gain=None,
            gains=(),
            dose=none,
            band_low=none,
            band_high=none,
            expected=nothing,
            residual=nothing,
        )
        if p is not None and p <= MAX_P:
            found = self._fitted(found)
        return replace(found, sentences=response_words(found, self.question))

    def _p(self) -> float | None:
        """Of no response; None where no curve can be fitted."""
        if len(np.unique(self.dose)) < MIN_DOSES or np.ptp(self.value) == 0.0:
            return None
        if len(self.dose) - int(np.linalg.matrix_rank(self.effects)) - 2 < 1:
            return None
        return p_of_no_response(self.dose, self.value, self.block, self.effects)

    def _fitted(self, found: Response) -> Response:
        scaled = (self.dose - self.lowest) / self.span
        seen = Observations.sum_up(scaled, self.value, self.effects)
        fits = _fits(seen, self.question.model)
        if not fits:
            return found
        p_straight = _p_straight(fits)
        weights = _weights(fits, straight_ruled_out=p_straight is not None and p_straight <= MAX_P)
        order = np.argsort(-weights, kind="stable")
        fits = [fits[k] for k in order]
        weights = weights[order]
        mixed = _Average(fits, weights, self.lowest, self.span)
        every = _Optima(fits, None, self.lowest, self.span)
        paying = _Optima(fits, self.question.ratio, self.lowest, self.span) if self.question.ratio is not None else None
        dose = np.linspace(0.0, 1.0, BAND_STEPS)
        band = fits[0].band(dose, float(special.stdtrit(fits[0].freedom, LIMIT_P)))
        agronomic = every.estimate(weights)
        economic = paying.estimate(weights) if paying is not None else None
        best = (economic or agronomic).value
        highest = self.lowest + self.span
        step = min(GAIN_STEP, self.span)
        begin = min(best, highest - step)
        expected = np.full(len(self.known), np.nan)
        expected[self.known] = self._expected(fits[0], scaled)
        residual = np.full(len(self.known), np.nan)
        residual[self.known] = self.value - expected[self.known]
        return replace(
            found,
            p_straight=p_straight,
            models=tuple(
                replace(
                    self._model(fit, float(weight), dose),
                    agronomic=every.estimate(alone),
                    economic=paying.estimate(alone) if paying is not None else None,
                )
                for fit, weight, alone in zip(fits, weights, np.eye(len(fits)), strict=True)
            ),
            agronomic=agronomic,
            economic=economic,
            best=mixed.gain(best, best),
            gain=mixed.gain(begin, begin + step),
            gains=tuple(mixed.gain(at, min(at + step, highest)) for at in np.unique(self.dose)[:-1].tolist()),
            dose=self.lowest + self.span * dose,
            band_low=band[0],
            band_high=band[1],
            expected=expected,
            residual=residual,
        )

    def _expected(self, fit: ProfiledModel, scaled: FloatArray) -> FloatArray:
        """The curve with the other effects at each observation."""
        curve = fit.rise * fit.model.unit(fit.theta[None], scaled)[0]
        basis = np.linalg.svd(self.effects, full_matrices=False)[0][:, : fit.seen.rank]
        return np.asarray(curve + basis @ (basis.T @ (self.value - curve)))

    def _model(self, fit: ProfiledModel, weight: float, dose: FloatArray) -> FittedModel:
        squares, freedom = fit.seen.pure_error()
        lack = fit.freedom - freedom
        p = None
        if freedom > 0 and lack > 0 and squares > 0.0:
            ratio = max(fit.sum_squares - squares, 0.0) / lack / (squares / freedom)
            p = float(special.fdtrc(lack, freedom, ratio))
        aicc = _aicc(fit)
        total = fit.seen.squares
        return FittedModel(
            name=fit.model.name,
            weight=weight,
            aicc=aicc if np.isfinite(aicc) else None,
            sum_squares=fit.sum_squares,
            freedom=fit.freedom,
            sigma=float(np.sqrt(fit.variance)),
            r2=1.0 - fit.sum_squares / total if total > 0.0 else 0.0,
            lack_of_fit_p=p,
            coefficients=_coefficients(fit, self.lowest, self.span),
            agronomic=None,
            economic=None,
            fitted=fit.curve(dose),
        )


@dataclass(frozen=True)
class _Average:
    """Shapes with their weights, over doses from `lowest` on along `span`."""

    fits: Sequence[ProfiledModel]
    weights: FloatArray
    lowest: float
    span: float

    def gain(self, dose: float, until: float) -> Gain:
        """The yield at `until` less that at a dose; that at a dose if they are equal."""
        at = (dose - self.lowest) / self.span
        behind = (until - self.lowest) / self.span if until > dose else None
        ends = []
        for fit in self.fits:
            least, most = fit.value_range(at, behind)
            ends += [least, most]
        value = np.linspace(min(ends), max(ends), VALUE_STEPS)
        confidence = self._mean(lambda fit: fit.value_confidence(value, at, behind))
        mean = float(self.weights @ np.array([fit.value(at, behind) for fit in self.fits]))
        low, high = np.interp([1.0 - LIMIT_P, LIMIT_P], confidence, value).tolist()
        least = 1e-9 * float(np.sqrt(self.fits[0].variance))  # on a plateau nothing is gained
        return Gain(
            dose, until, *(each if abs(each) > least else 0.0 for each in (mean, min(low, mean), max(high, mean)))
        )

    def _mean(self, confidence: Callable[[ProfiledModel], FloatArray]) -> FloatArray:
        weights = _doubted(self.weights)
        parts = [weight * confidence(fit) for fit, weight in zip(self.fits, weights, strict=True) if weight > 0.0]
        return np.asarray(np.maximum.accumulate(sum(parts)))


def _doubted(weights: FloatArray) -> FloatArray:
    """Weights that the same data made, for intervals."""
    doubted = weights**DOUBT
    return np.asarray(doubted / doubted.sum())


class _Optima:
    """The optimum of each shape, and the confidence that it is at most a dose."""

    def __init__(self, fits: Sequence[ProfiledModel], ratio: float | None, lowest: float, span: float) -> None:
        scaled_ratio = ratio * span if ratio is not None else None
        self._dose = np.linspace(0.0, 1.0, DOSE_STEPS)
        self._value = np.array([fit.optimum(scaled_ratio) for fit in fits])
        self._confidence = np.array([fit.optimum_confidence(self._dose, scaled_ratio) for fit in fits])
        self._unseen = UNSEEN * float(fits[0].seen.doses[1])
        self._lowest = lowest
        self._span = span

    def estimate(self, weights: FloatArray) -> Estimate:
        """Averaged over the shapes (k,); at an end of the doses if more than half of the weight says so."""
        confidence = np.maximum.accumulate(_doubted(weights) @ self._confidence)
        value = float(weights @ self._value)
        for end in (0.0, 1.0):
            if float(weights[self._value == end].sum()) > 0.5:
                value = end
        low, high = np.interp([1.0 - LIMIT_P, LIMIT_P], confidence, self._dose).tolist()
        # a curve that levels off before the second dose may do so anywhere there
        low_open = bool(np.interp(self._unseen, self._dose, confidence) >= 1.0 - LIMIT_P)
        high_open = bool(confidence[-1] <= LIMIT_P)
        low = 0.0 if low_open else min(low, value)
        high = 1.0 if high_open else max(high, value)
        value, low, high = (self._lowest + self._span * each for each in (value, low, high))
        return Estimate(value, low, high, low_open, high_open)


def _fits(seen: Observations, only: ModelName | None) -> list[ProfiledModel]:
    """The shapes that the observations are enough for."""
    found = []
    for name in MODEL_NAMES if only is None else (only,):
        try:
            found.append(fit_model(name, seen))
        except ValueError:
            continue
    return found


def _aicc(fit: ProfiledModel) -> float:
    """Akaike's criterion of second order (Hurvich and Tsai 1989, Biometrika 76:297-307); infinite without one."""
    number = fit.seen.number
    parameters = number - fit.freedom + 1
    left = number - parameters - 1
    if left < 1:
        return np.inf
    squares = max(fit.sum_squares, 1e-300)
    return float(number * np.log(squares / number) + 2.0 * parameters * (1.0 + (parameters + 1.0) / left))


def _p_straight(fits: Sequence[ProfiledModel]) -> float | None:
    """Probability of as much better a curve where the response is a straight line (F, by Bonferroni).

    Few observations hold AICc back from curves that are beyond doubt: with six, a curve has to explain 99 % of what the
    line leaves.
    """
    line = next((fit for fit in fits if fit.model.name == "linear"), None)
    curved = [fit for fit in fits if fit.model.parameters == 1]
    if line is None or not curved:
        return None
    best = min(curved, key=lambda fit: fit.sum_squares)
    ratio = max(line.sum_squares - best.sum_squares, 0.0) / best.variance
    return min(1.0, len(curved) * float(special.fdtrc(1, best.freedom, ratio)))


def _weights(fits: Sequence[ProfiledModel], *, straight_ruled_out: bool) -> FloatArray:
    """Weights of Akaike."""
    criteria = np.array([_aicc(fit) for fit in fits])
    if straight_ruled_out:
        criteria[[fit.model.name == "linear" for fit in fits]] = np.inf
    if not np.isfinite(criteria).any():
        possible = [not (straight_ruled_out and fit.model.name == "linear") for fit in fits]
        simplest = max(fit.freedom for fit, kept in zip(fits, possible, strict=True) if kept)
        alike = [kept and fit.freedom == simplest for fit, kept in zip(fits, possible, strict=True)]
        squares = np.array([fit.seen.number * np.log(fit.variance) for fit in fits])
        criteria = np.where(alike, squares, np.inf)
    weights = np.exp(-0.5 * (criteria - criteria.min()))
    return np.asarray(weights / weights.sum())


def _coefficients(fit: ProfiledModel, lowest: float, span: float) -> dict[str, float]:
    """Of the shape in the units of dose and value."""
    theta = fit.theta
    rise = fit.rise
    lower = fit.seen.mean - rise * float(fit.nodes.mean[fit.at])
    match fit.model.name:
        case "linear":
            slope = rise / span
            return {"intercept": lower - slope * lowest, "linear": slope}
        case "quadratic":
            linear = rise * float(np.cos(theta[0])) / span
            square = rise * float(np.sin(theta[0])) / span**2
            intercept = lower - linear * lowest + square * lowest**2
            return {"intercept": intercept, "linear": linear - 2.0 * square * lowest, "quadratic": square}
        case "quadratic-plateau" | "linear-plateau":
            return {"lower": lower, "plateau": lower + rise, "join": lowest + span * float(np.exp(theta[0]))}
        case "mitscherlich":
            rate = float(np.exp(theta[0]))
            whole = rise / min(rate, 1.0)
            return {"lower": lower, "plateau": lower + whole, "rate": rate / span}
        case "logistic":
            gradient = float(np.exp(theta[0])) / span
            return {"lower": lower, "rise": rise, "gradient": gradient, "midpoint": lowest + span * float(theta[1])}
