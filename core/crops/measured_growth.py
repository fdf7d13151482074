"""Growth of parcels from flights whose soils are aligned."""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Sequence
from dataclasses import dataclass

from furrowmap.core.crops.canopy import PIXEL_M
from furrowmap.core.crops.growth import Growth, growth_of
from furrowmap.core.crops.measure import measured
from furrowmap.core.crops.parcel_points import CellsNear, ParcelPoints
from furrowmap.core.crops.soil import soil_around
from furrowmap.core.crops.soil_cells import SoilCells
from furrowmap.core.crops.soil_change import ChangedSoil, SoilChange, joined_cells, soil_change
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.values.parcel import Parcel


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


@dataclass(frozen=True)
class MeasuredGrowth:
    """The growth of a trial.

    Attributes:
        parcels: of the trial.
        changes: of the soil from the first flight to each other.
    """

    parcels: tuple[GrownParcel, ...]
    changes: tuple[SoilChange, ...]


def soil_changes(flights: Sequence[ParcelPoints]) -> tuple[list[SoilCells], list[SoilChange | None]]:
    """Bare soil of each flight, and its change from the first flight to each other; None where too little is common."""
    cells = [points.soil() for points in flights]
    return cells, [soil_change(cells[0], other, flights[0].parcels) for other in cells[1:]]


def measured_growth(
    days: Sequence[dt.date],
    flights: Sequence[ParcelPoints],
    cells: Sequence[SoilCells],
    changes: Sequence[SoilChange],
    progress: Progress,
) -> MeasuredGrowth:
    """Heights of parcels on several days above one soil, and what they grew.

    The soil under the crop is that of all flights together: where it is wrong, it is so for each of them, and the
    growth does not change. Its standard deviation is therefore in that of the heights, and not in that of the growth,
    which has those of the canopies and of the alignment.

    Args:
        days: of k flights, increasing.
        flights: points of the same parcels.
        cells: bare soil of each.
        changes: of the soil from the first flight to each of the others.
        progress: receives the stage "measuring parcels".
    """
    parcels = flights[0].parcels
    moved = [
        SoilCells(own.xy_m, own.height_m - change.trend_at(own.xy_m), own.sigma_m)
        for own, change in zip(cells[1:], changes, strict=True)
    ]
    soil = soil_around(CellsNear(parcels, joined_cells([cells[0], *moved])))
    heights, stated, alone = [], [], []
    for number, points in enumerate(flights):
        change = changes[number - 1] if number else None
        height, sigma, own = {}, {}, {}
        below = soil if change is None else ChangedSoil(soil, change)
        for k, (row, _) in enumerate(measured(points, below, points.noise_m(PIXEL_M))):
            name, figures = row.parcel.id, row.figures
            aligned = change.under(row.parcel).sigma_m if change is not None else 0.0
            height[name], sigma[name] = figures.mean_height_m, math.hypot(figures.height_sigma_m, aligned)
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
    grown = tuple(
        GrownParcel(
            parcel,
            tuple(height[parcel.id] for height in heights),
            tuple(sigma[parcel.id] for sigma in stated),
            tuple(step.get(parcel.id) for step in steps),
            whole.get(parcel.id),
        )
        for parcel in parcels
    )
    return MeasuredGrowth(grown, tuple(changes))
