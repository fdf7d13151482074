"""The column of a table that is the dose, and the names of columns for people."""

import re
from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from furrowmap.core.crops.number_cells import checked_numbers, left_out, number_cells
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text, Words
from furrowmap.core.values.parcel import Attribute, Parcel

DOSE_WORDS: Final = ("n_kg_ha", "dose", "rate", "kg_ha")
"""What the names of columns with doses contain, the first that is found."""
_BRACKETS: Final = re.compile(r"[(\[（][^)\]）]*[)\]）]\s*$")
_COLUMN_UNITS: Final = {"dt_ha": "dt/ha", "kg_ha": "kg/ha", "t_ha": "t/ha", "m": "m", "m2": "m²", "m3": "m³"}
_NUTRIENTS: Final = {"n": Text("nitrogen"), "p": Text("phosphorus"), "k": Text("potassium")}
_MEASURES: Final = {"mean_height_m": Text("mean height (m)")}
"""Columns of our own with names in other languages, too."""


def dose_name(parcels: Sequence[Parcel], stated: str | None = None) -> str | None:
    """The attribute that is the dose: as stated, else the first so named. Raises InputError for no such number."""
    names = list(dict.fromkeys(name for each in parcels for name in each.attributes))
    found = {name: number_cells(attribute_cells(parcels, name)) for name in names}
    if stated is None:
        numbers = [name for name in names if found[name].mostly]
        return next((name for word in DOSE_WORDS for name in numbers if word in name.casefold()), None)
    column = stated_column(names, stated)
    if column is None or not np.isfinite(found[column].values).any():
        numbers = [name for name in names if np.isfinite(found[name].values).any()]
        raise InputError("dose-unknown", stated=stated, numbers=", ".join(numbers) or "none")
    return column


def parcel_doses(parcels: Sequence[Parcel], name: str) -> FloatArray:
    """The dose of each parcel (n,); nan where it is not known."""
    return number_cells(attribute_cells(parcels, name)).values


def checked_column(parcels: Sequence[Parcel], name: str) -> tuple[FloatArray, list[Notice]]:
    """The numbers (n,) of an attribute, nan where there is none, and which cells are left out.

    Raises InputError if a comma may separate decimals or thousands.
    """
    return checked_numbers(attribute_cells(parcels, name), name, [each.id for each in parcels])


def left_out_doses(parcels: Sequence[Parcel], name: str) -> list[Notice]:
    """Which doses are left out, as they are no number or stand for none."""
    cells = attribute_cells(parcels, name)
    return left_out(number_cells(cells), cells, name, [each.id for each in parcels])


def attribute_cells(parcels: Sequence[Parcel], name: str) -> list[Attribute | None]:
    """An attribute of each parcel; None where it has none."""
    return [each.attributes.get(name) for each in parcels]


def number_columns(parcels: Sequence[Parcel]) -> list[str]:
    """The attributes that are mostly numbers."""
    names = dict.fromkeys(name for each in parcels for name in each.attributes)
    return [name for name in names if number_cells(attribute_cells(parcels, name)).mostly]


def stated_column(names: Iterable[str], stated: str) -> str | None:
    """The column that is stated, in any case; with its unit in brackets or, of a single one, without."""
    known = {name.casefold(): name for name in names}
    plain = _BRACKETS.sub("", stated).strip().casefold()
    same = [name for low, name in known.items() if _BRACKETS.sub("", low).strip() == plain]
    return known.get(stated.strip().casefold()) or known.get(plain) or (same[0] if len(same) == 1 else None)


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
