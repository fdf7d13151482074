"""A mount that turns against the vehicle, and the file that says how."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from furrowmap.core.simulator.flight_scenario import MovingMount
from furrowmap.core.simulator.motion import vehicle_rotation
from furrowmap.core.simulator.noise import FloatArray, random_for
from furrowmap.core.simulator.site import SimulatedSite


@dataclass(frozen=True)
class SimulatedMountMotion:
    """Sines of roll, pitch and yaw of the mount against the vehicle; `phase_rad` (3,) is at t0."""

    mount: MovingMount
    phase_rad: FloatArray

    @classmethod
    def with_random_phases(cls, mount: MovingMount, seed: int) -> SimulatedMountMotion:
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
