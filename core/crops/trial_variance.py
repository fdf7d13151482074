"""Analysis of variance of a trial by statsmodels: factors, blocks and a covariate; adjusted means with letters."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations, product
from typing import Any, Final

import numpy as np
from scipy import special, stats

from furrowmap.core.crops.confounding import Confounding, confounded_terms, factor_columns, interaction_columns
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import MissingExtraError
from furrowmap.core.runtime.languages.texts import Text

SIGNIFICANT_P: Final = 0.05
"""Of a difference: means that share a letter do not differ at this level, over all their pairs."""
BLOCK_SOURCE: Final = "block"
ESTIMABLE: Final = 1e-6
"""Part of a mean outside the rows of the design from which on the values do not tell it."""


@dataclass(frozen=True)
class VarianceRow:
    """A source of variance: a factor, "dose × variety" of two, "block", a covariate or "residual".

    The sum of squares is adjusted for the others (type II), with as many degrees of freedom as the rank of the design
    loses without the source. The residual has no F and no probability.
    """

    source: str
    freedom: int
    sum_squares: float
    f: float | None
    p: float | None


@dataclass(frozen=True)
class TreatmentMean:
    """The adjusted mean of a level: of equal shares of the other factors and blocks, at the mean covariate.

    Its 95 % interval is with the residual variance of the whole trial. Levels of a factor that share one of `letters`
    do not differ (Tukey and Kramer).
    """

    factor: str
    treatment: str
    parcels: int
    mean: float
    low: float
    high: float
    letters: str = ""


@dataclass(frozen=True)
class TwoWayCell:
    """The parcels of two levels at once."""

    factors: str
    first: str
    second: str
    parcels: int
    mean: float


@dataclass(frozen=True)
class Variance:
    """An analysis of variance; means in the order of the first parcels of their levels.

    Terms that are wholly confounded have no row and no means; factors that are so partly have no means, and their
    tests are of what can be told apart.
    """

    rows: tuple[VarianceRow, ...]
    means: tuple[TreatmentMean, ...]
    cells: tuple[TwoWayCell, ...] = ()
    confounded: tuple[Confounding, ...] = ()


@dataclass(frozen=True)
class TrialFactors:
    """What the values of n parcels are analysed by.

    Attributes:
        factors: name → level of each parcel; of several their pairs too, if each pair of levels is there.
        block: of each parcel; None for none.
        covariates: name → (n,) values.
    """

    factors: Mapping[str, Sequence[str]]
    block: Sequence[str] | None = None
    covariates: Mapping[str, FloatArray] = field(default_factory=dict)


def analysis_of_variance(value: FloatArray, trial: TrialFactors) -> Variance | None:
    """Least squares of value (n,) on factors, block and covariates; None if nothing is left over.

    Raises InputError if statsmodels is not installed.
    """
    pd, ols, _ = _statsmodels()
    table, terms, names = _design(value, trial, pd)
    columns = {f"f{k}": name for k, name in enumerate(trial.factors)}
    if any(table[column].nunique() < 2 for column in columns) or np.ptp(value) == 0.0:
        return None

    def fit(some: Sequence[str]) -> Any:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of terms that are partly confounded: ranks tell what is left
            return ols("value ~ " + (" + ".join(some) or "1"), table).fit()

    told = {_pair(term, names): term for term in terms}
    confounded = _confounded(trial, told)
    lost = {told[each.term] for each in confounded if not each.is_partly}
    terms = [term for term in terms if term not in lost and lost.isdisjoint(term.split(":"))]
    fitted = fit(terms)
    if fitted.df_resid < 1:
        terms = [term for term in terms if ":" not in term]
        fitted = fit(terms)
    if fitted.df_resid < 1 or fitted.ssr <= 0.0:
        return None
    rows = []
    for term in terms:
        others = [each for each in terms if not set(term.split(":")) <= set(each.split(":"))]
        without = fit(others)
        with_it = fit([*others, term])
        freedom = round(without.df_resid - with_it.df_resid)
        squares = max(float(without.ssr - with_it.ssr), 0.0)
        f = squares / freedom / (fitted.ssr / fitted.df_resid) if freedom > 0 else None
        p = float(special.fdtrc(freedom, fitted.df_resid, f)) if f is not None else None
        rows.append(VarianceRow(_pair(term, names), freedom, squares, f, p))
    rows.append(VarianceRow("residual", round(fitted.df_resid), float(fitted.ssr), None, None))
    means: list[TreatmentMean] = []
    kept = {column: name for column, name in columns.items() if f"C({column})" in terms}
    formula = "value ~ " + (" + ".join(terms) or "1")
    for column in kept:
        means += _adjusted_means(column, kept, table, formula, fitted)
    return Variance(tuple(rows), tuple(means), _cells(value, trial.factors), confounded)


def _pair(term: str, names: Mapping[str, str]) -> str:
    """The name of a term for people."""
    return " × ".join(names.get(part, part) for part in term.split(":"))


def _confounded(trial: TrialFactors, terms: Mapping[str, str]) -> tuple[Confounding, ...]:
    """Of the terms by name: blocks before covariates, these before factors in their order, and pairs last."""
    design: dict[str, FloatArray] = {}
    if BLOCK_SOURCE in terms and trial.block is not None:
        design[BLOCK_SOURCE] = factor_columns(trial.block)
    design |= {name: np.asarray(values, np.float64)[:, None] for name, values in trial.covariates.items()}
    design |= {name: factor_columns(levels) for name, levels in trial.factors.items()}
    for one, other in combinations(trial.factors, 2):
        if (pair := f"{one} × {other}") in terms:
            design[pair] = interaction_columns(design[one], design[other])
    return confounded_terms(design)


def nested_probability(
    value: FloatArray, factors: Sequence[Sequence[str]], cells: Sequence[str], block: Sequence[str]
) -> float | None:
    """Probability of so large differences between cells (n,) beside factors and blocks (n,) where there are none.

    None if nothing is left over, or the factors tell all cells apart. Raises InputError without statsmodels.
    """
    pd, ols, anova_lm = _statsmodels()
    table = pd.DataFrame({"value": value, "cell": list(cells), "block": list(block)})
    for k, levels in enumerate(factors):
        table[f"f{k}"] = list(levels)
    blocks = ["C(block)"] if len(set(block)) > 1 else []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # blocks of a site are alone with its cells: the fit is the same
        coarse = ols("value ~ " + " + ".join([*(f"C(f{k})" for k in range(len(factors))), *blocks]), table).fit()
        fine = ols("value ~ " + " + ".join(["C(cell)", *blocks]), table).fit()
    if fine.df_resid < 1 or coarse.df_resid <= fine.df_resid or fine.ssr <= 0.0:
        return None
    p = float(anova_lm(coarse, fine)["Pr(>F)"].iloc[1])
    return p if np.isfinite(p) else None


def _statsmodels() -> tuple[Any, Any, Any]:
    try:
        import pandas as pd
        from statsmodels.formula.api import ols
        from statsmodels.stats.anova import anova_lm
    except ImportError:
        raise MissingExtraError(
            "statsmodels", "trials", Text("The analysis of variance is made by it; the curve needs none.")
        ) from None
    return pd, ols, anova_lm


def _design(value: FloatArray, trial: TrialFactors, pd: Any) -> tuple[Any, list[str], dict[str, str]]:
    """The table, the terms of the formula, and the names of these for people."""
    table: dict[str, Any] = {"value": value}
    terms = []
    pairwise = []
    names = {}
    for k, (name, levels) in enumerate(trial.factors.items()):
        table[f"f{k}"] = list(levels)
        terms.append(f"C(f{k})")
        names[f"C(f{k})"] = name
    for one, other in combinations(range(len(trial.factors)), 2):
        pairs = set(zip(table[f"f{one}"], table[f"f{other}"], strict=True))
        if len(pairs) == len(set(table[f"f{one}"])) * len(set(table[f"f{other}"])):
            pairwise.append(f"C(f{one}):C(f{other})")
    if trial.block is not None and len(set(trial.block)) > 1:
        table["block"] = list(trial.block)
        terms.append("C(block)")
        names["C(block)"] = BLOCK_SOURCE
    terms += pairwise
    for k, (name, values) in enumerate(trial.covariates.items()):
        table[f"x{k}"] = values
        terms.append(f"x{k}")
        names[f"x{k}"] = name
    return pd.DataFrame(table), terms, names


def _adjusted_means(
    column: str, columns: Mapping[str, str], table: Any, formula: str, fitted: Any
) -> list[TreatmentMean]:
    """Of the levels of a factor, with the letters of their comparison; none if the design does not tell them."""
    pd, ols, _ = _statsmodels()
    levels = list(dict.fromkeys(table[column]))
    others = [name for name in (*columns, "block") if f"C({name})" in formula and name != column]
    rest = list(product(*(list(dict.fromkeys(table[name])) for name in others)))
    covariates = {name: float(table[name].mean()) for name in table if name.startswith("x")}
    grid = [
        {"value": 0.0, column: level, **dict(zip(others, row, strict=True)), **covariates}
        for level in levels
        for row in rest
    ]
    # The columns of the design do not depend on the rows, as long as these have the same levels.
    design = np.asarray(ols(formula, pd.concat([table, pd.DataFrame(grid)], ignore_index=True)).exog)[len(table) :]
    lines = design.reshape(len(levels), len(rest), -1).mean(axis=1)
    known = np.asarray(fitted.model.exog)
    if np.abs(lines @ np.linalg.pinv(known) @ known - lines).max() > ESTIMABLE:
        return []
    mean = lines @ np.asarray(fitted.params)
    covariance = lines @ np.asarray(fitted.cov_params()) @ lines.T
    half = float(special.stdtrit(fitted.df_resid, 0.975)) * np.sqrt(np.diag(covariance))
    variance = np.diag(covariance)[:, None] + np.diag(covariance) - 2.0 * covariance
    apart = np.abs(mean[:, None] - mean) / np.sqrt(np.maximum(variance, 1e-300))
    np.fill_diagonal(apart, 0.0)
    limit = float(stats.studentized_range.isf(SIGNIFICANT_P, len(levels), fitted.df_resid)) / np.sqrt(2.0)
    letters = comparison_letters(mean, apart > limit)
    return [
        TreatmentMean(
            columns[column],
            level,
            int((table[column] == level).sum()),
            float(mean[k]),
            float(mean[k] - half[k]),
            float(mean[k] + half[k]),
            letters[k],
        )
        for k, level in enumerate(levels)
    ]


def comparison_letters(mean: FloatArray, differs: Any) -> list[str]:
    """Letters of n means, "a" for the highest: two share one unless they differ (n, n).

    By insertion and absorption (Piepho 2004, J. Comput. Graph. Stat. 13:456-466).
    """
    order = np.argsort(-mean, kind="stable")
    groups: list[frozenset[int]] = [frozenset(range(len(mean)))]
    for one, other in combinations(range(len(mean)), 2):
        if not differs[one, other]:
            continue
        parted: list[frozenset[int]] = []
        for group in groups:
            parted += [group - {one}, group - {other}] if {one, other} <= group else [group]
        groups = [group for group in dict.fromkeys(parted) if not any(group < wider for wider in parted)]
    place = {int(number): k for k, number in enumerate(order)}
    groups.sort(key=lambda group: sorted(place[number] for number in group))
    names = [chr(ord("a") + k) if k < 26 else f"({k})" for k in range(len(groups))]
    return ["".join(name for name, group in zip(names, groups, strict=True) if k in group) for k in range(len(mean))]


def _cells(value: FloatArray, factors: Mapping[str, Sequence[str]]) -> tuple[TwoWayCell, ...]:
    """The two-way tables of the factors."""
    cells = []
    for one, other in combinations(factors, 2):
        pairs = list(zip(factors[one], factors[other], strict=True))
        for first, second in product(dict.fromkeys(factors[one]), dict.fromkeys(factors[other])):
            own = value[np.array([pair == (first, second) for pair in pairs])]
            mean = float(own.mean()) if len(own) else float("nan")
            cells.append(TwoWayCell(f"{one} × {other}", first, second, len(own), mean))
    return tuple(cells)
