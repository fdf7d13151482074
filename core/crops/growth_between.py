"""Growth of parcels between flights, whose heights the bare soil that they have in common aligns."""

import datetime as dt
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import numpy as np
from scipy.linalg import cho_solve
from scipy.special import chdtri

from furrowmap.core.crops.bare_soil import (
    MIN_CELL_POINTS,
    OUTLIER_SIGMAS,
    SOIL_CELL_M,
    HeightCovariance,
    SoilCells,
    SoilPatch,
    estimate_covariance,
    least_squares,
    patch_nodes,
    plane_design,
)
from furrowmap.core.crops.canopy_height import CROP_PIXEL_M
from furrowmap.core.crops.measure import measure_parcels
from furrowmap.core.crops.parcel_points import CellsNear, ParcelPoints
from furrowmap.core.crops.site_soil import SAMPLED_CELLS, SoilAround, sample_surroundings, soil_around
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.values.parcel import Parcel

MIN_COMMON_CELLS: Final = 12
"""Cells that two flights have in common, for an offset between them."""
TREND_CELLS: Final = 800
"""Cells that offset and tilt are estimated from."""
TILT_P: Final = 0.01
"""Significance level of a tilt."""


@dataclass(frozen=True)
class Growth:
    """Growth of a parcel: slope of its height by least squares, its standard deviation or nan, and days covered."""

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
    """The growth of each parcel with heights (m above the soil by parcel, a mapping a flight) of two days or more.

    They come in the order in which they appear. Raises ValueError if two flights have the same day.
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


@dataclass(frozen=True)
class SoilChange:
    """Heights of the soil in one flight less those in another: what aligns them in height.

    Bare ground that both flights see does not grow: the difference of its heights is that of the flights. It is an
    offset, a tilt where that shows, and what departs from both from place to place.

    Attributes:
        middle_m: (2,) easting and northing where `trend` has its offset.
        trend: (3,) offset in m, and its change per metre of easting and of northing; zeros where no tilt shows.
        covariance: (3, 3) of it.
        tilted: whether a tilt shows.
        departure: covariance of what departs from the trend.
        departures: around each parcel by its id, from the trend.
    """

    middle_m: FloatArray
    trend: FloatArray
    covariance: FloatArray
    tilted: bool
    departure: HeightCovariance
    departures: dict[str, SoilCells]
    cells: int

    def trend_at(self, xy_m: FloatArray) -> FloatArray:
        """Offset and tilt (n,) at positions (n, 2)."""
        out: FloatArray = plane_design(xy_m, self.middle_m) @ self.trend
        return out

    def under(self, parcel: Parcel) -> SoilPatch:
        """The change under a net parcel, with the standard deviation of its mean: trend, and departures by kriging."""
        nodes = patch_nodes(parcel)
        design = plane_design(nodes.xy_m, self.middle_m)
        heights = design @ self.trend
        of_mean = design[nodes.inside].mean(axis=0)
        under = nodes.xy_m[nodes.inside]
        block = float(self.departure.between(under, under).mean())
        cells = self.departures[parcel.id]
        if len(cells):
            factor = self.departure.factor(cells)
            near = self.departure.between(nodes.xy_m, cells.xy_m)
            heights = heights + near @ cho_solve(factor, cells.height_m)
            mean_near = near[nodes.inside].mean(axis=0)
            block -= float(mean_near @ cho_solve(factor, mean_near))
        return nodes.patch(heights, math.sqrt(max(float(of_mean @ self.covariance @ of_mean) + block, 0.0)))

    def plain(self) -> dict[str, Any]:
        """As reports have it."""
        names = ("offset", "tilt_east", "tilt_north")
        sigmas = np.sqrt(np.diag(self.covariance))
        out: dict[str, Any] = {"cells": self.cells, "tilted": self.tilted}
        for name, unit, value, sigma in zip(names, ("_m", "", ""), self.trend, sigmas, strict=True):
            out |= {f"{name}{unit}": round(float(value), 7), f"{name}_sigma{unit}": round(float(sigma), 7)}
        departure = {"departures_m": round(self.departure.relief_m, 5), "range_m": round(self.departure.range_m, 2)}
        return out | departure


def soil_change(before: SoilCells, after: SoilCells, parcels: Sequence[Parcel]) -> SoilChange | None:
    """The change of the soil between two flights; None if they see too little of the same bare ground.

    Offset and tilt are by generalised least squares; how departures vary with distance is estimated by restricted
    maximum likelihood, as that of the soil is. A tilt shows if Wald's statistic of both slopes is larger than in one of
    a hundred cases without one.
    """
    # Heights after less before in the cells that both have.
    first, second = (np.floor(cells.xy_m / SOIL_CELL_M).tolist() for cells in (before, after))
    number = {tuple(key): k for k, key in enumerate(first)}
    pairs = [(number[tuple(key)], k) for k, key in enumerate(second) if tuple(key) in number]
    a, b = np.array(pairs, np.intp).reshape(-1, 2).T
    differences = SoilCells(
        0.5 * (before.xy_m[a] + after.xy_m[b]),
        after.height_m[b] - before.height_m[a],
        np.hypot(before.sigma_m[a], after.sigma_m[b]),
    )
    both = _without_outliers(differences)
    if len(both) < MIN_COMMON_CELLS:
        return None
    near = CellsNear(parcels, both)
    sample = sample_surroundings(list(near.values()), MIN_COMMON_CELLS) or [both.thinned(SAMPLED_CELLS)]
    departure = estimate_covariance(sample)
    some = both.thinned(TREND_CELLS)
    middle = some.xy_m.mean(axis=0)
    trend, covariance, _ = least_squares(some, departure, plane_design(some.xy_m, middle))
    slopes = trend[1:]
    wald = float(slopes @ np.linalg.solve(covariance[1:, 1:], slopes))
    tilted = wald > chdtri(2, TILT_P)
    if not tilted:
        offset, variance, _ = least_squares(some, departure, np.ones((len(some), 1)))
        trend = np.array([offset[0], 0.0, 0.0])
        covariance = np.diag([variance[0, 0], 0.0, 0.0])
    departures = {}
    for parcel in parcels:
        own = near[parcel.id].nearest(parcel)
        departures[parcel.id] = replace(own, height_m=own.height_m - plane_design(own.xy_m, middle) @ trend)
    return SoilChange(middle, trend, covariance, bool(tilted), departure, departures, len(both))


def joined_cells(flights: Sequence[SoilCells]) -> SoilCells:
    """The cells of several aligned flights as one: the mean height where more than one sees a cell."""
    xy, height, sigma = (np.concatenate([getattr(f, name) for f in flights]) for name in vars(flights[0]))
    _, at, count = np.unique(np.floor(xy / SOIL_CELL_M), axis=0, return_inverse=True, return_counts=True)

    def mean(values: FloatArray) -> FloatArray:
        out: FloatArray = np.bincount(at, values) / count
        return out

    corner = xy[0] if len(xy) else np.zeros(2)
    place = np.column_stack([mean(xy[:, k] - corner[k]) + corner[k] for k in range(2)])
    return SoilCells(place, mean(height), np.sqrt(mean(sigma**2) / count))


def _without_outliers(cells: SoilCells) -> SoilCells:
    """Differences without those that lie off a plane: weeds, or crop that one flight found there."""
    kept = np.ones(len(cells), np.bool_)
    if len(cells) < MIN_COMMON_CELLS:
        return cells
    design = plane_design(cells.xy_m, cells.xy_m.mean(axis=0))
    off = cells.height_m - np.median(cells.height_m)
    for _ in range(10):
        now = np.abs(off) <= max(OUTLIER_SIGMAS * 1.4826 * float(np.median(np.abs(off[kept]))), 1e-4)
        if (now == kept).all() or now.sum() < MIN_COMMON_CELLS:
            break
        kept = now
        off = cells.height_m - design @ np.linalg.lstsq(design[kept], cells.height_m[kept])[0]
    return cells.at(kept)


def align_flights(days: Sequence[dt.date], flights: Sequence[ParcelPoints]) -> tuple[list[SoilCells], list[SoilChange]]:
    """Bare soil of each flight, and its change from the first. Raises InputError if they have too little in common."""
    cells = [points.soil() for points in flights]
    changes = []
    for day, other in zip(days[1:], cells[1:], strict=True):
        change = soil_change(cells[0], other, flights[0].parcels)
        if change is None:
            raise InputError(
                "growth-soil", fewest_common=MIN_COMMON_CELLS, fewest=MIN_CELL_POINTS, days=days[0], day=day
            )
        changes.append(change)
    return cells, changes


@dataclass(frozen=True)
class GrownParcel:
    """One parcel on k days.

    Attributes:
        height_m: of each day, above the soil that all flights share; nan where the points do not show it.
        height_sigma_m: standard deviations, with those of the soil.
        steps: growth from each day to the next; None where a height is not known.
        growth: over all days; None with heights of fewer than two.
    """

    parcel: Parcel
    height_m: tuple[float, ...]
    height_sigma_m: tuple[float, ...]
    steps: tuple[Growth | None, ...]
    growth: Growth | None


def measure_growth(
    days: Sequence[dt.date],
    flights: Sequence[ParcelPoints],
    cells: Sequence[SoilCells],
    changes: Sequence[SoilChange],
    progress: Progress,
) -> tuple[GrownParcel, ...]:
    """Heights of parcels on several days above one soil, and what they grew.

    The soil under the crop is that of all flights together: where it is wrong, it is so for each of them, and the
    growth does not change. Its standard deviation is therefore in that of the heights, and not in that of the growth,
    which has those of the canopies and of the alignment.

    Args:
        days: of k flights, increasing.
        changes: of the soil from the first flight to each of the others.
    """
    parcels = flights[0].parcels
    moved = [
        replace(own, height_m=own.height_m - change.trend_at(own.xy_m))
        for own, change in zip(cells[1:], changes, strict=True)
    ]
    soil = soil_around(CellsNear(parcels, joined_cells([cells[0], *moved])))
    heights = []
    stated = []
    alone = []
    for number, (points, change) in enumerate(zip(flights, [None, *changes], strict=True)):
        height = {}
        sigma = {}
        own = {}
        changed = {each.id: change.under(each) for each in parcels} if change is not None else {}
        measured = measure_parcels(points, partial(_changed_soil, soil, changed), points.noise_m(CROP_PIXEL_M))
        for k, (row, _) in enumerate(measured):
            name = row.parcel.id
            figures = row.figures
            aligned = changed[name].sigma_m if changed else 0.0
            height[name] = figures.mean_height_m
            sigma[name] = math.hypot(figures.height_sigma_m, aligned)
            canopy = math.sqrt(max(figures.height_sigma_m**2 - figures.soil_sigma_m**2, 0.0))
            own[name] = math.hypot(canopy, aligned)
            progress("measuring parcels", (number + (k + 1) / len(parcels)) / len(flights))
        heights.append(height)
        stated.append(sigma)
        alone.append(own)
    steps = [
        {each.id: each for each in growth_of(days[k : k + 2], heights[k : k + 2], alone[k : k + 2])}
        for k in range(len(days) - 1)
    ]
    whole = {each.id: each for each in growth_of(days, heights, alone)}
    return tuple(
        GrownParcel(
            parcel,
            tuple(height[parcel.id] for height in heights),
            tuple(sigma[parcel.id] for sigma in stated),
            tuple(step.get(parcel.id) for step in steps),
            whole.get(parcel.id),
        )
        for parcel in parcels
    )


def _changed_soil(soil: SoilAround, changed: Mapping[str, SoilPatch], parcel: Parcel) -> SoilPatch | None:
    """The soil under a parcel on the day of another flight."""
    patch = soil.under(parcel)
    if patch is None or parcel.id not in changed:
        return patch
    return replace(patch, height_m=patch.height_m + changed[parcel.id].height_m)
