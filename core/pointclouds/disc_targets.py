"""Disc targets: the centre of a disc that is brighter or darker than the ground around it."""

from typing import Final

import numpy as np

from furrowmap.core.runtime.arrays import FloatArray

STEP_SHARE: Final = 0.15
"""Spacing of the search grid, in disc diameters."""
MIN_DISC_RETURNS: Final = 8
MIN_CONTRAST_ERRORS: Final = 6.0
"""Least contrast of a disc, in standard errors from the variation of the ground."""
MIN_CONTRAST_SIGMAS: Final = 2.0
"""And in standard deviations of the brightness of the ground."""
FINE_SHARE: Final = 0.6
FINE_STEPS: Final = 61
"""Extent of the fine search in radii, and its steps along each axis."""


def find_disc(xy_m: FloatArray, brightness: FloatArray, diameter_m: float, search_m: float) -> FloatArray | None:
    """Centre (2,) of a disc that is brighter or darker than the ground around it; None where none is found.

    A grid search for the greatest contrast between the disc and the ring around it, then a fit of its edge. Places (n,
    2) of the returns are relative to the expected centre, from which it lies within `search_m`; brightness (n,) is
    intensity or luminance.
    """
    radius = 0.5 * diameter_m
    steps = np.arange(-search_m, search_m + 1e-9, STEP_SHARE * diameter_m)
    places = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    places = places[np.hypot(*places.T) <= search_m]
    best = None
    surest = MIN_CONTRAST_ERRORS
    for place in places:
        contrast = _contrast(np.hypot(*(xy_m - place).T), brightness, radius)
        if contrast is not None and abs(contrast) > surest:
            best = place
            surest = abs(contrast)
    return _centred(xy_m, brightness, best, radius) if best is not None else None


def _contrast(distance_m: FloatArray, brightness: FloatArray, radius_m: float) -> float | None:
    """Difference of the means of disc and ring in standard errors; None with too few returns or too little contrast."""
    inside = brightness[distance_m < 0.9 * radius_m]
    around = brightness[(distance_m > 1.1 * radius_m) & (distance_m < 2.0 * radius_m)]
    if min(len(inside), len(around)) < MIN_DISC_RETURNS:
        return None
    difference = float(inside.mean() - around.mean())
    uneven = float(around.std()) + 1e-9 * (1.0 + abs(float(around.mean())))
    if abs(difference) < MIN_CONTRAST_SIGMAS * uneven:
        return None
    return difference / (uneven * float(np.sqrt(1.0 / len(inside) + 1.0 / len(around))))


def _centred(xy_m: FloatArray, brightness: FloatArray, middle: FloatArray, radius_m: float) -> FloatArray:
    """Centre of the disc whose edge best parts brighter and darker returns; the mean of equally good ones."""
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
