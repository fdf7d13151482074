"""Positions corrected by what the scanner sees of control points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.pipeline.control.control_points import (
    ControlledPoint,
    ControlResult,
    GroundControl,
    PointState,
)
from furrowmap.core.pipeline.control.frame_error import (
    CRITICAL_RESIDUAL,
    FRAME_SIGMA_M,
    MIN_AGREEING,
    UP,
    ControlObservations,
    ErrorModel,
    FrameError,
    Snooped,
    snooped,
)
from furrowmap.core.pipeline.control.seen_points import UNKNOWN_ATTITUDE_DEG, SeenPoint, Unseen
from furrowmap.core.runtime.arrays import FloatArray, three
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.trajectory import Trajectory, same_hemisphere

UNSTATED_SIGMA_M: Final = (0.02, 0.02, 0.03)
"""Standard deviations of positions that state none."""
FREE_DRIFT_SHARE: Final = 0.5
"""Share of the variance of positions that changes within minutes."""
HELD_DRIFT_SHARE: Final = 0.02
"""The same of poses that ground seen again holds together: they move by a seventh of what they state."""
MAX_FRAME_SHIFT_M: Final = 2.0
"""A greater error is none of positions: of another height system, datum or unit."""
NAMED_POINTS: Final = 5
"""Points that a message names."""


@dataclass(frozen=True)
class Correction:
    """The error of positions by control points, and what they showed.

    Attributes:
        error: None where nothing is corrected.
        contradicts_m: (3,) by which all points contradict the positions, which is too much to be corrected; else None.
    """

    error: FrameError | None
    result: ControlResult
    notices: tuple[Notice, ...] = ()
    contradicts_m: FloatArray | None = None

    def applied(self, trajectory: Trajectory, *, keep_sigma: bool = False) -> Trajectory:
        """A trajectory without the error; its standard deviations are those after, or as they were to `keep_sigma`."""
        if self.error is None or not len(trajectory):
            return trajectory
        stated = stated_sigma_m(trajectory.sigma)
        shift, variance = self.error.at(trajectory.t_s, trajectory.xyz_m, stated)
        turn, turn_variance = self.error.turn_rad
        turned = Rotation.from_rotvec(turn) * Rotation.from_quat(trajectory.quaternion, scalar_first=True)
        quaternion = same_hemisphere(turned.as_quat(scalar_first=True))
        sigma = trajectory.sigma
        if not keep_sigma:
            position = np.where(self.error.axes & np.isfinite(sigma[:, :3]), np.sqrt(variance), sigma[:, :3])
            attitude = _attitude_sigma_deg(trajectory, self.error.model.turn_sigma_rad**2, turn_variance)
            sigma = np.column_stack([position, attitude])
        return replace(trajectory, xyz_m=trajectory.xyz_m + shift, quaternion=quaternion, sigma=sigma)


def _attitude_sigma_deg(trajectory: Trajectory, before: FloatArray, after: FloatArray) -> FloatArray:
    """(n, 3) standard deviations of roll, pitch and heading, once the turn of the frame, which all share, is known.

    A turn about the vehicle's axis x is roll, one about y pitch. No pose is known better than the frame.

    Args:
        before: (3,) variances (rad²) of the turns about the axes to the east, to the north and upwards.
        after: (3,) the same with the points.
    """
    axes = Rotation.from_quat(trajectory.quaternion, scalar_first=True).as_matrix()
    share = np.stack([axes[:, :, 0], axes[:, :, 1], np.broadcast_to([0.0, 0.0, 1.0], axes[:, 0].shape)], axis=1) ** 2
    stated = np.radians(trajectory.sigma[:, 3:]) ** 2
    own = stated - share @ (before - after)
    variance: FloatArray = np.maximum(own, np.minimum(stated, share @ after))
    return np.degrees(np.sqrt(variance))


def correction(
    control: GroundControl, seen: Sequence[SeenPoint], trajectory: Trajectory, model: ErrorModel
) -> Correction:
    """The error of a trajectory by points; the worst are left out.

    Args:
        seen: what the scanner sees of each.
        model: what is known of the error before.
    """
    observed = observations(control, seen, trajectory)
    is_control = ~control.is_check[observed.point]
    used = observed.where(is_control)
    found = snooped(used, model) if len(used) else Snooped(None, (), (), (), {})
    notices = list(control.notices)
    error = found.error
    contradicts_m = _far_m(error, trajectory)
    if contradicts_m is not None:
        error = None
        east_m, north_m, up_m = (-contradicts_m + 0.0).tolist()
        notices.append(Notice("ground-control-contradicts.far", east_m=east_m, north_m=north_m, up_m=up_m))
    points = _points(control, seen, observed, replace(found, error=error))
    shift, sigma, spread, axes = _summary(error, trajectory)
    result = ControlResult(control.file, points, shift, sigma, spread, axes)
    notices += [*_notices(result, found), *_shift_notices(result, trajectory)]
    return Correction(error, result, tuple(notices), contradicts_m)


def error_model(trajectory: Trajectory, points_m: FloatArray, *, held: bool) -> ErrorModel:
    """What is known before of the error of a trajectory.

    The frame can tilt as far as roll and pitch are uncertain and positions that far from each other allow, and turn as
    far as the heading is; it does about the middle of the points (n, 3).

    Args:
        held: whether ground seen again holds the poses together, so that heights hardly drift.
    """
    pivot = points_m.mean(axis=0)
    stated = stated_sigma_m(trajectory.sigma)
    angles = np.radians(np.where(np.isfinite(trajectory.sigma[:, 3:]), trajectory.sigma[:, 3:], UNKNOWN_ATTITUDE_DEG))
    axes = Rotation.from_quat(trajectory.quaternion, scalar_first=True).as_matrix()
    # Roll is a turn about the vehicle's axis x, pitch one about y: here by their parts to the east and to the north.
    level = np.sqrt(
        np.mean(angles[:, :1] ** 2 * axes[:, :UP, 0] ** 2 + angles[:, 1:2] ** 2 * axes[:, :UP, 1] ** 2, axis=0)
    )
    heading = float(np.sqrt(np.mean(angles[:, UP] ** 2)))
    apart_m = float(np.sqrt(np.mean(np.var(trajectory.xyz_m[:, :2], axis=0))))
    positions = np.sqrt(np.mean(stated**2, axis=0)) / max(apart_m, 1e-3)
    east, north = (1.0 / np.hypot(1.0 / np.maximum(level, 1e-9), 1.0 / max(positions[UP], 1e-9))).tolist()
    turn = 1.0 / np.hypot(1.0 / max(heading, 1e-9), 1.0 / max(float(np.max(positions[:UP])), 1e-9))
    share = HELD_DRIFT_SHARE if held else FREE_DRIFT_SHARE
    return ErrorModel(pivot, np.full(3, FRAME_SIGMA_M), np.array([east, north, turn]), share)


def stated_sigma_m(sigma: FloatArray) -> FloatArray:
    """(n, 3) standard deviations of positions (n, 6), with the usual ones where none are stated."""
    return np.where(np.isfinite(sigma[:, :3]), sigma[:, :3], UNSTATED_SIGMA_M)


def observations(control: GroundControl, seen: Sequence[SeenPoint], trajectory: Trajectory) -> ControlObservations:
    """All that the scanner sees of points, of those to check as well.

    A height sees the error along the normal of the ground: on a slope a shift to the side is a height. Where no target
    shows the place, that is left to its standard deviation, so that heights correct heights alone.
    """
    in_plan = any(one.target is not None for one, check in zip(seen, control.is_check, strict=True) if not check)
    rows: list[tuple[int, int, tuple[float, float, float], float, float]] = []
    epochs: list[tuple[FloatArray, FloatArray]] = []
    for number, one in enumerate(seen):
        if one.target is not None:
            for axis, (off_m, sigma_m) in enumerate(zip(one.target.off_m, one.target.sigma_m, strict=True)):
                direction = (float(axis == 0), float(axis == 1), float(axis == UP))
                rows.append((number, axis, direction, -off_m, sigma_m))
                epochs.append((one.target.t_s, one.target.share))
        for height in one.heights:
            east, north = height.slope
            aside_m = float(np.hypot(east, north)) * float(np.median(stated_sigma_m(trajectory.sigma)[:, :2]))
            sigma_m = height.sigma_m if in_plan else float(np.hypot(height.sigma_m, aside_m))
            direction = (-east, -north, 1.0) if in_plan else (0.0, 0.0, 1.0)
            rows.append((number, UP, direction, -height.above_m, sigma_m))
            epochs.append((np.array([height.t_s]), np.ones(1)))
    t_s = np.concatenate([np.empty(0), *(times for times, _ in epochs)])
    share = np.zeros((len(rows), len(t_s)))
    begin = 0
    for row, (times, weights) in enumerate(epochs):
        share[row, begin : begin + len(times)] = weights
        begin += len(times)
    point = np.array([row[0] for row in rows], np.int64)
    component = np.array([row[1] for row in rows], np.int64)
    return ControlObservations(
        point,
        component,
        np.array([row[2] for row in rows], np.float64).reshape(-1, 3),
        control.xyz_m[point],
        np.array([row[3] for row in rows], np.float64),
        np.array([row[4] for row in rows], np.float64),
        control.sigma_m[point, component] if len(rows) else np.empty(0),
        share,
        t_s,
        _sigma_at(trajectory, t_s),
    )


def _sigma_at(trajectory: Trajectory, t_s: FloatArray) -> FloatArray:
    """(e, 3) standard deviations of the nearest knots."""
    if not len(t_s):
        return np.empty((0, 3))
    before, share, _ = trajectory.interval(t_s)
    return stated_sigma_m(trajectory.sigma[before + (share > 0.5)])


def _summary(
    error: FrameError | None, trajectory: Trajectory
) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.bool_]]:
    """Mean, standard deviation after and range of what is added to a trajectory, and along which axes, (3,) each."""
    if error is None:
        return np.zeros(3), np.full(3, np.nan), np.zeros(3), np.zeros(3, np.bool_)
    shift, variance = error.at(trajectory.t_s, trajectory.xyz_m, stated_sigma_m(trajectory.sigma))
    sigma = np.where(error.axes, np.sqrt(variance.mean(axis=0)), np.nan)
    return shift.mean(axis=0), sigma, np.ptp(shift, axis=0), error.axes


def _far_m(error: FrameError | None, trajectory: Trajectory) -> FloatArray | None:
    """(3,) the error on which points agree if positions do not have it; None for one that is corrected."""
    shift = _summary(error, trajectory)[0]
    return shift if float(np.abs(shift).max()) > MAX_FRAME_SHIFT_M else None


def _points(
    control: GroundControl, seen: Sequence[SeenPoint], observed: ControlObservations, found: Snooped
) -> tuple[ControlledPoint, ...]:
    """Each point with its residuals."""
    used = found.error.normalised() if found.error is not None else {}
    out = []
    for number, one in enumerate(seen):
        state = _state(number, observed, control, found)
        rows = observed.where(observed.point == number)
        before = _mean_off(rows)
        residual = before.copy()
        sigma = np.full(3, np.nan)
        normalised = np.full(3, np.nan)
        for axis in sorted(set(rows.component.tolist())):
            shift, variance = _predicted(found.error, rows.where(rows.component == axis), axis)
            own = _own_variance(rows.where(rows.component == axis))
            residual[axis] += shift
            sigma[axis] = np.sqrt(own + variance)
            normalised[axis] = residual[axis] / sigma[axis]
            if (number, axis) in used:
                normalised[axis] = -used[number, axis]
            elif (number, axis) in found.residual:
                normalised[axis] = -found.residual[number, axis]
        out.append(
            ControlledPoint(
                control.name[number],
                state,
                three(control.xyz_m[number]),
                before,
                residual,
                sigma,
                normalised,
                one.visits,
                one.why_not,
                control.target[number],
                one.picture,
            )
        )
    return tuple(out)


def _state(number: int, observed: ControlObservations, control: GroundControl, found: Snooped) -> PointState:
    if not (observed.point == number).any():
        return PointState.NOT_OBSERVED
    if control.is_check[number]:
        return PointState.CHECK
    if number in found.left_out:
        return PointState.LEFT_OUT
    return PointState.USED if found.error is not None else PointState.CONTRADICTS


def _mean_off(rows: ControlObservations) -> FloatArray:
    """(3,) cloud less survey of a point, the mean of its visits by their weights; nan along unobserved components."""
    out = np.full(3, np.nan)
    for axis in range(3):
        chosen = rows.component == axis
        if chosen.any():
            weight = rows.sigma_m[chosen] ** -2.0
            out[axis] = -float(np.sum(weight * rows.off_m[chosen]) / weight.sum())
    return out


def _own_variance(rows: ControlObservations) -> float:
    """Variance of the mean of the visits of a point along a component, with that of the survey."""
    return float(1.0 / np.sum(rows.sigma_m**-2.0) + rows.survey_sigma_m[0] ** 2)


def _predicted(error: FrameError | None, rows: ControlObservations, axis: int) -> tuple[float, float]:
    """What is added to the positions where a component of a point was seen, and its variance."""
    if error is None:
        return 0.0, float(np.mean(rows.gnss_sigma_m[:, axis] ** 2))
    weight = rows.sigma_m**-2.0
    share = (weight / weight.sum()) @ rows.share
    seen = np.flatnonzero(share > 0.0)
    shift, variance = error.at(rows.t_s[seen], np.repeat(rows.place_m[:1], len(seen), axis=0), rows.gnss_sigma_m[seen])
    return float(share[seen] @ shift[:, axis]), float(share[seen] @ variance[:, axis])


def _notices(result: ControlResult, found: Snooped) -> list[Notice]:
    """What the points show, and which take no part."""
    out: list[Notice] = []
    seen = [point for point in result.points if point.state is not PointState.NOT_OBSERVED]
    unseen = [point for point in result.points if point.state is PointState.NOT_OBSERVED]
    no_target = [point for point in seen if point.why_not is Unseen.NO_TARGET]
    for key, points in (("ground-control-unseen", unseen), ("ground-control-unseen.target", no_target)):
        if points:
            names = ", ".join(point.name for point in points[:NAMED_POINTS])
            more = len(points) > NAMED_POINTS
            out.append(Notice(key, unseen=len(points), points=len(result.points), names=names, more=more))
    left_out = [point for point in result.points if point.state is PointState.LEFT_OUT]
    if left_out:
        out.append(
            Notice(
                "ground-control-left-out",
                left_out=len(left_out),
                critical=CRITICAL_RESIDUAL,
                points=_described(left_out),
                more=len(left_out) > NAMED_POINTS,
                unclear=", ".join(result.points[number].name for number in found.unclear) or None,
            )
        )
    if found.contradicting:
        doubted = [result.points[number] for number in found.contradicting]
        out.append(Notice("ground-control-contradicts", points=_described(doubted), more=len(doubted) > NAMED_POINTS))
    used = result.count(PointState.USED)
    if 0 < used < MIN_AGREEING:
        out.append(Notice("ground-control-few", used=used, fewest=MIN_AGREEING))
    return out


def _shift_notices(result: ControlResult, trajectory: Trajectory) -> list[Notice]:
    """Positions that are off by more than they state."""
    stated = np.sqrt(np.mean(stated_sigma_m(trajectory.sigma) ** 2, axis=0))
    after = np.where(result.axes, result.sigma_m, 0.0)
    if not (np.abs(result.shift_m) > CRITICAL_RESIDUAL * np.hypot(stated, after)).any():
        return []
    east_m, north_m, up_m = (-result.shift_m + 0.0).tolist()
    return [Notice("ground-control-shift", east_m=east_m, north_m=north_m, up_m=up_m)]


def _described(points: Sequence[ControlledPoint]) -> str:
    """Points with their greatest residual, in metres and normalised."""
    shown = sorted(points, key=lambda point: -point.worst)[:NAMED_POINTS]
    out = []
    for point in shown:
        axis = int(np.nanargmax(np.abs(point.normalised)))
        out.append(f"{point.name} ({'ENH'[axis]} {point.residual_m[axis]:+.3f} m, w {point.normalised[axis]:+.1f})")
    return ", ".join(out)
