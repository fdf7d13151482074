"""Place, heading, tilt and speed of a wheeled vehicle while positions come in, where scans show how it turns."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from furrowmap.core.adjustment.position_observations import ANTENNA_HEADING_SIGMA_RAD
from furrowmap.core.adjustment.vehicle import SLIP, SLIP_EVERY_S
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.gnss import DRIFT_CORRELATION_S

DRIVE_ACCELERATION: Final = 0.2
"""Change of the speed after a second (m/s, one standard deviation)."""
BRAKES_MPS2: Final = 0.25
MAY_BRAKE_AFTER_S: Final = 0.5
"""Between positions further apart than this the vehicle may have accelerated or braked all the time."""
START_SIGMA: Final = (0.5, np.radians(8.0), 0.5)
"""Of place, heading and speed at the first position that is used."""
START_SLOPE: Final = 0.025
"""How far from level the ground is that the scans' turns count from: slope of a field, and its waves."""
SLOPE_WALK: Final = 5e-4
"""Change of that slope after a metre: errors of the scans' turns add up."""
CLIMB_M: Final = 0.002
"""Error after a metre of the height by which the scans show the vehicle to climb."""
JUMP_SQUARES: Final = 30.0
JUMPS_IN_A_ROW: Final = 5
"""A position whose squared deviation is larger is left out, unless so many follow one another."""


@dataclass(frozen=True)
class ScannedWay:
    """How far a vehicle went by scans, in the axes in which these have it turned.

    Attributes:
        way_m: (2,) in plan.
        sigma_m: standard deviation of each of these.
        speed_mps: at the end.
        speed_sigma_mps: standard deviation of that.
    """

    way_m: FloatArray
    sigma_m: float
    speed_mps: float
    speed_sigma_mps: float


class DriveFilter:
    """Kalman filter of ten values, see `mean`.

    Args:
        t_s: time at which it begins.
        mean: (10,) what is assumed then.
        turned: sum of the scans' turns until then, in rad.
        variance: of that sum; only its growth counts.
        slope_sigma: of the slopes; 0 where they are not known, as at the start of a drive.

    Attributes:
        mean: (10,) easting, northing and height of the vehicle's origin, yaw less the sum of the scans' turns, speed,
            slopes to the east and the north of the plane that the scans take for level, the receiver's error (3,).
        covariance: (10, 10).
    """

    def __init__(self, t_s: float, mean: FloatArray, turned: float, variance: float, slope_sigma: float = 0.0) -> None:
        self.mean = mean
        place, yaw, speed = START_SIGMA
        slope = slope_sigma or START_SLOPE
        self.covariance = np.diag(np.square([place, place, place, yaw, speed, slope, slope, 0.0, 0.0, 0.0]))
        self._t_s = t_s
        self._turned = turned
        self._variance = variance
        self._climbed_m = 0.0
        self._fix = -1
        self._jumps = 0
        self._drift_m = np.zeros(3)

    def predict(
        self, t_s: float, turned: float, variance: float, climbed_m: float, scanned: ScannedWay | None = None
    ) -> None:
        """Go on to a time, at which the scans have turned and climbed by so much, the turns with such a variance.

        The vehicle went on at its speed, or as it was scanned.
        """
        step_s = t_s - self._t_s
        yaw = 0.5 * (turned + self._turned) + float(self.mean[3])
        speed = float(self.mean[4])
        ahead = np.array([np.cos(yaw), np.sin(yaw)])
        left = np.array([-ahead[1], ahead[0]])
        kept = np.exp(-step_s / DRIFT_CORRELATION_S)
        design = np.diag([*np.ones(7), kept, kept, kept])
        noise = np.zeros((10, 10))
        if scanned is None:
            plan = speed * step_s * ahead
            design[:2, 4] = step_s * ahead
            noise[:2, :2] = (SLIP * speed) ** 2 * SLIP_EVERY_S * step_s * np.outer(left, left)
            noise[4, 4] = DRIVE_ACCELERATION**2 * step_s
            if step_s > MAY_BRAKE_AFTER_S:
                braking = np.array([*(0.5 * step_s**2 * ahead), 0.0, 0.0, step_s, *np.zeros(5)])
                noise += BRAKES_MPS2**2 * np.outer(braking, braking)
        else:
            offset = float(self.mean[3])
            east, north = scanned.way_m
            plan = np.array(
                [np.cos(offset) * east - np.sin(offset) * north, np.sin(offset) * east + np.cos(offset) * north]
            )
            design[4, 4] = 0.0
            noise[:2, :2] = scanned.sigma_m**2 * np.eye(2)
            noise[4, 4] = scanned.speed_sigma_mps**2
        way_m = float(np.hypot(*plan))
        design[:2, 3] = -plan[1], plan[0]
        design[2, 5:7] = plan
        moved = np.array([*plan, plan @ self.mean[5:7] + climbed_m - self._climbed_m])
        self.mean = np.array([*(self.mean[:3] + moved), *self.mean[3:7], *(kept * self.mean[7:])])
        self.mean[4] = speed if scanned is None else scanned.speed_mps
        noise[2, 2] = CLIMB_M**2 * way_m
        noise[3, 3] = max(0.0, variance - self._variance)
        noise[5, 5] = noise[6, 6] = SLOPE_WALK**2 * way_m
        noise[7:, 7:] = np.diag(self._drift_m**2 * (1.0 - kept**2))
        self.covariance = design @ self.covariance @ design.T + noise
        self._t_s = t_s
        self._turned = turned
        self._variance = variance
        self._climbed_m = climbed_m

    def take(self, xyz_m: FloatArray, arm_m: FloatArray, white_m: FloatArray, drift_m: FloatArray, fix: int) -> float:
        """Take a position (3,) of the antenna, which the arm (3,) leads to from the origin, with errors (3,).

        Gives its squared deviation from what was expected, 3 in the mean.
        """
        self._drift_m = drift_m
        if fix != self._fix:
            self._fix = fix
            self._forget_error(drift_m)
        design = np.zeros((3, 10))
        design[:, :3] = design[:, 7:] = np.eye(3)
        design[:2, 3] = -arm_m[1], arm_m[0]
        design[:, 5] = (-arm_m[2], 0.0, arm_m[0])
        design[:, 6] = (0.0, -arm_m[2], arm_m[1])
        off = xyz_m - self.mean[:3] - arm_m - self.mean[7:]
        noise = np.diag(white_m**2)
        spread = design @ self.covariance @ design.T + noise
        squares = float(off @ np.linalg.solve(spread, off))
        if squares > JUMP_SQUARES:
            self._jumps += 1
            if self._jumps < JUMPS_IN_A_ROW:
                return squares
            self._forget_error(drift_m)
            self.covariance[:5, :5] += np.diag([*off**2, START_SIGMA[1] ** 2, START_SIGMA[2] ** 2])
            spread = design @ self.covariance @ design.T + noise
        self._jumps = 0
        self._update(design, spread, off)
        return squares

    def take_yaw(self, off_rad: float) -> None:
        """Take a heading that two antennas showed, less the sum of the scans' turns."""
        design = np.zeros((1, 10))
        design[0, 3] = 1.0
        off = (off_rad - float(self.mean[3]) + np.pi) % (2.0 * np.pi) - np.pi
        self._update(design, design @ self.covariance @ design.T + ANTENNA_HEADING_SIGMA_RAD**2, np.array([off]))

    def forget_speed(self) -> None:
        """What was found of the speed is wrong."""
        self.covariance[4] = 0.0
        self.covariance[:, 4] = 0.0
        self.covariance[4, 4] = START_SIGMA[2] ** 2

    def _forget_error(self, sigma_m: FloatArray) -> None:
        """The receiver's error begins anew."""
        self.mean[7:] = 0.0
        self.covariance[7:] = 0.0
        self.covariance[:, 7:] = 0.0
        self.covariance[7:, 7:] = np.diag(sigma_m**2)

    def _update(self, design: FloatArray, spread: FloatArray, off: FloatArray) -> None:
        gain = np.linalg.solve(spread, design @ self.covariance).T
        self.mean = self.mean + gain @ off
        covariance = self.covariance - gain @ spread @ gain.T
        self.covariance = 0.5 * (covariance + covariance.T)
