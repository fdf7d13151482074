"""A stand that is no plot, from the heights of its returns: percentiles, gaps, and how its plants are layered."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray

PERCENTILES: Final = (5, 10, 25, 50, 75, 90, 95, 99)
MAX_LAYERS: Final = 10_000


@dataclass(frozen=True)
class Stand:
    """The stand on one area; heights above the ground; nan where no return shows them.

    Attributes:
        area_m2: of its pixels with returns, on the ground.
        gap_fraction: share of the returns from the ground.
        mean_height_m: of the returns from plants.
        percentiles_m: of their heights, for PERCENTILES.
        top_height_m: mean of the canopy height model, the highest return of each pixel; ground counts as 0.
        profile: share of all returns by layer, the lowest first.
    """

    id: str
    area_m2: float
    returns: int
    returns_m2: float
    gap_fraction: float
    mean_height_m: float
    height_sd_m: float
    percentiles_m: tuple[float, ...]
    max_height_m: float
    top_height_m: float
    top_sd_m: float
    profile: tuple[float, ...]


def stand_of(
    name: str, height_m: FloatArray, pixel: NDArray[np.int64], pixel_m2: float, ground_m: float, layer_m: float
) -> Stand:
    """The stand on an area.

    The gap fraction by returns is that of pulses where each pulse gives one return; where pulses give several, those
    that meet plants count more often, and gaps seem fewer. `height_m` (n,) are above the ground, returns up to
    `ground_m` of it; `pixel` (n,) is the pixel of the canopy height model; the lowest layer of `layer_m` has what lies
    below the ground, too.
    """
    plants = height_m[height_m > ground_m]
    _, at = np.unique(pixel, return_inverse=True)
    tops = np.full(int(at.max()) + 1 if len(at) else 0, -np.inf)
    np.maximum.at(tops, at, height_m)
    tops = np.where(tops > ground_m, tops, 0.0)
    known = len(height_m) > 0
    area = len(tops) * pixel_m2
    layer = np.clip(np.floor(height_m / layer_m), 0, MAX_LAYERS - 1).astype(np.intp)
    return Stand(
        id=name,
        area_m2=area,
        returns=len(height_m),
        returns_m2=len(height_m) / area if known else math.nan,
        gap_fraction=1.0 - len(plants) / len(height_m) if known else math.nan,
        mean_height_m=float(plants.mean()) if len(plants) else math.nan,
        height_sd_m=float(plants.std()) if len(plants) else math.nan,
        percentiles_m=tuple(np.percentile(plants, PERCENTILES).tolist())
        if len(plants)
        else (math.nan,) * len(PERCENTILES),
        max_height_m=float(plants.max()) if len(plants) else math.nan,
        top_height_m=float(tops.mean()) if known else math.nan,
        top_sd_m=float(tops.std()) if known else math.nan,
        profile=tuple((np.bincount(layer) / len(height_m)).tolist()) if known else (),
    )
