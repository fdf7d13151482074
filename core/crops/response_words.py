"""What a trial shows of the response to a dose, in sentences; those in Japanese are in the catalogue of pages."""

from typing import Final

from furrowmap.core.crops.response_models import ModelName
from furrowmap.core.crops.response_values import Estimate, FittedModel, Response, ResponseQuestion

MODEL_WORDS: Final[dict[ModelName, str]] = {
    "linear": "straight line",
    "quadratic": "parabola",
    "quadratic-plateau": "parabola with plateau",
    "linear-plateau": "line with plateau",
    "mitscherlich": "Mitscherlich",
    "logistic": "logistic",
}
MIN_WEIGHT: Final = 0.05
"""Shapes of less weight are not named."""
MAX_P: Final = 0.05
"""Significance level of a response, of its curvature and of a lack of fit."""


def response_words(found: Response, question: ResponseQuestion) -> tuple[str, ...]:
    """What the data show, sentence by sentence."""
    unit = f" {question.unit}" if question.unit else ""
    if found.p is None or (found.p <= MAX_P and not found.models):
        return (
            f"{found.parcels} parcels with {found.doses} different doses: a response needs three doses, and more "
            "parcels than parameters.",
        )
    if not found.models:
        share = f"{100 * found.p:.0f} %"
        return (f"No response shown: where the dose has no effect, {share} of trials would show one as strong.",)
    sentences = []
    if found.economic is not None:
        sentences.append(_economic(found.economic, found, unit))
    if found.agronomic is not None:
        sentences.append(_agronomic(found.agronomic, found, unit))
    if found.best is not None and found.gain is not None:
        sentences.append(
            f"Expected at {found.best.dose:.0f}{unit}: {found.best.value:.4g} (95 %: {found.best.low:.4g} to "
            f"{found.best.high:.4g}); from {found.gain.dose:.0f} to {found.gain.until:.0f}{unit} it rises by "
            f"{found.gain.value:.2g} (95 %: {found.gain.low:.2g} to {found.gain.high:.2g})."
        )
    return (*sentences, *_shapes(found.models, unit))


def _economic(optimum: Estimate, found: Response, unit: str) -> str:
    at = f"{optimum.value:.0f}{unit}"
    if optimum.value >= found.highest:
        rest = "" if optimum.low >= found.highest else f" (95 %: from {optimum.low:.0f})"
        return f"The economic optimum is at or above the highest dose, {at}{rest}."
    if optimum.low_open and optimum.high_open:
        span = f"{found.lowest:.0f} to {found.highest:.0f}{unit}"
        return f"The doses do not show the economic optimum: it may be any of them, {span}."
    if optimum.value <= found.lowest:
        return f"No dose pays: the economic optimum is the lowest, {at} (95 %: up to {_end(optimum, found)})."
    if optimum.low_open:
        return f"The economic optimum is {at} (95 %: up to {optimum.high:.0f})."
    return f"The economic optimum is {at} (95 %: {optimum.low:.0f} to {_end(optimum, found)})."


def _agronomic(optimum: Estimate, found: Response, unit: str) -> str:
    at = f"{optimum.value:.0f}{unit}"
    if optimum.value <= found.lowest:
        return f"More than the lowest dose, {at}, gains nothing (95 %: up to {_end(optimum, found)})."
    if optimum.value >= found.highest:
        rest = "" if optimum.low >= found.highest else f" (95 %: from {optimum.low:.0f})"
        return f"The response does not level off up to the highest dose, {at}{rest}."
    return f"Beyond {at} (95 %: {optimum.low:.0f} to {_end(optimum, found)}) nothing is gained."


def _end(optimum: Estimate, found: Response) -> str:
    return f"above the highest dose, {found.highest:.0f}" if optimum.high_open else f"{optimum.high:.0f}"


def _shapes(models: tuple[FittedModel, ...], unit: str) -> list[str]:
    """The shapes that were compared, and whether they disagree."""
    first = models[0]
    sentences = []
    named = [each for each in models if each.weight >= MIN_WEIGHT]
    names = ", ".join(MODEL_WORDS[each.name] for each in named)
    weights = ", ".join(f"{100 * each.weight:.0f}" for each in named)
    if len(models) == 1:
        sentences.append(f"Shape: {names}.")
    elif len(named) == 1:
        sentences.append(f"Shape: {names} ({weights} % of the weight).")
    else:
        optima = [optimum.value for each in named if (optimum := each.economic or each.agronomic) is not None]
        sentences.append(
            f"Shapes by weight, over which the figures are averaged: {names} ({weights} %); alone they say "
            f"{min(optima):.0f} to {max(optima):.0f}{unit}."
        )
    if first.lack_of_fit_p is not None and first.lack_of_fit_p <= MAX_P:
        sentences.append(f"The shape does not fit the means of the doses (p = {first.lack_of_fit_p:.2g}).")
    return sentences
