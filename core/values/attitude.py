"""Attitude of the vehicle by an attitude and heading reference system (AHRS)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

TRUE: Final = "true"
GRID: Final = "grid"
MAGNETIC: Final = "magnetic"
UNSTATED: Final = ""
"""From which north headings count."""


@dataclass(frozen=True)
class AttitudeTrack:
    """Attitudes in the conventions of files, in the order of time.

    Attributes:
        t_s: (n,) UTC, strictly increasing.
        roll_deg: (n,) positive right side down; nan where it is not recorded, as for the others.
        pitch_deg: (n,) positive nose up.
        heading_deg: (n,) clockwise from north.
        north: "true", "grid", "magnetic", or "" if the file does not state it.
        source: the name of the file or topic, for messages.
    """

    t_s: FloatArray
    roll_deg: FloatArray
    pitch_deg: FloatArray
    heading_deg: FloatArray
    north: str = UNSTATED
    source: str = ""

    def __post_init__(self) -> None:
        n = len(self.t_s)
        if any(values.shape != (n,) for values in (self.roll_deg, self.pitch_deg, self.heading_deg)):
            raise ValueError("AttitudeTrack has arrays of different lengths")
        if n > 1 and not bool(np.all(np.diff(self.t_s) > 0)):
            raise ValueError("AttitudeTrack.t_s does not increase")

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def has_level(self) -> bool:
        """Whether it has roll and pitch."""
        return bool(np.isfinite(self.roll_deg).any() and np.isfinite(self.pitch_deg).any())

    @property
    def has_heading(self) -> bool:
        """Whether it has headings."""
        return bool(np.isfinite(self.heading_deg).any())
