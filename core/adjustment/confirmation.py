"""Which of the places that a session states its own recording confirms."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from furrowmap.core.adjustment.boresight import Boresight
from furrowmap.core.trajectory.located import Located
from furrowmap.core.values.session import Session
from furrowmap.core.values.trajectory import Trajectory

if TYPE_CHECKING:
    from furrowmap.core.adjustment.matched import Matched

LEVER_ASSUMED: Final = "lever-assumed"

TURNED_DEG: Final = 45.0
"""A vehicle that turns by less takes a wrong lever arm with it: all it does is to shift the map."""


def unconfirmed(
    session: Session, located: Located, matched: Matched | None, boresight: Boresight | None
) -> tuple[str, ...]:
    """Keys of stated places that the recording does not show: standard deviations hold if these are right.

    Args:
        located: the trajectory, with its notices.
        matched: the result of scan matching; None without.
        boresight: of a scanner on a vehicle with an IMU; None where the scans do not show it.
    """
    if not session.recording.lidar:
        return ()
    angles, height, lever = boresight is not None and boresight.certain, False, located.source == "file"
    if matched is not None:
        angles = matched.facing_shown
        height = bool(np.isfinite(matched.calibration.sigma_height_m))
        lever = all(notice.code != LEVER_ASSUMED for notice in located.notices) and _turns(located.trajectory)
    shown = {"antenna.xyz_m": lever, "lidar.xyz_m": height, "lidar.rpy_deg": angles}
    return tuple(key for key, known in shown.items() if not known and key not in session.unstated)


def _turns(trajectory: Trajectory) -> bool:
    """Whether headings differ from their mean by TURNED_DEG."""
    heading = np.radians(trajectory.attitude_deg()[2])
    mean = np.angle(np.mean(np.exp(1j * heading)))
    return bool(np.degrees(np.abs(np.angle(np.exp(1j * (heading - mean))))).max(initial=0.0) > TURNED_DEG)
