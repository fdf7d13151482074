"""A trial as it was laid out: response to the dose with blocks, factors, a covariate, split doses, sites and years."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from furrowmap.core.crops.confounding import Confounding
from furrowmap.core.crops.dose_columns import (
    attribute_cells,
    checked_column,
    dose_name,
    dose_unit,
    number_columns,
    stated_column,
)
from furrowmap.core.crops.dose_response import fit_response
from furrowmap.core.crops.parcel_areas import list_names
from furrowmap.core.crops.response_models import ModelName
from furrowmap.core.crops.response_values import Response, ResponseQuestion
from furrowmap.core.crops.response_words import MAX_P
from furrowmap.core.crops.trial_tables import SITE, SPLIT, TREATMENT
from furrowmap.core.crops.trial_variance import TrialFactors, Variance, analysis_of_variance, nested_probability
from furrowmap.core.runtime.arrays import BoolArray, FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.parcel import Parcel

MIN_SITES: Final = 3
"""From which on the mean of a dose at a site is an observation, if sites respond differently."""
DOSE_FACTOR: Final = "dose"


@dataclass(frozen=True)
class TrialPlan:
    """What is asked of a trial.

    Attributes:
        dose: column; None for the first so named.
        model, ratio: as of :class:`~furrowmap.core.crops.response_values.ResponseQuestion`.
        factors: columns of other factors.
        covariate: column.
        blocks: whether they are effects of their own.
    """

    dose: str | None = None
    model: ModelName | None = None
    ratio: float | None = None
    factors: tuple[str, ...] = ()
    covariate: str | None = None
    blocks: bool = False


@dataclass(frozen=True)
class TrialPart:
    """The parcels of a site, or of a level of a factor, and their response alone."""

    by: str
    label: str
    response: Response


@dataclass(frozen=True)
class Trial:
    """What a trial of n parcels shows.

    Attributes:
        dose_name, dose: column and (n,) values; None without a dose.
        labels: of the treatment of each parcel; None where unknown.
        levels: of each parcel by what the variance is analysed by; None where unknown.
        response: of all parcels; of the means of a dose at each site where these respond differently.
        parts: each site, and each level of each factor, alone.
        differs: "site", a factor or "split" → probability of so different responses where there is no difference.
        sentences: what it shows.
    """

    dose_name: str | None
    dose: FloatArray | None
    labels: tuple[str | None, ...]
    levels: Mapping[str, Sequence[str | None]]
    response: Response | None
    parts: tuple[TrialPart, ...]
    differs: Mapping[str, float]
    variance: Variance | None
    sentences: tuple[Text, ...]
    notices: tuple[Notice, ...]


def analyse_trial(parcels: Sequence[Parcel], value: FloatArray, plan: TrialPlan) -> Trial:
    """What the values (n,) of parcels, nan where unknown, show of their treatments.

    Raises InputError for a column that no parcel has.
    """
    name = dose_name(parcels, plan.dose)
    notices: list[Notice] = []
    dose = None
    if name is not None:
        dose, notices = checked_column(parcels, name)
    factors = {factor: _levels(parcels, factor) for factor in plan.factors}
    sites = _sites(parcels)
    several = len(set(sites)) > 1
    block = [
        " ".join(filter(None, [site, (each.block or "") if plan.blocks else ""]))
        for site, each in zip(sites, parcels, strict=True)
    ]
    without = [each.id for each in parcels if not each.block]
    if plan.blocks and 0 < len(without) < len(parcels):
        notices.append(Notice("trial-block-missing", names=list_names(without, "parcel"), total=len(parcels)))
    covariate = None
    if plan.covariate is not None:
        covariate, left_out = _numbers(parcels, plan.covariate)
        notices += left_out
    labels = _labels(parcels, dose)
    is_treated = any(label is not None for label in labels)
    if not is_treated and not factors and (numbers := number_columns(parcels)):
        notices.append(Notice("trial-without-dose", names=", ".join(numbers)[:200]))
    known = np.isfinite(value)
    if is_treated:
        known &= np.array([label is not None for label in labels], bool)
    for levels in factors.values():
        known &= np.array([bool(level) for level in levels], bool)
    if covariate is not None:
        known &= np.isfinite(covariate)
    split = _split(labels, dose, factors)
    confounded: tuple[Confounding, ...] = ()
    try:
        variance = _variance(value, known, split, block, {plan.covariate or "": covariate})
        differs = _differences(parcels, value, known, name, dose, factors, sites, block) if dose is not None else {}
    except InputError as error:
        notices.append(Notice("variance-missing", what=error.words("what"), remedy=error.words("remedy")))
        variance = None
        differs = {}
    if variance is not None:
        confounded = variance.confounded
        notices += [
            Notice("trial-confounded", term=each.term, others=each.others, is_partly=each.is_partly)
            for each in confounded
        ]
    response = None
    parts: list[TrialPart] = []
    if dose is not None:
        question = ResponseQuestion(plan.model, plan.ratio, dose_unit(name))
        lost = {each.term for each in confounded if not each.is_partly}
        told = {factor: levels for factor, levels in factors.items() if factor not in lost}
        covariates = _covariates(told, covariate if plan.covariate not in lost else None)
        response = fit_response(dose, value, block, question, covariates)
        if several and differs.get(SITE, 1.0) <= MAX_P and len(set(sites)) >= MIN_SITES:
            response = _over_sites(dose, value, sites, question, response)
        for by, levels in {**({SITE: sites} if several else {}), **factors}.items():
            for label in dict.fromkeys(filter(None, levels)):
                own = np.array([level == label for level in levels])
                alone = fit_response(
                    np.where(own, dose, np.nan), value, block, question, covariates if by == SITE else None
                )
                parts.append(TrialPart(by, label, alone))
    said = response.sentences if response is not None else (Text("The parcels have no doses."),)
    sentences = (*said, *_difference_words(differs))
    return Trial(name, dose, labels, split, response, tuple(parts), differs, variance, sentences, tuple(notices))


def _difference_words(differs: Mapping[str, float]) -> list[Text]:
    sentences = []
    for by, p in differs.items():
        if by == "split" and p <= MAX_P:
            sentences.append(Text("Equal sums of different single doses differ (p = {p:.2g}).", p=p))
        elif by == "split":
            sentences.append(
                Text("No difference between equal sums of different single doses is shown (p = {p:.2g}).", p=p)
            )
        elif p <= MAX_P:
            sentences.append(Text("The response differs by {by} (p = {p:.2g}): read each alone.", by=by, p=p))
        else:
            sentences.append(Text("No difference of the response by {by} is shown (p = {p:.2g}).", by=by, p=p))
    return sentences


def _over_sites(
    dose: FloatArray, value: FloatArray, sites: Sequence[str], question: ResponseQuestion, whole: Response
) -> Response:
    """The response of the means of each dose at each site: the sites are a sample, and their differences its error."""
    cells: dict[tuple[str, float], list[float]] = {}
    for site, at, each in zip(sites, dose.tolist(), value.tolist(), strict=True):
        if math.isfinite(at) and math.isfinite(each):
            cells.setdefault((site, at), []).append(each)
    means = fit_response(
        np.array([at for _, at in cells]),
        np.array([float(np.mean(each)) for each in cells.values()]),
        [site for site, _ in cells],
        question,
    )
    return replace(means, parcels=whole.parcels, expected=whole.expected, residual=whole.residual)


def _split(
    labels: Sequence[str | None], dose: FloatArray | None, factors: Mapping[str, Sequence[str]]
) -> dict[str, Sequence[str | None]]:
    """The levels of each parcel by what the variance is analysed by: treatments, or the dose beside factors."""
    split: dict[str, Sequence[str | None]] = {}
    if factors and dose is not None:
        split[DOSE_FACTOR] = [f"{each:g}" if math.isfinite(each) else None for each in dose]
    elif any(label is not None for label in labels):
        split[TREATMENT] = labels
    return {**split, **factors}


def _variance(
    value: FloatArray,
    known: BoolArray,
    split: Mapping[str, Sequence[str | None]],
    block: Sequence[str],
    covariates: Mapping[str, FloatArray | None],
) -> Variance | None:
    for levels in split.values():
        known = known & np.array([level is not None for level in levels], bool)
    rows = np.flatnonzero(known).tolist()
    if not rows or not split:
        return None
    own = {name: [str(levels[k]) for k in rows] for name, levels in split.items()}
    beside = {name: column[rows] for name, column in covariates.items() if column is not None}
    return analysis_of_variance(value[rows], TrialFactors(own, [block[k] for k in rows], beside))


def _differences(
    parcels: Sequence[Parcel],
    value: FloatArray,
    known: BoolArray,
    name: str | None,
    dose: FloatArray,
    factors: Mapping[str, Sequence[str]],
    sites: Sequence[str],
    block: Sequence[str],
) -> dict[str, float]:
    """Probabilities of equal responses of sites, levels of factors, and single doses of the same sum."""
    rows = np.flatnonzero(known & np.isfinite(dose)).tolist()
    doses = [f"{dose[k]:g}" for k in rows]
    own = value[rows]
    blocks = [block[k] for k in rows]
    split = [str(parcels[k].attributes.get(SPLIT.format(name), "")) for k in rows]
    trials: dict[str, tuple[list[list[str]], list[str]]] = {SITE: ([doses], [sites[k] for k in rows])}
    for factor, levels in factors.items():
        trials[factor] = ([doses, [levels[k] for k in rows]], [levels[k] for k in rows])
    trials["split"] = ([doses], split)
    found = {}
    for by, (coarse, levels) in trials.items():
        if len(set(levels)) < 2:
            continue
        cells = [f"{one} {other}" for one, other in zip(doses, levels, strict=True)]
        p = nested_probability(own, coarse, cells, blocks)
        if p is not None:
            found[by] = p
    return found


def _sites(parcels: Sequence[Parcel]) -> list[str]:
    return [str(each.attributes.get(SITE, "")) for each in parcels]


def _covariates(factors: Mapping[str, Sequence[str]], covariate: FloatArray | None) -> FloatArray | None:
    """Columns (n, k) of the levels of factors beside their first, and of the covariate; nan where unknown."""
    columns = []
    for levels in factors.values():
        names = list(dict.fromkeys(filter(None, levels)))
        columns += [np.array([float(level == name) if level else np.nan for level in levels]) for name in names[1:]]
    if covariate is not None:
        columns.append(covariate)
    return np.column_stack(columns) if columns else None


def _column(parcels: Sequence[Parcel], name: str) -> str:
    """The attribute that is stated."""
    names = list(dict.fromkeys(key for each in parcels for key in each.attributes))
    found = stated_column(names, name)
    if found is None:
        raise InputError("trial-column-unknown", stated=name, is_number=False, names=", ".join(names) or "none")
    return found


def _levels(parcels: Sequence[Parcel], name: str) -> list[str]:
    values = [value if value is not None else "" for value in attribute_cells(parcels, _column(parcels, name))]
    return [f"{value:g}" if isinstance(value, float) else value for value in values]


def _numbers(parcels: Sequence[Parcel], name: str) -> tuple[FloatArray, list[Notice]]:
    numbers, left_out = checked_column(parcels, _column(parcels, name))
    if not np.isfinite(numbers).any():
        names = ", ".join(number_columns(parcels)) or "none"
        raise InputError("trial-column-unknown", stated=name, is_number=True, names=names)
    return numbers, left_out


def _labels(parcels: Sequence[Parcel], dose: FloatArray | None) -> tuple[str | None, ...]:
    """The treatment of each parcel by name; by its dose where the treatments have no names."""
    named = [each.attributes.get(TREATMENT) for each in parcels]
    if any(name is not None for name in named):
        return tuple(None if name is None else f"{name:g}" if isinstance(name, float) else name for name in named)
    if dose is None:
        return (None,) * len(parcels)
    return tuple(f"{value:g}" if math.isfinite(value) else None for value in dose)
