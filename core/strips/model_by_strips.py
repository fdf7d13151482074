"""Whether a flight's scanner is of the model that it is read as, by ground that is seen at several times.

Packets of several models look alike. With the elevations of another model the same ground comes out at other heights
under other angles, which no mounting, clock or place takes away; with those of the right one it coincides.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from furrowmap.core.matching.laser_elevations import raised
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.strips.boresight import Boresight, boresight
from furrowmap.core.strips.strips import StripReturns
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.trajectory import Trajectory

COINCIDES_M: Final = 0.01
"""Ground that coincides to less with the model in use asks for no other."""
LIKELIER_SHARE: Final = 0.6
"""Share of the scatter that another model must leave at most."""


@dataclass(frozen=True)
class LikelierModel:
    """A model whose elevations let the ground coincide.

    Attributes:
        name: of it.
        read_as: the one in use.
        scatter_m: of the ground with the model in use, and with this one.
    """

    name: str
    read_as: str
    scatter_m: tuple[float, float]

    @property
    def notice(self) -> Notice:
        """The contradiction that it is."""
        before_m, after_m = self.scatter_m
        return Notice(
            "contradiction.elevations-of-another",
            name=self.name,
            read_as=self.read_as,
            before_mm=1e3 * before_m,
            after_mm=1e3 * after_m,
        )


def likelier_model(
    returns: StripReturns,
    trajectory: Trajectory,
    stated: Mounting,
    carrier: Trajectory | None,
    found: Boresight,
    elevations_deg: Mapping[str, FloatArray],
) -> LikelierModel | None:
    """The model with which the ground coincides much better than with the one in use; None for none.

    Args:
        returns: of the scanner, with their poses, as read with the model in use.
        stated: the mounting as the session states it.
        carrier: trajectory of the frame that carries the scanner; None for the vehicle's.
        found: the boresight with the model in use.
        elevations_deg: (lasers,) of each model that the packets may be of, lowest first; the model in use first.
    """
    in_use, *others = elevations_deg or ("",)
    if found.scatter_m[1] < COINCIDES_M or not others or len(returns.beam) != len(returns):
        return None
    best: LikelierModel | None = None
    for name in others:
        by_deg = elevations_deg[name] - elevations_deg[in_use]
        if int(returns.beam.max(initial=0)) >= len(by_deg):
            continue
        sensor_m = raised(returns.sensor_m.astype(np.float64), by_deg[returns.beam]).astype(np.float32)
        other = boresight(replace(returns, sensor_m=sensor_m), trajectory, stated, carrier)
        least_m = best.scatter_m[1] if best is not None else LIKELIER_SHARE * found.scatter_m[1]
        if other is not None and other.coincides and other.scatter_m[1] < least_m:
            best = LikelierModel(name, in_use, (found.scatter_m[1], other.scatter_m[1]))
    return best
