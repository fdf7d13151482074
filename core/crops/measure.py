"""Heights and volumes of parcels: from collected points to figures."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.crops.canopy import PIXEL_M, Canopy, canopy_top
from furrowmap.core.crops.figures import ParcelFigures, parcel_figures
from furrowmap.core.crops.parcel_points import ParcelPoints
from furrowmap.core.crops.published import christiansen2017
from furrowmap.core.crops.soil import Soil, SoilPatch
from furrowmap.core.readers.areas.rings import pixels_in
from furrowmap.core.runtime.threads import in_threads
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.values.parcel import Parcel

FloatArray = NDArray[np.float64]

Method = Literal["canopy-top", "christiansen2017"]
TOGETHER: Final = 16
"""So many parcels are measured before any of them is passed on."""
METHODS: Final[tuple[Method, ...]] = ("canopy-top", "christiansen2017")


@dataclass(frozen=True)
class MeasuredParcel:
    """One parcel, measured.

    Attributes:
        figures: of it, by the method asked for.
        published_height_m: mean height by the published method; nan where it was not computed.
        published_volume_m3: volume likewise.
    """

    parcel: Parcel
    figures: ParcelFigures
    published_height_m: float = math.nan
    published_volume_m3: float = math.nan


def measured(
    points: ParcelPoints,
    soil: Soil,
    noise_m: float,
    method: Method = "canopy-top",
    *,
    compare: bool = False,
    scale: float = 1.0,
) -> Iterator[tuple[MeasuredParcel, Canopy]]:
    """The parcels one after another, each with its pixels by the default method; a thread holds the points of one.

    Args:
        points: of the parcels; collected with a strip around them for the published method.
        soil: below them.
        noise_m: standard deviation of heights of returns from one place.
        method: by which mean height and volume are computed.
        compare: whether the published method is computed, too.
        scale: of the map: metres of it per metre on the ground, in which areas and volumes are.
    """

    def one(number: int) -> tuple[MeasuredParcel, Canopy]:
        parcel, xyz = points.parcels[number], points.of(number)
        height = volume = math.nan
        if (compare or method == "christiansen2017") and len(xyz):
            done = christiansen2017(xyz, parcel.net, parcel.gross, points.kept_shape(number))
            height, volume = done.mean_height_m, done.volume_m3 / scale**2
        canopy, patch = _canopy(parcel, xyz, soil.under(parcel), noise_m)
        figures = parcel_figures(
            parcel.id, canopy, float(parcel.net.area) / scale**2, patch.sigma_m if patch is not None else math.nan
        )
        if method == "christiansen2017":
            figures = replace(
                figures, mean_height_m=height, volume_m3=volume, height_sigma_m=math.nan, volume_sigma_m3=math.nan
            )
        return MeasuredParcel(parcel, figures, height, volume), canopy

    for begin in range(0, len(points.parcels), TOGETHER):
        numbers = range(begin, min(begin + TOGETHER, len(points.parcels)))
        yield from chain.from_iterable(in_threads(lambda some: [one(number) for number in some], numbers))


def _canopy(
    parcel: Parcel, xyz_m: FloatArray, patch: SoilPatch | None, noise_m: float
) -> tuple[Canopy, SoilPatch | None]:
    """The canopy of a parcel; nowhere seen without points or soil."""
    grid = Grid.of_bounds(PIXEL_M, parcel.net.bounds)
    net = pixels_in(parcel.net, grid)
    if patch is None:
        xyz_m = xyz_m[:0]
    height = xyz_m[:, 2] - patch.at(xyz_m[:, :2]) if patch is not None else np.zeros(0)
    return canopy_top(xyz_m[:, :2], height, grid, net, noise_m), patch
