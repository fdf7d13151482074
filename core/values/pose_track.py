"""Poses of the vehicle from a file, before they are transformed to the map frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class PoseTrack:
    """Positions and attitudes of the vehicle frame, in the order of time.

    Attributes:
        t_s: (n,) UTC, strictly increasing.
        position: (n, 3): easting, northing, height in the session's map frame if `projected`, else longitude and
            latitude in degrees and height above the ellipsoid in metres.
        projected: see `position`.
        roll_deg: (n,) positive right side down.
        pitch_deg: (n,) positive nose up.
        heading_deg: (n,) clockwise from north.
        true_north: whether `heading_deg` counts from true north instead of grid north.
        sigma: (n, 6) standard deviations (e, n, h in metres; roll, pitch, heading in degrees); nan where unstated.
        source: the name of the file, for messages.
    """

    t_s: NDArray[np.float64]
    position: NDArray[np.float64]
    projected: bool
    roll_deg: NDArray[np.float64]
    pitch_deg: NDArray[np.float64]
    heading_deg: NDArray[np.float64]
    true_north: bool
    sigma: NDArray[np.float64]
    source: str = ""

    def __post_init__(self) -> None:
        n = len(self.t_s)
        for name in ("roll_deg", "pitch_deg", "heading_deg"):
            if getattr(self, name).shape != (n,):
                raise ValueError(f"PoseTrack.{name} has shape {getattr(self, name).shape}, not ({n},)")
        if self.position.shape != (n, 3) or self.sigma.shape != (n, 6):
            raise ValueError("PoseTrack.position must be (n, 3) and PoseTrack.sigma (n, 6)")
        if n > 1 and not bool(np.all(np.diff(self.t_s) > 0)):
            raise ValueError("PoseTrack.t_s does not increase")

    def __len__(self) -> int:
        return len(self.t_s)

    def __getitem__(self, index: slice | NDArray[np.bool_]) -> PoseTrack:
        """The track of some of its poses."""
        arrays = ("t_s", "position", "roll_deg", "pitch_deg", "heading_deg", "sigma")
        return replace(self, **{name: getattr(self, name)[index] for name in arrays})
