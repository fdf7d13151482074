"""What the adjustment with an IMU starts from: positions, measurements, knots, and a first guess of the states.

Measurements that cannot be of the same motion as the positions are errors, which name what would fit.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.adjustment.knots import KNOT_STEP_S, POSE, Chain, Knots, Observation, State, StateLayout, knots_over
from furrowmap.core.adjustment.position_observations import RecordedHeadings
from furrowmap.core.adjustment.preintegration import (
    FORCE_BIAS,
    INERTIAL,
    RATE_BIAS,
    VELOCITY,
    InertialLinks,
    Site,
    increments,
)
from furrowmap.core.adjustment.vehicle import ON_WHEELS, AlongNose, Standing
from furrowmap.core.geodesy.gravity import earth_rate_radps, normal_gravity_mps2, radius_m
from furrowmap.core.geodesy.longitudes import middle_deg
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice, RefusedError
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.trajectory.alignment import CHUNK_KNOTS, HALVES, Attitudes, attitudes, averaged_knots, moving_mean
from furrowmap.core.trajectory.heading_hints import Course, HeadingHint, RecordedHeading
from furrowmap.core.values.clock import GPS_EPOCH_S, HOUR_S, gps_minus_utc_s, iso_utc
from furrowmap.core.values.gnss import DRIFT_CORRELATION_S, GnssTrack, Positions
from furrowmap.core.values.inertial import InertialNoise, InertialTrack
from furrowmap.core.values.rotation import Mounting

MAX_BEYOND_POSITIONS_S: Final = 5.0
"""Poses go on by the IMU alone for this long before the first position and after the last."""
MAX_IMU_PAUSE_S: Final = 0.2
"""Where the IMU pauses for longer, poses are not carried across."""
MIN_STRETCH_S: Final = 10.0
"""A shorter stretch between two pauses is left out."""
FIRST_GUESS_GAP_S: Final = 1.0
"""Positions further apart than this are not interpolated for the first guess."""
LINEAR_RAD: Final = 0.05
"""Turn by the gyroscopes' bias within a chunk up to which alignment is linear in it: the rest turns gravity by 12 mm
in a second difference, less than these are trusted to."""
MAX_MISFIT: Final = 8.0
"""Misfit of the first guess beyond which measurements and positions are not of the same motion."""
KNOTS_TRIED: Final = 1200
"""Knots on which other units and signs are tried."""
_ALTERNATIVES: Final = (
    (Text("its angular rates were in degrees per second instead of radians"), np.pi / 180.0, 1.0),
    (Text("its angular rates were in radians per second instead of degrees"), 180.0 / np.pi, 1.0),
    (Text("its angular rates were in degrees or radians per second instead of thousandths of them"), 1000.0, 1.0),
    (Text("its angular rates were in thousandths of degrees or radians per second instead of whole ones"), 0.001, 1.0),
    (Text("its specific force were in g instead of m/s²"), 1.0, 9.80665),
    (Text("its specific force were in m/s² instead of g"), 1.0, 1.0 / 9.80665),
    (Text("its specific force had the other sign (an acceleration that points down at rest)"), 1.0, -1.0),
    (Text("its angular rates had the other sign"), -1.0, 1.0),
    (Text("its angular rate about the vehicle's x axis had the other sign"), np.array([-1.0, 1.0, 1.0]), 1.0),
    (Text("its angular rate about the vehicle's y axis had the other sign"), np.array([1.0, -1.0, 1.0]), 1.0),
    (Text("its angular rate about the vehicle's z axis had the other sign"), np.array([1.0, 1.0, -1.0]), 1.0),
    (Text("its axes were left-handed (one axis of both sensors with the other sign, or two swapped)"), -1.0, -1.0),
)
"""What may be wrong, and by which factors of rate and force it is mended."""


@dataclass(frozen=True)
class MountedImu:
    """An IMU on a vehicle, and its measurements in its own axes.

    Attributes:
        minus_gnss_s: what was taken off the times of its clock.
        clock_rate: seconds that its clock gained in a second, which were taken off.
        gyro_scale: share by which its angular rates were too large, which was taken off.
    """

    track: InertialTrack
    mounting: Mounting
    noise: InertialNoise
    minus_gnss_s: float = 0.0
    clock_rate: float = 0.0
    gyro_scale: float = 0.0

    def earlier_by(self, offset_s: float) -> "MountedImu":
        """With times that are earlier by an offset."""
        track = replace(self.track, t_s=self.track.t_s - offset_s)
        return replace(self, track=track, minus_gnss_s=self.minus_gnss_s + offset_s)

    def without(self, clock_rate: float, gyro_scale: float, middle_s: float) -> "MountedImu":
        """With a clock that runs slower, and is as it was at a time, and smaller rates."""
        track = self.track
        t_s = track.t_s - clock_rate * (track.t_s - middle_s)
        rate = (1.0 - gyro_scale) * track.rate_radps
        shares = self.clock_rate + clock_rate, self.gyro_scale + gyro_scale
        return MountedImu(
            replace(track, t_s=t_s, rate_radps=rate), self.mounting, self.noise, self.minus_gnss_s, *shares
        )

    @property
    def in_vehicle_axes(self) -> InertialTrack:
        """The measurements in the axes of the vehicle."""
        turn = self.mounting.rotation.T
        return replace(self.track, rate_radps=self.track.rate_radps @ turn, force_mps2=self.track.force_mps2 @ turn)


def site_of(track: GnssTrack, frame: MapFrame) -> Site:
    """Gravity, rotation and scale in the middle of a track."""
    lon, lat = middle_deg(track.lon_deg, track.lat_deg)
    height = float(np.nanmedian(track.height_m))
    radius = radius_m(lat)
    convergence = float(frame.convergence_deg(np.array([lon]), np.array([lat]))[0])
    scale = frame.ground_scale(lon, lat, height)
    return Site(normal_gravity_mps2(lat, height), earth_rate_radps(lat, convergence), radius, scale)


@dataclass(frozen=True)
class Hints:
    """What shows the heading beside accelerations.

    Attributes:
        on_wheels: whether the vehicle's origin moves along its nose, forward or in reverse.
        heading: the vehicle's heading by another device, or by the IMU's own filter; None without.
        any_travel: whether the direction of travel is any, not that of the nose within what a mounting by hand is off.
        unasked: whether the positions come with headings of two antennas that nobody asked for.
    """

    on_wheels: bool = False
    heading: RecordedHeadings | None = None
    any_travel: bool = False
    unasked: bool = False

    @property
    def layout(self) -> StateLayout:
        """The states of a knot."""
        return ON_WHEELS if self.on_wheels else INERTIAL

    def of_chain(
        self, t_s: FloatArray, antenna_m: FloatArray, sigmas_m: tuple[float, float], lever_m: FloatArray
    ) -> HeadingHint | None:
        """The hint for alignment at knots (n,).

        Args:
            antenna_m: (n, 3) antenna, metres on the ground; nan where unknown.
            sigmas_m: its noise, and the standard deviation of its slowly varying error.
        """
        if self.heading is not None:
            return RecordedHeading(self.heading.at(t_s), self.heading.sigma_rad)
        if self.on_wheels:
            return Course.from_antenna(antenna_m, *sigmas_m, lever_m)
        return None

    def observations(self, track: InertialTrack, positions: Positions) -> tuple[Observation, ...]:
        """What joins the adjustment of an IMU and positions."""
        along = AlongNose(np.pi) if self.any_travel else AlongNose()
        wheels = (along, Standing.find(track, positions)) if self.on_wheels else ()
        return wheels if self.heading is None else (*wheels, self.heading)


NO_HINTS: Final = Hints()


@dataclass(frozen=True)
class InertialProblem:
    """Input of the adjustment; `drift_s` is the correlation time of the slow error of the positions."""

    positions: Positions
    links: InertialLinks
    lever_m: FloatArray
    origin_m: FloatArray
    knots: Knots
    hints: Hints
    drift_s: float = DRIFT_CORRELATION_S

    @classmethod
    def over_common_time(
        cls, positions: Positions, imu: MountedImu, site: Site, lever_m: FloatArray, hints: Hints
    ) -> "InertialProblem":
        """Of an IMU and positions that go together. Raises InputError if they have too little time in common."""
        links = InertialLinks(imu.in_vehicle_axes, np.asarray(imu.mounting.xyz_m, np.float64), imu.noise, site)
        knots = knots_over(_common_s(positions.t_s, imu.track), MAX_IMU_PAUSE_S)
        return cls(positions, links, lever_m, np.round(np.median(positions.xyz_m, axis=0)), knots, hints)

    def with_imu_earlier(self, offset_s: float) -> "InertialProblem":
        """With times of the IMU, and of the knots, that are earlier by an offset."""
        track = self.links.track
        knots = self.knots
        chains = tuple(replace(chain, begin_s=chain.begin_s - offset_s) for chain in knots.chains)
        links = replace(self.links, track=replace(track, t_s=track.t_s - offset_s))
        return replace(self, links=links, knots=Knots(chains, knots.t_s - offset_s))


def _common_s(positions_s: FloatArray, imu: InertialTrack) -> FloatArray:
    """Times of the IMU for which there are positions; of stretches that are long enough."""
    t_s = imu.t_s[
        (imu.t_s >= positions_s[0] - MAX_BEYOND_POSITIONS_S) & (imu.t_s <= positions_s[-1] + MAX_BEYOND_POSITIONS_S)
    ]
    stretches = np.split(t_s, np.flatnonzero(np.diff(t_s) > MAX_IMU_PAUSE_S) + 1)
    # A knot lies before the first measurement and one after the last.
    long = [part[8:-16] for part in stretches if len(part) > 24 and part[-1] - part[0] > MIN_STRETCH_S]
    if not long:
        spans = " and ".join(f"{iso_utc(t[0])} to {iso_utc(t[-1])}" for t in (imu.t_s, positions_s) if len(t))
        offset_s, cause = _likely_offset(imu.t_s, positions_s)
        raise InputError(
            "imu-no-overlap",
            source=imu.source or "The IMU",
            shortest_s=MIN_STRETCH_S,
            spans=spans,
            cause=cause,
            offset_s=offset_s,
        )
    return np.concatenate(long)


def _likely_offset(imu_s: FloatArray, positions_s: FloatArray) -> tuple[float, Text | None]:
    """A common offset of the IMU's clock with which both would overlap, and its cause; None without one."""
    if not (len(imu_s) and len(positions_s)):
        return 0.0, None
    leap_s = float(gps_minus_utc_s(float(positions_s[0])))
    common: list[tuple[float, Text | None]] = [(sign * leap_s, Text("leap seconds")) for sign in (1, -1)]
    common += [(sign * k * HOUR_S, Text("a local time taken for UTC")) for k in range(1, 15) for sign in (1, -1)]
    common += [(-GPS_EPOCH_S + leap_s, Text("GPS time taken for UTC since 1970"))]

    def overlap_s(offset_s: float) -> float:
        first = max(imu_s[0] - offset_s, positions_s[0])
        return float(min(imu_s[-1] - offset_s, positions_s[-1]) - first)

    best_s, cause = max(common, key=lambda offset: overlap_s(offset[0]))
    if overlap_s(best_s) < 0.5 * min(float(np.ptp(imu_s)), float(np.ptp(positions_s))):
        return 0.0, None
    return best_s, cause


def heading_unknown(problem: InertialProblem) -> RefusedError:
    """The error of a motion that does not show the heading."""
    return RefusedError(
        "heading-unknown",
        source=problem.links.track.source or "The IMU",
        begin=iso_utc(float(problem.knots.t_s[0])),
        end=iso_utc(float(problem.knots.t_s[-1])),
        antennas=problem.hints.unasked,
        wheels=not problem.hints.on_wheels,
    )


def first_guess(problem: InertialProblem) -> tuple[InertialProblem, State, list[Notice]]:
    """Attitudes by alignment, places and speeds by the positions; stretches that cannot be aligned are left out.

    The notices tell of these.

    Raises:
        InputError: if the measurements contradict the positions.
        RefusedError: if nothing shows the heading in any stretch.
    """
    found = [(chain, _guess_states(problem, chain, problem.links.track)) for chain in problem.knots.chains]
    guesses = [guess for _, guess in found if guess is not None]
    if not guesses:
        raise heading_unknown(problem)
    left = [
        Text("{first} to {last}", first=iso_utc(chain.begin_s), last=iso_utc(chain.end_s))
        for chain, guess in found
        if guess is None
    ]
    notices = [Notice("imu-not-aligned", left=left)] if left else []
    worst = max(guess.misfit for guess in guesses)
    if worst > MAX_MISFIT:
        mended = likely_mistake(problem, worst)
        source = problem.links.track.source or "The IMU"
        raise InputError("imu-contradicts", source=source, misfit=worst, better_other=mended)
    chains = []
    first = 0
    for guess in guesses:
        chains.append(replace(guess.chain, first=first))
        first += guess.chain.count
    knots = Knots(tuple(chains), np.concatenate([c.begin_s + KNOT_STEP_S * np.arange(c.count) for c in chains]))
    names = ("xyz_m", "rotation", "added")
    xyz, rotation, added = (arrays.concatenated([getattr(g, name) for g in guesses]) for name in names)
    return replace(problem, knots=knots), State(xyz, rotation, added, problem.hints.layout), notices


def likely_mistake(problem: InertialProblem, misfit: float | None = None) -> Text | None:
    """The unit or sign with which measurements fit the positions much better, in words; None where none does.

    Args:
        misfit: of the first guess as it is; None if it is not known.
    """
    track = problem.links.track
    chain = max(problem.knots.chains, key=lambda c: c.count)
    part = replace(chain, count=min(chain.count, KNOTS_TRIED))
    if misfit is None:
        stated = _guess_states(problem, part, track)
        if stated is None:  # it shows nothing to compare with
            return None
        misfit = stated.misfit
    better: list[tuple[float, Text]] = []
    for words, rate, force in _ALTERNATIVES:
        tried = replace(track, rate_radps=track.rate_radps * rate, force_mps2=track.force_mps2 * force)
        guess = _guess_states(problem, part, tried)
        if guess is not None and guess.misfit < misfit / 3.0:
            better.append((guess.misfit, words))
    return min(better, key=lambda one: one[0])[1] if better else None


@dataclass(frozen=True)
class _Guess:
    """First guess of the states of a chain, and how badly the IMU fits the positions there."""

    chain: Chain
    xyz_m: FloatArray
    rotation: FloatArray
    added: FloatArray
    misfit: float


def _guess_states(problem: InertialProblem, chain: Chain, track: InertialTrack) -> _Guess | None:
    """The first guess of a chain; None where nothing shows the heading."""
    p = problem.positions
    links = problem.links
    stretch = links.site.stretch
    arm = problem.lever_m - links.lever_m
    t_s = chain.begin_s + KNOT_STEP_S * np.arange(chain.count, dtype=np.float64)
    off_m = p.xyz_m - problem.origin_m
    antenna = np.column_stack([np.interp(t_s, p.t_s, off_m[:, axis]) for axis in range(3)]) / stretch
    seen = np.where(without_positions(t_s, p.t_s)[:, None], np.nan, antenna)
    step_s = float(np.median(np.diff(p.t_s)))
    white, drift = (float(np.median(sigma[:, 0])) for sigma in (p.white_m, p.drift_m))

    def aligned(half: int, rate_bias: FloatArray) -> Attitudes | None:
        rate_radps = track.rate_radps - rate_bias
        steps = increments(track.t_s, rate_radps, track.force_mps2, t_s[:-1], t_s[:-1] + KNOT_STEP_S)
        many = averaged_knots(half)
        mean, kept = moving_mean(seen, many), np.exp(-half * KNOT_STEP_S / DRIFT_CORRELATION_S)
        noise = white / np.sqrt(max(1.0, many * KNOT_STEP_S / step_s))
        # Of the slow error, what is left in second differences beside what is left of white noise.
        sigma = float(np.sqrt(noise**2 + (1.0 + (kept**2 - 4.0 * kept) / 3.0) * drift**2))
        hint = problem.hints.of_chain(t_s, mean, (noise, drift), problem.lever_m)
        found = attitudes(steps, mean, arm, sigma, links.noise, links.site.gravity_mps2, hint, half)
        if found is None:
            return None
        return replace(found, bias=found.bias + np.concatenate([rate_bias, np.zeros(3)]))

    at_rest = Standing.find(track, p).rate_bias_radps(track) if problem.hints.on_wheels else np.zeros(3)
    for half in HALVES:
        found = aligned(half, at_rest)
        if found is None:
            continue
        rate_bias = found.bias[:, :3].mean(axis=0)
        if np.linalg.norm(rate_bias - at_rest) * min(chain.count, CHUNK_KNOTS) * KNOT_STEP_S > LINEAR_RAD:
            found = aligned(half, rate_bias) or found
        break
    else:
        return None
    velocity = np.gradient(antenna - found.rotation @ arm, KNOT_STEP_S, axis=0)
    added = np.zeros((chain.count, problem.hints.layout.size - POSE))
    for block, values in ((VELOCITY, velocity), (RATE_BIAS, found.bias[:, :3]), (FORCE_BIAS, found.bias[:, 3:])):
        first = problem.hints.layout.column(block) - POSE
        added[:, first : first + block.size] = values
    xyz = stretch * (antenna - found.rotation @ problem.lever_m)
    return _Guess(chain, xyz, found.rotation, added, found.misfit)


def without_positions(t_s: FloatArray, known_s: FloatArray) -> NDArray[np.bool_]:
    """Whether times (n,) lie before, after or between known ones (m,) that are more than FIRST_GUESS_GAP_S apart."""
    after = np.searchsorted(known_s, t_s)
    wide = np.concatenate(
        [[True], np.diff(known_s) > max(FIRST_GUESS_GAP_S, 2.5 * float(np.median(np.diff(known_s)))), [True]]
    )
    inside = (t_s > known_s[0]) & (t_s < known_s[-1])
    return np.asarray(np.where(inside, wide[after], (t_s < known_s[0]) | (t_s > known_s[-1])))
