"""How the soil's height differs between two flights of one site: what aligns them in height.

Bare ground that both flights see does not grow: the difference of its heights is that of the flights. It is an offset,
a tilt where that shows, and what departs from both from place to place.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.linalg import cho_solve
from scipy.stats import chi2

from furrowmap.core.crops.parcel_points import CellsNear
from furrowmap.core.crops.soil import (
    NODE_M,
    TRIED,
    Relief,
    Soil,
    SoilPatch,
    covariance_factor,
    fewer,
    least_squares,
    nearest,
    nodes_of,
    relief_of,
)
from furrowmap.core.crops.soil_cells import CELL_M, REJECTED, SoilCells
from furrowmap.core.values.parcel import Parcel

FloatArray = NDArray[np.float64]

FEWEST_COMMON: Final = 12
"""Cells that both flights see, with which an offset can be told."""
TREND_CELLS: Final = 800
"""Cells that offset and tilt are estimated from."""
TILT_P: Final = 0.01
"""Probability of a tilt so large where there is none, below which it is taken as one."""
_GROUP_CELLS: Final = 100
_ROUNDS: Final = 10


@dataclass(frozen=True)
class SoilChange:
    """Heights of the soil in one flight less those in another.

    Attributes:
        middle_m: (2,) easting and northing where `trend` has its offset.
        trend: (3,) offset in m, and its change per metre of easting and of northing; zeros where no tilt shows.
        covariance: (3, 3) of it.
        tilted: whether a tilt shows.
        relief: of what departs from the trend.
        departures: around each parcel by its id, from the trend.
        cells: number of cells that both flights see.
    """

    middle_m: FloatArray
    trend: FloatArray
    covariance: FloatArray
    tilted: bool
    relief: Relief
    departures: dict[str, SoilCells]
    cells: int

    def trend_at(self, xy_m: FloatArray) -> FloatArray:
        """Offset and tilt (n,) at positions (n, 2)."""
        out: FloatArray = _design(xy_m, self.middle_m) @ self.trend
        return out

    def under(self, parcel: Parcel) -> SoilPatch:
        """The change under a net parcel, with the standard deviation of its mean: trend, and departures by kriging."""
        west, south, nodes, shape = nodes_of(parcel)
        inside = shapely.contains_xy(parcel.net.buffer(0.5 * NODE_M), nodes[:, 0], nodes[:, 1])
        design = _design(nodes, self.middle_m)
        heights = design @ self.trend
        of_mean = design[inside].mean(axis=0)
        variance = float(of_mean @ self.covariance @ of_mean)
        block = float(self.relief.between(nodes[inside], nodes[inside]).mean())
        cells = self.departures[parcel.id]
        if len(cells):
            factor = covariance_factor(cells, self.relief)
            near = self.relief.between(nodes, cells.xy_m)
            heights = heights + near @ cho_solve(factor, cells.height_m)
            mean_near = near[inside].mean(axis=0)
            block -= float(mean_near @ cho_solve(factor, mean_near))
        return SoilPatch(west, south, heights.reshape(shape), math.sqrt(max(variance + block, 0.0)))

    def plain(self) -> dict[str, Any]:
        """As reports have it."""
        names = ("offset", "tilt_east", "tilt_north")
        sigmas = np.sqrt(np.diag(self.covariance))
        out: dict[str, Any] = {"cells": self.cells, "tilted": self.tilted}
        for name, unit, value, sigma in zip(names, ("m", "1", "1"), self.trend, sigmas, strict=True):
            out |= {f"{name}_{unit}".removesuffix("_1"): round(float(value), 7)}
            out |= {f"{name}_sigma_{unit}".removesuffix("_1"): round(float(sigma), 7)}
        return out | {"departures_m": round(self.relief.relief_m, 5), "range_m": round(self.relief.range_m, 2)}


@dataclass(frozen=True)
class ChangedSoil:
    """The soil of one flight as another flight has it: a :class:`~furrowmap.core.crops.soil.Soil`.

    Attributes:
        soil: of the first flight.
        change: from the first to the other.
    """

    soil: Soil
    change: SoilChange

    def under(self, parcel: Parcel) -> SoilPatch | None:
        """The soil under the net parcel; its standard deviation is that of `soil`."""
        patch = self.soil.under(parcel)
        if patch is None:
            return None
        moved = self.change.under(parcel)
        return SoilPatch(patch.west_m, patch.south_m, patch.height_m + moved.height_m, patch.sigma_m)


def soil_change(before: SoilCells, after: SoilCells, parcels: Sequence[Parcel]) -> SoilChange | None:
    """The change of the soil between two flights; None if they see too little of the same bare ground.

    Offset and tilt are by generalised least squares; how departures vary with distance is estimated by restricted
    maximum likelihood, as the relief of the soil is. A tilt shows if Wald's statistic of both slopes is larger than in
    one of a hundred cases without one.

    Args:
        before: cells of bare soil of the first flight.
        after: of the other.
        parcels: around which the cells lie.
    """
    both = _even(_differences(before, after))
    if len(both) < FEWEST_COMMON:
        return None
    near = CellsNear(parcels, both)
    full = [cells for cells in near.values() if len(cells) >= FEWEST_COMMON]
    step = max(1, len(full) // TRIED)
    relief = relief_of([fewer(cells, _GROUP_CELLS) for cells in full[::step][:TRIED]] or [fewer(both, _GROUP_CELLS)])
    some = fewer(both, TREND_CELLS)
    middle = some.xy_m.mean(axis=0)
    trend, covariance, _ = least_squares(some, relief, _design(some.xy_m, middle))
    slopes = trend[1:]
    wald = float(slopes @ np.linalg.solve(covariance[1:, 1:], slopes))
    tilted = wald > chi2.isf(TILT_P, 2)
    if not tilted:
        offset, variance, _ = least_squares(some, relief, np.ones((len(some), 1)))
        trend, covariance = np.array([offset[0], 0.0, 0.0]), np.diag([variance[0, 0], 0.0, 0.0])
    departures = {}
    for parcel in parcels:
        own = nearest(near[parcel.id], parcel)
        off = own.height_m - _design(own.xy_m, middle) @ trend
        departures[parcel.id] = SoilCells(own.xy_m, off, own.sigma_m)
    return SoilChange(middle, trend, covariance, bool(tilted), relief, departures, len(both))


def joined_cells(flights: Sequence[SoilCells]) -> SoilCells:
    """The cells of several aligned flights as one: the mean height where more than one sees a cell."""
    xy, height, sigma = (np.concatenate([getattr(f, name) for f in flights]) for name in vars(flights[0]))
    _, at, count = np.unique(_keys(xy), axis=0, return_inverse=True, return_counts=True)

    def mean(values: FloatArray) -> FloatArray:
        out: FloatArray = np.bincount(at, values) / count
        return out

    corner = xy[0] if len(xy) else np.zeros(2)
    place = np.column_stack([mean(xy[:, k] - corner[k]) + corner[k] for k in range(2)])
    return SoilCells(place, mean(height), np.sqrt(mean(sigma**2) / count))


def _keys(xy_m: FloatArray) -> NDArray[np.int64]:
    return np.floor(xy_m / CELL_M).astype(np.int64)


def _differences(before: SoilCells, after: SoilCells) -> SoilCells:
    """Heights after less before in the cells that both have."""
    first = {tuple(key): k for k, key in enumerate(_keys(before.xy_m).tolist())}
    pairs = [(first.get(tuple(key), -1), k) for k, key in enumerate(_keys(after.xy_m).tolist())]
    a, b = np.array([pair for pair in pairs if pair[0] >= 0], np.intp).reshape(-1, 2).T
    return SoilCells(
        0.5 * (before.xy_m[a] + after.xy_m[b]),
        after.height_m[b] - before.height_m[a],
        np.hypot(before.sigma_m[a], after.sigma_m[b]),
    )


def _even(cells: SoilCells) -> SoilCells:
    """Differences without those that lie off a plane: weeds, or crop that one flight found there."""
    kept = np.ones(len(cells), np.bool_)
    if len(cells) < FEWEST_COMMON:
        return cells
    design = _design(cells.xy_m, cells.xy_m.mean(axis=0))
    off = cells.height_m - np.median(cells.height_m)
    for _ in range(_ROUNDS):
        now = np.abs(off) <= max(REJECTED * 1.4826 * float(np.median(np.abs(off[kept]))), 1e-4)
        if (now == kept).all() or now.sum() < FEWEST_COMMON:
            break
        kept = now
        off = cells.height_m - design @ np.linalg.lstsq(design[kept], cells.height_m[kept])[0]
    return cells.at(kept)


def _design(xy_m: FloatArray, middle_m: FloatArray) -> FloatArray:
    return np.column_stack([np.ones(len(xy_m)), xy_m - middle_m])
