"""Growth of parcels between flights of several days."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Growth:
    """The growth of a parcel.

    Attributes:
        id: of the parcel.
        rate_m_day: slope of its height over time by least squares.
        sigma_m_day: standard deviation of the rate from those of the heights; nan where these are unknown.
        span_days: from the first of its days to the last.
    """

    id: str
    days: int
    rate_m_day: float
    sigma_m_day: float
    span_days: int


def growth_of(
    days: Sequence[dt.date],
    heights_m: Sequence[Mapping[str, float]],
    sigmas_m: Sequence[Mapping[str, float]] | None = None,
) -> tuple[Growth, ...]:
    """The growth of each parcel with heights of two days or more, in the order in which they appear.

    Args:
        days: of the flights.
        heights_m: of each flight: height above the soil by parcel; nan where unknown.
        sigmas_m: their standard deviations.

    Raises:
        ValueError: if two flights have the same day.
    """
    if len(set(days)) < len(days):
        raise ValueError("two tables of the same day")
    found = []
    for name in dict.fromkeys(name for flight in heights_m for name in flight):
        own = [k for k, flight in enumerate(heights_m) if np.isfinite(flight.get(name, np.nan))]
        if len(own) < 2:
            continue
        t = np.array([days[k].toordinal() for k in own], np.float64)
        weights = (t - t.mean()) / ((t - t.mean()) ** 2).sum()
        rate = float(weights @ [heights_m[k][name] for k in own])
        sigma = [sigmas_m[k].get(name, np.nan) if sigmas_m is not None else np.nan for k in own]
        found.append(Growth(name, len(own), rate, float(np.sqrt(weights**2 @ np.square(sigma))), int(np.ptp(t))))
    return tuple(found)
