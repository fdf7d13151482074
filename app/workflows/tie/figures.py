"""The figures of ties as reports and layers have them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.dates.network import MOVE_SIZE, Network
from furrowmap.core.dates.pair_tie import PairTie
from furrowmap.exporters.rasters.dated_surface import DatedSurface
from furrowmap.exporters.rasters.tied_surfaces import ChangeFigures

FloatArray = NDArray[np.float64]

_FIELDS: Final = ("east_m", "north_m", "height_m", "tilt_east_deg", "tilt_north_deg", "turn_deg")
_UNITS: Final = np.array([1.0, 1.0, 1.0, *3 * (math.degrees(1.0),)])


def date_rows(dates: Sequence[DatedSurface], net: Network, first: int, tied: Sequence[bool]) -> list[dict[str, Any]]:
    """Each date with what moves it."""
    rows = []
    for k, date in enumerate(dates):
        own = slice(MOVE_SIZE * (first + k), MOVE_SIZE * (first + k + 1))
        sigma = np.sqrt(np.diag(net.covariance[own, own]))
        rows.append(
            {
                "date": k + 1,
                "name": date.name,
                "start": date.start.isoformat(),
                "start_local": date.start.astimezone(date.zone).isoformat(),
                "time_zone": date.zone.key,
                "folder": str(date.folder),
                "tied": tied[k],
                "group": int(net.group[first + k]),
                "surface": f"dsm_{k + 1:02d}.tif" if tied[k] else "",
                **_values(net.moves[first + k], sigma, known=tied[k]),
            }
        )
    return rows


def tie_rows(ties: Mapping[tuple[int, int], PairTie], net: Network, first: int) -> list[dict[str, Any]]:
    """Each tie: what moves the second date onto the first after the adjustment; date 0 is the reference."""
    rows = []
    for (one, other), tie in ties.items():
        move, covariance = net.between(one, other)
        rows.append(
            {
                "date_a": one + 1 - first,
                "date_b": other + 1 - first,
                **_values(move, np.sqrt(np.maximum(np.diag(covariance), 0.0)), known=True),
                "cells": tie.cells,
                "patches": tie.patches,
                "upright": 0 if tie.upright is None else len(tie.upright.used_m),
                "departures_m": round(tie.departure.relief_m, 5),
                "range_m": round(tie.departure.range_m, 2),
                "scatter_m": round(tie.scatter_m, 5),
                "tension": round(net.tension[one, other], 2),
            }
        )
    return rows


def moved_figures(found: ChangeFigures, left: tuple[float, float]) -> dict[str, Any]:
    """Soil moved between two dates: the mean change of what both saw, for all ground worked."""
    off_m, sigma_m = left
    mean, sigma = found.mean_m - off_m, math.hypot(sigma_m, found.noise_m, found.unseen_m, found.hidden_m)
    still = found.untouched_m
    median = float(np.median(still)) if len(still) else math.nan
    spread = 1.4826 * float(np.median(np.abs(still - median))) if len(still) else math.nan
    figures = {
        "worked_m2": found.worked_m2,
        "compared_m2": found.compared_m2,
        "mean_change_m": mean,
        "mean_change_sigma_m": sigma,
        "volume_m3": mean * found.worked_m2,
        "volume_sigma_m3": sigma * found.worked_m2,
        "bend_m": off_m,
        "untouched_median_m": median,
        "untouched_spread_m": spread,
    }
    return {name: round(value, 5) if math.isfinite(value) else None for name, value in figures.items()}


def _values(move: FloatArray, sigma: FloatArray, *, known: bool) -> dict[str, float | None]:
    values: dict[str, float | None] = {}
    for name, value, one_sigma in zip(_FIELDS, move * _UNITS, sigma * _UNITS, strict=True):
        values[name] = round(float(value), 5) if known else None
        values[f"{name}_sigma"] = round(float(one_sigma), 5) if known else None
    return values
