"""The column of a table that is the dose, and the names of columns for people."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.languages.texts import Text, Words
from furrowmap.core.values.parcel import Parcel

DOSE_WORDS: Final = ("n_kg_ha", "dose", "rate", "kg_ha")
"""What the names of columns with doses contain, the first that is found."""
_COLUMN_UNITS: Final = {"dt_ha": "dt/ha", "kg_ha": "kg/ha", "t_ha": "t/ha", "m": "m", "m2": "m²", "m3": "m³"}
_NUTRIENTS: Final = {"n": Text("nitrogen"), "p": Text("phosphorus"), "k": Text("potassium")}
_MEASURES: Final = {"mean_height_m": Text("mean height (m)")}
"""Columns of our own with names in other languages, too."""


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
    low = (name or "").casefold()
    return next((unit for suffix, unit in _COLUMN_UNITS.items() if "_ha" in suffix and low.endswith(suffix)), "")


def column_words(name: str) -> Words:
    """The name of a column for people, with its unit: "nitrogen (kg/ha)" for `n_kg_ha`."""
    if name.casefold() in _MEASURES:
        return _MEASURES[name.casefold()]
    for suffix, unit in _COLUMN_UNITS.items():
        if name.casefold().endswith(f"_{suffix}"):
            words = name[: -len(suffix) - 1].replace("_", " ")
            nutrient = _NUTRIENTS.get(words.casefold())
            if nutrient is not None:
                return Text("{nutrient} ({unit})", nutrient=nutrient, unit=unit)
            return f"{words} ({unit})"
    return name.replace("_", " ")
