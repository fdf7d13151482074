"""Poses and attitudes from files: of the vehicle, before they are transformed to the map frame, and of a mount."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray, check_columns

TRUE_NORTH: Final = "true"
GRID_NORTH: Final = "grid"
MAGNETIC_NORTH: Final = "magnetic"
UNSTATED_NORTH: Final = ""
"""From which north headings count."""


@dataclass(frozen=True)
class PoseTrack:
    """Positions and attitudes of the vehicle frame, in the order of time.

    Attributes:
        t_s: (n,) UTC, strictly increasing.
        position: (n, 3): easting, northing, height in the session's map frame if `projected`, else longitude and
            latitude in degrees and height above the ellipsoid in metres.
        roll_deg: (n,) positive right side down.
        pitch_deg: (n,) positive nose up.
        heading_deg: (n,) clockwise from north.
        sigma: (n, 6) standard deviations (e, n, h in metres; roll, pitch, heading in degrees); nan where unstated.
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
        check_columns(self, position=3, sigma=6)

    def __len__(self) -> int:
        return len(self.t_s)

    def __getitem__(self, index: slice | NDArray[np.bool_]) -> "PoseTrack":
        """The track of some of its poses."""
        arrays = ("t_s", "position", "roll_deg", "pitch_deg", "heading_deg", "sigma")
        return replace(self, **{name: getattr(self, name)[index] for name in arrays})


@dataclass(frozen=True)
class MountMotion:
    """Attitude of a mount in the vehicle frame at UTC (n,), strictly increasing, interpolated between.

    Quaternions (n, 4) (w, x, y, z) lead from mount to vehicle: a mount at rest has the vehicle's axes.
    """

    t_s: FloatArray
    quaternion: FloatArray

    def __post_init__(self) -> None:
        check_columns(self, quaternion=4)
        if len(self.t_s) < 2:
            raise ValueError("MountMotion.t_s does not increase: it has fewer than two times")


@dataclass(frozen=True)
class AttitudeTrack:
    """Attitudes in the conventions of files, in the order of time.

    Attributes:
        t_s: (n,) UTC, strictly increasing.
        roll_deg: (n,) positive right side down; nan where it is not recorded, as for the others.
        pitch_deg: (n,) positive nose up.
        heading_deg: (n,) clockwise from north.
        north: "true", "grid", "magnetic", or "" if the file does not state it.
    """

    t_s: FloatArray
    roll_deg: FloatArray
    pitch_deg: FloatArray
    heading_deg: FloatArray
    north: str = UNSTATED_NORTH
    source: str = ""

    def __post_init__(self) -> None:
        check_columns(self)

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def has_heading(self) -> bool:
        """Whether it has headings."""
        return bool(np.isfinite(self.heading_deg).any())
