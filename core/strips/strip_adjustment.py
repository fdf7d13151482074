"""Strips of a flight adjusted to each other: ground seen at several times as observations of the trajectory.

Heights of the same cells at several times are observations of the same unknowns as those of GNSS and IMU: of the poses,
and of the scanner's mounting and its lasers' ranges. What GNSS and IMU say of the poses enters as the joint covariance
of their errors at nodes in time, with their correlation over the whole flight, so that the result is that of one
adjustment of everything, linearised at the poses before. A height shows the pose's height; on a slope, and where
the beams are oblique, also its place and attitude.

A mounting's angles may change slowly during the flight. Scans show the pose of the frame that carries the scanner:
errors of the vehicle's pose and turns of the mounting about the scanner's origin together. GNSS and IMU say how errors
of the vehicle's poses are correlated, and a random walk how the mounting's angles are; by both, what the scans show is
divided. The walk is against its mean, which is the mounting.
"""

from concurrent.futures import Future
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.banded import huber_weight
from furrowmap.core.adjustment.correlated_prior import covariance_after, root_of, solved
from furrowmap.core.adjustment.knots import POSE, ROTATION
from furrowmap.core.runtime.arrays import FloatArray, three
from furrowmap.core.runtime.background import beside
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.runtime.progress import silent
from furrowmap.core.strips.boresight import (
    CELL_HEIGHT_SIGMA_M,
    CLOCK_COLUMN,
    MAX_BORESIGHT_SIGMA_DEG,
    PLACE_COLUMNS,
    STATED_PRIOR,
    Boresight,
    boresight,
)
from furrowmap.core.strips.cell_heights import (
    PARAMETERS,
    ROBUST_ROUNDS,
    CellHeights,
    cell_heights,
    derivatives,
    smooth_groups,
)
from furrowmap.core.strips.relief import relief, relief_cell_m, relief_equations
from furrowmap.core.strips.strips import LASER_GROUPS, StripReturns, at_shifted_times
from furrowmap.core.trajectory.from_inertial import ANY_TIME
from furrowmap.core.trajectory.located import Located
from furrowmap.core.trajectory.pose_errors import PoseErrors, without_errors
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.trajectory import Trajectory

FIXED: Final = PARAMETERS + LASER_GROUPS
"""Unknowns beside those of the poses."""
CLEARLY_LESS: Final = 0.8
"""Scatter of the ground's heights at which another clock is better."""
GROUP_M: Final = 0.01
"""Standard deviation of a cell's mean in a window of time beside the noise of its returns.

Residuals show 4 mm. Errors of neighbouring cells go together (slopes, soil that is rough), so that they count less."""


@dataclass(frozen=True)
class MountingWalk:
    """How the angles of a mounting change.

    Attributes:
        carrier: trajectory of the frame that carries the scanner: the vehicle's, turned with the mounting.
        t_s: (m,) times of the nodes.
        angle_deg: (m, 3) rotation vector about the vehicle's axes, against the mean mounting.
        sigma_deg: (m, 3) its standard deviations.
    """

    carrier: Trajectory
    t_s: FloatArray
    angle_deg: FloatArray
    sigma_deg: FloatArray

    def plain(self) -> dict[str, Any]:
        """For `report.json`."""
        return {
            "t_s": np.round(self.t_s, 3).tolist(),
            "angle_deg": np.round(self.angle_deg, 5).tolist(),
            "sigma_deg": np.round(self.sigma_deg, 5).tolist(),
        }


def attitudes_at(trajectory: Trajectory, t_s: FloatArray) -> FloatArray:
    """(m, 3, 3) vehicle to map at the knots beside some times (m,)."""
    nearest = np.minimum(np.searchsorted(trajectory.t_s, np.clip(t_s, *trajectory.span_s)), len(trajectory) - 1)
    out: FloatArray = Rotation.from_quat(trajectory.quaternion[nearest], scalar_first=True).as_matrix()
    return out


def with_walk(
    root: FloatArray, fixed: int, t_s: FloatArray, attitude: FloatArray, lever_m: FloatArray, walk_deg_rts: float
) -> FloatArray:
    """(fixed + 12 m, fixed + 9 m) root of the joint covariance of fixed unknowns, carrier's and vehicle's errors.

    Args:
        root: (fixed + 6 m, fixed + 6 m) of fixed unknowns and of the errors of the vehicle's poses.
        fixed: number of the former.
        t_s: (m,) times of the nodes.
        attitude: (m, 3, 3) vehicle to map at these.
        lever_m: (3,) scanner in the vehicle frame, about which the mounting turns.
        walk_deg_rts: random walk of each angle.
    """
    m = len(t_s)
    steps = np.radians(walk_deg_rts) * np.sqrt(np.diff(t_s, prepend=t_s[0]))
    walk = np.tril(np.broadcast_to(steps, (m, m)))
    walk = walk - walk.mean(axis=0)
    # A turn about the scanner's origin moves that of the vehicle frame.
    moved = np.cross((attitude @ lever_m)[:, :, None], attitude, axis=1)
    by_angle = np.concatenate([moved, attitude], axis=1)
    own = root[fixed:, fixed:]
    turns = np.einsum("iab,ij->iajb", by_angle, walk).reshape(len(own), 3 * m)
    out = np.zeros((fixed + 2 * len(own), fixed + len(own) + 3 * m))
    out[:fixed, :fixed] = root[:fixed, :fixed]
    columns = slice(fixed, fixed + len(own))
    out[columns, columns] = own
    out[columns, fixed + len(own) :] = turns
    out[fixed + len(own) :, columns] = own
    return out


def mounting_walk(
    trajectory: Trajectory, errors: PoseErrors, off: FloatArray, covariance: FloatArray, fixed: int
) -> MountingWalk:
    """What is found of the mounting's changes.

    Args:
        trajectory: of the vehicle, before the errors were found.
        errors: of its poses before.
        off: (fixed + 12 m,) the unknowns in the order of :func:`with_walk`.
        fixed: number of fixed unknowns.
    """
    m = len(errors.t_s)
    ends = (fixed, fixed + POSE * m, fixed + 2 * POSE * m)
    carrier, vehicle = (slice(a, b) for a, b in pairwise(ends))
    of_carrier = PoseErrors(errors.t_s, off[carrier].reshape(m, POSE), covariance[carrier, carrier])
    across = covariance[carrier, vehicle]
    spread = (of_carrier.covariance + covariance[vehicle, vehicle] - across - across.T).reshape(m, POSE, m, POSE)
    own = spread[np.arange(m), ROTATION:, np.arange(m), ROTATION:]
    attitude = attitudes_at(trajectory, errors.t_s)
    turned = (off[carrier] - off[vehicle]).reshape(m, POSE)[:, ROTATION:]
    # Errors are found minus true: the mounting has turned by their negative.
    angle = -np.einsum("iba,ib->ia", attitude, turned)
    variance = np.einsum("iba,ibc,ica->ia", attitude, own, attitude)
    return MountingWalk(
        without_errors(trajectory, errors, of_carrier),
        errors.t_s,
        np.degrees(angle),
        np.degrees(np.sqrt(np.maximum(variance, 0.0))),
    )


@dataclass(frozen=True)
class StripAdjustment:
    """What the strips made of a flight.

    Attributes:
        boresight: adjusted with it.
        before: errors of the poses at nodes in time, as GNSS and IMU know them.
        found: the errors that were found, and their covariance with the strips.
        turned: how the mounting changes, where the session says that it may.
    """

    trajectory: Trajectory
    boresight: Boresight
    before: PoseErrors
    found: PoseErrors
    turned: MountingWalk | None = None

    def plain(self) -> dict[str, Any]:
        """For `report.json`: RMS of what the poses at the nodes were moved, medians of their standard deviations."""
        nodes = self.trajectory.at(np.clip(self.found.t_s, *self.trajectory.span_s)).quaternion
        known = np.isfinite(nodes[:, 0])
        rotation = np.zeros((len(nodes), 3, 3))
        rotation[known] = Rotation.from_quat(nodes[known], scalar_first=True).as_matrix()
        before, after = (np.median(one.sigma(rotation)[known], axis=0) for one in (self.before, self.found))
        moved = np.sqrt(np.mean(self.found.value[:, :3] ** 2, axis=0))
        return {
            "moved_rms_m": np.round(moved, 5).tolist(),
            "sigma_before_m": np.round(before[:3], 5).tolist(),
            "sigma_after_m": np.round(after[:3], 5).tolist(),
            "sigma_before_deg": np.round(np.degrees(before[3:]), 5).tolist(),
            "sigma_after_deg": np.round(np.degrees(after[3:]), 5).tolist(),
            **({} if self.turned is None else {"mounting_walk": self.turned.plain()}),
        }


def scanner_goes_with_imu(
    returns: StripReturns, trajectory: Trajectory, stated: Mounting, ahead_s: float, carrier: Trajectory | None
) -> bool:
    """Whether the ground fits together better if the scanner's clock is off with that of the IMU.

    Args:
        trajectory: of the vehicle, in the time of the positions.
        ahead_s: time by which the IMU's clock was found to be ahead of the positions'.
    """
    moved = at_shifted_times(returns, trajectory if carrier is None else carrier, -ahead_s)
    as_stated, with_imu = (boresight(each, trajectory, stated, carrier) for each in (returns, moved))
    if as_stated is None or with_imu is None:
        return as_stated is None and with_imu is not None
    return with_imu.scatter_m[1] < CLEARLY_LESS * as_stated.scatter_m[1]


def timed_wrongly(trajectory: Trajectory, off_s: float) -> Trajectory:
    """The trajectory with standard deviations enlarged by the way and the turn of a time that may be off."""
    angles = np.radians(np.column_stack(trajectory.attitude_deg()))
    moved = np.column_stack([trajectory.xyz_m, np.degrees(np.unwrap(angles, axis=0))])
    other = np.column_stack([np.interp(trajectory.t_s - off_s, trajectory.t_s, column) for column in moved.T])
    return replace(trajectory, sigma=np.hypot(trajectory.sigma, other - moved))


def calibrate_flight(
    returns: StripReturns,
    located: Located,
    stated: Mounting,
    carrier: Trajectory | None,
    walk_deg_rts: float = 0.0,
    *,
    place_known: bool = False,
) -> tuple[Boresight | None, StripReturns, StripAdjustment | None]:
    """The boresight of a flight's scanner, and the poses adjusted with it where an IMU tells how their errors go.

    Args:
        returns: of the scanner, with their poses.
        stated: the mounting as the session states it.
        carrier: trajectory of the frame that carries the scanner; None for the vehicle's.
        walk_deg_rts: random walk of the mounting's angles.
        place_known: whether the scanner's place stays as stated.

    Returns:
        The boresight, None where too little ground is seen at several times; the returns at the scanner's clock as
        corrected; the adjustment, None where the boresight is not certain or the trajectory has no joint covariance.
    """
    work = located.pose_errors
    aside: AbstractContextManager[Future[PoseErrors] | None] = (
        nullcontext() if work is None else beside(lambda _: work(ANY_TIME), silent)
    )
    with aside as errors:
        found = boresight(returns, located.trajectory, stated, carrier, place_known=place_known)
    if found is None or not found.certain:
        return found, returns, None
    if found.clock_used_s:
        returns = at_shifted_times(returns, located.trajectory if carrier is None else carrier, found.clock_used_s)
    if errors is None:
        return found, returns, None
    adjusted = adjust_strips(returns, located.trajectory, errors.result(), found, stated, walk_deg_rts)
    return adjusted.boresight, returns, adjusted


def adjust_strips(
    returns: StripReturns,
    trajectory: Trajectory,
    errors: PoseErrors,
    found: Boresight,
    stated: Mounting,
    walk_deg_rts: float = 0.0,
) -> StripAdjustment:
    """Trajectory and boresight with ground seen at several times as further observations.

    Args:
        returns: of the scanner, with the poses of the trajectory at its clock as corrected.
        trajectory: of the vehicle, by GNSS and IMU.
        errors: of its poses; their nodes cover its time.
        found: the boresight by the same returns.
        stated: the mounting as the session states it.
        walk_deg_rts: random walk of the mounting's angles.
    """
    mounting = found.mounting.rotation
    lever_m = np.asarray(found.mounting.xyz_m, np.float64)
    node = np.clip(np.searchsorted(errors.t_s, returns.t_s, side="right") - 1, 0, len(errors.t_s) - 2)
    heights = cell_heights(returns, node, mounting, lever_m)
    variance, chosen = smooth_groups(heights)
    fixed = derivatives(returns, heights, chosen, mounting, lever_m)
    design = np.hstack([fixed, _pose_design(returns, heights, chosen, errors)])
    first = FIXED + POSE * heights.window[chosen]
    weight = 1.0 / (variance / heights.count[chosen] + GROUP_M**2)
    corrected = np.zeros(PARAMETERS, np.bool_)
    corrected[CLOCK_COLUMN] = found.clock_used_s != 0.0
    corrected[PLACE_COLUMNS] = np.asarray(found.mounting.xyz_m) != np.asarray(stated.xyz_m)
    spread = np.where(corrected, found.free.sigma, STATED_PRIOR)
    root = root_of(np.concatenate([spread, np.full(LASER_GROUPS, CELL_HEIGHT_SIGMA_M)]), errors.covariance)
    if walk_deg_rts > 0.0:
        root = with_walk(root, FIXED, errors.t_s, attitudes_at(trajectory, errors.t_s), lever_m, walk_deg_rts)
    shapes = relief(returns, node, mounting, lever_m, relief_cell_m(heights))
    everything = np.arange(len(shapes.groups.cell))

    def by_all(groups: CellHeights) -> FloatArray:
        own = derivatives(returns, groups, everything, mounting, lever_m)
        return np.hstack([own, _pose_design(returns, groups, everything, errors)])

    shape_first = FIXED + POSE * shapes.groups.window
    plan = relief_equations(shapes, by_all, shape_first, FIXED, len(root))
    off, covariance = _solved(heights.cell[chosen], heights.height_m[chosen], weight, design, first, root, plan)
    vehicle = slice(len(off) - errors.value.size, None)
    after = PoseErrors(errors.t_s, off[vehicle].reshape(-1, POSE), covariance[vehicle, vehicle])
    turned = mounting_walk(trajectory, errors, off, covariance, FIXED) if walk_deg_rts > 0.0 else None
    rotation = Rotation.from_rotvec(-off[:CLOCK_COLUMN]).as_matrix() @ mounting
    sigma = np.degrees(np.sqrt(np.diag(covariance)[:CLOCK_COLUMN]))
    by_strips = replace(
        found,
        mounting=Mounting.from_rotation(found.mounting.xyz_m, rotation),
        correction_deg=three(np.degrees(Rotation.from_matrix(rotation @ stated.rotation.T).as_rotvec())),
        sigma_deg=three(sigma),
        certain=bool((sigma < MAX_BORESIGHT_SIGMA_DEG).all()),
    )
    return StripAdjustment(without_errors(trajectory, errors, after), by_strips, errors, after, turned)


def _solved(
    cell: NDArray[np.int64],
    height_m: FloatArray,
    independent: FloatArray,
    design: FloatArray,
    first: NDArray[np.int64],
    root: FloatArray,
    plan: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """What the unknowns put into the groups' heights, and their covariance; the heights of the cells are eliminated."""
    order = np.argsort(cell, kind="stable")
    begin = np.flatnonzero(np.diff(cell[order], prepend=-1))
    ends = np.append(begin, len(order))
    height_m = height_m[order]
    independent = independent[order]
    design = np.ascontiguousarray(design[order])
    first = first[order]
    robust = np.ones(len(order))
    for _ in range(ROBUST_ROUNDS):
        weight = independent * robust
        normal, right = _normal_equations(ends, height_m, weight, design, first, len(root))
        normal += np.tril(normal, -1).T
        normal += plan[0]
        right += plan[1]
        z, factor = solved(normal, right, root, np.zeros(root.shape[1]))
        off = root @ z
        columns = first[:, None] + np.arange(2 * POSE)
        left = height_m - design[:, :FIXED] @ off[:FIXED] - np.einsum("gc,gc->g", design[:, FIXED:], off[columns])
        middle = np.add.reduceat(weight * left, begin) / np.add.reduceat(weight, begin)
        residual = left - np.repeat(middle, np.diff(ends))
        robust = huber_weight(np.abs(residual) * np.sqrt(independent))
    return off, covariance_after(factor, root)[0]


@kernel()
def _normal_equations(ends, height_m, weight, design, first, unknowns):  # type: ignore[no-untyped-def]
    """Lower triangle of the normal matrix and the right side of groups in the order of their cells."""
    normal = np.zeros((unknowns, unknowns))
    right = np.zeros(unknowns)
    width = design.shape[1]
    column = np.empty(width, np.int64)
    column[:FIXED] = np.arange(FIXED)
    mean = np.zeros(unknowns)
    seen = np.zeros(unknowns, np.bool_)
    active = np.empty(unknowns, np.int64)
    for c in range(len(ends) - 1):
        count = 0
        total = 0.0
        middle = 0.0
        for g in range(ends[c], ends[c + 1]):
            w = weight[g]
            total += w
            middle += w * height_m[g]
            column[FIXED:] = np.arange(first[g], first[g] + width - FIXED)
            for j in range(width):
                u = column[j]
                by = w * design[g, j]
                if not seen[u]:
                    seen[u] = True
                    active[count] = u
                    count += 1
                mean[u] += by
                right[u] += by * height_m[g]
                for k in range(j + 1):
                    normal[u, column[k]] += by * design[g, k]
        for a in range(count):
            u = active[a]
            share = mean[u] / total
            right[u] -= share * middle
            for b in range(count):
                v = active[b]
                if v <= u:
                    normal[u, v] -= share * mean[v]
        for a in range(count):
            mean[active[a]] = 0.0
            seen[active[a]] = False
    return normal, right


def _pose_design(
    returns: StripReturns, heights: CellHeights, chosen: NDArray[np.intp], errors: PoseErrors
) -> FloatArray:
    """(c, 12) mean derivatives of the heights of some groups by the errors of the poses at the nodes beside each."""
    row = np.full(len(heights.cell), -1, np.int32)
    row[chosen] = np.arange(len(chosen))
    node = heights.window[chosen]
    slope = heights.slope[chosen]
    sums = _sums(heights.member, row, node, returns.t_s, returns.origin_m, errors.t_s)
    sums /= heights.count[chosen][:, None, None]
    normal = np.column_stack([-slope, np.ones(len(chosen))])
    middle = np.column_stack([(heights.place[chosen] + 0.5) * heights.cell_m, heights.height_m[chosen]])
    share = sums[:, :, :1]
    origin = sums[:, :, 1:]
    by_turn = np.cross(share * middle[:, None] - origin, normal[:, None])
    out: FloatArray = np.concatenate([share * normal[:, None], by_turn], axis=2).reshape(len(chosen), 2 * POSE)
    return out


@kernel()
def _sums(member, row, node, t_s, origin_m, node_s):  # type: ignore[no-untyped-def]
    """Sums (c, 2, 4) over the returns of each row's group: the shares of its two nodes, and the origin times these."""
    out = np.zeros((len(node), 2, 4))
    for i in range(len(member)):
        if member[i] < 0 or row[member[i]] < 0:
            continue
        r = row[member[i]]
        first = node[r]
        late = min(max((t_s[i] - node_s[first]) / (node_s[first + 1] - node_s[first]), 0.0), 1.0)
        for e in range(2):
            share = late if e else 1.0 - late
            out[r, e, 0] += share
            for a in range(3):
                out[r, e, 1 + a] += share * origin_m[i, a]
    return out
