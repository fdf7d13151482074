"""Whether a scanner's lasers have the elevations of the model that it is read as, by the ground of its first scans.

Packets of several models look alike: a Puck Hi-Res read as a VLP-16 has elevations half as large again. From a scanner
that looks down at an angle, level ground stays nearly as even as it is, but is tilted and at another height than the
mounting says; from one that stands upright it becomes a cone. A wrong mounting does the one or the other as well, but
then it is a chance if the elevations of another model put the ground where it should be.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import Scan

LOOKED_AT_M: Final = (2.0, 15.0)
"""Distances of the returns that are looked at: beyond the vehicle, before the field's end."""
MOST_RETURNS: Final = 8_000
LEAST_RETURNS: Final = 400
TRIED_PLANES: Final = 400
ON_GROUND_PLANE_M: Final = 0.06
REFINED: Final = 4
"""So often a plane is fitted again to the returns on it."""
STATED_TILT_SIGMA_DEG: Final = 1.5
STATED_HEIGHT_SIGMA_M: Final = 0.08
"""A vehicle on a field, as a mounting that is stated rightly shows its ground (one standard deviation)."""
OFF: Final = 4.0
"""Misfit, in standard deviations, from which on the ground is not where the mounting says."""
RIGHT: Final = 2.0
"""Misfit up to which it is."""
AS_EVEN: Final = 0.7
"""The ground must be nearly as even with the elevations that put it in its place, by its share of the returns.
Elevations that are too close make it more even than it is: by a scanner that looks 24° down 0.90 of the returns are on
the plane instead of 0.81, by an upright one 0.83 instead of 0.68."""
MUCH_MORE_EVEN: Final = 1.5
"""With elevations that are off it is a cone, if it has so many times fewer returns on one plane."""


@dataclass(frozen=True)
class GroundPlane:
    """The ground with the elevations of a model.

    Attributes:
        tilt_deg: against the vehicle frame.
        above_m: height above the vehicle frame's origin.
        share: of the returns that lie on it.
    """

    tilt_deg: float
    above_m: float
    share: float

    @property
    def misfit(self) -> float:
        """How far it is from where the mounting says, in standard deviations."""
        return float(np.hypot(self.tilt_deg / STATED_TILT_SIGMA_DEG, self.above_m / STATED_HEIGHT_SIGMA_M))


@dataclass(frozen=True)
class OtherModel:
    """A model that a scanner is likely of, rather than the one that it is read as.

    Attributes:
        name: of it.
        read_as: the one in use.
        ground: with the elevations in use.
    """

    name: str
    read_as: str
    ground: GroundPlane


def other_model(
    scans: Sequence[Scan], mounting: Mounting, elevations_deg: Mapping[str, FloatArray]
) -> OtherModel | None:
    """The model whose elevations put the ground where the mounting has it; None where those in use do, or none does.

    Args:
        scans: some at the begin of the recording.
        mounting: of the scanner, as stated.
        elevations_deg: (lasers,) of each model that the packets may be of, lowest first; the model in use first.
    """
    names = list(elevations_deg)
    places = np.concatenate([np.zeros((0, 3)), *(np.asarray(scan.xyz_m, np.float64) for scan in scans)])
    laser = np.concatenate([np.zeros(0, np.uint8), *(scan.laser for scan in scans)])
    distance = np.linalg.norm(places, axis=1)
    chosen = np.flatnonzero((distance > LOOKED_AT_M[0]) & (distance < LOOKED_AT_M[1]))
    chosen = chosen[:: max(1, len(chosen) // MOST_RETURNS)]
    if len(names) < 2 or len(chosen) < LEAST_RETURNS or laser.max() >= len(elevations_deg[names[0]]):
        return None
    places = places[chosen]
    laser = laser[chosen]
    in_use = elevations_deg[names[0]]
    ground = ground_plane(places, mounting)
    if ground is None:
        return None
    others: list[tuple[float, str]] = []
    for name in names[1:]:
        found = ground_plane(raised(places, (elevations_deg[name] - in_use)[laser]), mounting)
        if found is None or found.misfit > RIGHT:
            continue
        in_place = ground.misfit > OFF and found.share > AS_EVEN * ground.share
        if in_place or found.share > MUCH_MORE_EVEN * ground.share:
            others.append((found.misfit, name))
    return OtherModel(min(others)[1], names[0], ground) if others else None


def raised(places_m: FloatArray, by_deg: FloatArray) -> FloatArray:
    """Returns (n, 3) in the sensor frame, at elevations higher by (n,)."""
    level_m = np.hypot(places_m[:, 0], places_m[:, 1])
    away_m = np.hypot(level_m, places_m[:, 2])
    elevation = np.arctan2(places_m[:, 2], level_m) + np.radians(by_deg)
    across = away_m * np.cos(elevation) / np.maximum(level_m, 1e-9)
    return np.column_stack([places_m[:, 0] * across, places_m[:, 1] * across, away_m * np.sin(elevation)])


def ground_plane(places_m: FloatArray, mounting: Mounting) -> GroundPlane | None:
    """The plane below the scanner with most of the returns (n, 3) in its frame (RANSAC; Fischler and Bolles 1981)."""
    corners = places_m[np.random.default_rng(0).integers(0, len(places_m), (TRIED_PLANES, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-9)[:, None]
    away_m = np.einsum("ij,ij->i", normals, corners[:, 0])
    # The scanner, at the origin, is above the ground: the normal points to it.
    normals = normals * -np.sign(away_m)[:, None]
    away_m = -np.abs(away_m)
    up = mounting.rotation[2]
    each = zip(normals, away_m, strict=True)  # plane by plane, in the processor's cache
    count = np.array([np.count_nonzero(np.abs(places_m @ one - off) < ON_GROUND_PLANE_M) for one, off in each])
    count[normals @ up < np.cos(np.pi / 4.0)] = 0
    if not count.any():
        return None
    normal = normals[np.argmax(count)]
    off_m = float(away_m[np.argmax(count)])
    for _ in range(REFINED):
        normal, off_m = _fitted(places_m[np.abs(places_m @ normal - off_m) < ON_GROUND_PLANE_M], normal)
    share = float(np.mean(np.abs(places_m @ normal - off_m) < ON_GROUND_PLANE_M))
    tilt_deg = float(np.degrees(np.arccos(np.clip(normal @ up, -1.0, 1.0))))
    # Where the vertical through the scanner meets the plane.
    below_m = off_m / float(normal @ up)
    return GroundPlane(tilt_deg, below_m + mounting.xyz_m[2], share)


def _fitted(on_plane_m: FloatArray, like: FloatArray) -> tuple[FloatArray, float]:
    """Unit normal of the plane through places (n, 3), on the side of another one, and its distance from the origin."""
    middle: NDArray[np.float64] = on_plane_m.mean(axis=0)
    normal = np.linalg.svd(on_plane_m - middle, full_matrices=False)[2][2]
    normal = normal * (1.0 if normal @ like > 0.0 else -1.0)
    return normal, float(normal @ middle)
