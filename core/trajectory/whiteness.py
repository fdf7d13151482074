"""Whether the residuals of GNSS positions are white: what is left of them must not follow from those before.

Residuals that follow from those before carry less than the noise stated for them says: as many of them as are alike
count as one. A first-order process of correlation r from one to the next has, for anything slower, the information of
white noise that is √((1 + r) / (1 − r)) times as large (Bartlett 1946, J. Royal Statistical Society B 8, 27-41).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

WHITE: Final = 0.2
"""Correlation from one residual to the next up to which they are called white: noise is then 1.2 times as large."""
SIGNIFICANT: Final = 3.0
"""Correlations below so many of their standard deviations, 1/√n, show nothing."""
FEWEST: Final = 20


@dataclass(frozen=True)
class Whiteness:
    """Residuals of positions, by axis: easting, northing, height.

    Attributes:
        correlation: (3,) from one position to the next; nan where there are too few.
        noise_m: (3,) white noise with the same information.
        assumed_m: (3,) white noise that was assumed (median).
    """

    correlation: tuple[float, ...]
    noise_m: tuple[float, ...]
    assumed_m: tuple[float, ...]

    @classmethod
    def of(cls, residual_m: FloatArray, assumed_m: FloatArray) -> Whiteness:
        """Of residuals (n, 3) in the order of time, nan where one takes no part, and the noise assumed (n, 3)."""
        part = np.asarray(np.isfinite(residual_m).all(axis=1))
        pairs = part[1:] & part[:-1]
        count = int(pairs.sum())
        if count < FEWEST:
            unknown = (np.nan, np.nan, np.nan)
            return cls(unknown, unknown, unknown)
        before, after = residual_m[:-1][pairs], residual_m[1:][pairs]
        square = (residual_m[part] ** 2).mean(axis=0)
        share = np.clip((before * after).mean(axis=0) / np.maximum(square, 1e-12), -0.99, 0.99)
        share = np.where(np.abs(share) < SIGNIFICANT / np.sqrt(count), 0.0, share)
        # Negative correlations come from the trajectory's own freedom to follow, and are no noise.
        noise = np.sqrt(square * (1.0 + np.maximum(share, 0.0)) / (1.0 - np.maximum(share, 0.0)))
        values = (share, noise, np.median(assumed_m[part], axis=0))
        return cls(*(tuple(np.round(value, 4).tolist()) for value in values))

    @property
    def white(self) -> bool:
        """Whether no axis is correlated; false where there are too few positions to tell."""
        return bool(np.all(np.asarray(self.correlation) < WHITE))

    @property
    def words(self) -> str:
        """The verdict for a report."""
        if not np.isfinite(self.correlation).all():
            return "too few GNSS positions to tell whether their residuals are white"
        largest = max(self.correlation)
        if self.white:
            return f"GNSS residuals are white (correlation from one to the next at most {max(largest, 0.0):.2f})"
        noise, assumed = max(self.noise_m[:2]), max(self.assumed_m[:2])
        verdict = "which is what was assumed" if noise < 1.1 * assumed else f"{assumed:.3f} m was assumed"
        return (
            f"GNSS residuals are not white (correlation from one to the next up to {largest:.2f}): on the map they are "
            f"as good as white noise of {noise:.3f} m, {verdict}"
        )
