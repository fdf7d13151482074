"""Shapes of the response to a dose: each is lower + rise · unit(dose; θ), with none, one or two parameters θ.

Doses are scaled, so that the least dose of a trial is 0 and the highest 1. Given θ, lower and rise are linear, and the
dose that pays grows with rise; fits and intervals follow from nodes of θ alone (:mod:`response_profile`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from scipy import special

from furrowmap.core.runtime.arrays import FloatArray

ModelName = Literal["linear", "quadratic", "quadratic-plateau", "linear-plateau", "mitscherlich", "logistic"]
MODEL_NAMES: Final[tuple[ModelName, ...]] = (
    "linear",
    "quadratic",
    "quadratic-plateau",
    "linear-plateau",
    "mitscherlich",
    "logistic",
)
PLATEAU: Final = 0.95
"""Share of the rise of a curve without a highest point beyond which nothing is said to be gained."""
STEEPEST_CURVE: Final = 50.0
"""A curve that levels off within this part of the least step of doses cannot be told from a step."""
FLATTEST_CURVE: Final = 50.0
"""A curve that levels off at this multiple of the range of doses cannot be told from a straight line."""
MAX_GRADIENT: Final = 20.0
"""Gradient of a logistic curve times the least step of doses."""
MIN_GRADIENT: Final = 0.3
"""The same times the range of doses: flatter curves are straight lines within it."""
BEYOND: Final = 1.5
"""The midpoint of a logistic curve is searched up to this many ranges beyond the least and the highest dose."""
CHORDS: Final = 61
"""Doses at which the chord of a curve is looked for."""


@dataclass(frozen=True)
class ResponseModel:
    """A shape of the response.

    Attributes:
        parameters: number of parameters θ.
        unit: the curve (k, m) of θ (k, p) at scaled doses (m,).
        slope: derivative (k, m) of its concave envelope from each dose on: the highest of rise · unit − ratio · dose is
            at a dose d where rise · slope(d) falls to the ratio.
        best: (k,) scaled dose of the highest yield or, without one, of PLATEAU of the rise above dose 0; infinite for
            none.
        box: ends (p, 2) of the search from the distinct scaled doses (d,).
        rising: whether rise is at least zero, because a θ has the other sign.
    """

    name: ModelName
    parameters: int
    unit: Callable[[FloatArray, FloatArray], FloatArray]
    slope: Callable[[FloatArray, FloatArray], FloatArray]
    best: Callable[[FloatArray], FloatArray]
    box: Callable[[FloatArray], FloatArray]
    rising: bool = False


def _line(theta: FloatArray, dose: FloatArray) -> FloatArray:
    return np.broadcast_to(dose, (len(theta), len(dose)))


def _line_slope(theta: FloatArray, dose: FloatArray) -> FloatArray:
    return np.ones((len(theta), len(dose)))


def _parabola(theta: FloatArray, dose: FloatArray) -> FloatArray:
    return np.cos(theta) * dose + np.sin(theta) * dose**2


def _parabola_slope(theta: FloatArray, dose: FloatArray) -> FloatArray:
    concave = np.sin(theta) < 0.0
    return np.where(concave, np.cos(theta) + 2.0 * np.sin(theta) * dose, np.cos(theta) + np.sin(theta))


def _parabola_best(theta: FloatArray) -> FloatArray:
    across = np.cos(theta[:, 0])
    up = np.sin(theta[:, 0])
    with np.errstate(divide="ignore"):
        vertex = np.maximum(-across / (2.0 * up), 0.0)
    return np.where(up < 0.0, vertex, np.where(across + up > 0.0, np.inf, 0.0))


def _quadratic_plateau(theta: FloatArray, dose: FloatArray) -> FloatArray:
    part = np.minimum(dose / np.exp(theta), 1.0)
    return part * (2.0 - part)


def _quadratic_plateau_slope(theta: FloatArray, dose: FloatArray) -> FloatArray:
    end = np.exp(theta)
    return 2.0 * np.maximum(1.0 - dose / end, 0.0) / end


def _linear_plateau(theta: FloatArray, dose: FloatArray) -> FloatArray:
    return np.minimum(dose / np.exp(theta), 1.0)


def _linear_plateau_slope(theta: FloatArray, dose: FloatArray) -> FloatArray:
    end = np.exp(theta)
    return np.where(dose < end, 1.0 / end, 0.0)


def _join(theta: FloatArray) -> FloatArray:
    return np.exp(theta[:, 0])


def _linear_join(theta: FloatArray) -> FloatArray:
    return np.where(theta[:, 0] >= 0.0, np.inf, np.exp(theta[:, 0]))


def _mitscherlich(theta: FloatArray, dose: FloatArray) -> FloatArray:
    rate = np.exp(theta)
    return -np.expm1(-rate * dose) / np.minimum(rate, 1.0)


def _mitscherlich_slope(theta: FloatArray, dose: FloatArray) -> FloatArray:
    rate = np.exp(theta)
    return rate * np.exp(-rate * dose) / np.minimum(rate, 1.0)


def _mitscherlich_best(theta: FloatArray) -> FloatArray:
    return np.asarray(-np.log(1.0 - PLATEAU) / np.exp(theta[:, 0]))


def _logistic(theta: FloatArray, dose: FloatArray) -> FloatArray:
    return np.asarray(special.expit(np.exp(theta[:, :1]) * (dose - theta[:, 1:])))


def _logistic_slope(theta: FloatArray, dose: FloatArray) -> FloatArray:
    """Where the curve is convex a chord from the least dose has more: its end is where it touches the curve."""
    gradient = np.exp(theta[:, :1])
    own = special.expit(gradient * (dose - theta[:, 1:]))
    own *= gradient * (1.0 - own)
    convex = theta[:, 1] > 0.0
    at = np.linspace(0.0, 1.0, CHORDS)
    value = special.expit(gradient[convex] * (at - theta[convex, 1:]))
    chord = (value[:, 1:] - value[:, :1]) / at[1:]
    touching = np.argmax(chord, axis=1)
    steepest = chord[np.arange(len(chord)), touching][:, None]
    own[convex] = np.where(dose < at[1:][touching][:, None], steepest, np.minimum(own[convex], steepest))
    return own


def _logistic_best(theta: FloatArray) -> FloatArray:
    gradient = np.exp(theta[:, 0])
    left = (1.0 - PLATEAU) * special.expit(gradient * theta[:, 1])
    return np.asarray(theta[:, 1] + special.logit(1.0 - left) / gradient)


def _no_box(_dose: FloatArray) -> FloatArray:
    return np.zeros((0, 2))


def _circle(_dose: FloatArray) -> FloatArray:
    return np.array([[-np.pi, np.pi]])


def _joins(dose: FloatArray) -> FloatArray:
    return np.array([[np.log(dose[1] / STEEPEST_CURVE), np.log(FLATTEST_CURVE)]])


def _joins_within(dose: FloatArray) -> FloatArray:
    return np.array([[np.log(dose[1] / STEEPEST_CURVE), 0.0]])


def _rates(dose: FloatArray) -> FloatArray:
    return np.array([[-np.log(FLATTEST_CURVE), np.log(STEEPEST_CURVE / dose[1])]])


def _logistic_box(dose: FloatArray) -> FloatArray:
    steepest = np.log(MAX_GRADIENT / np.diff(dose).min())
    return np.array([[np.log(MIN_GRADIENT), steepest], [-BEYOND, 1.0 + BEYOND]])


MODELS: Final[dict[ModelName, ResponseModel]] = {
    each.name: each
    for each in (
        ResponseModel("linear", 0, _line, _line_slope, lambda theta: np.full(len(theta), np.inf), _no_box),
        ResponseModel("quadratic", 1, _parabola, _parabola_slope, _parabola_best, _circle, rising=True),
        ResponseModel("quadratic-plateau", 1, _quadratic_plateau, _quadratic_plateau_slope, _join, _joins),
        ResponseModel("linear-plateau", 1, _linear_plateau, _linear_plateau_slope, _linear_join, _joins_within),
        ResponseModel("mitscherlich", 1, _mitscherlich, _mitscherlich_slope, _mitscherlich_best, _rates),
        ResponseModel("logistic", 2, _logistic, _logistic_slope, _logistic_best, _logistic_box),
    )
}
