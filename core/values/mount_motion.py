"""How the mount of a scanner turns against the vehicle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class MountMotion:
    """Attitude of a mount in the vehicle frame over time, interpolated between samples.

    Attributes:
        t_s: (n,) UTC, strictly increasing.
        quaternion: (n, 4) (w, x, y, z) unit quaternions, mount to vehicle: a mount at rest has the vehicle's axes.
    """

    t_s: FloatArray
    quaternion: FloatArray

    def __post_init__(self) -> None:
        if self.quaternion.shape != (len(self.t_s), 4):
            raise ValueError(f"MountMotion.quaternion has shape {self.quaternion.shape}, not ({len(self.t_s)}, 4)")
        if len(self.t_s) < 2 or not bool(np.all(np.diff(self.t_s) > 0)):
            raise ValueError("MountMotion.t_s does not increase")
