"""Heights of positions that creep, by what strips find of them beyond what positions and IMU leave open.

To an IMU slow errors of heights are a motion. Ground that is seen at several times stays where it is: strips show by
how much heights are off against each other, and the adjustment with them takes it off. What GNSS and IMU leave open is
a joint covariance; along its longest axes, slow courses of the height over the whole flight, errors that are found
should be within a few standard deviations. A mean error of all heights does not show.
"""

from dataclasses import replace
from typing import Final

import numpy as np

from furrowmap.core.adjustment.knots import POSE
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.trajectory.pose_errors import PoseErrors
from furrowmap.core.values.trajectory import Trajectory

HEIGHT_AXIS: Final = 2
"""Column of the height among the errors of a pose."""
COURSES: Final = 6
"""Slow courses of the height that are looked at."""
MAX_SIGMAS: Final = 5.0
"""Standard deviations of a course up to which heights err as stated."""
MIN_EXTENT_SIGMAS: Final = 3.0
"""Half of the extent of what is found over the stated standard deviation of heights: less does not matter."""


def held_against_heights(
    trajectory: Trajectory, before: PoseErrors, found: PoseErrors
) -> tuple[Trajectory, Notice | None]:
    """The trajectory with larger standard deviations where its heights had crept, and the notice.

    Args:
        trajectory: without the errors that were found.
        before: errors as GNSS and IMU leave them open.
        found: errors that strips find.
    """
    nodes = len(before.t_s)
    covariance = before.covariance.reshape(nodes, POSE, nodes, POSE)[:, HEIGHT_AXIS, :, HEIGHT_AXIS]
    height_m = found.value[:, HEIGHT_AXIS]
    variance, course = np.linalg.eigh(covariance)
    slowest = slice(-min(COURSES, nodes), None)
    sigmas = np.abs(height_m @ course[:, slowest]) / np.sqrt(np.maximum(variance[slowest], 1e-12))
    half_m = 0.5 * float(np.ptp(height_m))
    stated_m = float(np.median(np.sqrt(np.diag(covariance))))
    if sigmas.max() < MAX_SIGMAS or half_m < MIN_EXTENT_SIGMAS * stated_m:
        return trajectory, None
    sigma = trajectory.sigma.copy()
    # Heights may have been right at any time of the flight.
    sigma[:, HEIGHT_AXIS] = np.hypot(sigma[:, HEIGHT_AXIS], half_m)
    length_min = (trajectory.span_s[1] - trajectory.span_s[0]) / 60.0
    notice = Notice("contradiction.height-creep", whole_m=2.0 * half_m, length_min=length_min)
    return replace(trajectory, sigma=sigma), notice
