"""What the scanner sees of surveyed points: the height of the ground by visit, and the middle of a disc."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.pipeline.control.returns_at_points import ReturnsAround
from furrowmap.core.pointclouds.disc_targets import SEARCH_DIAMETERS, find_disc
from furrowmap.core.pointclouds.local_plane import (
    MAX_PLANE_SLOPE,
    PLANE_RADIUS_M,
    LocalPlane,
    local_plane,
)
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.trajectory import Trajectory

VISIT_S: Final = 20.0
"""A point that is not seen for so long is visited again; a longer visit counts as several."""
HEIGHT_FLOOR_M: Final = 0.003
"""Standard deviation of the height of a plane however many returns it has: lasers err by as much each."""
DISC_FLOOR_M: Final = 0.003
"""The same of the middle of a disc."""
MAX_ROUGHNESS_M: Final = 0.06
"""Returns that scatter more about their plane are not of the ground alone."""
UNKNOWN_ATTITUDE_DEG: Final = 0.1
"""Standard deviation of roll, pitch and heading where none is stated."""
DISC_RETURNS: Final = 4_000
"""Returns among which a disc is looked for, at most."""
FINE_DIAMETERS: Final = 1.5
"""Radius of those by which its middle is found."""


class Unseen(StrEnum):
    """Why a point was not observed."""

    NOTHING = ""
    NO_RETURNS = "no-returns"
    FEW_RETURNS = "few-returns"
    STEEP = "steep"
    ROUGH = "rough"


@dataclass(frozen=True)
class SeenHeight:
    """The height of the ground at a point in one visit.

    Attributes:
        above_m: of the ground less the survey.
        slope: its rise to the east and to the north.
        sigma_m: of the height, by scatter, lasers and attitude.
        t_s: UTC of the middle of the returns.
    """

    above_m: float
    slope: tuple[float, float]
    sigma_m: float
    t_s: float
    returns: int


@dataclass(frozen=True)
class SeenDisc:
    """The middle of a disc, by the returns of all visits.

    Attributes:
        off_m: (2,) of it less the survey, to the east and to the north.
        sigma_m: along each axis.
        t_s: (k,) UTC of the visits.
        share: (k,) of the returns that are of each, of sum 1.
    """

    off_m: tuple[float, float]
    sigma_m: float
    t_s: FloatArray
    share: FloatArray


@dataclass(frozen=True)
class SeenPoint:
    """What was seen of a point; `why_not` says why no height was."""

    heights: tuple[SeenHeight, ...] = ()
    disc: SeenDisc | None = None
    why_not: Unseen = Unseen.NOTHING


@dataclass(frozen=True)
class Sight:
    """From where points are seen.

    Attributes:
        trajectory: of the vehicle.
        mounting_sigma_deg: of the scanner's angles, which move what is seen as those of the vehicle do.
        common_sigma_deg: of tilt and of heading, as far as these are errors of the whole frame: they do not count here.
    """

    trajectory: Trajectory
    mounting: Mounting
    mounting_sigma_deg: float = 0.0
    common_sigma_deg: tuple[float, float] = (0.0, 0.0)

    def sigmas_m(self, point_m: FloatArray, t_s: float) -> tuple[float, float]:
        """Standard deviations of height and place (along each axis) by the attitude, of a point (3,) seen at a time.

        A tilt moves the height by the horizontal distance and the place by the vertical one, a turn the place by the
        horizontal distance.
        """
        trajectory = self.trajectory
        before, share, _ = trajectory.interval(t_s)
        nearest = int(before[0]) + int(share[0] > 0.5)
        angles = trajectory.sigma[nearest, 3:]
        roll, pitch, heading = np.where(np.isfinite(angles), angles, UNKNOWN_ATTITUDE_DEG)
        whole = np.array([np.hypot(roll, pitch) / np.sqrt(2.0), heading])
        own = np.sqrt(np.maximum(whole**2 - np.square(self.common_sigma_deg), 0.0))
        tilt, turn = np.radians(np.hypot(own, self.mounting_sigma_deg)).tolist()
        away = point_m - trajectory.xyz_m[nearest]
        flat_m = float(np.hypot(*away[:2]))
        above_m = float(away[2] - self.mounting.xyz_m[2])
        return tilt * flat_m, float(np.hypot(tilt * above_m, turn * flat_m / np.sqrt(2.0)))


def seen_point(point_m: FloatArray, around: ReturnsAround, sight: Sight, disc_m: float | None) -> SeenPoint:
    """What returns around a point (3,) show of it.

    Args:
        disc_m: diameter of the disc that lies on the point; None to look for none.
    """
    disc = _seen_disc(point_m, around, sight, disc_m) if disc_m is not None else None
    at = np.array(disc.off_m) if disc is not None else np.zeros(2)
    close = around.where(np.hypot(*(around.xyz_m[:, :2] - at).T) <= PLANE_RADIUS_M)
    if not len(close):
        return SeenPoint(disc=disc, why_not=Unseen.NO_RETURNS)
    reasons: list[Unseen] = []
    heights: list[SeenHeight] = []
    visit = visits(close.t_s)
    for number in range(int(visit.max()) + 1):
        returns = close.where(visit == number)
        plane = local_plane(returns.xyz_m - np.array([*at, 0.0]))
        why = _why_not(plane)
        if plane is None or why:
            reasons.append(why)
            continue
        t_s = float(np.mean(returns.t_s))
        by_attitude = sight.sigmas_m(point_m, t_s)[0]
        by_scatter = _spread(plane) / np.sqrt(len(plane.above_m))
        sigma = float(np.sqrt(by_scatter**2 + HEIGHT_FLOOR_M**2 + by_attitude**2))
        heights.append(SeenHeight(plane.height_m, plane.slope, sigma, t_s, len(returns)))
    if heights:
        return SeenPoint(tuple(heights), disc)
    return SeenPoint((), disc, max(reasons, key=list(Unseen).index))


def visits(t_s: FloatArray) -> NDArray[np.int64]:
    """Number (n,) of the visit of each of n times, from 0 in the order of time."""
    order = np.argsort(t_s, kind="stable")
    ordered = t_s[order]
    begins = np.diff(ordered, prepend=-np.inf) > VISIT_S
    group = np.cumsum(begins) - 1
    within = np.floor((ordered - ordered[begins][group]) / VISIT_S)
    changes = begins | (np.diff(within, prepend=0.0) != 0.0)
    out = np.empty(len(t_s), np.int64)
    out[order] = np.cumsum(changes) - 1
    return out


def _seen_disc(point_m: FloatArray, around: ReturnsAround, sight: Sight, diameter_m: float) -> SeenDisc | None:
    """The disc at a point; None where none is found."""
    searched = _thinned(around)
    coarse = find_disc(searched.xyz_m[:, :2], searched.intensity, diameter_m, SEARCH_DIAMETERS * diameter_m)
    if coarse is None:
        return None
    near = _thinned(around.where(np.hypot(*(around.xyz_m[:, :2] - coarse).T) <= FINE_DIAMETERS * diameter_m))
    fine = find_disc(near.xyz_m[:, :2] - coarse, near.intensity, diameter_m, 0.5 * diameter_m)
    if fine is None:
        return None
    off = coarse + fine
    inside = near.where(np.hypot(*(near.xyz_m[:, :2] - off).T) <= 0.5 * diameter_m)
    visit = visits(inside.t_s)
    share = np.bincount(visit) / len(inside)
    t_s = np.bincount(visit, inside.t_s - inside.t_s[0]) / np.bincount(visit) + inside.t_s[0]
    by_attitude = np.array([sight.sigmas_m(point_m, float(t))[1] for t in t_s])
    variance = _edge_sigma_m(len(inside), diameter_m) ** 2 + DISC_FLOOR_M**2 + np.sum((share * by_attitude) ** 2)
    return SeenDisc((float(off[0]), float(off[1])), float(np.sqrt(variance)), t_s, share)


def _edge_sigma_m(returns: int, diameter_m: float) -> float:
    """Standard deviation along an axis of the middle of a disc by its edge, from the number of returns inside.

    With a density ρ of returns the edge lies between two, ρ^-½ apart, a distance that is distributed evenly; there are
    π D ρ^½ such places on it, half of the information of which is along an axis.
    """
    density = returns / (0.25 * np.pi * diameter_m**2)
    edge_m = density**-0.5 / np.sqrt(12.0)
    return float(edge_m * np.sqrt(2.0 / (np.pi * diameter_m * np.sqrt(density))))


def _thinned(around: ReturnsAround) -> ReturnsAround:
    """Every so manieth return, DISC_RETURNS at most."""
    step = -(-len(around) // DISC_RETURNS)
    return around.where(np.arange(len(around)) % step == 0) if step > 1 else around


def _why_not(plane: LocalPlane | None) -> Unseen:
    """Why a plane gives no height."""
    if plane is None:
        return Unseen.FEW_RETURNS
    if plane.steepness > MAX_PLANE_SLOPE:
        return Unseen.STEEP
    return Unseen.ROUGH if _spread(plane) > MAX_ROUGHNESS_M else Unseen.NOTHING


def _spread(plane: LocalPlane) -> float:
    """Standard deviation of returns about their plane."""
    return float(np.sqrt(np.sum(plane.above_m**2) / max(plane.freedom, 1)))
