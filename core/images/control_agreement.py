"""Which surveyed points agree with each other and with the poses, before they place a block of images.

The differences between where the poses see points and where these were surveyed have a joint normal distribution, by
the errors of the poses, which all points share, the noise of the views, the camera's intrinsics and the survey. Points
enter one by one in a forward search (Atkinson and Riani 2000, Robust diagnostic regression analysis): always the one
that the poses and the points before it predict best, until that one is off by too many standard deviations. The largest
set that agrees is kept.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from furrowmap.core.images.block_adjustment import AdjustedBlock, ImageBlock, Known, adjusted_poses, place_by_images
from furrowmap.core.images.ties import Ties
from furrowmap.core.runtime.arrays import FloatArray, IntArray

MAX_SIGMAS: Final = 5.0
"""Distance of a point from where the others and the poses expect it, in standard deviations of all axes together."""
INTRINSICS_SHARE: Final = 0.001
"""Standard deviation of a calibrated focal length, principal point and distortion, over the focal length."""
MAX_SHIFT_M: Final = 1000.0
"""What another datum, height system or base station may move all points by; more is an error of the points alone."""


@dataclass(frozen=True)
class ControlAgreement:
    """What surveyed points say of each other.

    Attributes:
        kept: (c,) whether a point agrees with the poses and the others.
        off_m: (c, 3) surveyed minus expected by poses and kept points: easting, northing, height.
        shift_m: (3,) surveyed minus seen, common to points that agree with each other and contradict the poses; None
            where there is no such shift.
        alike: number of these points.
    """

    kept: NDArray[np.bool_]
    off_m: FloatArray
    shift_m: FloatArray | None = None
    alike: int = 0


def held_against_poses(block: ImageBlock, adjusted: AdjustedBlock, views: Ties, known: Known) -> ControlAgreement:
    """The surveyed points that agree with the poses of a block that was adjusted without them.

    Args:
        views: of the points alone.
        known: what was surveyed of them, in the same order.
    """
    seen_m, covariance = place_by_images(block, adjusted, views)
    begin = np.flatnonzero(np.diff(views.point, prepend=-1))
    away_m = seen_m - adjusted_poses(block, adjusted).xyz_m[views.frame[begin]]
    by_intrinsics_m = INTRINSICS_SHARE * np.linalg.norm(away_m, axis=1)
    # All points are seen with the same focal length; distortion is of each place in the image.
    shared = np.outer(by_intrinsics_m, by_intrinsics_m) + np.diag(by_intrinsics_m**2)
    covariance = covariance + np.kron(shared, np.eye(3)) + np.diag(known.sigma_m.ravel() ** 2)
    return agreement_of(known.xyz_m - seen_m, covariance)


def agreement_of(off_m: FloatArray, covariance: FloatArray) -> ControlAgreement:
    """The points that agree; none where it cannot be told which are right.

    Args:
        off_m: (c, 3) surveyed minus seen by the poses.
        covariance: (3 c, 3 c) of these differences.
    """
    points = len(off_m)
    kept = _common_to(_largest_sets(off_m, covariance))
    if len(kept) < points:
        together = covariance + np.kron(np.ones((points, points)), MAX_SHIFT_M**2 * np.eye(3))
        alike = _common_to(_largest_sets(off_m, together))
        # The poses are a witness, too.
        if len(alike) > len(kept) and (len(alike) > 1 or points == 1):
            return ControlAgreement(np.zeros(points, np.bool_), off_m, off_m[alike].mean(axis=0), len(alike))
    chosen = np.zeros(points, np.bool_)
    chosen[kept] = True
    return ControlAgreement(chosen, off_m - _predicted(kept, off_m, covariance)[0])


def _common_to(sets: list[IntArray]) -> IntArray:
    """The points of all sets: where equally large ones contradict each other, nobody knows which is right."""
    common = set.intersection(*(set(one.tolist()) for one in sets)) if sets else set()
    return np.array(sorted(common), np.int64)


def _largest_sets(off_m: FloatArray, covariance: FloatArray) -> list[IntArray]:
    """The largest sets of points that agree, each grown from another point."""
    from_poses = _predicted(np.zeros(0, np.int64), off_m, covariance)[1]
    found: list[IntArray] = []
    for seed in np.argsort(from_poses).tolist():
        if from_poses[seed] > MAX_SIGMAS:
            break
        grown = _grown(seed, off_m, covariance)
        if len(grown) == len(off_m):
            return [grown]
        found.append(grown)
    most = max(map(len, found), default=0)
    return [one for one in found if len(one) == most]


def _grown(seed: int, off_m: FloatArray, covariance: FloatArray) -> IntArray:
    """The points that agree with one, in the order in which they join it."""
    members = [seed]
    while len(members) < len(off_m):
        sigmas = _predicted(np.array(members), off_m, covariance)[1]
        sigmas[members] = np.inf
        nearest = int(np.argmin(sigmas))
        if sigmas[nearest] > MAX_SIGMAS:
            break
        members.append(nearest)
    return np.array(members, np.int64)


def _predicted(given: IntArray, off_m: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What given points (k,) say of all: (c, 3) expected differences, and (c,) standard deviations off these."""
    points = len(off_m)
    known = (3 * given[:, None] + np.arange(3)).ravel()
    beside = covariance[known]
    expected = np.zeros(3 * points)
    left = covariance
    if len(known):
        factor = scipy.linalg.cho_factor(covariance[np.ix_(known, known)], lower=True)
        gain = scipy.linalg.cho_solve(factor, beside)
        expected = gain.T @ off_m.ravel()[known]
        left = covariance - beside.T @ gain
    apart = off_m - expected.reshape(points, 3)
    own = left.reshape(points, 3, points, 3)[np.arange(points), :, np.arange(points)]
    return expected.reshape(points, 3), np.array([_length(*one) for one in zip(apart, own, strict=True)])


def _length(off: FloatArray, variance: FloatArray) -> float:
    """Length (3,) in standard deviations; that of a given point, whose variance is used up, is of no meaning."""
    values, axes = np.linalg.eigh(variance)
    return float(np.linalg.norm(off @ axes / np.sqrt(np.maximum(values, 1e-12))))
