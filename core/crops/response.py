"""Doses among the attributes of parcels, and the response of a trial to them: a curve where the data hold one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.crops.logistic import PLATEAU, Logistic, fit_logistic, p_of_no_response
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.parcel import Parcel

FloatArray = NDArray[np.float64]

MAX_P: Final = 0.05
"""Significance level of a curve."""
MIN_DOSES: Final = 4
DOSE_WORDS: Final = ("n_kg_ha", "dose", "rate", "kg_ha")
"""What the names of columns with doses contain, the first that is found."""
TRIALS: Final = 1999
"""Permutations: the least probability is 1 in 2000."""


def dose_name(parcels: Sequence[Parcel], stated: str | None = None) -> str | None:
    """The attribute that is the dose: the stated one, or the first number whose name says so; None if there is none.

    Raises:
        InputError: if no parcel has a number under the stated name.
    """
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


@dataclass(frozen=True)
class Response:
    """The response of a quantity to a dose.

    Attributes:
        parcels: number of parcels with both.
        doses: number of distinct doses.
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
        unit: of the doses, for the sentence.
    """
    known = np.isfinite(dose) & np.isfinite(value)
    names = np.array(["" if name is None else name for name in (block or [""] * len(dose))], object)[known]
    labels = tuple(dict.fromkeys(str(name) for name in names))
    index = np.array([labels.index(str(name)) for name in names], np.intp)
    dose, value = dose[known], value[known]
    doses = len(np.unique(dose))
    gap = f" {unit}" if unit else ""
    if doses < MIN_DOSES or len(dose) - len(labels) - 3 < 1:
        words = (
            f"{len(dose)} parcels with {doses} different doses: a logistic curve needs {MIN_DOSES} doses, and more "
            "parcels than parameters."
        )
        return Response(len(dose), doses, labels, None, None, plateau_shown=False, words=words)
    p = p_of_no_response(dose, value, index, TRIALS)
    if p > MAX_P:
        words = (
            "The data hold no curve: heights without any effect of the dose would give as good a one in "
            f"{100 * p:.0f} % of trials."
        )
        return Response(len(dose), doses, labels, p, None, plateau_shown=False, words=words)
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
            f"The doses do not show the rate beyond which nothing is gained: it is at least {max(reach.low, 0.0):.0f}"
            f"{gap} (95 %), and may be above the highest dose, {highest:.0f}{gap}."
        )
    return Response(len(dose), doses, labels, p, curve, plateau_shown=shown, words=words)
