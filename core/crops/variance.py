"""Analysis of variance of a trial by treatment and block, by statsmodels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from furrowmap.core.runtime.errors import InputError

FloatArray = NDArray[np.float64]


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
    """A treatment.

    Attributes:
        mean: of the parcels.
        low, high: 95 % interval of the mean, with the residual variance of the whole trial.
    """

    treatment: str
    parcels: int
    mean: float
    low: float
    high: float


@dataclass(frozen=True)
class Variance:
    """An analysis of variance.

    Attributes:
        rows: the sources.
        means: of the treatments, in the order of their first parcels.
    """

    rows: tuple[VarianceRow, ...]
    means: tuple[TreatmentMean, ...]


def analysis_of_variance(
    value: FloatArray, treatment: Sequence[str], block: Sequence[str] | None = None
) -> Variance | None:
    """Ordinary least squares of value (n,) on treatment and block, without interaction; None if nothing is left over.

    Args:
        value: (n,) of each parcel.
        treatment: (n,) its treatment.
        block: (n,) its block.

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
