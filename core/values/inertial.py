"""Measurements of an inertial measurement unit (IMU), and its noise."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from furrowmap.core.runtime.arrays import FloatArray, check_columns

STANDARD_GRAVITY_MPS2: Final = 9.80665
RATE_UNITS: Final = {"rad/s": 1.0, "deg/s": np.pi / 180.0, "mrad/s": 1e-3, "mdeg/s": 1e-3 * np.pi / 180.0}
"""Units of angular rates, and their factors to rad/s."""
FORCE_UNITS: Final = {"m/s2": 1.0, "g": STANDARD_GRAVITY_MPS2, "mg": 1e-3 * STANDARD_GRAVITY_MPS2}
"""Units of specific forces, and their factors to m/s²."""


@dataclass(frozen=True)
class StatedUnits:
    """Units of an IMU's numbers that replace those of its format, and scales; None where the format's count."""

    rate_unit: str | None = None
    force_unit: str | None = None
    rate_scale: float = 1.0
    force_scale: float = 1.0

    def factors(self, rate: float, force: float) -> tuple[float, float]:
        """Factors to rad/s and m/s² of numbers whose factors are `rate` and `force` by their format."""
        rate = RATE_UNITS[self.rate_unit] if self.rate_unit is not None else rate
        force = FORCE_UNITS[self.force_unit] if self.force_unit is not None else force
        return self.rate_scale * rate, self.force_scale * force

    def in_si(self, values: FloatArray) -> FloatArray:
        """Angular rates and specific forces (n, 6) in rad/s and m/s², of numbers of a format that has these units."""
        rate, force = self.factors(1.0, 1.0)
        return np.asarray(values * np.repeat([rate, force], 3), np.float64)


UNITS_OF_FORMAT: Final = StatedUnits()


@dataclass(frozen=True)
class InertialTrack:
    """Angular rate and specific force in the axes of the IMU, in the order of time.

    Attributes:
        t_s: (n,) UTC, strictly increasing.
        rate_radps: (n, 3) angular rate against inertial space.
        force_mps2: (n, 3) specific force: at rest it points up.
    """

    t_s: FloatArray
    rate_radps: FloatArray
    force_mps2: FloatArray
    source: str = ""

    def __post_init__(self) -> None:
        check_columns(self, rate_radps=3, force_mps2=3)

    def __len__(self) -> int:
        return len(self.t_s)

    def part(self, chosen: slice) -> "InertialTrack":
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
    ) -> "InertialNoise":
        """Noise in the units of data sheets."""
        dps = np.pi / 180.0
        mg = 1e-3 * STANDARD_GRAVITY_MPS2
        return cls(
            gyro_deg_s_rthz * dps, accel_mg_rthz * mg, gyro_bias_deg_s * dps, accel_bias_mg * mg,
            gyro_walk_deg_s_rts * dps, accel_walk_mg_rts * mg,
        )  # fmt: skip


_NOISE_FIGURES: Final = (
    "gyro_deg_s_rthz", "accel_mg_rthz", "gyro_bias_deg_s", "accel_bias_mg", "gyro_walk_deg_s_rts", "accel_walk_mg_rts",
)  # fmt: skip
IMU_CLASSES: Final = {
    "consumer": dict(zip(_NOISE_FIGURES, (0.01, 0.3, 0.5, 30.0, 0.002, 0.05), strict=True)),
    "industrial": dict(zip(_NOISE_FIGURES, (0.0035, 0.14, 0.1, 10.0, 0.0004, 0.01), strict=True)),
    "tactical": dict(zip(_NOISE_FIGURES, (0.0012, 0.05, 0.01, 3.0, 0.0001, 0.005), strict=True)),
}
"""Typical figures: of phones and hobby autopilots (MPU-9250, ICM-20948), of industrial MEMS units (VN-100, Xsens MTi),
and of tactical ones (ADIS16490, HG4930). Data sheets state the noise; spread and walk of the biases are rounded up."""
IMU_MODELS: Final = {
    **dict.fromkeys(("VN-100", "VN-200", "VN-300", "MTi-300", "MTi-680G"), "industrial"),
    **dict.fromkeys(("BMI088", "ICM-20948", "MPU-9250"), "consumer"),
    **dict.fromkeys(("ADIS16490", "HG4930"), "tactical"),
}
"""The class of each model that `[imu] class` may name."""


def inertial_noise(kind: str, stated: Mapping[str, float] | None = None) -> InertialNoise:
    """The noise of a class or model of IMU, with the figures of a data sheet that are stated instead of its own."""
    return InertialNoise.of_data_sheet(**(IMU_CLASSES[IMU_MODELS.get(kind, kind)] | dict(stated or {})))
