"""Tilt of the ground in the vehicle frame as scans show it: a scanner upside down, or far from its stated mounting."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import Scan

BETWEEN_M: Final = (2.0, 15.0)
"""Distances from the scanner of the returns that are looked at: beyond the vehicle, before the field's end."""
MOST_RETURNS: Final = 4_000
LEAST_RETURNS: Final = 200
PLANES: Final = 400
WITHIN_M: Final = 0.12
LEVEL_DEG: Final = 20.0
"""A field and the vehicle on it are never steeper together."""
UPRIGHT_DEG: Final = (65.0, 115.0)
"""A plane of such a tilt may be a wall."""
CLEAR: Final = 2.0
"""Returns on another plane must be so many times those on a level one below the scanner."""


@dataclass(frozen=True)
class GroundTilt:
    """How the ground lies in the vehicle frame.

    Attributes:
        tilt_deg: angle between the vehicle's z axis and the upward normal of the ground; 0 where it is as it should be.
        upside_down: whether it would be as it should be with the scanner turned over.
    """

    tilt_deg: float = 0.0
    upside_down: bool = False


LEVEL: Final = GroundTilt()
"""As it should be."""


def ground_tilt(scans: Sequence[Scan], mounting: Mounting) -> GroundTilt:
    """How the ground lies in the vehicle frame.

    The ground is the plane with most returns (RANSAC; Fischler and Bolles 1981). It is as it should be if a plane below
    the scanner, level to LEVEL_DEG, has nearly as many. With an upright plane it may be a wall, unless turning the
    scanner over, or its pitch, makes it level.

    Args:
        scans: some at the begin of the recording.
        mounting: of the scanner, as stated.
    """
    places = np.concatenate([np.zeros((0, 3)), *(np.asarray(scan.xyz_m, np.float64) for scan in scans)])
    distance = np.linalg.norm(places, axis=1)
    places = places[(distance > BETWEEN_M[0]) & (distance < BETWEEN_M[1])]
    places = places[:: max(1, len(places) // MOST_RETURNS)]
    if len(places) < LEAST_RETURNS:
        return LEVEL
    corners = places[np.random.default_rng(0).integers(0, len(places), (PLANES, 3))]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-9)[:, None]
    away = np.einsum("ij,ij->i", normal, corners[:, 0])
    # The scanner, at the origin, is above the ground: the normal points to it.
    normal, away = normal * -np.sign(away)[:, None], -np.abs(away)
    on_plane = (np.abs(places @ normal.T - away) < WITHIN_M).sum(axis=0)

    def tilts(roll_deg: float, pitch_sign: float) -> FloatArray:
        roll, pitch, yaw = mounting.rpy_deg
        up = Mounting(mounting.xyz_m, (roll + roll_deg, pitch_sign * pitch, yaw)).rotation[2]
        return np.asarray(np.degrees(np.arccos(np.clip(normal @ up, -1.0, 1.0))), np.float64)

    tilt = tilts(0.0, 1.0)
    least = CLEAR * np.where(tilt < LEVEL_DEG, on_plane, 0).max()
    turned = {
        (roll_deg, sign): np.where((tilts(roll_deg, sign) < LEVEL_DEG) & (tilt > LEVEL_DEG), on_plane, 0)
        for roll_deg, sign in ((180.0, 1.0), (180.0, -1.0), (0.0, -1.0))
    }
    (roll_deg, _), most = max(turned.items(), key=lambda item: int(item[1].max()))
    if most.max() > least:
        return GroundTilt(float(tilt[np.argmax(most)]), upside_down=roll_deg > 0.0)
    wall = (tilt > UPRIGHT_DEG[0]) & (tilt < UPRIGHT_DEG[1])
    other = np.where(wall | (tilt < LEVEL_DEG), 0, on_plane)
    return GroundTilt(float(tilt[np.argmax(other)])) if other.max() > least else LEVEL
