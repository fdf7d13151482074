"""Discs laid out as targets, found in a cloud by their brightness."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

STEP_SHARE: Final = 0.15
"""Of a disc's diameter between places at which it is looked for."""
FEWEST_RETURNS: Final = 8
SURE: Final = 6.0
"""Contrast over its standard error, as far as the ground's own unevenness makes it, from which on a disc is one."""
CONTRAST: Final = 2.0
"""And a disc differs by so many standard deviations of the ground's brightness."""
FINE_SHARE: Final = 0.6
FINE_STEPS: Final = 61
"""The middle is sought so far around the best place, in parts of the radius, in so many steps along each axis."""


def find_disc(xy_m: FloatArray, brightness: FloatArray, diameter_m: float, search_m: float) -> FloatArray | None:
    """Where the middle of a disc lies that is brighter or darker than the ground around it; None where none shows.

    The disc is laid over the returns at places on a grid, and the place taken where inside and the ring around it
    differ most; then its edge is fitted to the returns that are brighter or darker.

    Args:
        xy_m: (n, 2) returns from where the disc is expected, which is 0, 0.
        brightness: (n,) intensity, or luminance.
        diameter_m: of the disc.
        search_m: how far its middle may be from where it is expected.

    Returns:
        (2,) its middle.
    """
    radius = 0.5 * diameter_m
    steps = np.arange(-search_m, search_m + 1e-9, STEP_SHARE * diameter_m)
    places = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    places = places[np.hypot(*places.T) <= search_m]
    best, surest = None, SURE
    for place in places:
        contrast = _contrast(np.hypot(*(xy_m - place).T), brightness, radius)
        if contrast is not None and abs(contrast) > surest:
            best, surest = place, abs(contrast)
    return _centred(xy_m, brightness, best, radius) if best is not None else None


def _contrast(distance_m: FloatArray, brightness: FloatArray, radius_m: float) -> float | None:
    """Difference of means of a disc and the ring round it, over its standard error.

    None with too few returns, or too little contrast.
    """
    inside = brightness[distance_m < 0.9 * radius_m]
    around = brightness[(distance_m > 1.1 * radius_m) & (distance_m < 2.0 * radius_m)]
    if min(len(inside), len(around)) < FEWEST_RETURNS:
        return None
    difference = float(inside.mean() - around.mean())
    uneven = float(around.std()) + 1e-9 * (1.0 + abs(float(around.mean())))
    if abs(difference) < CONTRAST * uneven:
        return None
    return difference / (uneven * float(np.sqrt(1.0 / len(inside) + 1.0 / len(around))))


def _centred(xy_m: FloatArray, brightness: FloatArray, middle: FloatArray, radius_m: float) -> FloatArray:
    """The middle of the discs that part the returns best, near a place: its returns inside, the ground's outside.

    The brightness of returns tells of which they are; where discs a little apart part them equally well, the mean of
    their middles stands for all. The edge holds the middle better than the returns' mean would.
    """
    distance = np.hypot(*(xy_m - middle).T)
    inside = float(np.median(brightness[distance < 0.8 * radius_m]))
    around = float(np.median(brightness[(distance > 1.2 * radius_m) & (distance < 2.0 * radius_m)]))
    near = distance < 2.5 * radius_m
    own = np.where(np.abs(brightness[near] - inside) < np.abs(brightness[near] - around), 1.0, -1.0)
    steps = np.linspace(-FINE_SHARE, FINE_SHARE, FINE_STEPS) * radius_m
    places = middle + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    apart = np.hypot(*(xy_m[near][:, None] - places[None]).transpose(2, 0, 1))
    score = own @ (apart < radius_m)
    return np.asarray(places[score >= score.max() - 0.5].mean(axis=0), np.float64)
