"""The machine in space: its four wheels stand on the ground of the moment, and it sways on its tyres.

A mount may turn against the vehicle; a file says how.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from furrowmap.core.simulator.drive import DRIVE_RATE_HZ, SimulatedTrack
from furrowmap.core.simulator.noise import FloatArray, band_noise, random_for
from furrowmap.core.simulator.scenario import MovingMount, Sway, Tractor
from furrowmap.core.simulator.site import SimulatedSite
from furrowmap.core.simulator.soil_over_time import Ground, ground_height


@dataclass(frozen=True)
class SimulatedMountMotion:
    """Sines of roll, pitch and yaw of the mount against the vehicle; `phase_rad` (3,) is at t0."""

    mount: MovingMount
    phase_rad: FloatArray

    @classmethod
    def with_random_phases(cls, mount: MovingMount, seed: int) -> "SimulatedMountMotion":
        """With phases by chance."""
        return cls(mount, random_for(seed, "mount").uniform(0.0, 2.0 * np.pi, 3))

    def angles_deg(self, t_s: FloatArray) -> FloatArray:
        """(n, 3) roll, pitch, yaw."""
        turns = 2.0 * np.pi * np.outer(t_s, self.mount.frequency_hz) + self.phase_rad
        return np.array(self.mount.amplitude_deg) * np.sin(turns)

    def mounted(self, t_s: FloatArray, rigid: FloatArray, xyz_m: tuple[float, float, float]) -> FloatArray:
        """(n, 3, 4) rotations from sensor to vehicle, and its origin, about which the mount turns."""
        roll, pitch, yaw = np.radians(self.angles_deg(t_s)).T
        turned = vehicle_rotation(roll, -pitch, yaw) @ rigid
        origin = np.broadcast_to(np.array(xyz_m)[:, None], (len(t_s), 3, 1))
        return np.concatenate([turned, origin], axis=2)

    def write(self, file: Path, site: SimulatedSite, end_s: float, seed: int) -> None:
        """The series as CSV, from a second before t0 to a second after `end_s`."""
        t_s = np.arange(-self.mount.rate_hz, round((end_s + 1.0) * self.mount.rate_hz)) / self.mount.rate_hz
        angles = self.angles_deg(t_s)
        angles += self.mount.noise_deg * random_for(seed, "mount file").standard_normal(angles.shape)
        names = "time_unix_s,roll_deg,pitch_deg,yaw_deg"
        np.savetxt(
            file, np.column_stack([site.t0_s + t_s, angles]), fmt="%.4f,%.5f,%.5f,%.5f", header=names, comments=""
        )


_MOTION_BLOCK: Final = 20_000
_PATCH: Final = 5
"""Points along the edge of the square on which a tyre rests."""


@dataclass(frozen=True)
class SimulatedMotion:
    """Position and attitude of the vehicle frame at `RATE_HZ`.

    Attributes:
        xyz_m: (n, 3) its origin, local.
        roll_rad: (n,) right side down positive.
        pitch_rad: (n,) nose up positive.
        yaw_rad: (n,) counter-clockwise from east, without jumps.
        dusty: (n,) 1 where the tool works and the machine moves, else 0.
        scale: horizontal metres of the map for a metre on the ground.
    """

    t_s: FloatArray
    xyz_m: FloatArray
    roll_rad: FloatArray
    pitch_rad: FloatArray
    yaw_rad: FloatArray
    tool_m: FloatArray
    dusty: FloatArray
    scale: float = 1.0

    def at(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(xyz_m (n, 3), axes (n, 3, 3)) at times within the motion: the axes take metres of the vehicle to local."""
        xyz = np.stack([np.interp(t_s, self.t_s, self.xyz_m[:, k]) for k in range(3)], axis=-1)
        angles = (np.interp(t_s, self.t_s, a) for a in (self.roll_rad, self.pitch_rad, self.yaw_rad))
        return xyz, np.array([[self.scale], [self.scale], [1.0]]) * vehicle_rotation(*angles)

    def of_point(self, t_s: FloatArray, xyz_m: tuple[float, float, float]) -> FloatArray:
        """(n, 3) local positions of a point of the vehicle frame."""
        origin, rotation = self.at(t_s)
        position: FloatArray = origin + rotation @ np.array(xyz_m)
        return position


def vehicle_rotation(roll_rad: FloatArray, pitch_rad: FloatArray, yaw_rad: FloatArray) -> FloatArray:
    """(n, 3, 3) rotations from vehicle to map: right side down by roll, nose up by pitch, then turned by yaw."""
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll_rad, pitch_rad, yaw_rad) for f in (np.cos, np.sin))
    forward = np.stack([cy * cp, sy * cp, sp], axis=-1)
    level_left = np.stack([-sy, cy, np.zeros_like(sy)], axis=-1)
    level_up = np.cross(forward, level_left)
    left = cr[..., None] * level_left + sr[..., None] * level_up
    return np.stack([forward, left, np.cross(forward, left)], axis=-1)


def mount_rotation(rpy_deg: tuple[float, float, float]) -> FloatArray:
    """(3, 3) from sensor to vehicle, ``Rz(yaw)·Ry(pitch)·Rx(roll)``."""
    roll, pitch, yaw = np.radians(rpy_deg)
    return vehicle_rotation(np.array(roll), np.array(-pitch), np.array(yaw))


def stand_on(
    ground: Ground, track: SimulatedTrack, tractor: Tractor, sway: Sway, rng: np.random.Generator
) -> SimulatedMotion:
    """The drive in space.

    The rear axle lies on its two wheels and gives height and roll; the front axle swings about its middle, as on most
    tractors, so that only the mean of its wheels counts and gives pitch.
    """
    half_rear = 0.5 * tractor.track_rear_m
    half_front = 0.5 * tractor.track_front_m
    wheels = [
        (0.0, half_rear),
        (0.0, -half_rear),
        (tractor.wheelbase_m, half_front),
        (tractor.wheelbase_m, -half_front),
    ]
    rear_left, rear_right, front_left, front_right = (
        tyre_height(ground, track, x_m, y_m, tractor.tyre_m) for x_m, y_m in wheels
    )
    rear = 0.5 * (rear_left + rear_right)
    front = 0.5 * (front_left + front_right)
    n = len(track.t_s)
    driving = np.clip(np.abs(track.speed_mps) / 0.5, 0.0, 1.0)
    window = np.hanning(DRIVE_RATE_HZ // 2 + 2)[1:-1]
    driving = np.convolve(np.pad(driving, len(window) // 2, "edge"), window / window.sum(), "same")[len(window) // 2 :][
        :n
    ]
    moved = [driving * band_noise(rng, n, DRIVE_RATE_HZ, 1.0, 3.0) for _ in range(3)]
    shaken = [np.radians(sway.vibration_deg) * band_noise(rng, n, DRIVE_RATE_HZ, 12.0, 18.0) for _ in range(2)]
    height = rear + sway.heave_m * moved[2]
    return SimulatedMotion(
        track.t_s,
        np.stack([track.e_m, track.n_m, height], axis=-1),
        np.arctan2(rear_left - rear_right, tractor.track_rear_m) + np.radians(sway.sway_deg) * moved[0] + shaken[0],
        np.arctan2(front - rear, tractor.wheelbase_m) + np.radians(sway.sway_deg) * moved[1] + shaken[1],
        track.yaw_rad,
        track.tool_m,
        (track.down & (np.abs(track.speed_mps) > 0.05)).astype(np.float64),
    )


def tyre_height(ground: Ground, track: SimulatedTrack, x_m: float, y_m: float, tyre_m: float) -> FloatArray:
    """(n,) mean height of the ground under a tyre at (`x_m`, `y_m`) of the vehicle, at the track's times."""
    offset = (np.arange(_PATCH) - 0.5 * (_PATCH - 1)) * (tyre_m / _PATCH)
    x, y = (a.ravel() for a in np.meshgrid(x_m + offset, y_m + offset))
    out = np.empty(len(track.t_s), np.float64)
    for begin in range(0, len(out), _MOTION_BLOCK):
        part = slice(begin, begin + _MOTION_BLOCK)
        c = np.cos(track.yaw_rad[part, None])
        s = np.sin(track.yaw_rad[part, None])
        e = track.e_m[part, None] + c * x - s * y
        n = track.n_m[part, None] + s * x + c * y
        t = np.broadcast_to(track.t_s[part, None], e.shape)
        out[part] = ground_height(ground, e.ravel(), n.ravel(), t.ravel()).reshape(e.shape).mean(axis=1)
    return out
