"""Measurements of an inertial measurement unit (IMU), and its noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

STANDARD_GRAVITY_MPS2: Final = 9.80665
_MG: Final = 1e-3 * STANDARD_GRAVITY_MPS2
_DPS: Final = np.pi / 180.0


@dataclass(frozen=True)
class InertialTrack:
    """Angular rate and specific force in the axes of the IMU, in the order of time.

    Attributes:
        t_s: (n,) UTC, strictly increasing.
        rate_radps: (n, 3) angular rate against inertial space.
        force_mps2: (n, 3) specific force: at rest it points up.
        source: the name of the file or topic, for messages.
    """

    t_s: FloatArray
    rate_radps: FloatArray
    force_mps2: FloatArray
    source: str = ""

    def __post_init__(self) -> None:
        n = len(self.t_s)
        if self.rate_radps.shape != (n, 3) or self.force_mps2.shape != (n, 3):
            raise ValueError("InertialTrack has arrays of different lengths")
        if n > 1 and not bool(np.all(np.diff(self.t_s) > 0)):
            raise ValueError("InertialTrack.t_s does not increase")

    def __len__(self) -> int:
        return len(self.t_s)

    def part(self, chosen: slice) -> InertialTrack:
        """Some of the measurements."""
        return InertialTrack(self.t_s[chosen], self.rate_radps[chosen], self.force_mps2[chosen], self.source)


@dataclass(frozen=True)
class InertialNoise:
    """Noise densities of an IMU, and the spread of its biases.

    Attributes:
        rate: angular random walk, rad/s/√Hz.
        force: velocity random walk, m/s²/√Hz.
        rate_bias: standard deviation of the bias at turn-on, rad/s.
        force_bias: the same of the specific force, m/s².
        rate_walk: random walk of the bias, rad/s/√s.
        force_walk: the same of the specific force, m/s²/√s.
    """

    rate: float
    force: float
    rate_bias: float
    force_bias: float
    rate_walk: float
    force_walk: float

    @classmethod
    def of_data_sheet(
        cls,
        gyro_deg_s_rthz: float,
        accel_mg_rthz: float,
        gyro_bias_deg_s: float,
        accel_bias_mg: float,
        gyro_walk_deg_s_rts: float,
        accel_walk_mg_rts: float,
    ) -> InertialNoise:
        """Noise in the units of data sheets."""
        return cls(
            gyro_deg_s_rthz * _DPS, accel_mg_rthz * _MG, gyro_bias_deg_s * _DPS, accel_bias_mg * _MG,
            gyro_walk_deg_s_rts * _DPS, accel_walk_mg_rts * _MG,
        )  # fmt: skip


_FIGURES: Final = (
    "gyro_deg_s_rthz", "accel_mg_rthz", "gyro_bias_deg_s", "accel_bias_mg", "gyro_walk_deg_s_rts", "accel_walk_mg_rts",
)  # fmt: skip
IMU_CLASSES: Final = {
    "consumer": dict(zip(_FIGURES, (0.01, 0.3, 0.5, 30.0, 0.002, 0.05), strict=True)),
    "industrial": dict(zip(_FIGURES, (0.0035, 0.14, 0.1, 10.0, 0.0004, 0.01), strict=True)),
    "tactical": dict(zip(_FIGURES, (0.0012, 0.05, 0.01, 3.0, 0.0001, 0.005), strict=True)),
}
"""Typical figures: of phones and hobby autopilots (MPU-9250, ICM-20948), of industrial MEMS units (VN-100, Xsens MTi),
and of tactical ones (ADIS16490, HG4930). Data sheets state the noise; spread and walk of the biases are rounded up."""
IMU_MODELS: Final = {
    "VN-100": "industrial",
    "VN-200": "industrial",
    "VN-300": "industrial",
    "MTi-300": "industrial",
    "MTi-680G": "industrial",
    "BMI088": "consumer",
    "ICM-20948": "consumer",
    "MPU-9250": "consumer",
    "ADIS16490": "tactical",
    "HG4930": "tactical",
}
"""The class of each model that `[imu] class` may name."""


def inertial_noise(kind: str, stated: Mapping[str, float] | None = None) -> InertialNoise:
    """The noise of a class or model of IMU, with the figures of a data sheet that are stated instead of its own."""
    return InertialNoise.of_data_sheet(**(IMU_CLASSES[IMU_MODELS.get(kind, kind)] | dict(stated or {})))
