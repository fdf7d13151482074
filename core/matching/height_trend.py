"""Whether GNSS heights creep: a constant rate of change that ground seen again contradicts.

A slow error as large as stated hardly grows by the same amount every second for a minute; a larger slow error explains
that no better, since it would be as likely to turn back. So the rate is an unknown of its own. What a drive on one
straight way shows of it is nothing: there the field may slope.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from furrowmap.core.runtime.arrays import FloatArray

RATE_SIGMA_MPS: Final = 0.01
"""Of a rate before anything was seen: half a metre a minute."""
MIN_TREND_GAIN: Final = 20.0
"""By how much −2 log likelihood falls with a rate that is shown. Of right drives it rises by 3 to 5, by the rate's own
uncertainty; with 0.2 m a minute, which standard deviations hold, it falls by 12, with 0.4 m by 70."""


@dataclass(frozen=True)
class HeightTrend:
    """A rate at which heights creep, and by how much −2 log likelihood falls with it."""

    rate_mps: float = 0.0
    gain: float = 0.0

    @property
    def shown(self) -> bool:
        """Whether heights creep."""
        return self.gain > MIN_TREND_GAIN


def height_trend(
    others: tuple[FloatArray, FloatArray], own: tuple[FloatArray, FloatArray], t_s: FloatArray
) -> HeightTrend:
    """The likeliest rate of the heights' errors.

    Args:
        others: normal matrix (3 n, 3 n) and right-hand side (3 n,) of all observations but the errors' own law, all
            other unknowns eliminated; errors of easting, northing and height at n times in turn.
        own: the same of the errors' own law.
        t_s: (n,) the times.
    """
    normal, right = others
    law, law_right = own
    ramp = np.zeros((len(t_s), 3))
    ramp[:, 2] = t_s - t_s.mean()
    along = ramp.ravel()
    # The law is that of the errors less a rate times the ramp, whose own uncertainty is large (Woodbury's identity).
    pull = law @ along
    weight = float(along @ pull) + 1.0 / RATE_SIGMA_MPS**2
    shift = float(along @ law_right)
    freed = law - np.outer(pull, pull) / weight
    freed_right = law_right - pull * (shift / weight)

    def deviance(own_normal: FloatArray, own_right: FloatArray, own_logarithm: float) -> tuple[float, FloatArray]:
        both = normal + own_normal
        found: FloatArray = np.asarray(np.linalg.solve(both, right + own_right), np.float64)
        logarithm = float(np.linalg.slogdet(both)[1])
        return float(-(right + own_right) @ found) + logarithm - own_logarithm, found

    logarithm = float(np.linalg.slogdet(law)[1])
    without, _ = deviance(law, law_right, logarithm)
    freed_logarithm = logarithm - np.log(weight * RATE_SIGMA_MPS**2)
    with_rate, found = deviance(freed, freed_right, freed_logarithm)
    gain = without - (with_rate - shift**2 / weight)
    rate = float(along @ (law @ found - law_right)) / weight
    return HeightTrend(rate, float(gain))
