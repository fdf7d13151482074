"""POS2JGD: steady crustal motion of Japan for a quarter of a year, published by GSI for PPP and CLAS.

The header states fields, period and both datums, but not the sign. It follows from the motion: since the epoch of
JGD2011
the plates under Japan have moved south in every ITRF, except the Philippine Sea plate (Izu and Ogasawara islands).
"""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

TITLE: Final = "GRIDDED CORRECTION PARAMETER FOR POS2JGD"
_NATIONAL: Final = ("JGD2011", "JGD2024")
_FIELDS: Final = "'4 MeshCode dB dL dH'"
_IZU_DEG: Final = 138.0, 35.0
"""East of this longitude and south of this latitude the islands move north-west."""


@dataclass(frozen=True)
class Pos2Jgd:
    """Content of a file.

    Attributes:
        days: first and last day of validity, in Japan.
        codes: (m,) mesh codes.
        corrections: (m, 3) latitude and longitude in seconds of arc, height in metres.
        from_map: whether adding these to map coordinates gives current ones, or the reverse.
    """

    days: tuple[dt.date, dt.date]
    codes: NDArray[np.int64]
    corrections: NDArray[np.float64]
    from_map: bool


def parse(lines: list[str]) -> Pos2Jgd:
    """The content of a file whose first line is `TITLE`.

    Raises:
        ValueError: if it is damaged, of another version, or covers islands alone.
    """
    pairs = [(line.partition("=")) for line in lines if "=" in line]
    head = {key.strip(): value.strip() for key, _, value in pairs}
    if head.get("DATA_FIELDS", _FIELDS) != _FIELDS:
        raise ValueError(f"its fields are {head['DATA_FIELDS']}, not {_FIELDS}")
    if head.get("NATIONAL_DATUM") not in _NATIONAL:
        raise ValueError(f"its NATIONAL_DATUM is {head.get('NATIONAL_DATUM', 'not stated')}")
    days = _day(head, "START_OF_APPLICABLE_PERIOD"), _day(head, "END_OF_APPLICABLE_PERIOD")
    rows = [line.split() for line in lines if line[:8].isdigit()]
    if not rows or any(len(row) != 4 or len(row[0]) != 8 for row in rows):
        raise ValueError("not every line after its header has a mesh code and three numbers")
    values = np.array([[float(value) for value in row[1:]] for row in rows])
    codes = np.array([int(row[0]) for row in rows], np.int64)
    return Pos2Jgd(days, codes, values, _moves_south(codes, values[:, 0]))


def _day(head: dict[str, str], key: str) -> dt.date:
    try:
        return dt.datetime.strptime(head.get(key, ""), "%Y%m%d").date()  # noqa: DTZ007 - a day of a calendar
    except ValueError:
        raise ValueError(f"its {key} is not a date such as 20230601") from None


def _moves_south(codes: NDArray[np.int64], latitude: NDArray[np.float64]) -> bool:
    """Whether the numbers point south, as the motion of the plates under Japan does."""
    north_deg, east_deg = codes // 1_000_000 / 1.5, 100.0 + codes // 10_000 % 100
    known = latitude[~((north_deg < _IZU_DEG[1]) & (east_deg >= _IZU_DEG[0])) & (latitude != 0.0)]
    if not len(known) or max((known < 0.0).mean(), (known > 0.0).mean()) < 0.9:
        raise ValueError("the sign of its numbers cannot be determined without nodes on the main islands of Japan")
    return bool(np.median(known) < 0.0)
