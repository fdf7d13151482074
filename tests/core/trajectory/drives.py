"""Drives of a wheeled vehicle in closed form, seen by an antenna off its axle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

STEP_S = 0.1


@dataclass(frozen=True)
class Drive:
    """What truly happened: axle positions, yaw and signed speed at 10 Hz."""

    t_s: NDArray[np.float64]
    en_m: NDArray[np.float64]
    yaw_rad: NDArray[np.float64]
    speed_mps: NDArray[np.float64]

    def antenna(self, x_m: float, y_m: float) -> NDArray[np.float64]:
        """Positions (n, 2) of an antenna at (x, y) in the vehicle frame."""
        c, s = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        return self.en_m + np.column_stack([c * x_m - s * y_m, s * x_m + c * y_m])


def drive(*legs: tuple[float, float, float], yaw_deg: float = 0.0, t0_s: float = 1.75e9) -> Drive:
    """A drive of legs (duration s, speed m/s signed, yaw rate °/s), integrated finely, sampled at 10 Hz."""
    fine = 0.001
    speed, rate = [], []
    for duration, v, w in legs:
        n = round(duration / fine)
        ramp = np.minimum(1.0, np.minimum(np.arange(n), np.arange(n)[::-1]) * fine / 1.0)
        speed.append(v * ramp)
        rate.append(np.radians(w) * ramp)
    v, w = np.concatenate(speed), np.concatenate(rate)
    yaw = np.radians(yaw_deg) + np.concatenate([[0], np.cumsum(w[:-1]) * fine])
    e = np.concatenate([[0], np.cumsum(v[:-1] * np.cos(yaw[:-1])) * fine])
    n_ = np.concatenate([[0], np.cumsum(v[:-1] * np.sin(yaw[:-1])) * fine])
    every = round(STEP_S / fine)
    t = t0_s + np.arange(len(v)) * fine
    return Drive(t[::every], np.column_stack([e, n_])[::every], yaw[::every], v[::every])


FISHTAIL = ((2, 0, 0), (8, 1.1, 0), (4, 1.0, 22), (2, 0, 0), (4, -1.0, 20), (1, 0, 0), (10, 1.1, 0), (2, 0, 0))
