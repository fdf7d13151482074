"""Heights and volumes of parcels: from collected points to figures."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Final, Literal

import numpy as np
from scipy.ndimage import uniform_filter
from scipy.special import ndtri

from furrowmap.core.crops.bare_soil import SoilPatch
from furrowmap.core.crops.canopy_height import CROP_PIXEL_M, MODEL_SHARE, Canopy, canopy_top, penetration_table
from furrowmap.core.crops.parcel_points import ParcelPoints
from furrowmap.core.crops.published import christiansen2017
from furrowmap.core.readers.areas.rings import pixels_in
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.background import in_threads
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.values.parcel import Parcel

Method = Literal["canopy-top", "christiansen2017"]
METHODS: Final[tuple[Method, ...]] = ("canopy-top", "christiansen2017")
TOGETHER: Final = 16
"""Parcels that are measured at once."""
STANDS_M: Final = 0.10
"""Least height of a pixel that counts as covered."""
ROUGHNESS_M: Final = 0.20
"""Side of the squares about whose mean roughness is measured."""
LODGED: Final = 0.6
"""Share of the height of the upper tenth of a parcel below which a square is low."""
LODGED_SHARE: Final = 0.1
"""Share of low squares from which a parcel is marked."""
BLUR_SHARE: Final = 0.5
"""Variance of the place of a return on each horizontal axis, as a share of that of its height. Noise of ranges at 45°
makes a quarter; the width of beams and the trajectory are taken to make as much."""
NOISE_SHARE: Final = 0.15
"""Standard deviation of the noise, as a share: the crop may scatter otherwise than the soil."""
EXTRAPOLATED_SHARE: Final = 0.5
"""Standard deviation of the extrapolations to many returns and to no horizontal noise, as a share of each."""
CORRELATED_PIXELS: Final = 9.0
"""Neighbouring pixels that vary together."""


@dataclass(frozen=True)
class ParcelFigures:
    """Figures of one parcel; heights above the soil; nan where the points do not show them.

    Attributes:
        area_m2: of the net parcel, on the ground.
        filled: share of net pixels without returns.
        mean_height_m: mean height of the canopy's top over all net pixels, gaps included.
        p50_m, p90_m, p95_m, p99_m: quantiles of it.
        volume_m3: mean height times area.
        cover: share of net pixels of at least 0.10 m.
        height_cv: standard deviation of the heights over their mean.
        roughness_m: standard deviation about the mean of the 0.2 m around.
        lodging: whether a tenth of the parcel or more lies below 0.6 of the height of its upper tenth.
        penetration_m: mean depth of a return below the top.
        soil_sigma_m: standard deviation of the mean height of the soil.
        common_sigma_m: part of `height_sigma_m` that all parcels of a flight share, and their differences do not have.
    """

    id: str
    points: int
    points_m2: float
    area_m2: float
    filled: float
    mean_height_m: float
    p50_m: float
    p90_m: float
    p95_m: float
    p99_m: float
    volume_m3: float
    cover: float
    height_cv: float
    roughness_m: float
    lodging: bool
    penetration_m: float
    soil_sigma_m: float
    common_sigma_m: float
    height_sigma_m: float
    volume_sigma_m3: float


@dataclass(frozen=True)
class MeasuredParcel:
    """One parcel, measured; `published_height_m` is its mean height by the published method, nan if not computed."""

    parcel: Parcel
    figures: ParcelFigures
    published_height_m: float = math.nan
    published_volume_m3: float = math.nan


def measure_parcels(
    points: ParcelPoints,
    soil_under: Callable[[Parcel], SoilPatch | None],
    noise_m: float,
    method: Method = "canopy-top",
    *,
    compare: bool = False,
    scale: float = 1.0,
) -> Iterator[tuple[MeasuredParcel, Canopy]]:
    """The parcels one after another, each with its pixels by the default method; a thread holds the points of one.

    `points` have a strip around the parcels for the published method; `soil_under` gives the soil under a net parcel or
    None; `scale` is metres of the map per metre on the ground, in which areas and volumes are.
    """

    def measure(number: int) -> tuple[MeasuredParcel, Canopy]:
        parcel, xyz = points.parcels[number], points.of(number)
        height = volume = math.nan
        if (compare or method == "christiansen2017") and len(xyz):
            done = christiansen2017(xyz, parcel.net, parcel.gross, points.kept[number])
            height = done.mean_height_m
            volume = done.volume_m3 / scale**2
        patch = soil_under(parcel)
        grid = Grid.of_bounds(CROP_PIXEL_M, parcel.net.bounds)
        xyz = xyz if patch is not None else xyz[:0]  # without soil no pixel has a height
        above = xyz[:, 2] - patch.at(xyz[:, :2]) if patch is not None else np.zeros(0)
        blur_m = noise_m * math.sqrt(BLUR_SHARE)
        canopy = canopy_top(xyz[:, :2], above, grid, pixels_in(parcel.net, grid), noise_m, blur_m)
        soil_sigma_m = patch.sigma_m if patch is not None else math.nan
        figures = parcel_figures(parcel.id, canopy, float(parcel.net.area) / scale**2, soil_sigma_m)
        if method == "christiansen2017":
            figures = replace(figures, mean_height_m=height, volume_m3=volume)
            figures = replace(figures, height_sigma_m=math.nan, volume_sigma_m3=math.nan)
        return MeasuredParcel(parcel, figures, height, volume), canopy

    penetration_table()  # once, not in each thread
    for begin in range(0, len(points.parcels), TOGETHER):
        numbers = range(begin, min(begin + TOGETHER, len(points.parcels)))
        yield from chain.from_iterable(in_threads(lambda some: [measure(number) for number in some], numbers))


def parcel_figures(name: str, canopy: Canopy, area_m2: float, soil_sigma_m: float) -> ParcelFigures:
    """The figures of a canopy on a net parcel of some area."""
    top = canopy.top_m[canopy.net]
    points = int(canopy.returns.count[canopy.net].sum())
    known = bool(np.isfinite(top).all()) and len(top) > 0
    mean = float(top.mean()) if known else math.nan
    true = _without_chance(top, canopy.chance_m) if known else np.full(max(len(top), 1), np.nan)
    spread = float(true.std())
    quantiles = _quantiles(true, (0.50, 0.90, 0.95, 0.99))
    common = _common_sigma_m(canopy) if known else math.nan
    sigma = math.hypot(_own_sigma_m(canopy, spread), common, soil_sigma_m) if known else math.nan
    roughness = math.nan
    lodging = False
    if known:
        # mean height of the net pixels in the square around each
        size = 2 * round(0.5 * ROUGHNESS_M / canopy.grid.cell_m) + 1
        weight = uniform_filter(canopy.net.astype(np.float64), size, mode="constant")
        total = uniform_filter(np.where(canopy.net, canopy.top_m, 0.0), size, mode="constant")
        smooth = total / np.maximum(weight, 1e-9)
        roughness = math.sqrt(max(float((canopy.top_m - smooth)[canopy.net].var()) - canopy.chance_m**2, 0.0))
        low = smooth[canopy.net] < LODGED * _quantiles(smooth[canopy.net], (0.9,))[0]
        lodging = float(low.mean()) >= LODGED_SHARE
    return ParcelFigures(
        id=name,
        points=points,
        points_m2=points / area_m2,
        area_m2=area_m2,
        filled=1.0 - float(canopy.seen.sum()) / max(int(canopy.net.sum()), 1),
        mean_height_m=mean,
        **dict(zip(("p50_m", "p90_m", "p95_m", "p99_m"), quantiles, strict=True)),
        volume_m3=mean * area_m2,
        cover=float((true >= STANDS_M).mean()) if known else math.nan,
        height_cv=spread / mean if known and mean > 0.0 else math.nan,
        roughness_m=roughness,
        lodging=lodging,
        penetration_m=canopy.penetration.mean_depth_m if canopy.penetration is not None else math.nan,
        soil_sigma_m=soil_sigma_m,
        common_sigma_m=common,
        height_sigma_m=sigma,
        volume_sigma_m3=sigma * area_m2,
    )


def _quantiles(values: FloatArray, shares: Sequence[float]) -> list[float]:
    """Quantiles of values (n,), as NumPy's; sorting once is faster than its partitions for several."""
    place = np.array(shares) * (len(values) - 1)
    low = place.astype(np.int64)
    ordered = np.sort(values)
    below = ordered[low]
    above = ordered[np.minimum(low + 1, len(values) - 1)]
    out: list[float] = (below + (place - low) * (above - below)).tolist()
    return out


def _without_chance(top: FloatArray, chance_m: float) -> FloatArray:
    """Heights (n,) of the net pixels, drawn towards their median by as much as chance spreads them."""
    (middle,) = _quantiles(top, (0.5,))
    stands = top >= STANDS_M
    variance = float(top[stands].var()) if stands.any() else 0.0
    left = math.sqrt(max(variance - chance_m**2, 0.25 * variance) / variance) if variance > 0.0 else 1.0
    return np.where(stands, np.maximum(middle + left * (top - middle), 0.0), top)


def _own_sigma_m(canopy: Canopy, spread_m: float) -> float:
    """Standard deviation of the mean height by what is of one parcel, but for the soil: by chance and filling."""
    seen = max(int(canopy.seen.sum()), 1)
    chance = math.hypot(spread_m * math.sqrt(CORRELATED_PIXELS), canopy.error_m) / math.sqrt(seen)
    # pixels without returns are between like the others and the lowest of all: as much below the mean as the tail
    # of a normal distribution, a third of whose square is the variance of what is spread evenly between both
    missing = 1.0 - int(canopy.seen.sum()) / max(int(canopy.net.sum()), 1)
    empty = spread_m * math.exp(-0.5 * ndtri(missing) ** 2) / math.sqrt(2.0 * math.pi * 3.0)
    return math.hypot(chance, empty)


def _common_sigma_m(canopy: Canopy) -> float:
    """Standard deviation of the mean height by what errs alike on all parcels: model, noise, extrapolation."""
    found = canopy.penetration
    if found is None:
        return math.nan
    extrapolated = EXTRAPOLATED_SHARE * math.hypot(canopy.extrapolated_m, canopy.sharpened_m)
    return math.hypot(MODEL_SHARE * found.mean_depth_m, NOISE_SHARE * found.noise_m, extrapolated)
