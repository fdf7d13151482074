"""Place, heading and speed of a wheeled vehicle while positions come in, where scans show how it turns."""

from __future__ import annotations

from typing import Final

import numpy as np

from furrowmap.core.estimation.positions import ANTENNA_HEADING_SIGMA_RAD
from furrowmap.core.estimation.vehicle import SLIP, SLIP_EVERY_S
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.gnss import DRIFT_CORRELATION_S

DRIVE_ACCELERATION: Final = 0.2
"""Change of the speed after a second (m/s, one standard deviation)."""
START_SIGMA: Final = (0.5, np.radians(8.0), 0.5)
"""Of place, heading and speed at the first position that is used."""
JUMP_SQUARES: Final = 30.0
JUMPS_IN_A_ROW: Final = 5
"""A position whose squared deviation is larger is left out, unless so many follow one another."""


class DriveFilter:
    """Kalman filter of easting, northing, yaw less the sum of the scans' turns, speed, the receiver's error in e and n.

    Args:
        t_s: time at which it begins.
        mean: (6,) what is assumed then.
        turned: sum of the scans' turns until then, in rad.
        variance: of that sum; only its growth counts.

    Attributes:
        mean: (6,) in the order above.
        covariance: (6, 6).
    """

    def __init__(self, t_s: float, mean: FloatArray, turned: float, variance: float) -> None:
        self.mean = mean
        place, yaw, speed = START_SIGMA
        self.covariance = np.diag(np.square([place, place, yaw, speed, 0.0, 0.0]))
        self._t_s, self._turned, self._variance = t_s, turned, variance
        self._fix, self._jumps, self._drift_m = -1, 0, 0.0

    def predict(self, t_s: float, turned: float, variance: float) -> None:
        """Go on to a time, at which the scans have turned by so much, with such a variance."""
        step_s = t_s - self._t_s
        yaw, speed = 0.5 * (turned + self._turned) + float(self.mean[2]), float(self.mean[3])
        ahead = np.array([np.cos(yaw), np.sin(yaw)])
        left = np.array([-ahead[1], ahead[0]])
        kept = np.exp(-step_s / DRIFT_CORRELATION_S)
        design = np.diag([1.0, 1.0, 1.0, 1.0, kept, kept])
        design[:2, 2], design[:2, 3] = speed * step_s * left, step_s * ahead
        self.mean[:2] += speed * step_s * ahead
        self.mean[4:] *= kept
        noise = np.zeros((6, 6))
        noise[:2, :2] = (SLIP * speed) ** 2 * SLIP_EVERY_S * step_s * np.outer(left, left)
        noise[2, 2] = max(0.0, variance - self._variance)
        noise[3, 3] = DRIVE_ACCELERATION**2 * step_s
        noise[4, 4] = noise[5, 5] = self._drift_m**2 * (1.0 - kept**2)
        self.covariance = design @ self.covariance @ design.T + noise
        self._t_s, self._turned, self._variance = t_s, turned, variance

    def take(self, en_m: FloatArray, arm_m: FloatArray, white_m: float, drift_m: float, fix: int) -> None:
        """Take a position of the antenna, which the arm (3,) leads to from the origin."""
        self._drift_m = drift_m
        if fix != self._fix:
            self._fix = fix
            self._forget_error(drift_m)
        design = np.zeros((2, 6))
        design[0, 0] = design[1, 1] = design[0, 4] = design[1, 5] = 1.0
        design[0, 2], design[1, 2] = -arm_m[1], arm_m[0]
        off = en_m - self.mean[:2] - arm_m[:2] - self.mean[4:]
        spread = design @ self.covariance @ design.T + white_m**2 * np.eye(2)
        if float(off @ np.linalg.solve(spread, off)) > JUMP_SQUARES:
            self._jumps += 1
            if self._jumps < JUMPS_IN_A_ROW:
                return
            self._forget_error(drift_m)
            self.covariance[:3, :3] += np.diag([off @ off, off @ off, START_SIGMA[1] ** 2])
            spread = design @ self.covariance @ design.T + white_m**2 * np.eye(2)
        self._jumps = 0
        self._update(design, spread, off)

    def take_yaw(self, off_rad: float) -> None:
        """Take a heading that two antennas showed, less the sum of the scans' turns."""
        design = np.zeros((1, 6))
        design[0, 2] = 1.0
        off = (off_rad - float(self.mean[2]) + np.pi) % (2.0 * np.pi) - np.pi
        self._update(design, design @ self.covariance @ design.T + ANTENNA_HEADING_SIGMA_RAD**2, np.array([off]))

    def _forget_error(self, sigma_m: float) -> None:
        """The receiver's error begins anew."""
        self.mean[4:] = 0.0
        self.covariance[4:], self.covariance[:, 4:] = 0.0, 0.0
        self.covariance[4, 4] = self.covariance[5, 5] = sigma_m**2

    def _update(self, design: FloatArray, spread: FloatArray, off: FloatArray) -> None:
        gain = np.linalg.solve(spread, design @ self.covariance).T
        self.mean = self.mean + gain @ off
        covariance = self.covariance - gain @ spread @ gain.T
        self.covariance = 0.5 * (covariance + covariance.T)
