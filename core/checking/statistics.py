"""Error statistics of GNSS services.

Those of Nakagawa et al., *LiDAR scan matching with PPP-RTK for 3D farm mapping*, tables 1 to 3, which satisfy: RMSE² =
average² + standard deviation² (of the population); RMSE(2D)² = RMSE(X)² + RMSE(Y)²; RMSE(3D)² = RMSE(2D)² + RMSE(Z)²;
averages of X, Y, Z are signed, those of 2D and 3D are of lengths. See :data:`DEFINITIONS`.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray

DEFINITIONS: Final = {
    "difference": "test minus reference at the same instant",
    "X": "towards east, at the reference's place",
    "Y": "towards north",
    "Z": "up, along the ellipsoid's normal",
    "2D": "length of (X, Y)",
    "3D": "length of (X, Y, Z)",
    "average": "arithmetic mean: of signed differences for X, Y and Z, of lengths for 2D and 3D",
    "standard deviation": "of the same quantity about its average, of the population (divided by n)",
    "RMSE": "square root of the mean square, so that RMSE² = average² + standard deviation²",
    "along": "the horizontal difference in the direction the reference travels (at 0.5 m/s or more)",
    "across": "to the left of that direction",
    "outlier": "an epoch whose X, Y or Z lies more than 3.5 scaled median absolute deviations from the median of its "
    "kind of fix (Iglewicz and Hoaglin 1993)",
}
QUANTILES: Final = (0.50, 0.68, 0.90, 0.95, 0.99)
OUTLIER_MADS: Final = 3.5
MAD_TO_SIGMA: Final = 1.4826
MIN_SPREAD_M: Final = 1e-3
"""Least spread for outlier detection: below it differences are rounding."""


@dataclass(frozen=True)
class ErrorStatistics:
    """Statistics of one quantity (:data:`DEFINITIONS`), nan without epochs; percentiles are at :data:`QUANTILES`."""

    n: int
    average_m: float
    standard_deviation_m: float
    rmse_m: float
    percentiles_m: tuple[float, ...]
    greatest_m: float

    @classmethod
    def from_values(cls, values: FloatArray) -> "ErrorStatistics":
        """Of the values (n,) that are known."""
        known = values[np.isfinite(values)]
        if not len(known):
            nothing = float("nan")
            return cls(0, nothing, nothing, nothing, (nothing,) * len(QUANTILES), nothing)
        size = np.abs(known)
        return cls(
            n=len(known),
            average_m=float(np.mean(known)),
            standard_deviation_m=float(np.std(known)),
            rmse_m=float(np.sqrt(np.mean(known**2))),
            percentiles_m=tuple(np.quantile(size, QUANTILES).tolist()),
            greatest_m=float(size.max()),
        )


ErrorTable = dict[str, ErrorStatistics]


def table(error_m: FloatArray, along_m: FloatArray, across_m: FloatArray) -> ErrorTable:
    """Statistics of errors (n, 3) and of their components along and across the track (n,)."""
    return {
        "3D": ErrorStatistics.from_values(np.sqrt(np.sum(error_m**2, axis=1))),
        "2D": ErrorStatistics.from_values(np.hypot(error_m[:, 0], error_m[:, 1])),
        "X": ErrorStatistics.from_values(error_m[:, 0]),
        "Y": ErrorStatistics.from_values(error_m[:, 1]),
        "Z": ErrorStatistics.from_values(error_m[:, 2]),
        "along": ErrorStatistics.from_values(along_m),
        "across": ErrorStatistics.from_values(across_m),
    }


def outliers(error_m: FloatArray, kind: NDArray[np.int8]) -> NDArray[np.bool_]:
    """Which epochs (n,) are outliers among those of their fix type."""
    found = np.zeros(len(error_m), bool)
    for one in np.unique(kind):
        mine = np.flatnonzero(kind == one)
        for axis in range(3):
            values = error_m[mine, axis]
            known = np.isfinite(values)
            if known.sum() < 3:
                continue
            away = np.abs(values - np.median(values[known]))
            spread_m = max(MAD_TO_SIGMA * float(np.median(away[known])), MIN_SPREAD_M)
            found[mine[known & (away > OUTLIER_MADS * spread_m)]] = True
    return found


def within_sigmas(error_m: FloatArray, sigma_m: FloatArray) -> dict[str, float] | None:
    """Share of errors (n, 3) within one, two and three stated standard deviations (n, 3); None where none is stated."""
    known = np.isfinite(error_m) & np.isfinite(sigma_m) & (sigma_m > 0.0)
    if not known.any():
        return None
    ratio = np.abs(error_m[known] / sigma_m[known])
    return {f"within_{k}_sigma": float(np.mean(ratio <= k)) for k in (1, 2, 3)}


def time_ahead_s(along_m: FloatArray, speed_mps: FloatArray) -> tuple[float, float] | None:
    """Clock offset of the test against the reference, with its standard error; None if the speed varies too little.

    A clock offset shifts positions along the track in proportion to speed, an antenna offset by a constant: it is the
    slope of the line of best fit.
    """
    known = np.isfinite(along_m) & np.isfinite(speed_mps)
    if known.sum() < 20 or np.std(speed_mps[known]) < 0.5:
        return None
    speed, along = speed_mps[known] - speed_mps[known].mean(), along_m[known] - along_m[known].mean()
    slope = float(np.sum(speed * along) / np.sum(speed**2))
    rest = along - slope * speed
    return slope, float(np.sqrt(np.mean(rest**2) / np.sum(speed**2)))
