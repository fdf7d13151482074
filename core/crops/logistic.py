"""The logistic response to a dose (Christiansen et al. 2017, equation 3), with profile-likelihood intervals.

height = lower + rise / (1 + exp(−gradient · (dose − midpoint))), with an offset for each block.

Lower, rise and the offsets are linear: for each gradient and midpoint they follow by least squares in closed form. So
the sum of squares is a function of two parameters, and is computed on a grid that is narrowed to the region of
S ≤ S_min · (1 + t²/ν) with t of Student's distribution (Bates and Watts 1988, Nonlinear regression analysis and its
applications, section 6.1). The extremes of a quantity in that region are its interval. Where the region reaches the end
of what the doses can show, the interval is open.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from furrowmap.core.runtime.arrays import FloatArray

IntArray = NDArray[np.intp]

NODES: Final = 90
"""Nodes of each axis of the grid while it is narrowed."""
FINE_NODES: Final = 240
"""The same of the last grid: the interval misses less than its 200th part."""
MAX_GRADIENT: Final = 20.0
"""Gradient times the least distance of two doses: steeper curves are steps between these."""
MIN_GRADIENT: Final = 0.3
"""Gradient times the range of doses: flatter curves are straight lines within it."""
BEYOND: Final = 1.5
"""The midpoint is searched up to this many ranges beyond the least and the highest dose."""
PLATEAU: Final = 0.95
"""Share of the rise beyond which nothing is said to be gained."""


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval; an end that the data leave open is infinite."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Logistic:
    """A logistic curve through n observations.

    Attributes:
        lower: asymptote towards low doses (mean of the blocks).
        rise: upper asymptote minus lower; negative where doses lower the crop.
        gradient: per unit of the dose.
        midpoint: dose at half the rise.
        plateau: dose at PLATEAU of the rise: beyond it nothing is gained.
        sigma, freedom: standard deviation and degrees of freedom of the residuals.
        r2: share of the variance within blocks that the curve explains.
        offsets: of each block, in the order of their labels; their mean is 0.
        dose: (m,) abscissae of the band, from the least dose to the highest.
        fitted, band_low, band_high: (m,) the curve and its pointwise 95 % confidence band.
    """

    lower: Estimate
    rise: Estimate
    gradient: Estimate
    midpoint: Estimate
    plateau: Estimate
    sigma: float
    freedom: int
    r2: float
    offsets: FloatArray
    dose: FloatArray
    fitted: FloatArray
    band_low: FloatArray
    band_high: FloatArray


@dataclass(frozen=True)
class Observations:
    """Sums of n observations by block and dose, which is all that the fit needs.

    Attributes:
        doses: (d,) distinct doses, ascending.
        count: (b, d) observations.
        total: (b, d) sum of their heights.
        squares: sum of the squared heights about the means of their blocks.
    """

    doses: FloatArray
    count: FloatArray
    total: FloatArray
    squares: float

    @classmethod
    def sum_up(cls, dose: FloatArray, height: FloatArray, block: IntArray) -> Observations:
        """The sums of observations (n,), with blocks numbered from 0 without gaps."""
        doses, index = np.unique(dose, return_inverse=True)
        shape = (int(block.max(initial=0)) + 1, len(doses))
        count, total = np.zeros(shape), np.zeros(shape)
        np.add.at(count, (block, index), 1.0)
        np.add.at(total, (block, index), height)
        means = total.sum(axis=1) / count.sum(axis=1)
        return cls(doses, count, total, float(((height - means[block]) ** 2).sum()))

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the residuals of a curve with an offset for each block."""
        return int(self.count.sum()) - len(self.count) - 3


@dataclass(frozen=True)
class _Nodes:
    """Least squares at nodes (k,) of gradient and midpoint."""

    gradient: FloatArray
    midpoint: FloatArray
    sum_squares: FloatArray  # of the residuals
    rise: FloatArray
    precision: FloatArray  # sum of squares of the curve of unit rise about the means of its blocks
    mean: FloatArray  # of that curve over the blocks
    lower: FloatArray


def fit_logistic(dose: FloatArray, height: FloatArray, block: IntArray) -> Logistic:
    """The curve by least squares, with 95 % intervals.

    Args:
        dose: (n,) of each observation.
        height: (n,) or any other quantity that responds.
        block: (n,) number of its block, from 0 without gaps; all 0 without blocks.

    Raises:
        ValueError: if there are fewer than four distinct doses, or fewer observations than parameters plus one.
    """
    seen = Observations.sum_up(dose, height, block)
    if len(seen.doses) < 4 or seen.freedom < 1:
        raise ValueError("a logistic curve needs four doses, and more observations than parameters")
    t = float(special.stdtrit(seen.freedom, 0.975))
    outer = _outer(seen.doses)
    box, limit = _narrowed(seen, outer, 1.0 + t * t / seen.freedom)
    kept, spread = _inside(_fit_nodes(seen, box, FINE_NODES), limit)
    at = int(np.argmin(kept.sum_squares))
    # whether nodes lie on the border of what the doses can show
    place, near = np.array([np.log(kept.gradient), kept.midpoint]), 1e-6 * np.diff(outer, axis=1)
    edge = np.any((place < outer[:, :1] + near) | (place > outer[:, 1:] - near), axis=0)
    weights = 1.0 / seen.count.sum(axis=1)
    one = float(weights.sum()) / len(weights) ** 2
    none = np.zeros(len(spread))
    reach = kept.midpoint + np.log(PLATEAU / (1.0 - PLATEAU)) / kept.gradient
    block_means = (seen.total * weights[:, None]).sum(axis=1)
    unit_means = seen.count @ special.expit(kept.gradient[at] * (seen.doses - kept.midpoint[at])) * weights
    x = np.linspace(seen.doses[0], seen.doses[-1], 61)
    best = kept.lower[at] + kept.rise[at] * special.expit(kept.gradient[at] * (x - kept.midpoint[at]))
    nodes, room = _inside(_fit_nodes(seen, box, NODES), limit)
    curve = special.expit(nodes.gradient[:, None] * (x - nodes.midpoint[:, None]))
    width = room[:, None] * np.sqrt(one + (nodes.mean[:, None] - curve) ** 2 / nodes.precision[:, None])
    curve = nodes.lower[:, None] + nodes.rise[:, None] * curve
    least = float(kept.sum_squares[at])
    return Logistic(
        lower=_estimate(kept.lower, spread * np.sqrt(one + kept.mean**2 / kept.precision), at, edge),
        rise=_estimate(kept.rise, spread / np.sqrt(kept.precision), at, edge),
        gradient=_estimate(kept.gradient, none, at, edge, least=0.0),
        midpoint=_estimate(kept.midpoint, none, at, edge),
        plateau=_estimate(reach, none, at, edge),
        sigma=float(np.sqrt(least / seen.freedom)),
        freedom=seen.freedom,
        r2=1.0 - least / seen.squares if seen.squares > 0.0 else 0.0,
        offsets=block_means - kept.rise[at] * unit_means - kept.lower[at],
        dose=x,
        fitted=best,
        band_low=np.minimum((curve - width).min(axis=0), best),
        band_high=np.maximum((curve + width).max(axis=0), best),
    )


def _inside(nodes: _Nodes, limit: float) -> tuple[_Nodes, FloatArray]:
    """The nodes up to a sum of squares, at least the best one, and the roots of what each is below it."""
    inside = nodes.sum_squares <= limit
    inside[np.argmin(nodes.sum_squares)] = True
    kept = _Nodes(*(getattr(nodes, name)[inside] for name in _Nodes.__dataclass_fields__))
    return kept, np.sqrt(np.maximum(limit - kept.sum_squares, 0.0))


def p_of_no_response(dose: FloatArray, height: FloatArray, block: IntArray, trials: int) -> float:
    """Probability of as good a curve where doses have no effect: heights are permuted within blocks.

    The distribution of F does not hold here, since without an effect gradient and midpoint have no meaning (Davies
    1987, Biometrika 74:33-43); permutation does. The random numbers are the same every time.
    """
    rng = np.random.default_rng(20170523)
    gradient, midpoint = _nodes(_outer(np.unique(dose)), 24)
    unit = special.expit(gradient[:, None] * (dose - midpoint[:, None]))
    members = [np.flatnonzero(block == k) for k in np.unique(block)]
    centred = height.astype(np.float64)
    for rows in members:
        unit[:, rows] -= unit[:, rows].mean(axis=1, keepdims=True)
        centred[rows] -= centred[rows].mean()
    length = np.sqrt((unit**2).sum(axis=1))
    unit = unit[length > 1e-9] / length[length > 1e-9, None]
    shuffled = np.tile(centred[:, None], (1, trials + 1))
    for rows in members:
        order = np.argsort(rng.random((len(rows), trials)), axis=0)
        shuffled[rows, 1:] = centred[rows][order]
    explained = (np.abs(unit @ shuffled)).max(axis=0)
    return float((explained >= explained[0] * (1.0 - 1e-9)).sum()) / (trials + 1)


def _outer(doses: FloatArray) -> FloatArray:
    """(2, 2) least and greatest logarithm of the gradient, and midpoint, that doses (d,) can show."""
    span, step = float(doses[-1] - doses[0]), float(np.diff(doses).min())
    gradients = [np.log(MIN_GRADIENT / span), np.log(MAX_GRADIENT / step)]
    return np.array([gradients, [doses[0] - BEYOND * span, doses[-1] + BEYOND * span]])


def _narrowed(seen: Observations, outer: FloatArray, factor: float) -> tuple[FloatArray, float]:
    """The box (2, 2) around the region of `factor` times the least sum of squares, a node at least, and that limit."""
    box, least = outer, np.inf
    for _ in range(12):
        nodes = _fit_nodes(seen, box, NODES)
        least = min(least, float(nodes.sum_squares.min()))
        inside = (nodes.sum_squares <= least * factor).reshape(NODES, NODES)
        inside.flat[np.argmin(nodes.sum_squares)] = True
        ends = [np.flatnonzero(inside.any(axis=1 - axis))[[0, -1]] for axis in (0, 1)]
        width = np.diff(box, axis=1)[:, 0]
        step = width / (NODES - 1)
        first, last = np.array(ends).T
        low = np.where(first == 0, box[:, 0] - 0.5 * width, box[:, 0] + (first - 2) * step)
        high = np.where(last == NODES - 1, box[:, 1] + 0.5 * width, box[:, 0] + (last + 2) * step)
        around = np.clip(np.column_stack([low, high]), outer[:, :1], outer[:, 1:])
        ratio = np.diff(around, axis=1)[:, 0] / width
        if ((ratio > 0.8) & (ratio <= 1.0)).all():
            break
        box = around
    return box, least * factor


def _nodes(box: FloatArray, number: int) -> tuple[FloatArray, FloatArray]:
    """Gradient and midpoint of the nodes of a grid in a box."""
    flattest, steepest, first, last = (float(end) for end in box.ravel())
    axes = np.exp(np.linspace(flattest, steepest, number)), np.linspace(first, last, number)
    gradient, midpoint = np.meshgrid(*axes, indexing="ij")
    return gradient.ravel(), midpoint.ravel()


def _fit_nodes(seen: Observations, box: FloatArray, number: int) -> _Nodes:
    gradient, midpoint = _nodes(box, number)
    unit = special.expit(gradient[:, None] * (seen.doses - midpoint[:, None]))
    per_block = seen.count.sum(axis=1)
    means = unit @ (seen.count.T / per_block)
    block_means = seen.total.sum(axis=1) / per_block
    precision = (unit**2) @ seen.count.sum(axis=0) - (means**2) @ per_block
    precision = np.maximum(precision, 1e-12 * per_block.sum())
    product = unit @ seen.total.sum(axis=0) - means @ (per_block * block_means)
    rise = product / precision
    mean = means.mean(axis=1)
    return _Nodes(
        gradient=gradient,
        midpoint=midpoint,
        sum_squares=np.maximum(seen.squares - product * rise, 0.0),
        rise=rise,
        precision=precision,
        mean=mean,
        lower=block_means.mean() - rise * mean,
    )


def _estimate(value: FloatArray, half: FloatArray, at: int, edge: NDArray[Any], least: float = -np.inf) -> Estimate:
    """The value at a node, and the extremes of value ± half over all nodes; open where a border has them."""
    low, high = value - half, value + half
    first, last = int(np.argmin(low)), int(np.argmax(high))
    return Estimate(
        float(value[at]), least if edge[first] else float(low[first]), np.inf if edge[last] else float(high[last])
    )
