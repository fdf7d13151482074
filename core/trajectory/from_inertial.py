"""The trajectory of a vehicle with GNSS and an IMU.

A first guess of the attitudes comes from alignment, all else from the adjustment: preintegrated inertial measurements
from knot to knot, and positions with a correlated error, at all knots at once. That is what a filter with a backward
smoother would give, linearised anew until nothing moves.

Where the squared residuals of the adjustment are larger than expected, slow errors of the positions or another place of
the antenna would take much of them away, the adjustment is done anew under one hypothesis at a time: the antenna is
elsewhere, the positions err more than stated and slowly, the specific force scatters more than stated; and each of the
latter two with positions that scatter around the motion of the IMU, as they do where it does not show fast motion. The
restricted likelihood of the observations says which of them explains the residuals best; map and height are apart.
Positions are blamed only for slow errors that remain beside an IMU with as much noise as is likeliest. An offset of the
clocks was found and taken off before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.covariance import marginal_covariance
from furrowmap.core.adjustment.imu_constants import ImuConstants
from furrowmap.core.adjustment.knots import KNOT_STEP_S, POSE, ROTATION, StateBlock, normal_equations
from furrowmap.core.adjustment.preintegration import (
    FORCE_BIAS,
    RATE_BIAS,
    VELOCITY,
    Site,
    carried_on,
    predicted,
    unbiased_increments,
)
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.readers.implausible_positions import spans_in_words
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import CONTRADICTION, InputError, Notice
from furrowmap.core.trajectory.from_gnss import GnssTrajectory
from furrowmap.core.trajectory.height_steps import without_height_steps
from furrowmap.core.trajectory.held_positions import held_against_motion, without_held
from furrowmap.core.trajectory.imu_clock import MIN_OFFSET_S, search_imu_clock
from furrowmap.core.trajectory.inertial_adjustment import (
    Fitted,
    InertialAdjustment,
    adjust,
    beside_positions,
    fitted,
    with_clock,
    with_constant,
    with_travel,
)
from furrowmap.core.trajectory.inertial_checks import (
    TurnedMounting,
    Whiteness,
    densities,
    turned_mounting,
    with_shown_noise,
)
from furrowmap.core.trajectory.inertial_start import (
    MAX_IMU_PAUSE_S,
    NO_HINTS,
    Hints,
    InertialProblem,
    MountedImu,
    first_guess,
    heading_unknown,
    likely_mistake,
    site_of,
    without_positions,
)
from furrowmap.core.trajectory.pose_errors import PoseErrors
from furrowmap.core.trajectory.position_steps import with_steps
from furrowmap.core.trajectory.shown_errors import (
    MIN_GAIN,
    with_shown_drift,
    with_shown_force_noise,
    with_shown_scatter,
)
from furrowmap.core.trajectory.used_positions import (
    MEDIAN_OF_MEAN,
    WHITE_EPOCHS,
    climb_notices,
    positions_without_steps,
    quality_words,
    usable,
)
from furrowmap.core.trajectory.vehicle_motion import STANDING_MPS
from furrowmap.core.values.gnss import Fix, GnssTrack, Positions
from furrowmap.core.values.inertial import InertialTrack
from furrowmap.core.values.margins import margin
from furrowmap.core.values.rotation import quaternion_to_matrix
from furrowmap.core.values.scan import named_offset
from furrowmap.core.values.trajectory import Motion, Trajectory, same_hemisphere, source_columns

MAX_VARIANCE_FACTOR: Final = 1.3
"""Squared residuals over their expected ones; with more, something is not as stated."""
MIN_DOUBTED_S: Final = 1.0
MAX_DOUBTED_SHARE: Final = 0.02
"""Outliers come one by one. What lies outside of the noise for longer, in sum for so much of the time, is no noise."""
OWN_SCATTER_SHARE: Final = 0.75
"""White noise shows in the differences between positions; what they move by within a second shows less there."""
MAX_NOISE_FACTOR: Final = 1.5
"""White noise that is larger than what the spectrum of the measurements shows, by this factor, is none of the IMU."""


@dataclass(frozen=True)
class Explained:
    """An adjustment that is explained.

    Attributes:
        cause: "" where it agrees with what is stated; else "lever-arm", "positions", "noise" or "scatter".
        times: standard deviations of what is blamed, over the stated ones; 0 where these are not blamed.
        lever_off_m: (3,) lever arm that was used, minus the stated one.
        is_certain: whether the next best cause explains much less.
    """

    cause: str
    adjusted: InertialAdjustment
    times: float = 0.0
    is_certain: bool = False
    lever_off_m: FloatArray = field(default_factory=lambda: np.zeros(3))

    def notice(self, measured: InertialTrack) -> Notice | None:
        """What it contradicts, None for nothing; `measured` is by the IMU."""
        if self.cause == "lever-arm":
            place = ", ".join(f"{value:.3f}" for value in self.adjusted.problem.lever_m.tolist())
            margins = ", ".join(margin(sigma, " m") for sigma in self.adjusted.constants.lever.sigma)
            off_m = float(np.linalg.norm(self.lever_off_m))
            return Notice("contradiction.lever-arm", off_m=off_m, place=place, margins=margins)
        if self.cause == "positions":
            return Notice("contradiction.positions-err", times=self.times)
        if self.cause == "noise":
            if self.times > MAX_NOISE_FACTOR and denied_by_spectrum(self.adjusted, measured):
                return Notice("contradiction.force-scatters", times=self.times, is_imu=self.is_certain)
            return Notice("imu-noisier", times=self.times)
        if self.cause == "scatter":
            key = "contradiction.scatter" if scatter_by_themselves(self.adjusted) else "imu-misses-motion"
            return Notice(key, times=self.times)
        return None


def denied_by_spectrum(fit: Fitted, measured: InertialTrack) -> bool:
    """Whether the noise of the specific force in a fit is larger than what the measurements of the IMU show."""
    links = fit.problem.links
    return links.noise.force * max(links.force_times) > MAX_NOISE_FACTOR * densities(measured)[1]


def scatter_by_themselves(adjusted: Fitted) -> bool:
    """Whether positions scatter as much from one to the next as around the trajectory, as noise of their own does.

    Of the axis that scatters most, by third differences (:func:`.positions.white_noise_m`).
    """
    positions = adjusted.problem.positions
    if len(positions.t_s) < WHITE_EPOCHS:
        return False
    residual_m = adjusted.observed.residuals_m(adjusted.problem.knots, adjusted.state)
    around_m = np.sqrt(np.nanmean(residual_m**2, axis=0))
    third_m = np.median(np.abs(np.diff(positions.xyz_m, 3, axis=0)), axis=0)
    own_m = third_m / (MEDIAN_OF_MEAN[1] * np.sqrt(20.0))
    worst = int(np.argmax(around_m))
    return bool(own_m[worst] > OWN_SCATTER_SHARE * around_m[worst])


def agrees(adjusted: InertialAdjustment) -> bool:
    """Whether the residuals of an adjustment are as large as expected, and outliers come one by one."""
    t_s = adjusted.problem.positions.t_s
    first, end = np.flatnonzero(np.diff(adjusted.observed.weight < 1.0, prepend=False, append=False)).reshape(-1, 2).T
    lasting_s = t_s[end - 1] - t_s[first]
    doubted_s = float(lasting_s[lasting_s > MIN_DOUBTED_S].sum())
    return adjusted.variance_factor <= MAX_VARIANCE_FACTOR and doubted_s <= MAX_DOUBTED_SHARE * float(np.ptp(t_s))


class Hypothesis(NamedTuple):
    """States that fit under a cause, and what is blamed: its standard deviations over the stated ones."""

    cause: str
    fit: Fitted
    times: float


def explained(adjusted: InertialAdjustment, measured: InertialTrack, *, by_noise_alone: bool) -> Explained:
    """An adjustment under the hypothesis that explains its residuals best; itself where it agrees.

    On wheels another lever arm is not looked for: a wheel that slips looks alike. A clock, units, axes, mounting or
    filter of the IMU that is wrong shows in the map's axes too, so that noise of heights alone that its spectrum
    denies is left to the heights of the positions where they explain it.

    Args:
        measured: by the IMU.
    """
    tried: list[Hypothesis] = []
    if not (by_noise_alone or adjusted.problem.hints.on_wheels) and adjusted.constants.lever_off:
        moved = with_constant(adjusted, "lever", lambda p, step: replace(p, lever_m=p.lever_m + step))[0]
        if agrees(moved):
            return _of_lever(adjusted, moved)
        tried = [Hypothesis("lever-arm", moved, 0.0)]
    slow = [] if by_noise_alone else blamed("positions", with_shown_drift, adjusted)
    if slow or not agrees(adjusted):
        noise = blamed("noise", with_shown_force_noise, adjusted)
        tried += [*slow, *noise]
        if not by_noise_alone:
            for beside in (Hypothesis("scatter", adjusted, 1.0), *slow, *noise):
                tried += with_scatter(beside)
    if not tried:
        return Explained("", adjusted)
    best, *others = sorted(tried, key=lambda one: one.fit.deviance)
    if slow and best.cause == "noise" and of_heights_alone(best.fit) and denied_by_spectrum(best.fit, measured):
        best = slow[0]
    elif slow and best.cause in ("noise", "scatter"):
        still = blamed("positions", with_shown_drift, best.fit)
        best = still[0] if still else best
    if isinstance(best.fit, InertialAdjustment):
        return _of_lever(adjusted, best.fit)
    apart = [other.fit.deviance - best.fit.deviance for other in others if other.cause != best.cause]
    return Explained(
        best.cause, adjust(best.fit.problem, best.fit.state), best.times, is_certain=min(apart, default=0.0) > MIN_GAIN
    )


def of_heights_alone(fit: Fitted) -> bool:
    """Whether the specific force in a fit has the stated noise in the map's axes, and a larger one in the height."""
    horizontal, vertical = fit.problem.links.force_times
    return vertical > horizontal == 1.0


def _of_lever(stated: InertialAdjustment, moved: InertialAdjustment) -> Explained:
    return Explained("lever-arm", moved, lever_off_m=moved.problem.lever_m - stated.problem.lever_m)


def blamed(cause: str, shown: Callable[[Fitted], tuple[InertialProblem, float]], fit: Fitted) -> list[Hypothesis]:
    """What a cause shows where it is as large as it is likeliest; none where it blames nothing."""
    with suppress(np.linalg.LinAlgError):
        problem, times = shown(fit)
        return [Hypothesis(cause, fitted(problem, fit.state), times)] if times > 1.0 else []
    return []


def with_scatter(beside: Hypothesis) -> list[Hypothesis]:
    """A hypothesis with white noise of the positions as large as it is likeliest: motion that an IMU does not show."""
    with suppress(np.linalg.LinAlgError):
        problem, times = with_shown_scatter(beside.fit)
        if max(times) > 1.0:
            blamed = max(times) if beside.cause == "scatter" else beside.times
            return [Hypothesis(beside.cause, fitted(problem, beside.fit.state), blamed)]
    return []


NODE_S: Final = 1.0
MAX_NODES: Final = 150
MAX_WANTED_NODES: Final = 400
NEAR: Final = 0.75
"""Share of the distance of nodes within which none is needed beside one at a wanted time."""
MENDING_ROUNDS: Final = 4
FAR_OFF_SIGMAS: Final = 10.0
"""Positions whose residuals are larger hardly take part, which is told."""
ANY_TIME: Final = np.zeros(0)
UNKNOWN_HEADING_DEG: Final = 10.0
"""Median standard deviation of a trajectory's headings from which on they are not known."""


@dataclass(frozen=True)
class InertialFigures:
    """What the adjustment found beside the poses.

    Attributes:
        rate_bias_dps: (3,) mean bias of the angular rate in the axes of the IMU, degrees per second.
        rate_bias_sigma_dps: (3,) its standard deviation, of the knot at which it is known best.
        force_bias_mps2: (3,) mean bias of the specific force.
        force_bias_sigma_mps2: (3,) its standard deviation.
        position_rms_m: (3,) residuals of the positions: easting, northing, height.
        doubted: positions of less than their whole weight.
        residual_correlation: (3,) of the residuals from one position to the next; nan where there are too few.
        residual_noise_m: (3,) white noise with as much information as them.
        assumed_noise_m: (3,) white noise of the positions that was assumed.
        variance_factor: squared residuals of all observations over their expected ones; 1 where sigmas are right.
        lever_arm_m: (3,) the antenna in the vehicle frame, as used.
        minus_gnss_s: the IMU's clock minus that of the positions, as used.
        constants: what the residuals show beyond that.
    """

    knots: int
    rounds: int
    rate_bias_dps: tuple[float, ...]
    rate_bias_sigma_dps: tuple[float, ...]
    force_bias_mps2: tuple[float, ...]
    force_bias_sigma_mps2: tuple[float, ...]
    position_rms_m: tuple[float, ...]
    doubted: int
    residual_correlation: tuple[float, ...]
    residual_noise_m: tuple[float, ...]
    assumed_noise_m: tuple[float, ...]
    variance_factor: float
    lever_arm_m: tuple[float, ...]
    minus_gnss_s: float
    constants: ImuConstants

    @property
    def clock_estimate_s(self) -> list[float] | None:
        """The offset of the clocks and its standard deviation; None where the motion does not show it."""
        if not self.constants.clock_shown:
            return None
        clock = self.constants.clock
        return [round(self.minus_gnss_s + clock.value[0], 5), round(clock.sigma[0], 5)]


@dataclass(frozen=True)
class InertialTrajectory(GnssTrajectory):
    """A trajectory at the times of the IMU, and what it was made of."""

    figures: InertialFigures
    adjusted: InertialAdjustment

    def pose_errors(self, at_s: FloatArray = ANY_TIME) -> PoseErrors:
        """Errors of the poses at nodes in time, zero as far as positions and IMU say, and their joint covariance.

        The nodes are at some times, and elsewhere NODE_S apart; on long drives further, so that they are no more than
        MAX_NODES beside the ends of the chains of knots.

        Args:
            at_s: (k,) times that want a node.
        """
        a = self.adjusted
        knots = a.problem.knots
        ends = [end for chain in knots.chains for end in (chain.first, chain.first + chain.count - 1)]
        wanted = np.unique(np.clip(np.searchsorted(knots.t_s, at_s - 0.5 * KNOT_STEP_S), 0, len(knots) - 1))
        wanted = wanted[:: -(-len(wanted) // MAX_WANTED_NODES) if len(wanted) else 1]
        step = max(round(NODE_S / KNOT_STEP_S), -(-len(knots) // MAX_NODES))
        regular = np.arange(0, len(knots), step)
        if len(wanted):
            after = np.searchsorted(wanted, regular)
            beside = np.abs(wanted[np.clip([after - 1, after], 0, len(wanted) - 1)] - regular).min(axis=0)
            regular = regular[beside > NEAR * step]
        nodes = np.unique(np.concatenate([regular, wanted, ends])).astype(np.int64)
        equations = normal_equations((a.observed, *beside_positions(a.problem)), knots, a.state)
        covariance = marginal_covariance(equations, a.state.layout.size, nodes, POSE)
        by_clock = a.clock_sigma_s * a.by_clock[nodes, :POSE].ravel()
        covariance += np.outer(by_clock, by_clock)
        return PoseErrors(knots.t_s[nodes], np.zeros((len(nodes), POSE)), covariance)


def _corrections(imu: MountedImu, source: str, clock_s: float, clock_sigma_s: float) -> Iterator[Notice]:
    """What the positions correct of an IMU: its clock, the rate of that, and the scale of its gyroscopes."""
    if clock_s:
        yield Notice(
            "imu-clock-off",
            source=source,
            off_s=abs(clock_s),
            is_off_s=clock_s > 0,
            cause=named_offset(clock_s) or None,
            minus_gnss_s=imu.earlier_by(clock_s).minus_gnss_s,
            margin=margin(clock_sigma_s, " s"),
        )
    if imu.clock_rate:
        by_ms = abs(1e3 * imu.clock_rate)
        yield Notice("imu-clock-off.rate-off", source=source, is_fast=imu.clock_rate > 0.0, by_ms=by_ms)
    if imu.gyro_scale:
        yield Notice("imu-scale-off", source=source, times=1.0 / (1.0 - imu.gyro_scale))


def trajectory_from_inertial(
    track: GnssTrack,
    imu: MountedImu,
    frame: MapFrame,
    lever_m: tuple[float, float, float],
    fixes: tuple[Fix, ...] | None,
    hints: Hints = NO_HINTS,
    *,
    by_noise_alone: bool = False,
) -> InertialTrajectory:
    """The trajectory of the vehicle frame.

    Args:
        track: positions of the antenna, in the datum of the map.
        by_noise_alone: whether a contradiction counts as noise of the IMU, and no other cause is looked for.

    Raises:
        InputError: if no position is left to use, or IMU and positions have no time in common.
        RefusedError: if the motion does not show the heading.
    """
    kept = without_held(usable(track, fixes))
    en = np.column_stack(frame.project(kept.track.lon_deg, kept.track.lat_deg))
    kept = held_against_motion(kept, en)
    kept = without_height_steps(kept.told(*(climb_notices(kept.track, en) if hints.on_wheels else ())))
    gated = kept.track
    positions = positions_without_steps(gated, en)
    noise, shaken = with_shown_noise(imu.noise, imu.track)
    notices = [*kept.notices, *shaken]
    imu = replace(imu, noise=noise)
    site = site_of(gated, frame)
    lever = np.asarray(lever_m, np.float64)
    in_air = not (by_noise_alone or hints.on_wheels)
    source = imu.track.source or "The IMU"
    adjusted, imu, clock_s, left_out = _adjusted(positions, imu, site, lever, hints, in_air=in_air)
    notices += left_out
    if np.degrees(np.median(adjusted.sigma[:, ROTATION + 2])) > UNKNOWN_HEADING_DEG:
        raise heading_unknown(adjusted.problem)
    clock_sigma_s = adjusted.constants.clock_left_s(clock_s)
    clock_sigma_s = clock_sigma_s if np.isfinite(clock_sigma_s) else MIN_OFFSET_S
    notices += _corrections(imu, source, clock_s, clock_sigma_s)
    if in_air and not agrees(adjusted) and (mistake := likely_mistake(adjusted.problem)) is not None:
        misfit = float(np.sqrt(adjusted.variance_factor))
        raise InputError("imu-contradicts", source=source, misfit=misfit, better_other=mistake)
    found = explained(adjusted, imu.track, by_noise_alone=by_noise_alone)
    adjusted = found.adjusted.with_clock_sigma(clock_sigma_s) if clock_sigma_s else found.adjusted
    trajectory = _trajectory(adjusted)
    turned = turned_mounting(trajectory, imu.mounting, source, on_wheels=hints.on_wheels)
    contradiction = found.notice(imu.track)
    # The lever arm turns with the IMU.
    if contradiction is not None and (turned is None or found.cause != "lever-arm"):
        notices.append(contradiction)
    if turned is not None:
        notices.append(turned.notice(source))
    trajectory = _as_doubtful(trajectory, found, contradiction, turned)
    far = np.nan_to_num(adjusted.observed.normalised(adjusted.problem.knots, adjusted.state)) > FAR_OFF_SIGMAS
    # Between the knots of two runs, their slow errors are interpolated.
    far &= np.diff(adjusted.problem.positions.run, append=adjusted.problem.positions.run[-1]) == 0
    if contradiction is None and far.any():
        notices.append(Notice("gnss-jumps.by-imu", unused=int(far.sum()), track=spans_in_words(gated, far)))
    figures = _figures(adjusted, imu.earlier_by(clock_s))
    counts = quality_words(gated.fix), kept.unused
    return InertialTrajectory(trajectory, positions, *counts, tuple(notices), kept.levels_m, figures, adjusted)


def _adjusted(
    positions: Positions, imu: MountedImu, site: Site, lever_m: FloatArray, hints: Hints, *, in_air: bool
) -> tuple[InertialAdjustment, MountedImu, float, list[Notice]]:
    """The adjustment, the IMU with clock rate and gyroscope scale corrected, the offset of its clock, and notices.

    Rate and scale are only estimated in the air: a slipping wheel has the same effect.
    """
    found: list[tuple[InertialAdjustment, MountedImu, float, list[Notice]]] = []
    stepping: tuple[Notice, ...] = ()
    for number in range(MENDING_ROUNDS):
        axes = imu.in_vehicle_axes
        searched_s = search_imu_clock(axes, positions, lever_m - imu.mounting.xyz_m, on_wheels=hints.on_wheels)
        whole = InertialProblem.over_common_time(positions, imu.earlier_by(searched_s), site, lever_m, hints)
        problem, start, notices = first_guess(whole)
        adjusted, clock_s = with_clock(with_travel(adjust(problem, start)), searched_s)
        if number == 0:
            error_m = adjusted.observed.errors_m(adjusted.problem.knots, adjusted.state)
            stepped, stepping = with_steps(adjusted.problem.positions, error_m)
            if stepping:
                positions = stepped
                continue
        found.append((adjusted, imu, clock_s, [*notices, *stepping]))
        rate, scale = (
            share if in_air else 0.0 for share in adjusted.constants.shares_off(imu.clock_rate, imu.gyro_scale)
        )
        if not (rate or scale):
            break
        middle_s = 0.5 * float(problem.knots.t_s[0] + problem.knots.t_s[-1])
        imu = imu.without(rate, scale, middle_s + clock_s)
    return min(found, key=lambda one: one[0].variance_factor)


def _as_doubtful(
    trajectory: Trajectory, found: Explained, contradiction: Notice | None, turned: TurnedMounting | None
) -> Trajectory:
    """Standard deviations enlarged to what is seen."""
    if contradiction is None and turned is None:
        return trajectory
    sigma = trajectory.sigma.copy()
    rotation = quaternion_to_matrix(trajectory.quaternion)
    # The place of the IMU may be off instead of that of the antenna.
    sigma[:, :3] = np.hypot(sigma[:, :3], rotation @ found.lever_off_m)
    if contradiction is not None and contradiction.code == CONTRADICTION and found.cause == "noise":
        # What scatters is no noise, and does not become less with time; the antenna is where the positions are.
        sigma[:, 3:] *= found.times
        turned_rad = np.radians(np.minimum(np.linalg.norm(sigma[:, 3:], axis=1), 180.0))
        arm_m = float(np.linalg.norm(found.adjusted.problem.lever_m))
        sigma[:, :3] = np.hypot(sigma[:, :3], (turned_rad * arm_m)[:, None])
    if turned is not None:
        half_turn = 2.0 * np.sin(np.radians(0.5 * turned.yaw_deg))
        tilt = np.degrees(np.arccos(np.clip(rotation[:, 2, 2], -1.0, 1.0))) * half_turn
        sigma[:, 3:5] = np.hypot(sigma[:, 3:5], tilt[:, None])
        sigma[:, 5] = np.hypot(sigma[:, 5], turned.yaw_deg)
    return replace(trajectory, sigma=np.minimum(sigma, [np.inf, np.inf, np.inf, 180.0, 180.0, 180.0]))


def _trajectory(adjusted: InertialAdjustment) -> Trajectory:
    """Poses at the times of the IMU: carried on from the knot before, closing on the knot after."""
    p = adjusted.problem
    knots = adjusted.problem.knots
    t_s = p.links.track.t_s
    knot, share, inside = knots.at(t_s)
    t_s = t_s[inside]
    knot = knot[inside]
    share = share[inside]
    variance = adjusted.sigma[:, ROTATION:POSE] ** 2
    turned = adjusted.state.rotation
    knot_sigma = np.empty((len(variance), 6))
    knot_sigma[:, :3] = adjusted.sigma[:, :3]
    for axis in range(2):
        knot_sigma[:, 3 + axis] = np.degrees(np.sqrt((turned[:, :, axis] ** 2 * variance).sum(axis=1)))
    knot_sigma[:, 5] = np.degrees(adjusted.sigma[:, ROTATION + 2])

    def carried(part: slice) -> list[NDArray[Any]]:
        xyz, rotation, velocity = _carried_poses(adjusted, t_s[part], knot[part], share[part])
        quaternion = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
        speed = np.einsum("ki,ki->k", velocity, rotation[:, :, 0])
        return [xyz, quaternion, knot_sigma[knot[part]], speed, np.linalg.norm(velocity, axis=1) < STANDING_MPS]

    xyz, quaternion, sigma, speed, standing = arrays.in_parts(carried, len(t_s))
    nearest = np.clip(np.searchsorted(p.positions.t_s, t_s), 0, len(p.positions.t_s) - 1)
    alone = without_positions(t_s, p.positions.t_s)
    source = np.where(alone, "imu", "gnss")
    return Trajectory(
        t_s=t_s,
        xyz_m=xyz,
        quaternion=same_hemisphere(quaternion),
        speed_mps=np.where(standing, 0.0, speed),
        motion=np.where(standing, Motion.STANDING, np.sign(speed)).astype(np.int8),
        fix=np.where(alone, Fix.NONE, p.positions.fix[nearest]).astype(np.int8),
        sigma=sigma,
        **source_columns(len(t_s), "imu", source, source, "imu"),
        max_gap_s=MAX_IMU_PAUSE_S,
    )


def _carried_poses(
    adjusted: InertialAdjustment, t_s: FloatArray, knot: NDArray[np.int64], share: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places (n, 3), rotations (n, 3, 3) and velocities (n, 3) at times between a knot and the next."""
    p = adjusted.problem
    state = adjusted.state
    knots = adjusted.problem.knots
    site = adjusted.problem.links.site
    steps = unbiased_increments(p.links, knots, state, knots.t_s[knot], t_s)
    here = carried_on(p.links, state, knot, steps, t_s - knots.t_s[knot])
    linked, link = np.unique(knot, return_inverse=True)
    ahead = predicted(p.links, knots, state, linked)
    after = state.rotation[linked + 1]
    off_rad = Rotation.from_matrix(after @ ahead.rotation.transpose(0, 2, 1)).as_rotvec()
    off_m = state.xyz_m[linked + 1] + site.stretch * (after @ p.links.lever_m) - ahead.xyz_m
    rotation = Rotation.from_rotvec(share[:, None] * off_rad[link]).as_matrix() @ here.rotation
    xyz = here.xyz_m + share[:, None] * off_m[link] - site.stretch * (rotation @ p.links.lever_m) + p.origin_m
    velocity = state[VELOCITY][knot] + share[:, None] * (state[VELOCITY][knot + 1] - state[VELOCITY][knot])
    return xyz, rotation, velocity


def _figures(adjusted: InertialAdjustment, imu: MountedImu) -> InertialFigures:
    """The biases in the axes of the IMU, and the residuals of the positions."""
    state = adjusted.state
    layout = adjusted.state.layout
    turn = imu.mounting.rotation
    residual = adjusted.observed.residuals_m(adjusted.problem.knots, state)
    white = Whiteness.of_residuals(residual, adjusted.problem.positions.white_m)

    def rounded(values: FloatArray, digits: int) -> tuple[float, ...]:
        return tuple(np.round(values, digits).tolist())

    def sigma(block: StateBlock) -> FloatArray:
        first = layout.column(block)
        return np.asarray(np.sqrt((turn.T**2) @ adjusted.sigma[:, first : first + 3].min(axis=0) ** 2))

    return InertialFigures(
        knots=len(adjusted.problem.knots),
        rounds=adjusted.rounds,
        rate_bias_dps=rounded(np.degrees(state[RATE_BIAS].mean(axis=0) @ turn), 5),
        rate_bias_sigma_dps=rounded(np.degrees(sigma(RATE_BIAS)), 5),
        force_bias_mps2=rounded(state[FORCE_BIAS].mean(axis=0) @ turn, 5),
        force_bias_sigma_mps2=rounded(sigma(FORCE_BIAS), 5),
        position_rms_m=rounded(np.sqrt(np.nanmean(residual**2, axis=0)), 4),
        doubted=int((adjusted.observed.weight < 1.0).sum()),
        residual_correlation=white.correlation,
        residual_noise_m=white.noise_m,
        assumed_noise_m=white.assumed_m,
        variance_factor=round(adjusted.variance_factor, 3),
        lever_arm_m=rounded(adjusted.problem.lever_m, 4),
        minus_gnss_s=round(imu.minus_gnss_s, 5),
        constants=adjusted.constants,
    )
