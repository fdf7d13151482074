"""What a trial shows of the response to a dose, in sentences."""

from typing import Final

from furrowmap.core.crops.response_models import ModelName
from furrowmap.core.crops.response_values import Estimate, FittedModel, Response, ResponseQuestion
from furrowmap.core.runtime.languages.texts import Text, Words

MODEL_WORDS: Final[dict[ModelName, Text]] = {
    "linear": Text("straight line"),
    "quadratic": Text("parabola"),
    "quadratic-plateau": Text("parabola with plateau"),
    "linear-plateau": Text("line with plateau"),
    "mitscherlich": Text("Mitscherlich"),
    "logistic": Text("logistic"),
}
MIN_WEIGHT: Final = 0.05
"""Shapes of less weight are not named."""
MAX_P: Final = 0.05
"""Significance level of a response, of its curvature and of a lack of fit."""


def response_words(found: Response, question: ResponseQuestion) -> tuple[Text, ...]:
    """What the data show, sentence by sentence."""
    unit = f" {question.unit}" if question.unit else ""
    if found.p is None or (found.p <= MAX_P and not found.models):
        return (
            Text(
                "{parcels} parcels with {doses} different doses: a response needs three doses, and more parcels than "
                "parameters.",
                parcels=found.parcels,
                doses=found.doses,
            ),
        )
    if not found.models:
        return (
            Text(
                "No response shown: where the dose has no effect, {percent:.0f} % of trials would show one as strong.",
                percent=100 * found.p,
            ),
        )
    sentences = []
    if found.economic is not None:
        sentences.append(_economic(found.economic, found, unit))
    if found.agronomic is not None:
        sentences.append(_agronomic(found.agronomic, found, unit))
    if found.best is not None and found.gain is not None:
        sentences.append(
            Text(
                "Expected at {dose:.0f}{unit}: {value:.4g} (95 %: {low:.4g} to {high:.4g}); from {gain_dose:.0f} to "
                "{until:.0f}{unit} it rises by {gain:.2g} (95 %: {gain_low:.2g} to {gain_high:.2g}).",
                dose=found.best.dose,
                value=found.best.value,
                low=found.best.low,
                high=found.best.high,
                gain_dose=found.gain.dose,
                until=found.gain.until,
                gain=found.gain.value,
                gain_low=found.gain.low,
                gain_high=found.gain.high,
                unit=unit,
            )
        )
    return (*sentences, *_shapes(found.models, unit))


def _economic(optimum: Estimate, found: Response, unit: str) -> Text:
    dose = f"{optimum.value:.0f}{unit}"
    if optimum.value >= found.highest:
        if optimum.low >= found.highest:
            return Text("The economic optimum is at or above the highest dose, {dose}.", dose=dose)
        return Text(
            "The economic optimum is at or above the highest dose, {dose} (95 %: from {low:.0f}).",
            dose=dose,
            low=optimum.low,
        )
    if optimum.low_open and optimum.high_open:
        return Text(
            "The doses do not show the economic optimum: it may be any of them, {lowest:.0f} to {highest:.0f}{unit}.",
            lowest=found.lowest,
            highest=found.highest,
            unit=unit,
        )
    end = _end(optimum, found)
    if optimum.value <= found.lowest:
        return Text("No dose pays: the economic optimum is the lowest, {dose} (95 %: up to {end}).", dose=dose, end=end)
    if optimum.low_open:
        return Text("The economic optimum is {dose} (95 %: up to {end}).", dose=dose, end=f"{optimum.high:.0f}")
    return Text("The economic optimum is {dose} (95 %: {low:.0f} to {end}).", dose=dose, low=optimum.low, end=end)


def _agronomic(optimum: Estimate, found: Response, unit: str) -> Text:
    dose = f"{optimum.value:.0f}{unit}"
    end = _end(optimum, found)
    if optimum.value <= found.lowest:
        return Text("More than the lowest dose, {dose}, gains nothing (95 %: up to {end}).", dose=dose, end=end)
    if optimum.value < found.highest:
        return Text("Beyond {dose} (95 %: {low:.0f} to {end}) nothing is gained.", dose=dose, low=optimum.low, end=end)
    if optimum.low >= found.highest:
        return Text("The response does not level off up to the highest dose, {dose}.", dose=dose)
    return Text(
        "The response does not level off up to the highest dose, {dose} (95 %: from {low:.0f}).",
        dose=dose,
        low=optimum.low,
    )


def _end(optimum: Estimate, found: Response) -> Words:
    if optimum.high_open:
        return Text("above the highest dose, {highest:.0f}", highest=found.highest)
    return f"{optimum.high:.0f}"


def _shapes(models: tuple[FittedModel, ...], unit: str) -> list[Text]:
    """The shapes that were compared, and whether they disagree."""
    first = models[0]
    sentences = []
    named = [each for each in models if each.weight >= MIN_WEIGHT]
    names = tuple(MODEL_WORDS[each.name] for each in named)
    weights = ", ".join(f"{100 * each.weight:.0f}" for each in named)
    if len(models) == 1:
        sentences.append(Text("Shape: {names}.", names=names))
    elif len(named) == 1:
        sentences.append(Text("Shape: {names} ({weights} % of the weight).", names=names, weights=weights))
    else:
        optima = [optimum.value for each in named if (optimum := each.economic or each.agronomic) is not None]
        sentences.append(
            Text(
                "Shapes by weight, over which the figures are averaged: {names} ({weights} %); alone they say "
                "{least:.0f} to {most:.0f}{unit}.",
                names=names,
                weights=weights,
                least=min(optima),
                most=max(optima),
                unit=unit,
            )
        )
    if first.lack_of_fit_p is not None and first.lack_of_fit_p <= MAX_P:
        sentences.append(Text("The shape does not fit the means of the doses (p = {p:.2g}).", p=first.lack_of_fit_p))
    return sentences
