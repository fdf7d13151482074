"""The observations of a wheeled vehicle with GNSS, beside what its scanner adds."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.estimation.gnss_drift import GnssDrift
from furrowmap.core.estimation.headings import AntennaHeadings
from furrowmap.core.estimation.level import Level
from furrowmap.core.estimation.motion_prior import MotionPrior
from furrowmap.core.estimation.observation import Observation
from furrowmap.core.estimation.positions import AntennaPositions
from furrowmap.core.estimation.wheels import Wheels
from furrowmap.core.values.positions import Positions


def wheeled_vehicle(
    positions: Positions,
    origin_m: NDArray[np.float64],
    lever_m: NDArray[np.float64],
    aiding: tuple[Observation, ...] = (),
) -> tuple[Observation, ...]:
    """Positions and headings of the antennas with their drift, the motion prior, wheels and level, and an IMU's.

    Args:
        positions: (m,) of the antenna.
        origin_m: (3,) local origin.
        lever_m: (3,) the antenna in the vehicle frame.
        aiding: observations of an IMU; none without one.
    """
    antenna = AntennaPositions.of(positions, origin_m, lever_m)
    motion = MotionPrior.with_measured_turns() if aiding else MotionPrior()
    return (antenna, AntennaHeadings(positions), GnssDrift(positions), motion, Wheels(), Level(), *aiding)


def with_positions(observations: Iterable[Observation], positions: Positions) -> tuple[Observation, ...]:
    """The observations with other positions of the antenna, each of its whole weight."""

    def changed(one: Observation) -> Observation:
        if isinstance(one, AntennaPositions):
            return AntennaPositions.of(positions, one.origin_m, one.lever_m)
        return replace(one, positions=positions) if isinstance(one, AntennaHeadings | GnssDrift) else one

    return tuple(changed(one) for one in observations)
