"""What the scanner sees of surveyed points: the height of the ground by visit, and the middle of a target."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.pipeline.control.returns_at_points import ReturnsAround
from furrowmap.core.pointclouds.flat_targets import TargetShape, find_target
from furrowmap.core.pointclouds.local_plane import (
    MAX_PLANE_SLOPE,
    PLANE_RADIUS_M,
    LocalPlane,
    local_plane,
)
from furrowmap.core.pointclouds.plane_corners import CORNER_REACH_M, CORNER_SEARCH_M, find_corner
from furrowmap.core.pointclouds.survey_targets import Target, TargetKind
from furrowmap.core.runtime.arrays import FloatArray, three
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.trajectory import Trajectory

VISIT_S: Final = 20.0
"""A point that is not seen for so long is visited again; a longer visit counts as several."""
HEIGHT_FLOOR_M: Final = 0.003
"""Standard deviation of the height of a plane however many returns it has: lasers err by as much each."""
TARGET_FLOOR_M: Final = 0.003
"""The same of the middle of a target, along each axis."""
MAX_ROUGHNESS_M: Final = 0.06
"""Returns that scatter more about their plane are not of the ground alone."""
UNKNOWN_ATTITUDE_DEG: Final = 0.1
"""Standard deviation of roll, pitch and heading where none is stated."""
TARGET_RETURNS: Final = 4_000
"""Returns among which a target is looked for, at most."""
FINE_DIAMETERS: Final = 1.5
"""Radius of those by which its middle is found, in its sizes."""
PICTURE_PIXELS: Final = 48
"""Rows and columns of a picture."""
PICTURE_SIZES: Final = 0.9
"""Of a target, from its middle to the edge of its picture."""


class Unseen(StrEnum):
    """Why a point was not observed."""

    NOTHING = ""
    NO_RETURNS = "no-returns"
    FEW_RETURNS = "few-returns"
    STEEP = "steep"
    ROUGH = "rough"
    NO_TARGET = "no-target"


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
class SeenTarget:
    """The middle of a target, by the returns of all visits.

    Attributes:
        off_m: (2,) of it less the survey, to the east and to the north; (3,) of a corner, with the height.
        sigma_m: along each axis.
        t_s: (k,) UTC of the visits.
        share: (k,) of the returns that are of each, of sum 1.
    """

    off_m: tuple[float, ...]
    sigma_m: tuple[float, ...]
    t_s: FloatArray
    share: FloatArray


@dataclass(frozen=True)
class TargetPicture:
    """The mean intensity of the returns around a point, from above.

    Attributes:
        intensity: (rows, columns), the first row in the north; nan where no return is.
        side_m: of the whole, whose middle is the surveyed place.
        off_m: (2,) of the middle of the target that was found; None where none was.
    """

    intensity: FloatArray
    side_m: float
    off_m: tuple[float, float] | None


@dataclass(frozen=True)
class SeenPoint:
    """What was seen of a point; `why_not` says why no height was, or no target."""

    heights: tuple[SeenHeight, ...] = ()
    target: SeenTarget | None = None
    why_not: Unseen = Unseen.NOTHING
    picture: TargetPicture | None = None

    @property
    def visits(self) -> int:
        """In which its height was seen."""
        by_corner = len(self.target.t_s) if self.target is not None and len(self.target.off_m) == len("enh") else 0
        return len(self.heights) or by_corner


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


def seen_point(point_m: FloatArray, around: ReturnsAround, sight: Sight, target: Target) -> SeenPoint:
    """What returns around a point (3,) show of it.

    Args:
        target: what lies at it; returns farther than it reaches take no part.
    """
    around = around.where(np.hypot(*around.xyz_m[:, :2].T) <= target.reach_m)
    if target.kind is TargetKind.GROUND:
        return _seen_ground(point_m, around, sight, np.zeros(2))
    if target.kind is TargetKind.CORNER:
        corner = _seen_corner(point_m, around, sight)
        why = Unseen.NOTHING if corner is not None else Unseen.NO_TARGET if len(around) else Unseen.NO_RETURNS
        return SeenPoint((), corner, why, _picture(around, target, corner))
    flat = _seen_flat(point_m, around, sight, target)
    off = np.array(flat.off_m) if flat is not None else np.zeros(2)
    ground = _seen_ground(point_m, around, sight, off)
    why = ground.why_not or (Unseen.NO_TARGET if flat is None else Unseen.NOTHING)
    return replace(ground, target=flat, why_not=why, picture=_picture(around, target, flat))


def _seen_ground(point_m: FloatArray, around: ReturnsAround, sight: Sight, at_m: FloatArray) -> SeenPoint:
    """The height of the ground by visit, at a place (2,) beside the point."""
    close = around.where(np.hypot(*(around.xyz_m[:, :2] - at_m).T) <= PLANE_RADIUS_M)
    if not len(close):
        return SeenPoint(why_not=Unseen.NO_RETURNS)
    reasons: list[Unseen] = []
    heights: list[SeenHeight] = []
    visit = visits(close.t_s)
    for number in range(int(visit.max()) + 1):
        returns = close.where(visit == number)
        plane = local_plane(returns.xyz_m - np.array([*at_m, 0.0]))
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
        return SeenPoint(tuple(heights))
    return SeenPoint(why_not=max(reasons, key=list(Unseen).index))


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


def _seen_flat(point_m: FloatArray, around: ReturnsAround, sight: Sight, target: Target) -> SeenTarget | None:
    """The disc or checkerboard at a point; None where none is found."""
    is_disc = target.kind is TargetKind.DISC
    searched = _thinned(around)
    coarse = _middle(searched, target, target.search_m)
    if coarse is None:
        return None
    near = around.where(np.hypot(*(around.xyz_m[:, :2] - coarse).T) <= FINE_DIAMETERS * target.size_m)
    near = _thinned(near.beside(coarse))
    fine = _middle(near, target, 0.5 * target.size_m)
    if fine is None:
        return None
    off = coarse + fine
    inside = near.where(np.hypot(*(near.xyz_m[:, :2] - fine).T) <= 0.5 * target.size_m)
    t_s, share = _visited(inside)
    edge_m = _edge_sigma_m(len(inside), target.size_m, 0.5 * np.pi if is_disc else 1.0)
    by_attitude = np.array([sight.sigmas_m(point_m, t)[1] for t in t_s.tolist()])
    sigma = float(np.sqrt(edge_m**2 + TARGET_FLOOR_M**2 + np.sum((share * by_attitude) ** 2)))
    return SeenTarget((float(off[0]), float(off[1])), (sigma, sigma), t_s, share)


def _middle(around: ReturnsAround, target: Target, search_m: float) -> FloatArray | None:
    """The middle (2,) of the disc or checkerboard among returns; None where none is found."""
    shape: TargetShape = "disc" if target.kind is TargetKind.DISC else "checkerboard"
    return find_target(shape, around.xyz_m[:, :2], around.intensity, target.size_m, search_m)


def _seen_corner(point_m: FloatArray, around: ReturnsAround, sight: Sight) -> SeenTarget | None:
    """The corner at a point; None where none is found."""
    near = _thinned(around.where(np.linalg.norm(around.xyz_m, axis=1) <= CORNER_REACH_M))
    corner = find_corner(near.xyz_m)
    if corner is None:
        return None
    t_s, share = _visited(near.where(corner.used))
    up, aside = (share**2 @ np.square([sight.sigmas_m(point_m, t) for t in t_s.tolist()])).tolist()
    variance = corner.sigma_m**2 + TARGET_FLOOR_M**2 + np.array([aside, aside, up])
    return SeenTarget(three(corner.middle_m), three(np.sqrt(variance)), t_s, share)


def _visited(returns: ReturnsAround) -> tuple[FloatArray, FloatArray]:
    """Middle times (k,) of the visits of returns, and the share (k,) that is of each."""
    visit = visits(returns.t_s)
    count = np.bincount(visit)
    return np.bincount(visit, returns.t_s - returns.t_s[0]) / count + returns.t_s[0], count / len(returns)


def _edge_sigma_m(returns: int, size_m: float, edges: float) -> float:
    """Standard deviation along an axis of the middle of a target by its edges, from the number of returns inside.

    With a density ρ of returns an edge lies between two, ρ^-½ apart, a distance that is distributed evenly; there are
    ρ^½ such places on a metre of it. Of a disc half of the information of its edge, π D, is along an axis; a
    checkerboard has an edge across each axis, as long as its side.

    Args:
        returns: within half of its size around the middle.
        edges: length of the edges across an axis, in sizes.
    """
    density = returns / (0.25 * np.pi * size_m**2)
    edge_m = density**-0.5 / np.sqrt(12.0)
    return float(edge_m / np.sqrt(edges * size_m * np.sqrt(density)))


def _picture(around: ReturnsAround, target: Target, found: SeenTarget | None) -> TargetPicture | None:
    """A picture of the target and what lies round it, or of where it was looked for; None without returns."""
    reach_m = target.reach_m
    if found is not None:
        shown_m = max(PICTURE_SIZES * target.size_m, CORNER_SEARCH_M if target.kind is TargetKind.CORNER else 0.0)
        reach_m = min(reach_m, float(np.max(np.abs(found.off_m[:2]))) + shown_m)
    pixel_m = 2.0 * reach_m / PICTURE_PIXELS
    column, row = np.floor((around.xyz_m[:, :2] * (1.0, -1.0) + reach_m) / pixel_m).astype(np.int64).T
    inside = (np.minimum(column, row) >= 0) & (np.maximum(column, row) < PICTURE_PIXELS)
    if not inside.any():
        return None
    at = (row * PICTURE_PIXELS + column)[inside]
    count = np.bincount(at, minlength=PICTURE_PIXELS**2)
    total = np.bincount(at, around.intensity[inside], minlength=PICTURE_PIXELS**2)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan).reshape(PICTURE_PIXELS, PICTURE_PIXELS)
    return TargetPicture(mean, 2.0 * reach_m, (found.off_m[0], found.off_m[1]) if found is not None else None)


def _thinned(around: ReturnsAround) -> ReturnsAround:
    """Every so manieth return, TARGET_RETURNS at most."""
    step = -(-len(around) // TARGET_RETURNS)
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
