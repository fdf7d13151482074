"""Doses of parcels, the response of a trial to them, and analysis of variance by treatment and block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from furrowmap.core.crops.logistic import PLATEAU, Logistic, fit_logistic, p_of_no_response
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.parcel import Parcel

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
    """The response of parcels, of which those without dose or value are left out.

    Args:
        dose: (n,) of each parcel; nan where unknown.
        value: (n,) of the quantity that responds, such as the mean height; nan where unknown.
        block: (n,) labels; parcels without one are a block of their own.
    """
    known = np.isfinite(dose) & np.isfinite(value)
    names = np.array(["" if name is None else name for name in (block or [""] * len(dose))], object)[known]
    labels = tuple(dict.fromkeys(str(name) for name in names))
    index = np.array([labels.index(str(name)) for name in names], np.intp)
    dose, value = dose[known], value[known]
    doses, p, curve, shown = len(np.unique(dose)), None, None, False
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
        highest, reach = float(dose.max()), curve.plateau
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
    """A source of variance.

    Attributes:
        source: "treatment", "block" or "residual".
        freedom: degrees of freedom.
        sum_squares: adjusted for the other source (type II).
        f: ratio of mean squares; None for the residual.
        p: probability of so great an F without an effect; None for the residual.
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
    """Ordinary least squares of value (n,) on treatment and block, without interaction; None if nothing is left over.

    Raises:
        InputError: if statsmodels is not installed.
    """
    try:
        import pandas as pd
        from statsmodels.formula.api import ols
        from statsmodels.stats.anova import anova_lm
    except ImportError:
        raise InputError("extra-missing.analysis-of-variance") from None
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
    sigma, t = float(np.sqrt(model.mse_resid)), float(special.stdtrit(model.df_resid, 0.975))
    means = []
    for name in names:
        own = value[np.array([each == name for each in treatment])]
        half = t * sigma / len(own) ** 0.5
        means.append(
            TreatmentMean(name, len(own), float(own.mean()), float(own.mean()) - half, float(own.mean()) + half)
        )
    return Variance(rows, tuple(means))
