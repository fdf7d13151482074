"""Doses of parcels, the response curve of a trial, and analysis of variance by treatment and block."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.parcel import Parcel

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
    """Sums of observations (b, d) by block and dose (d,), ascending, which is all that the fit needs."""

    doses: FloatArray
    count: FloatArray
    total: FloatArray
    squares: float

    @classmethod
    def sum_up(cls, dose: FloatArray, height: FloatArray, block: IntArray) -> "Observations":
        """The sums of observations (n,), with blocks numbered from 0 without gaps."""
        doses, index = np.unique(dose, return_inverse=True)
        shape = (int(block.max(initial=0)) + 1, len(doses))
        count = np.zeros(shape)
        total = np.zeros(shape)
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
    """The curve by least squares through heights (n,) over doses (n,), with 95 % intervals.

    `block` (n,) is the number of its block, from 0 without gaps. Raises ValueError if there are fewer than four
    distinct doses, or fewer observations than parameters plus one.
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
    place = np.array([np.log(kept.gradient), kept.midpoint])
    near = 1e-6 * np.diff(outer, axis=1)
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
    span = float(doses[-1] - doses[0])
    step = float(np.diff(doses).min())
    gradients = [np.log(MIN_GRADIENT / span), np.log(MAX_GRADIENT / step)]
    return np.array([gradients, [doses[0] - BEYOND * span, doses[-1] + BEYOND * span]])


def _narrowed(seen: Observations, outer: FloatArray, factor: float) -> tuple[FloatArray, float]:
    """The box (2, 2) around the region of `factor` times the least sum of squares, a node at least, and that limit."""
    box = outer
    least = np.inf
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
    low = value - half
    high = value + half
    first = int(np.argmin(low))
    last = int(np.argmax(high))
    return Estimate(
        float(value[at]), least if edge[first] else float(low[first]), np.inf if edge[last] else float(high[last])
    )


MAX_P: Final = 0.05
"""Significance level of a curve."""
MIN_DOSES: Final = 4
DOSE_WORDS: Final = ("n_kg_ha", "dose", "rate", "kg_ha")
"""What the names of columns with doses contain, the first that is found."""
_COLUMN_UNITS: Final = {"kg_ha": "kg/ha", "m": "m", "m2": "m²", "m3": "m³"}
_NUTRIENTS: Final = {"n": "nitrogen", "p": "phosphorus", "k": "potassium"}
TRIALS: Final = 1999
"""Permutations: the least probability is 1 in 2000."""


def dose_name(parcels: Sequence[Parcel], stated: str | None = None) -> str | None:
    """The attribute that is the dose: as stated, else the first so named. Raises InputError for no such number."""
    numbers = dict.fromkeys(
        name for each in parcels for name, value in each.attributes.items() if isinstance(value, float)
    )
    if stated is not None:
        found = next((name for name in numbers if name.casefold() == stated.casefold()), None)
        if found is None:
            raise InputError("dose-unknown", stated=stated, numbers=", ".join(numbers) or "none")
        return found
    return next((name for word in DOSE_WORDS for name in numbers if word in name.casefold()), None)


def parcel_doses(parcels: Sequence[Parcel], name: str) -> NDArray[np.float64]:
    """The dose of each parcel (n,); nan where it is not known."""
    values = [each.attributes.get(name) for each in parcels]
    return np.array([value if isinstance(value, float) else np.nan for value in values])


def dose_unit(name: str | None) -> str:
    """The unit that a name ends with; "" where it says none."""
    return "kg/ha" if name is not None and name.casefold().endswith("kg_ha") else ""


def column_words(name: str) -> str:
    """The name of a column for people, with its unit: "nitrogen (kg/ha)" for `n_kg_ha`."""
    for suffix, unit in _COLUMN_UNITS.items():
        if name.casefold().endswith(f"_{suffix}"):
            words = name[: -len(suffix) - 1].replace("_", " ")
            return f"{_NUTRIENTS.get(words.casefold(), words)} ({unit})"
    return name.replace("_", " ")


@dataclass(frozen=True)
class Response:
    """The response of a quantity to a dose.

    Attributes:
        blocks: labels of the blocks; one without blocks.
        p: probability of as good a curve where the dose has no effect; None where no curve can be fitted.
        curve: None where the data hold none.
        plateau_shown: whether the interval of the rate beyond which nothing is gained ends within the doses.
        words: what the data show, in a sentence.
    """

    parcels: int
    doses: int
    blocks: tuple[str, ...]
    p: float | None
    curve: Logistic | None
    plateau_shown: bool
    words: str


def fit_response(
    dose: FloatArray, value: FloatArray, block: Sequence[str | None] | None = None, unit: str = ""
) -> Response:
    """The response of a value (n,) of parcels to their dose (n,); those without either (nan) are left out.

    `block` (n,) are labels; parcels without one are a block of their own.
    """
    known = np.isfinite(dose) & np.isfinite(value)
    names = np.array(["" if name is None else name for name in (block or [""] * len(dose))], object)[known]
    labels = tuple(dict.fromkeys(str(name) for name in names))
    index = np.array([labels.index(str(name)) for name in names], np.intp)
    dose = dose[known]
    value = value[known]
    doses = len(np.unique(dose))
    p = None
    curve = None
    shown = False
    gap = f" {unit}" if unit else ""
    if doses >= MIN_DOSES and len(dose) - len(labels) - 3 >= 1:
        p = p_of_no_response(dose, value, index, TRIALS)
    if p is None:
        words = (
            f"{len(dose)} parcels with {doses} different doses: a logistic curve needs {MIN_DOSES} doses, and more "
            "parcels than parameters."
        )
    elif p > MAX_P:
        words = (
            "The data hold no curve: heights without any effect of the dose would give as good a one in "
            f"{100 * p:.0f} % of trials."
        )
    else:
        curve = fit_logistic(dose, value, index)
        highest = float(dose.max())
        reach = curve.plateau
        shown = reach.high <= highest
        if shown:
            words = (
                f"Beyond {reach.value:.0f}{gap} (95 %: {reach.low:.0f} to {reach.high:.0f}) nothing is gained: "
                f"{100 * PLATEAU:.0f} % of the rise is reached."
            )
        elif reach.low > highest:
            words = f"The response does not level off up to the highest dose, {highest:.0f}{gap}."
        else:
            words = (
                "The doses do not show the rate beyond which nothing is gained: it is at least "
                f"{max(reach.low, 0.0):.0f}{gap} (95 %), and may be above the highest dose, {highest:.0f}{gap}."
            )
    return Response(len(dose), doses, labels, p, curve, plateau_shown=shown, words=words)


@dataclass(frozen=True)
class VarianceRow:
    """A source of variance: "treatment", "block" or "residual"; the latter without F and its probability.

    The sum of squares is adjusted for the other source (type II).
    """

    source: str
    freedom: int
    sum_squares: float
    f: float | None
    p: float | None


@dataclass(frozen=True)
class TreatmentMean:
    """A treatment; its 95 % interval is with the residual variance of the whole trial."""

    treatment: str
    parcels: int
    mean: float
    low: float
    high: float


@dataclass(frozen=True)
class Variance:
    """An analysis of variance; the means are in the order of the treatments' first parcels."""

    rows: tuple[VarianceRow, ...]
    means: tuple[TreatmentMean, ...]


def analysis_of_variance(
    value: FloatArray, treatment: Sequence[str], block: Sequence[str] | None = None
) -> Variance | None:
    """Least squares of value (n,) on treatment and block; None if nothing is left over.

    Without interaction. Raises InputError if statsmodels is not installed.
    """
    try:
        import pandas as pd
        from statsmodels.formula.api import ols
        from statsmodels.stats.anova import anova_lm
    except ImportError:
        raise InputError("extra-missing.statsmodels") from None
    names = list(dict.fromkeys(treatment))
    blocked = block is not None and len(set(block)) > 1
    table = pd.DataFrame({"value": value, "treatment": list(treatment), "block": list(block or [""] * len(value))})
    if len(names) < 2 or len(value) - len(names) - (len(set(table["block"])) - 1) < 1 or np.ptp(value) == 0.0:
        return None
    model: Any = ols("value ~ C(treatment) + C(block)" if blocked else "value ~ C(treatment)", table).fit()
    found = anova_lm(model, typ=2)
    rows = tuple(
        VarianceRow(
            source.removeprefix("C(").removesuffix(")").lower(),
            round(float(row["df"])),
            float(row["sum_sq"]),
            None if np.isnan(row["F"]) else float(row["F"]),
            None if np.isnan(row["PR(>F)"]) else float(row["PR(>F)"]),
        )
        for source, row in found.iterrows()
    )
    sigma = float(np.sqrt(model.mse_resid))
    t = float(special.stdtrit(model.df_resid, 0.975))
    means = []
    for name in names:
        own = value[np.array([each == name for each in treatment])]
        half = t * sigma / len(own) ** 0.5
        means.append(
            TreatmentMean(name, len(own), float(own.mean()), float(own.mean()) - half, float(own.mean()) + half)
        )
    return Variance(rows, tuple(means))
