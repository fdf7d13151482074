"""Figures of a parcel from the height of its canopy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter
from scipy.special import ndtri

from furrowmap.core.crops.canopy import Canopy
from furrowmap.core.crops.penetration import MODEL_SHARE

FloatArray = NDArray[np.float64]

STANDS_M: Final = 0.10
"""Least height of a pixel that counts as covered."""
ROUGHNESS_M: Final = 0.20
"""Side of the squares about whose mean roughness is measured."""
LODGED: Final = 0.6
"""Share of the height of the upper tenth of a parcel below which a square is low."""
LODGED_SHARE: Final = 0.1
"""Share of low squares from which a parcel is marked."""
NOISE_SHARE: Final = 0.15
"""Standard deviation of the noise, as a share: the crop may scatter otherwise than the soil."""
EXTRAPOLATED_SHARE: Final = 0.5
"""Standard deviation of the extrapolation to many returns, as a share."""
CORRELATED_PIXELS: Final = 9.0
"""Neighbouring pixels that vary together."""


@dataclass(frozen=True)
class ParcelFigures:
    """Figures of one parcel; heights above the soil; nan where the points do not show them.

    Attributes:
        points: in the net parcel.
        points_m2: per square metre.
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
        height_sigma_m: standard deviation of the mean height.
        volume_sigma_m3: standard deviation of the volume.
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
    height_sigma_m: float
    volume_sigma_m3: float


def parcel_figures(name: str, canopy: Canopy, area_m2: float, soil_sigma_m: float) -> ParcelFigures:
    """The figures of a canopy on a net parcel of some area."""
    top = canopy.top_m[canopy.net]
    points = int(canopy.returns.count[canopy.net].sum())
    known = bool(np.isfinite(top).all()) and len(top) > 0
    mean = float(top.mean()) if known else math.nan
    true = _without_chance(top, canopy.chance_m) if known else np.full(max(len(top), 1), np.nan)
    spread = float(true.std())
    smooth = _smooth(canopy, ROUGHNESS_M) if known else canopy.top_m
    quantiles = _quantiles(true, (0.50, 0.90, 0.95, 0.99))
    sigma = math.hypot(_height_sigma_m(canopy, spread), soil_sigma_m) if known else math.nan
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
        roughness_m=_roughness_m(canopy, smooth) if known else math.nan,
        lodging=known and _low_share(smooth[canopy.net]) >= LODGED_SHARE,
        penetration_m=canopy.penetration.mean_depth_m if canopy.penetration is not None else math.nan,
        soil_sigma_m=soil_sigma_m,
        height_sigma_m=sigma,
        volume_sigma_m3=sigma * area_m2,
    )


def _quantiles(values: FloatArray, shares: Sequence[float]) -> list[float]:
    """Quantiles of values (n,), as NumPy's; sorting once is faster than its partitions for several."""
    place = np.array(shares) * (len(values) - 1)
    low = place.astype(np.int64)
    ordered = np.sort(values)
    below, above = ordered[low], ordered[np.minimum(low + 1, len(values) - 1)]
    out: list[float] = (below + (place - low) * (above - below)).tolist()
    return out


def _without_chance(top: FloatArray, chance_m: float) -> FloatArray:
    """Heights (n,) of the net pixels, drawn towards their median by as much as chance spreads them."""
    (middle,) = _quantiles(top, (0.5,))
    stands = top >= STANDS_M
    variance = float(top[stands].var()) if stands.any() else 0.0
    left = math.sqrt(max(variance - chance_m**2, 0.25 * variance) / variance) if variance > 0.0 else 1.0
    return np.where(stands, np.maximum(middle + left * (top - middle), 0.0), top)


def _height_sigma_m(canopy: Canopy, spread_m: float) -> float:
    """Standard deviation of the mean height but for the soil: by chance, model, noise, filling, extrapolation."""
    found = canopy.penetration
    if found is None:
        return float("nan")
    seen = max(int(canopy.seen.sum()), 1)
    chance = math.hypot(spread_m * math.sqrt(CORRELATED_PIXELS), canopy.error_m) / math.sqrt(seen)
    model = MODEL_SHARE * found.mean_depth_m
    noise = NOISE_SHARE * found.noise_m
    # pixels without returns are between like the others and the lowest of all: as much below the mean as the tail
    # of a normal distribution, a third of whose square is the variance of what is spread evenly between both
    missing = 1.0 - int(canopy.seen.sum()) / max(int(canopy.net.sum()), 1)
    empty = spread_m * math.exp(-0.5 * ndtri(missing) ** 2) / math.sqrt(2.0 * math.pi * 3.0)
    return math.sqrt(chance**2 + model**2 + noise**2 + empty**2 + (EXTRAPOLATED_SHARE * canopy.extrapolated_m) ** 2)


def _roughness_m(canopy: Canopy, smooth_m: FloatArray) -> float:
    """Standard deviation of the heights about the mean of the squares around, less that of chance."""
    off = (canopy.top_m - smooth_m)[canopy.net]
    return math.sqrt(max(float(off.var()) - canopy.chance_m**2, 0.0))


def _low_share(smooth_m: FloatArray) -> float:
    """Share of the net pixels whose surroundings, of mean heights (n,), are low."""
    return float((smooth_m < LODGED * _quantiles(smooth_m, (0.9,))[0]).mean())


def _smooth(canopy: Canopy, side_m: float) -> FloatArray:
    """Mean height (rows, columns) of the net pixels in the square around each."""
    size = 2 * round(0.5 * side_m / canopy.grid.cell_m) + 1
    weight = uniform_filter(canopy.net.astype(np.float64), size, mode="constant")
    total = uniform_filter(np.where(canopy.net, canopy.top_m, 0.0), size, mode="constant")
    out: FloatArray = total / np.maximum(weight, 1e-9)
    return out
