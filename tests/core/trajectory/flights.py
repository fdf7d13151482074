"""Flights with known truth, and the IMU and GNSS that go with them, worked out in earth-centred coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import Transformer
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from furrowmap.core.geodesy.projection import MapFrame, map_frame
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.core.values.inertial import InertialNoise, InertialTrack, inertial_noise
from furrowmap.core.values.rotation import Mounting, attitude_to_quaternion
from furrowmap.core.values.session import Crs

FloatArray = NDArray[np.float64]

CRS = "EPSG:25832"
SITE = (651_500.0, 6_133_880.0, 76.0)
EARTH_RATE = 7.292115e-5
BEGIN_S = 1_779_529_272.0
MOUNTING = Mounting((-0.3, 0.1, -0.2), (180.0, 0.0, 90.0))
LEVER_M = (0.4, -0.2, 0.5)
DRIFT_S = 60.0
INDUSTRIAL = inertial_noise("industrial")


@dataclass(frozen=True)
class Flight:
    """A flight of sines: smooth, known at every time."""

    length_s: float
    seed: int
    speed_mps: float = 4.0

    def _sines(self, t_s: FloatArray, number: int, size: float, slowest_hz: float, fastest_hz: float) -> FloatArray:
        random = np.random.default_rng([self.seed, number])
        frequency = random.uniform(slowest_hz, fastest_hz, 4)
        phase = random.uniform(0, 2 * np.pi, 4)
        share = random.uniform(0.5, 1.0, 4) / 2.0
        out: FloatArray = size * (share * np.sin(2 * np.pi * frequency * t_s[:, None] + phase)).sum(axis=1)
        return out

    def attitude_deg(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Roll, pitch, heading."""
        roll, pitch = (self._sines(t_s, k, 4.0, 0.1, 1.0) for k in (1, 2))
        return roll, pitch, 50.0 + 20.0 * self.seed + self._sines(t_s, 3, 70.0, 0.01, 0.05)

    def xyz_m(self, t_s: FloatArray) -> FloatArray:
        """The vehicle's origin on the map."""
        wave = [self._sines(t_s, 4 + k, size, 0.03, 0.2) for k, size in enumerate((6.0, 6.0, 1.0))]
        return np.asarray(SITE) + np.column_stack(wave) + np.outer(t_s * self.speed_mps, [0.6, 0.8, 0.0])

    def earth(self, t_s: FloatArray, arm_m: FloatArray) -> tuple[FloatArray, Rotation]:
        """A point of the vehicle and its axes in earth-centred, earth-fixed coordinates."""
        to_lon_lat = Transformer.from_crs(CRS, "EPSG:4258", always_xy=True)
        to_earth = Transformer.from_crs("EPSG:4937", "EPSG:4936", always_xy=True)
        e, n, h = self.xyz_m(t_s).T
        lon, lat = to_lon_lat.transform(e, n)
        place = np.column_stack(to_earth.transform(lon, lat, h))
        convergence = frame().convergence_deg(lon, lat)
        roll, pitch, heading = self.attitude_deg(t_s)
        true = Rotation.from_quat(attitude_to_quaternion(roll, pitch, heading + convergence), scalar_first=True)
        level = Rotation.from_euler("ZX", np.column_stack([90.0 + lon, 90.0 - lat]), degrees=True)
        axes = level * true
        return place + axes.apply(arm_m), axes

    @cache  # noqa: B019 -- the same few flights in all tests
    def imu(self, rate_hz: float = 200.0) -> InertialTrack:
        """Exact measurements in the axes of the IMU."""
        t = np.arange(0.0, self.length_s, 1.0 / rate_hz)
        arm = np.asarray(MOUNTING.xyz_m)
        step = 0.02
        places = [self.earth(t + k * step, arm)[0] for k in range(-2, 3)]
        centre = places[2]
        a = [p - centre for p in places]
        velocity = (a[0] - 8 * a[1] + 8 * a[3] - a[4]) / (12 * step)
        acceleration = (-a[0] + 16 * a[1] + 16 * a[3] - a[4]) / (12 * step**2)
        axes = self.earth(t, arm)[1]
        short = 0.002
        turned = (self.earth(t - short, arm)[1].inv() * self.earth(t + short, arm)[1]).as_rotvec() / (2 * short)
        spin = np.array([0.0, 0.0, EARTH_RATE])
        lon, lat, h = Transformer.from_crs("EPSG:4936", "EPSG:4937", always_xy=True).transform(*centre.T)
        up = np.column_stack(
            [np.cos(np.radians(lat)) * np.cos(np.radians(lon)), np.cos(np.radians(lat)) * np.sin(np.radians(lon)),
             np.sin(np.radians(lat))]
        )  # fmt: skip
        sine2 = np.sin(np.radians(lat)) ** 2
        surface = 9.7803267715 * (1 + 0.001931851353 * sine2) / np.sqrt(1 - 0.00669438002290 * sine2)
        gravity = surface - 3.0877e-6 * (1 - 0.00142 * sine2) * np.asarray(h)
        force = axes.inv().apply(acceleration + 2 * np.cross(spin, velocity) + gravity[:, None] * up)
        rate = turned + axes.inv().apply(spin)
        mounted = MOUNTING.rotation
        return InertialTrack(BEGIN_S + t, rate @ mounted, force @ mounted, "flight")

    def track(self, rate_hz: float = 10.0, **columns: Any) -> GnssTrack:
        """Exact positions of the antenna."""
        t = np.arange(0.05, self.length_s, 1.0 / rate_hz)
        place = self.earth(t, np.asarray(LEVER_M))[0]
        lon, lat, h = Transformer.from_crs("EPSG:4936", "EPSG:4937", always_xy=True).transform(*place.T)
        fixed = np.full(len(t), Fix.FIXED)
        return GnssTrack.build(BEGIN_S + t, lon_deg=lon, lat_deg=lat, height_m=h, fix=fixed, **columns)

    @cache  # noqa: B019 -- the same few flights in all tests
    def noisy_track(self, white_m: float = 0.008, drift_m: float = 0.005) -> GnssTrack:
        """Positions with white noise and a slowly varying error, heights half as much again; sigmas are stated."""
        exact, random = self.track(), np.random.default_rng([self.seed, 99])
        n, kept = len(exact), np.exp(-0.1 / DRIFT_S)
        drift = np.empty((n, 3))
        drift[0] = random.normal(0, drift_m, 3)
        for k in range(1, n):
            drift[k] = kept * drift[k - 1] + random.normal(0, drift_m * np.sqrt(1 - kept**2), 3)
        off = (drift + random.normal(0, white_m, (n, 3))) * (1.0, 1.0, 1.5)
        sigma = np.full(n, np.hypot(white_m, drift_m))
        return GnssTrack.build(
            exact.t_s,
            lon_deg=exact.lon_deg + np.degrees(off[:, 0] / 6.38e6 / np.cos(np.radians(exact.lat_deg))),
            lat_deg=exact.lat_deg + np.degrees(off[:, 1] / 6.38e6),
            height_m=exact.height_m + off[:, 2],
            fix=exact.fix,
            sigma_e_m=sigma,
            sigma_n_m=sigma,
            sigma_h_m=1.5 * sigma,
        )

    @cache  # noqa: B019 -- the same few flights in all tests
    def noisy_imu(self, noise: InertialNoise = INDUSTRIAL, rate_hz: float = 200.0) -> InertialTrack:
        """Measurements with white noise and biases that wander."""
        exact, random = self.imu(rate_hz), np.random.default_rng([self.seed, 98])
        n = len(exact)
        parts = []
        for density, spread, walk in (
            (noise.rate, noise.rate_bias, noise.rate_walk), (noise.force, noise.force_bias, noise.force_walk)
        ):  # fmt: skip
            bias = random.normal(0, spread, 3) + np.cumsum(random.normal(0, walk / np.sqrt(rate_hz), (n, 3)), axis=0)
            parts.append(bias + random.normal(0, density * np.sqrt(rate_hz), (n, 3)))
        return InertialTrack(exact.t_s, exact.rate_radps + parts[0], exact.force_mps2 + parts[1], "flight")


class Forward(Flight):
    """A flight, or a drive, along its nose."""

    @cached_property
    def _way(self) -> CubicSpline:
        dense = np.arange(-1.0, self.length_s + 1.0, 0.01)
        heading = np.radians(self.attitude_deg(dense)[2])
        steps = 0.01 * self.speed_mps * np.column_stack([np.sin(heading), np.cos(heading)])
        return CubicSpline(dense, np.column_stack([np.cumsum(steps, axis=0), 0.5 * np.sin(0.5 * dense)]))

    def xyz_m(self, t_s: FloatArray) -> FloatArray:
        return np.asarray(np.asarray(SITE) + self._way(t_s))


def frame() -> MapFrame:
    """The map of all flights."""
    return map_frame(Crs(map=CRS))
