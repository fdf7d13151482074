"""The trajectory of a vehicle with GNSS and an IMU.

A first guess of the attitudes comes from alignment, all else from the adjustment: preintegrated inertial measurements
from knot to knot, and positions with a correlated error, at all knots at once. That is what a filter with a backward
smoother would give, linearised anew until nothing moves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.estimation.gnss_drift import GnssDrift
from furrowmap.core.estimation.inertial import (
    FORCE_BIAS,
    INERTIAL,
    RATE_BIAS,
    VELOCITY,
    InertialLinks,
    Site,
    carried_on,
    predicted,
    unbiased_increments,
)
from furrowmap.core.estimation.knots import STEP_S, Chain, Knots, knots_over
from furrowmap.core.estimation.observation import Observation, normal_equations
from furrowmap.core.estimation.positions import AntennaPositions
from furrowmap.core.estimation.preintegration import increments
from furrowmap.core.estimation.robust import HUBER
from furrowmap.core.estimation.states import POSE, ROTATION, State
from furrowmap.core.geodesy.gravity import earth_rate_radps, normal_gravity_mps2, radius_m
from furrowmap.core.geodesy.projection import MapFrame, middle_deg
from furrowmap.core.trajectory.alignment import attitudes
from furrowmap.core.trajectory.imu_mounting import check_mounting
from furrowmap.core.trajectory.motion import STANDING_MPS
from furrowmap.core.trajectory.positions import (
    Offsets,
    positions_of,
    quality_runs,
    quality_words,
    sigmas_m,
    usable,
    white_noise_m,
)
from furrowmap.core.values import scratch
from furrowmap.core.values.clock import GPS_EPOCH_S, HOUR_S, gps_minus_utc_s, iso_utc
from furrowmap.core.values.errors import InputError, Notice, RefusedError
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.core.values.inertial import InertialNoise, InertialTrack
from furrowmap.core.values.mounting import Mounting
from furrowmap.core.values.positions import Positions
from furrowmap.core.values.trajectory import Motion, Trajectory, same_hemisphere

FloatArray = NDArray[np.float64]

BEYOND_S: Final = 5.0
"""Poses go on by the IMU alone for this long before the first position and after the last."""
PAUSE_S: Final = 0.2
"""Where the IMU pauses for longer, poses are not carried across."""
SHORTEST_S: Final = 10.0
"""A shorter stretch between two pauses is left out."""
GAP_S: Final = 1.0
"""Positions further apart than this are not interpolated for the first guess."""
CONTRADICTION: Final = 8.0
"""Misfit of the first guess beyond which measurements and positions are not of the same motion."""
TRIED: Final = 1200
"""Knots on which other units and signs are tried."""
_ALTERNATIVES: Final = (
    ("its angular rates were in degrees per second instead of radians", np.pi / 180.0, 1.0),
    ("its angular rates were in radians per second instead of degrees", 180.0 / np.pi, 1.0),
    ("its specific force were in g instead of m/s²", 1.0, 9.80665),
    ("its specific force were in m/s² instead of g", 1.0, 1.0 / 9.80665),
    ("its specific force had the other sign (an acceleration that points down at rest)", 1.0, -1.0),
    ("its angular rates had the other sign", -1.0, 1.0),
    ("its angular rate about the vehicle's x axis had the other sign", np.array([-1.0, 1.0, 1.0]), 1.0),
    ("its angular rate about the vehicle's y axis had the other sign", np.array([1.0, -1.0, 1.0]), 1.0),
    ("its angular rate about the vehicle's z axis had the other sign", np.array([1.0, 1.0, -1.0]), 1.0),
    ("its axes were left-handed (one axis of both sensors with the other sign, or two swapped)", -1.0, -1.0),
)
"""What may be wrong, and by which factors of rate and force it is mended."""
MOST_VARIANCE: Final = 1.3
"""Squared residuals over their expected ones; with more, the noise of the IMU is larger than stated."""
NOISE_ROUNDS: Final = 6
ROUNDS: Final = 10
SETTLED_M: Final = 1e-4
SETTLED_RAD: Final = 1e-6
"""The adjustment ends when no pose moves by more."""


@dataclass(frozen=True)
class Imu:
    """An IMU on a vehicle.

    Attributes:
        track: its measurements in its own axes.
        mounting: in the vehicle frame.
        noise: of it.
    """

    track: InertialTrack
    mounting: Mounting
    noise: InertialNoise

    @property
    def in_vehicle_axes(self) -> InertialTrack:
        """The measurements in the axes of the vehicle."""
        turn = self.mounting.rotation.T
        return replace(self.track, rate_radps=self.track.rate_radps @ turn, force_mps2=self.track.force_mps2 @ turn)


@dataclass(frozen=True)
class InertialFigures:
    """What the adjustment found beside the poses.

    Attributes:
        knots: number of knots.
        rounds: of the adjustment.
        rate_bias_dps: (3,) mean bias of the angular rate in the axes of the IMU, degrees per second.
        rate_bias_sigma_dps: (3,) its standard deviation, of the knot at which it is known best.
        force_bias_mps2: (3,) mean bias of the specific force.
        force_bias_sigma_mps2: (3,) its standard deviation.
        position_rms_m: (3,) residuals of the positions: easting, northing, height.
        doubted: positions of less than their whole weight.
    """

    knots: int
    rounds: int
    rate_bias_dps: tuple[float, ...]
    rate_bias_sigma_dps: tuple[float, ...]
    force_bias_mps2: tuple[float, ...]
    force_bias_sigma_mps2: tuple[float, ...]
    position_rms_m: tuple[float, ...]
    doubted: int


@dataclass(frozen=True)
class InertialTrajectory:
    """A trajectory, and what it was made of.

    Attributes:
        trajectory: of the vehicle frame, at the times of the IMU.
        positions: of the antenna, those that were used.
        figures: for the report.
        used: positions used, by quality label.
        unused: positions left out, by reason.
        notices: for the report.
    """

    trajectory: Trajectory
    positions: Positions
    figures: InertialFigures
    used: dict[str, int]
    unused: dict[str, int]
    notices: tuple[Notice, ...]


def trajectory_from_inertial(
    track: GnssTrack, imu: Imu, frame: MapFrame, lever_m: tuple[float, float, float], fixes: tuple[Fix, ...] | None
) -> InertialTrajectory:
    """The trajectory of the vehicle frame.

    Args:
        track: positions of the antenna, in the datum of the map.
        imu: of the vehicle.
        frame: the map frame.
        lever_m: the antenna in the vehicle frame.
        fixes: qualities whose positions are used; None for 'fixed and float if there is any fixed, else all'.

    Raises:
        InputError: if no position is left to use, or IMU and positions have no time in common.
        RefusedError: if the motion does not show the heading.
    """
    notices: list[Notice] = []
    gated, unused = usable(track, fixes, notices)
    en = np.column_stack(frame.project(gated.lon_deg, gated.lat_deg))
    white = white_noise_m(gated, en, sigmas_m(gated)[:, 0])
    runs = Offsets(quality_runs(gated.fix), np.zeros(len(gated)))
    positions = positions_of(gated, en, white, np.full(len(gated), np.nan), runs)
    whole = _Problem.of(positions, imu, site_of(gated, frame), np.asarray(lever_m, np.float64))
    problem, start = _first_guess(whole, notices)
    adjusted = _adjusted(problem, start)
    trajectory = _trajectory(adjusted)
    notices += check_mounting(trajectory, imu.mounting, imu.track.source or "The IMU")
    if adjusted.variance_factor > MOST_VARIANCE:
        adjusted = _with_real_noise(adjusted, notices)
        trajectory = _trajectory(adjusted)
    return InertialTrajectory(
        trajectory, positions, _figures(adjusted, imu), quality_words(gated.fix), unused, tuple(notices)
    )


def site_of(track: GnssTrack, frame: MapFrame) -> Site:
    """Gravity, rotation and scale in the middle of a track."""
    lon, lat = middle_deg(track.lon_deg, track.lat_deg)
    height, radius = float(np.nanmedian(track.height_m)), radius_m(lat)
    convergence = float(frame.convergence_deg(np.array([lon]), np.array([lat]))[0])
    scale = frame.scale(lon, lat) * radius / (radius + height)
    return Site(normal_gravity_mps2(lat, height), earth_rate_radps(lat, convergence), radius, scale)


@dataclass(frozen=True)
class _Problem:
    """Input of the adjustment.

    Attributes:
        positions: of the antenna.
        links: the IMU.
        lever_m: (3,) the antenna in the vehicle frame.
        origin_m: (3,) local origin.
        knots: at which poses are estimated.
    """

    positions: Positions
    links: InertialLinks
    lever_m: FloatArray
    origin_m: FloatArray
    knots: Knots

    @classmethod
    def of(cls, positions: Positions, imu: Imu, site: Site, lever_m: FloatArray) -> _Problem:
        links = InertialLinks(imu.in_vehicle_axes, np.asarray(imu.mounting.xyz_m, np.float64), imu.noise, site)
        knots = knots_over(_common_s(positions.t_s, imu.track), PAUSE_S)
        return cls(positions, links, lever_m, np.round(np.median(positions.xyz_m, axis=0)), knots)


def _common_s(positions_s: FloatArray, imu: InertialTrack) -> FloatArray:
    """Times of the IMU for which there are positions; of stretches that are long enough.

    Raises:
        InputError: if there are none.
    """
    t_s = imu.t_s[(imu.t_s >= positions_s[0] - BEYOND_S) & (imu.t_s <= positions_s[-1] + BEYOND_S)]
    stretches = np.split(t_s, np.flatnonzero(np.diff(t_s) > PAUSE_S) + 1)
    # A knot lies before the first measurement and one after the last.
    long = [part[8:-16] for part in stretches if len(part) > 24 and part[-1] - part[0] > SHORTEST_S]
    if not long:
        spans = " and ".join(f"{iso_utc(t[0])} to {iso_utc(t[-1])}" for t in (imu.t_s, positions_s) if len(t))
        raise InputError(
            f"{imu.source or 'The IMU'}: its measurements and the positions have less than {SHORTEST_S:g} s in common "
            f"without a pause ({spans}).",
            "No trajectory can be computed from them.",
            _likely_offset(imu.t_s, positions_s)
            or "Check that both were recorded together, and that the times of the IMU are UTC (`time_unix_s`) or GPS "
            "time (`time_gps_s`).",
            code="imu-no-overlap",
        )
    return np.concatenate(long)


def _likely_offset(imu_s: FloatArray, positions_s: FloatArray) -> str:
    """A common offset of the IMU's clock with which both would overlap, and what to write; empty without one."""
    if not (len(imu_s) and len(positions_s)):
        return ""
    leap_s = float(gps_minus_utc_s(float(positions_s[0])))
    common = [(sign * leap_s, "leap seconds") for sign in (1, -1)]
    common += [(sign * k * HOUR_S, "a local time taken for UTC") for k in range(1, 15) for sign in (1, -1)]
    common += [(-GPS_EPOCH_S + leap_s, "GPS time taken for UTC since 1970")]

    def overlap_s(offset_s: float) -> float:
        first = max(imu_s[0] - offset_s, positions_s[0])
        return float(min(imu_s[-1] - offset_s, positions_s[-1]) - first)

    best_s, cause = max(common, key=lambda offset: overlap_s(offset[0]))
    if overlap_s(best_s) < 0.5 * min(float(np.ptp(imu_s)), float(np.ptp(positions_s))):
        return ""
    return (
        f"They would overlap with `minus_gnss_s = {best_s:g}` under `[imu]` ({cause}): write that, or mend the times."
    )


def _first_guess(problem: _Problem, notices: list[Notice]) -> tuple[_Problem, State]:
    """Attitudes by alignment, places and speeds by the positions; stretches that cannot be aligned are left out.

    Raises:
        InputError: if the measurements contradict the positions.
        RefusedError: if nothing shows the heading in any stretch.
    """
    found = [_guessed(problem, chain, problem.links.track) for chain in problem.knots.chains]
    left = [
        f"{iso_utc(c.begin_s)} to {iso_utc(c.end_s)}" for c, g in zip(problem.knots.chains, found, strict=True) if not g
    ]
    guesses = [guess for guess in found if guess is not None]
    if not guesses:
        raise _no_heading(problem.links.track, problem.knots)
    if left:
        notices.append(
            Notice("imu-not-aligned", f"The motion shows no heading from {', '.join(left)}: there are no poses there.")
        )
    worst = max(guess.misfit for guess in guesses)
    if worst > CONTRADICTION:
        raise _contradiction(problem, worst)
    chains, first = [], 0
    for guess in guesses:
        chains.append(replace(guess.chain, first=first))
        first += guess.chain.count
    knots = Knots(tuple(chains), np.concatenate([c.begin_s + STEP_S * np.arange(c.count) for c in chains]))
    xyz, rotation, added = (
        np.concatenate(
            [getattr(g, name) for g in guesses], out=scratch.zeros((first, *getattr(guesses[0], name).shape[1:]))
        )
        for name in ("xyz_m", "rotation", "added")
    )
    state = State(xyz, rotation, added, INERTIAL)
    return replace(problem, knots=knots), state


@dataclass(frozen=True)
class _Guess:
    """First guess of the states of a chain, and how badly the IMU fits the positions there."""

    chain: Chain
    xyz_m: FloatArray
    rotation: FloatArray
    added: FloatArray
    misfit: float


def _guessed(problem: _Problem, chain: Chain, track: InertialTrack) -> _Guess | None:
    """The first guess of a chain; None where nothing shows the heading."""
    p, links = problem.positions, problem.links
    stretch, arm = links.site.stretch, problem.lever_m - links.lever_m
    t_s = chain.begin_s + STEP_S * np.arange(chain.count, dtype=np.float64)
    antenna = _interpolated(t_s, p.t_s, p.xyz_m - problem.origin_m) / stretch
    seen = np.where(_in_gaps(t_s, p.t_s)[:, None], np.nan, antenna)
    steps = increments(track.t_s, track.rate_radps, track.force_mps2, t_s[:-1], t_s[:-1] + STEP_S)
    sigma = float(np.median(np.hypot(p.white_m, p.drift_m)[:, 0]))
    found = attitudes(steps, seen, arm, sigma, links.noise, links.site.gravity_mps2)
    if found is None:
        return None
    velocity = np.gradient(antenna - found.rotation @ arm, STEP_S, axis=0)
    added = np.column_stack([np.zeros((chain.count, 3)), velocity, found.bias])
    xyz = stretch * (antenna - found.rotation @ problem.lever_m)
    return _Guess(chain, xyz, found.rotation, added, found.misfit)


def _contradiction(problem: _Problem, misfit: float) -> InputError:
    """The error of measurements that are not of this drive, and what they would have to be instead."""
    track, chain = problem.links.track, max(problem.knots.chains, key=lambda c: c.count)
    part = replace(chain, count=min(chain.count, TRIED))
    better = []
    for words, rate, force in _ALTERNATIVES:
        tried = replace(track, rate_radps=track.rate_radps * rate, force_mps2=track.force_mps2 * force)
        guess = _guessed(problem, part, tried)
        if guess is not None and guess.misfit < misfit / 3.0:
            better.append((guess.misfit, words))
    cause = f"They would fit if {min(better)[1]}." if better else "No single axis or unit explains it."
    return InputError(
        f"{track.source or 'The IMU'}: the measurements contradict the positions ({misfit:.0f} times the expected "
        f"error). {cause}",
        "No attitude can be computed from them.",
        "Correct units, signs and axes of the columns, `[imu] rpy_deg`, or the clock of the IMU.",
        code="imu-contradicts",
    )


def _no_heading(track: InertialTrack, knots: Knots) -> RefusedError:
    begin_s, end_s = float(knots.t_s[0]), float(knots.t_s[-1])
    return RefusedError(
        f"{track.source or 'The IMU'}: its motion from {iso_utc(begin_s)} to {iso_utc(end_s)} shows no heading.",
        "Only changes of speed or direction show it, and the attitude of all points depends on it.",
        "Record some seconds of acceleration, turns or figures of eight, best soon after the start.",
        code="heading-unknown",
    )


@dataclass(frozen=True)
class _Adjusted:
    """Result of the adjustment.

    Attributes:
        problem: its input.
        state: at the knots.
        sigma: (n, size) standard deviations of the states; of the rotation vector in the map's axes.
        observed: the positions with their weights.
        rounds: how many were needed.
        variance_factor: squared residuals over their expected ones.
    """

    problem: _Problem
    state: State
    sigma: FloatArray
    observed: AntennaPositions
    rounds: int
    variance_factor: float


def _adjusted(problem: _Problem, state: State) -> _Adjusted:
    """Gauss-Newton rounds until no pose moves.

    Raises:
        LinAlgError: if the observations do not determine the trajectory.
    """
    knots = problem.knots
    antenna = AntennaPositions.of(problem.positions, problem.origin_m, problem.lever_m)
    beside: tuple[Observation, ...] = (GnssDrift(problem.positions), problem.links)
    for number in range(1, ROUNDS + 1):
        equations = normal_equations((antenna, *beside), knots, state)
        solution = equations.solve()
        step = solution.values.reshape(len(knots), -1)
        state = state.moved(step)
        before, antenna = antenna.weight, antenna.reweighted(knots, state)
        moved, turned = np.abs(step[:, :ROTATION]).max(), np.abs(step[:, ROTATION:POSE]).max()
        settled = moved < SETTLED_M and turned < SETTLED_RAD and np.abs(before - antenna.weight).max() < 0.05
        if settled or number == ROUNDS:
            break
    # An outlier counts as a position at the limit of what is trusted, not by its distance.
    normalised = antenna.normalised(knots, state)
    beyond = normalised[normalised > HUBER]
    factor = (equations.squares - HUBER * float((beyond - HUBER).sum())) / max(equations.redundancy, 1)
    return _Adjusted(problem, state, solution.sigma().reshape(len(knots), -1), antenna, number, factor)


def _with_real_noise(adjusted: _Adjusted, notices: list[Notice]) -> _Adjusted:
    """The adjustment with a noise of the specific force at which IMU and positions agree as their sigmas say.

    On a machine that shakes faster than the IMU is sampled, its noise is not that of its data sheet.
    """
    stated = adjusted.problem.links.noise.force
    for _ in range(NOISE_ROUNDS):
        links = adjusted.problem.links
        noise = replace(links.noise, force=links.noise.force * float(np.sqrt(adjusted.variance_factor)))
        adjusted = _adjusted(replace(adjusted.problem, links=replace(links, noise=noise)), adjusted.state)
        if adjusted.variance_factor < MOST_VARIANCE:
            break
    times = adjusted.problem.links.noise.force / stated
    notices.append(
        Notice(
            "imu-noisier",
            f"The specific force scatters {times:.1f} times as much as `[imu]` states, by what the positions say: the "
            "machine shakes faster than the IMU measures, or the IMU is of a lower class. Standard deviations follow "
            "what is found.",
        )
    )
    return adjusted


def _trajectory(adjusted: _Adjusted) -> Trajectory:
    """Poses at the times of the IMU: carried on from the knot before, closing on the knot after."""
    p, knots = adjusted.problem, adjusted.problem.knots
    t_s = p.links.track.t_s
    knot, share, inside = knots.at(t_s)
    t_s, knot, share = t_s[inside], knot[inside], share[inside]
    n = len(t_s)
    xyz, quaternion, sigma = scratch.zeros((n, 3)), scratch.zeros((n, 4)), scratch.zeros((n, 6))
    speed, standing, knot_sigma = np.empty(n), np.empty(n, np.bool_), _pose_sigmas(adjusted)
    for part in scratch.parts(n):
        xyz[part], rotation, velocity = _carried_poses(adjusted, t_s[part], knot[part], share[part])
        quaternion[part] = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
        speed[part] = np.einsum("ki,ki->k", velocity, rotation[:, :, 0])
        standing[part] = np.linalg.norm(velocity, axis=1) < STANDING_MPS
        sigma[part] = knot_sigma[knot[part]]
    nearest = np.clip(np.searchsorted(p.positions.t_s, t_s), 0, len(p.positions.t_s) - 1)
    alone = _in_gaps(t_s, p.positions.t_s)
    source = np.where(alone, "imu", "gnss")
    return Trajectory(
        t_s=t_s,
        xyz_m=xyz,
        quaternion=same_hemisphere(quaternion),
        speed_mps=np.where(standing, 0.0, speed),
        motion=np.where(standing, Motion.STANDING, np.sign(speed)).astype(np.int8),
        fix=np.where(alone, Fix.NONE, p.positions.fix[nearest]).astype(np.int8),
        sigma=sigma,
        heading_from=np.full(len(t_s), "imu"),
        position_from=source,
        height_from=source,
        level_from=np.full(len(t_s), "imu"),
        max_gap_s=PAUSE_S,
    )


def _carried_poses(
    adjusted: _Adjusted, t_s: FloatArray, knot: NDArray[np.int64], share: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places (n, 3), rotations (n, 3, 3) and velocities (n, 3) at times between a knot and the next."""
    p, state, knots, site = adjusted.problem, adjusted.state, adjusted.problem.knots, adjusted.problem.links.site
    steps = unbiased_increments(p.links, knots, state, knots.t_s[knot], t_s)
    here = carried_on(p.links, state, knot, steps, t_s - knots.t_s[knot])
    linked, link = np.unique(knot, return_inverse=True)
    ahead, after = predicted(p.links, knots, state, linked), state.rotation[linked + 1]
    off_rad = Rotation.from_matrix(after @ ahead.rotation.transpose(0, 2, 1)).as_rotvec()
    off_m = state.xyz_m[linked + 1] + site.stretch * (after @ p.links.lever_m) - ahead.xyz_m
    rotation = Rotation.from_rotvec(share[:, None] * off_rad[link]).as_matrix() @ here.rotation
    xyz = here.xyz_m + share[:, None] * off_m[link] - site.stretch * (rotation @ p.links.lever_m) + p.origin_m
    velocity = state[VELOCITY][knot] + share[:, None] * (state[VELOCITY][knot + 1] - state[VELOCITY][knot])
    return xyz, rotation, velocity


def _pose_sigmas(adjusted: _Adjusted) -> FloatArray:
    """(n, 6) standard deviations of the poses at the knots: metres, and degrees of roll, pitch, heading."""
    variance, turned = adjusted.sigma[:, ROTATION:POSE] ** 2, adjusted.state.rotation
    out = np.empty((len(variance), 6))
    out[:, :3] = adjusted.sigma[:, :3]
    for axis in range(2):
        out[:, 3 + axis] = np.degrees(np.sqrt((turned[:, :, axis] ** 2 * variance).sum(axis=1)))
    out[:, 5] = np.degrees(adjusted.sigma[:, ROTATION + 2])
    return out


def _figures(adjusted: _Adjusted, imu: Imu) -> InertialFigures:
    """The biases in the axes of the IMU, and the residuals of the positions."""
    state, layout, turn = adjusted.state, adjusted.state.layout, imu.mounting.rotation
    residual = adjusted.observed.residuals_m(adjusted.problem.knots, state)

    def of(block_values: FloatArray, digits: int) -> tuple[float, ...]:
        return tuple(np.round(block_values, digits).tolist())

    def sigma(first: int) -> FloatArray:
        least = adjusted.sigma[:, first : first + 3].min(axis=0)
        out: FloatArray = np.sqrt((turn.T**2) @ least**2)
        return out

    return InertialFigures(
        knots=len(adjusted.problem.knots),
        rounds=adjusted.rounds,
        rate_bias_dps=of(np.degrees(state[RATE_BIAS].mean(axis=0) @ turn), 5),
        rate_bias_sigma_dps=of(np.degrees(sigma(layout.column(RATE_BIAS))), 5),
        force_bias_mps2=of(state[FORCE_BIAS].mean(axis=0) @ turn, 5),
        force_bias_sigma_mps2=of(sigma(layout.column(FORCE_BIAS)), 5),
        position_rms_m=of(np.sqrt(np.nanmean(residual**2, axis=0)), 4),
        doubted=int((adjusted.observed.weight < 1.0).sum()),
    )


def _interpolated(t_s: FloatArray, known_s: FloatArray, values: FloatArray) -> FloatArray:
    return np.column_stack([np.interp(t_s, known_s, values[:, axis]) for axis in range(values.shape[1])])


def _in_gaps(t_s: FloatArray, known_s: FloatArray) -> NDArray[np.bool_]:
    """Whether times (n,) lie before, after or between known ones (m,) that are more than GAP_S apart."""
    after = np.searchsorted(known_s, t_s)
    wide = np.concatenate([[True], np.diff(known_s) > max(GAP_S, 2.5 * float(np.median(np.diff(known_s)))), [True]])
    inside = (t_s > known_s[0]) & (t_s < known_s[-1])
    return np.asarray(np.where(inside, wide[after], (t_s < known_s[0]) | (t_s > known_s[-1])))
