"""The dose among the attributes of parcels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.parcel import Parcel

_DOSES: Final = ("n_kg_ha", "dose", "rate", "kg_ha")
"""What the names of columns with doses hold, the first that is found."""


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
    return next((name for word in _DOSES for name in numbers if word in name.casefold()), None)


def doses_of(parcels: Sequence[Parcel], name: str) -> NDArray[np.float64]:
    """The dose of each parcel (n,); nan where it is not known."""
    values = [each.attributes.get(name) for each in parcels]
    return np.array([value if isinstance(value, float) else np.nan for value in values])


def dose_unit(name: str | None) -> str:
    """The unit that a name ends with; "" where it says none."""
    return "kg/ha" if name is not None and name.casefold().endswith("kg_ha") else ""
