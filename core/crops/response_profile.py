"""Least squares and profile likelihood of a shape of the response, with blocks and other effects beside the dose.

Lower, rise and the other effects are linear, so the sum of squares S is a function of the parameters θ of the shape
alone. S is computed at nodes of a grid of θ, which is narrowed to the region of S ≤ S_min · (1 + t² / ν), with t of
Student's distribution and ν degrees of freedom (profile likelihood; Bates and Watts 1988, section 6.1).
"""

from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from scipy import special

from furrowmap.core.crops.response_models import MODELS, ModelName, ResponseModel
from furrowmap.core.runtime.arrays import FloatArray

PROFILE_NODES: Final[dict[int, int]] = {0: 1, 1: 400, 2: 44}
"""Nodes of each axis of the grid, by the number of parameters θ."""
FINE_NODES: Final[dict[int, int]] = {0: 1, 1: 13, 2: 7}
FINE_ROUNDS: Final = 6
"""Finer grids around the best node."""
TAIL: Final = 1e-3
"""Probability of each tail outside the grid."""
NARROWING_ROUNDS: Final = 6
MAX_SQUARE: Final = 1e200
"""Bound of quotients where nothing is left over."""
DOSE_STEPS: Final = 241
"""Doses at which the confidence of an optimum is computed."""
VALUE_STEPS: Final = 201
"""Values at which that of a yield is."""


@dataclass(frozen=True)
class Observations:
    """What the fit needs of n observations, with p columns of other effects: blocks, factors, a covariate.

    Attributes:
        doses: (d,) distinct scaled doses, ascending, from 0 to 1.
        count: (d,) observations of each.
        crossed: (r, d) their sums by an orthonormal basis of the other effects.
        total: (d,) sums of the residuals of those effects.
        squares: sum of squares of the residuals.
        number: n.
        rank: r of the other effects; the mean among them.
        mean: of the observations as the other effects have it on average.
        mean_dose: (d,) share of each dose in it.
        mean_variance: of it, in units of σ².
    """

    doses: FloatArray
    count: FloatArray
    crossed: FloatArray
    total: FloatArray
    squares: float
    number: int
    rank: int
    mean: float
    mean_dose: FloatArray
    mean_variance: float

    @classmethod
    def sum_up(cls, dose: FloatArray, value: FloatArray, effects: FloatArray) -> "Observations":
        """The sums of values (n,) at scaled doses (n,) with effects (n, p), whose space has the mean in it."""
        doses, index = np.unique(dose, return_inverse=True)
        left, singular, right = np.linalg.svd(effects, full_matrices=False)
        rank = int((singular > 1e-10 * singular[0] * max(effects.shape)).sum())
        basis = left[:, :rank]
        rest = value - basis @ (basis.T @ value)
        rest -= basis @ (basis.T @ rest)
        crossed = np.zeros((rank, len(doses)))
        for k in range(rank):
            crossed[k] = np.bincount(index, basis[:, k], len(doses))
        # the mean of the fitted effects as a linear function of the observations: weights in the basis
        weights = (right[:rank] @ effects.mean(axis=0)) / singular[:rank]
        return cls(
            doses=doses,
            count=np.bincount(index).astype(np.float64),
            crossed=crossed,
            total=np.bincount(index, rest, len(doses)).astype(np.float64),
            squares=float(rest @ rest),
            number=len(value),
            rank=rank,
            mean=float(weights @ (basis.T @ value)),
            mean_dose=weights @ crossed,
            mean_variance=float(weights @ weights),
        )

    def freedom(self, model: ResponseModel) -> int:
        """Degrees of freedom of the residuals."""
        return self.number - self.rank - 1 - model.parameters

    def pure_error(self) -> tuple[float, int]:
        """Sum of squares, and degrees of freedom, of each dose with a mean of its own beside the other effects."""
        cross = np.diag(self.count) - self.crossed.T @ self.crossed
        value, vector = np.linalg.eigh(cross)
        kept = value > 1e-9 * max(float(value[-1]), 1e-300)
        explained = float(((vector[:, kept].T @ self.total) ** 2 / value[kept]).sum())
        return max(self.squares - explained, 0.0), self.number - self.rank - int(kept.sum())


@dataclass(frozen=True)
class ResponseNodes:
    """Least squares at nodes (k,) of θ.

    `theta` (k, p); `mean` is the unit curve's over the observations; `precision` the inverse variance of rise in units
    of σ².
    """

    theta: FloatArray
    sum_squares: FloatArray
    rise: FloatArray
    precision: FloatArray
    mean: FloatArray


@dataclass(frozen=True)
class ProfiledModel:
    """A shape through observations, and what is as likely.

    Attributes:
        nodes: of θ, as far as they are likely at all.
        at: the number of the best one.
        sum_squares, freedom: of its residuals.
    """

    model: ResponseModel
    seen: Observations
    nodes: ResponseNodes
    at: int
    sum_squares: float
    freedom: int

    @property
    def variance(self) -> float:
        """σ² of the residuals."""
        return max(self.sum_squares / self.freedom, 1.0 / MAX_SQUARE)

    @property
    def theta(self) -> FloatArray:
        """(p,) of the best node."""
        return np.asarray(self.nodes.theta[self.at])

    @property
    def rise(self) -> float:
        """Of the best node."""
        return float(self.nodes.rise[self.at])

    def curve(self, dose: FloatArray) -> FloatArray:
        """The fitted values (m,) at scaled doses (m,), as the other effects are on average."""
        return np.asarray(self._values(dose)[self.at])

    def _values(self, dose: FloatArray) -> FloatArray:
        unit = self.model.unit(self.nodes.theta, dose) - self.nodes.mean[:, None]
        return np.asarray(self.seen.mean + self.nodes.rise[:, None] * unit)

    def band(self, dose: FloatArray, t: float) -> tuple[FloatArray, FloatArray]:
        """The least and highest likely values (m,) at scaled doses (m,)."""
        limit = self.sum_squares * (1.0 + t * t / self.freedom)
        inside = self.nodes.sum_squares <= limit
        inside[self.at] = True
        room = np.sqrt(np.maximum(limit - self.nodes.sum_squares[inside], 0.0))
        unit = self.model.unit(self.nodes.theta[inside], dose) - self.nodes.mean[inside, None]
        value = self.seen.mean + self.nodes.rise[inside, None] * unit
        width = room[:, None] * np.sqrt(self.seen.mean_variance + unit**2 / self.nodes.precision[inside, None])
        best = self.curve(dose)
        return np.minimum((value - width).min(axis=0), best), np.maximum((value + width).max(axis=0), best)

    def optimum(self, ratio: float | None) -> float:
        """The scaled dose, 0 to 1, that pays at a ratio of prices; that of the highest yield without one."""
        theta = self.theta[None]
        if self.rise <= 0.0:
            return 0.0
        if ratio is None:
            return float(np.clip(self.model.best(theta)[0], 0.0, 1.0))
        low = 0.0
        high = 1.0
        if self.rise * self.model.slope(theta, np.ones(1))[0, 0] > ratio:
            return 1.0
        for _ in range(50):
            middle = 0.5 * (low + high)
            pays = self.rise * self.model.slope(theta, np.array([middle]))[0, 0] > ratio
            low, high = (middle, high) if pays else (low, middle)
        return high if high > 1e-9 else 0.0

    def optimum_confidence(self, dose: FloatArray, ratio: float | None) -> FloatArray:
        """Confidence (m,) that the optimum is at most each scaled dose (m,), ascending from 0 to 1.

        At the last dose it is that the optimum is not beyond it. For each θ the optimum grows with rise: the rise
        at which it is at a dose gives the least sum of squares of optima on the other side of it.
        """
        nodes = self.nodes
        precision = nodes.precision[:, None]
        if ratio is None:
            never = self.model.best(nodes.theta)[:, None] > dose
            threshold = np.where(never, 0.0, np.inf)
        else:
            slope = self.model.slope(nodes.theta, dose)
            with np.errstate(divide="ignore"):
                threshold = np.where(slope > 0.0, ratio / np.maximum(slope, 0.0), np.inf)
        below = np.maximum(nodes.rise[:, None] - threshold, 0.0)
        above = np.maximum(threshold - nodes.rise[:, None], 0.0)
        at_most = (nodes.sum_squares[:, None] + precision * below**2).min(axis=0)
        at_least = (nodes.sum_squares[:, None] + precision * above**2).min(axis=0)
        t_low = np.sqrt(np.maximum(at_most - self.sum_squares, 0.0) / self.variance)
        t_high = np.sqrt(np.maximum(at_least - self.sum_squares, 0.0) / self.variance)
        return np.asarray(special.stdtr(self.freedom, np.where(t_low > 0.0, -t_low, t_high)))

    def value(self, dose: float, behind: float | None = None) -> float:
        """The yield at a scaled dose; with `behind` that there less that at the dose."""
        return float(self._moments(dose, behind)[0][self.at])

    def value_range(self, dose: float, behind: float | None = None) -> tuple[float, float]:
        """Values between which nearly all of its confidence is."""
        estimate, variance = self._moments(dose, behind)
        t = float(special.stdtrit(self.freedom, 1.0 - TAIL))
        limit = self.sum_squares * (1.0 + t * t / self.freedom)
        width = np.sqrt(np.maximum(limit - self.nodes.sum_squares, 0.0) * variance)
        return float((estimate - width).min()), float((estimate + width).max())

    def value_confidence(self, value: FloatArray, dose: float, behind: float | None = None) -> FloatArray:
        """Confidence (m,) that the yield at a scaled dose is at most each value (m,).

        With `behind` that of the yield there less that at the dose.
        """
        estimate, variance = self._moments(dose, behind)
        off = (value - estimate[:, None]) ** 2 / np.maximum(variance[:, None], 1.0 / MAX_SQUARE)
        least = (self.nodes.sum_squares[:, None] + off).min(axis=0)
        t = np.sqrt(np.minimum(np.maximum(least - self.sum_squares, 0.0) / self.variance, MAX_SQUARE))
        return np.asarray(special.stdtr(self.freedom, np.where(value < estimate[self.at], -t, t)))

    def _moments(self, dose: float, behind: float | None) -> tuple[FloatArray, FloatArray]:
        """For each node a yield (k,), or what one is more than another, and its variance (k,) in units of σ²."""
        nodes = self.nodes
        unit = self.model.unit(nodes.theta, np.array([dose]))[:, 0]
        if behind is None:
            beside = unit - nodes.mean
            return self.seen.mean + nodes.rise * beside, self.seen.mean_variance + beside**2 / nodes.precision
        gained = self.model.unit(nodes.theta, np.array([behind]))[:, 0] - unit
        return nodes.rise * gained, np.maximum(gained**2 / nodes.precision, 1e-300)


def fit_model(name: ModelName, seen: Observations) -> ProfiledModel:
    """A shape by least squares; ValueError for fewer doses than it has parameters, or nothing left over."""
    model = MODELS[name]
    freedom = seen.freedom(model)
    if len(seen.doses) < model.parameters + 2 or freedom < 1:
        raise ValueError(f"{name} needs {model.parameters + 2} doses, and more observations than parameters")
    box = model.box(seen.doses)
    if name == "quadratic":
        box = box + _direction(seen)
    outer = box
    factor = 1.0 + float(special.stdtrit(freedom, 1.0 - TAIL)) ** 2 / freedom
    number = PROFILE_NODES[model.parameters]
    nodes = _nodes_of(model, seen, _grid(box, number))
    for _ in range(NARROWING_ROUNDS if model.parameters else 0):
        narrowed = _around_likely(nodes, box, outer, number, factor)
        shrunk = np.diff(narrowed, axis=1)[:, 0] < 0.8 * np.diff(box, axis=1)[:, 0]
        box = narrowed
        nodes = _nodes_of(model, seen, _grid(box, number))
        if not shrunk.any():
            break
    nodes = _with_best(model, seen, nodes, box, number)
    likely = nodes.sum_squares <= factor * nodes.sum_squares.min()
    nodes = ResponseNodes(*(getattr(nodes, each.name)[likely] for each in fields(ResponseNodes)))
    at = int(np.argmin(nodes.sum_squares))
    return ProfiledModel(model, seen, nodes, at, float(nodes.sum_squares[at]), freedom)


def _direction(seen: Observations) -> float:
    """The angle of the best parabola."""
    basis = np.column_stack([seen.doses, seen.doses**2])
    inner = basis.T @ (np.diag(seen.count) - seen.crossed.T @ seen.crossed) @ basis
    across, up = np.linalg.lstsq(inner, basis.T @ seen.total)[0]
    return float(np.arctan2(up, across))


def _grid(box: FloatArray, number: int) -> FloatArray:
    axes = [np.linspace(low, high, number) for low, high in box]
    if not axes:
        return np.zeros((1, 0))
    return np.column_stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")])


def _nodes_of(model: ResponseModel, seen: Observations, theta: FloatArray) -> ResponseNodes:
    unit = model.unit(theta, seen.doses)
    crossed = unit @ seen.crossed.T
    whole = (unit**2) @ seen.count
    precision = np.maximum(whole - (crossed**2).sum(axis=1), 1e-12 * np.maximum(whole, 1e-12))
    product = unit @ seen.total
    rise = np.maximum(product / precision, 0.0) if model.rising else product / precision
    squares = np.maximum(seen.squares - product * rise, 1e-14 * seen.squares)
    return ResponseNodes(theta, squares, rise, precision, unit @ seen.mean_dose)


def _around_likely(nodes: ResponseNodes, box: FloatArray, outer: FloatArray, number: int, factor: float) -> FloatArray:
    """The box of the likely nodes, and two more on each side."""
    likely = nodes.theta[nodes.sum_squares <= factor * nodes.sum_squares.min()]
    step = np.diff(box, axis=1)[:, 0] / (number - 1)
    around = np.column_stack([likely.min(axis=0) - 2.0 * step, likely.max(axis=0) + 2.0 * step])
    return np.asarray(np.clip(around, outer[:, :1], outer[:, 1:]))


def _with_best(
    model: ResponseModel, seen: Observations, nodes: ResponseNodes, box: FloatArray, number: int
) -> ResponseNodes:
    """The nodes, and finer ones around the best."""
    centre = nodes.theta[np.argmin(nodes.sum_squares)]
    step = np.diff(box, axis=1)[:, 0] / (number - 1)
    found = [nodes]
    fine_number = FINE_NODES[model.parameters]
    for _ in range(FINE_ROUNDS if model.parameters else 0):
        fine = _nodes_of(model, seen, _grid(np.column_stack([centre - step, centre + step]), fine_number))
        found.append(fine)
        centre = fine.theta[np.argmin(fine.sum_squares)]
        step = 2.0 * step / (fine_number - 1)
    return ResponseNodes(*(np.concatenate([getattr(each, name.name) for each in found]) for name in fields(nodes)))
