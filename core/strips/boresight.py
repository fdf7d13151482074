"""Boresight of a scanner on a vehicle with an IMU, from ground that is seen at several times.

The trajectory is known, so where the same ground comes out at different heights, the mounting is off (or the clock, or
the lasers' ranges). Heights of cells at each time are observations of three angles, a time offset, constants of the
lasers, and a height of each window of time for what the trajectory is off; the heights of the cells are eliminated.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.banded import huber_weight
from furrowmap.core.runtime.arrays import FloatArray, three
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.strips.cell_heights import (
    PARAMETERS,
    ROBUST_ROUNDS,
    CellHeights,
    GroupHeights,
    adjust_cells,
    cell_heights,
    derivatives,
    same_cell_pairs,
    smooth_groups,
)
from furrowmap.core.strips.strips import LASER_GROUPS, StripReturns, at_shifted_times
from furrowmap.core.strips.turned_mounting import level_mountings, turned_mountings
from furrowmap.core.values.margins import margin
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.time_span import Interval, interval_numbers
from furrowmap.core.values.trajectory import Trajectory

BORESIGHT_WINDOW_S: Final = 1.0
MAX_BORESIGHT_WINDOWS: Final = 400
CELL_HEIGHT_SIGMA_M: Final = 0.005
"""Standard deviation of what a window's heights are off, of a laser's range constant, and of a cell's mean."""
BORESIGHT_NAMES: Final = ("roll_deg", "pitch_deg", "yaw_deg", "time_s", "x_m", "y_m", "z_m")
"""The parameters, about and along the vehicle's axes."""
CLOCK_COLUMN: Final = 3
PLACE_COLUMNS: Final = slice(4, 7)
"""Where time offset and place are among them."""
STATED_PRIOR: Final = np.array([*np.radians([5.0, 5.0, 5.0]), 0.001, 1e-5, 1e-5, 1e-5])
"""Standard deviations of the parameters before they are estimated: clock and place as stated."""
FREE_PRIOR: Final = np.array([*np.radians([5.0, 5.0, 5.0]), 0.02, 0.3, 0.3, 0.3])
"""All free."""
MAX_OBSERVED_SIGMA: Final = np.array([0.2, 0.2, 0.2, 0.002, 0.05, 0.05, 0.05])
"""Largest standard deviations with which a parameter counts as observed."""
CERTAINLY_OFF_SIGMAS: Final = 5.0
"""Standard deviations by which clock or place must be off to be corrected."""
MIN_OFF: Final = np.array([0.0, 0.0, 0.0, 0.0005, 0.02, 0.02, 0.02])
"""Less of an offset of clock and place is not worth a correction."""
MAX_BORESIGHT_ROUNDS: Final = 6
SETTLED_CORRECTIONS: Final = np.array([*np.radians([0.001, 0.001, 0.001]), 1e-5, 5e-4, 5e-4, 5e-4])
"""Smaller corrections end the rounds."""
MIN_GROUPS: Final = 500
MAX_BORESIGHT_SIGMA_DEG: Final = 0.2
"""Largest standard deviation of an angle with which the boresight is used."""
MAX_DRAWN_DEG: Final = 3.0
"""A scanner or an IMU is mounted as drawn to a degree or so."""
MAX_COINCIDING_M: Final = 0.1
"""Ground that is seen at several times coincides to less with a mounting that is right, whatever else is wrong."""
TURNED_SHARE: Final = 0.6
"""A mounting that is turned must leave less than this share of the scatter."""
USUAL_OFFSETS_S: Final = (0.25, 0.5, 1.0, 2.0, 18.0, 19.0, 37.0)
"""Offsets of clocks: delays, whole seconds, and those between GPS time, UTC and TAI."""
MAX_CREEP_ROUNDS: Final = 12
"""Ground rises and falls within decimetres, so that differences show a part of a larger creep at once."""
MIN_CREEP_GAIN: Final = 50.0
"""By how much the sum of squared normalised differences falls with a creep that is certain."""
MIN_CREEP_PAIRS: Final = 500
MIN_CREEP_SIGMAS: Final = 3.0
"""Standard deviations of the positions by which they have moved in half of the flight at least."""


@dataclass(frozen=True)
class FreeFit:
    """All parameters estimated together, with wide limits: what the flight itself shows of each.

    Attributes:
        value: (7,) corrections in the order of :data:`BORESIGHT_NAMES`: of the angles from the mounting found, of the
            others from what the session states.
        sigma: (7,) their standard deviations; as wide as before the flight where this shows nothing.
        correlation: (7, 7) of their errors.
    """

    value: FloatArray
    sigma: FloatArray
    correlation: FloatArray

    @property
    def observed(self) -> NDArray[np.bool_]:
        """(7,) which parameters the flight shows well enough to be used."""
        observed: NDArray[np.bool_] = self.sigma < MAX_OBSERVED_SIGMA
        return observed


@dataclass(frozen=True)
class Boresight:
    """The mounting at which ground seen at several times coincides.

    Attributes:
        correction_deg: (3,) rotation from the stated mounting, about the vehicle's x, y and z axes.
        sigma_deg: (3,) standard deviation, that of the trajectory's attitude included.
        time_offset_s: time by which the scanner's clock is behind the positions', and its standard deviation.
        scatter_m: scatter of the ground's heights with the stated mounting and with this one (RMS between times).
        cells: number of cells that count.
        certain: whether all angles are known well enough to be used.
        free: angles, time offset and the scanner's place together.
        clock_used_s: the time offset where it is used, else 0.
    """

    mounting: Mounting
    correction_deg: tuple[float, float, float]
    sigma_deg: tuple[float, float, float]
    time_offset_s: tuple[float, float]
    scatter_m: tuple[float, float]
    cells: int
    certain: bool
    free: FreeFit
    clock_used_s: float = 0.0

    @property
    def coincides(self) -> bool:
        """Whether the ground coincides so well that what it shows beside the mounting can be believed."""
        return self.certain and self.scatter_m[1] < MAX_COINCIDING_M

    @property
    def lies_apart(self) -> bool:
        """Whether ground that is seen at several times does not coincide, and only a mounting far off comes near."""
        return self.scatter_m[1] >= MAX_COINCIDING_M and self.turned_deg >= MAX_DRAWN_DEG

    @property
    def turned_deg(self) -> float:
        """Angle between the stated mounting and this one."""
        return float(np.linalg.norm(self.correction_deg))

    @property
    def differs(self) -> bool:
        """Whether an angle is off the stated one by more than three standard deviations."""
        return any(abs(off) > 3.0 * sigma for off, sigma in zip(self.correction_deg, self.sigma_deg, strict=True))


def boresight(
    returns: StripReturns,
    trajectory: Trajectory,
    stated: Mounting,
    carrier: Trajectory | None = None,
    *,
    place_known: bool = False,
) -> Boresight | None:
    """The boresight; None where too little ground is seen at several times.

    The scanner's place is the stated one, and its clock that of the positions to a millisecond, unless all parameters
    estimated together show that they certainly are not.

    Args:
        returns: of the scanner, with their poses.
        stated: the mounting as the session states it.
        carrier: trajectory of the frame that carries the scanner, whose poses the returns have; None for the vehicle's.
        place_known: whether the place stays as stated, whatever the ground says.
    """
    if len(returns) < MIN_GROUPS:
        return None
    carrier = trajectory if carrier is None else carrier
    begin = _State(stated.rotation, np.asarray(stated.xyz_m, np.float64), 0.0)
    settled = _settled_or_turned(returns, carrier, begin, stated)
    if settled is None:
        return None
    first_m = settled.first_m
    # What else is certainly another than stated is corrected as well: the clock first, which looks like a place.
    freed = np.arange(PARAMETERS) < CLOCK_COLUMN
    freed[CLOCK_COLUMN] = settled.state.clock_s != 0.0
    for columns in (slice(CLOCK_COLUMN, CLOCK_COLUMN + 1), PLACE_COLUMNS):
        certain = _certainly_off(settled.free)
        if columns == PLACE_COLUMNS and (place_known or settled.fitted.apart_m > MAX_COINCIDING_M):
            break
        if certain[columns].any():
            freed[columns] |= certain[columns]
            settled = _settle(returns, carrier, settled.state, settled.observed, freed) or settled
    state = settled.state
    fitted = settled.fitted
    free = settled.free
    own = np.degrees(np.sqrt(np.diag(fitted.covariance)))
    inside = (trajectory.t_s >= returns.t_s[0]) & (trajectory.t_s <= returns.t_s[-1])
    sigma = np.hypot(own[:3], np.nanmedian(trajectory.sigma[inside, 3:], axis=0))
    clock_sigma_s = float(np.sqrt(fitted.covariance[CLOCK_COLUMN, CLOCK_COLUMN]))
    value = free.values.copy()
    spread = np.sqrt(np.diag(free.covariance))
    value[:CLOCK_COLUMN] = np.degrees(value[:CLOCK_COLUMN])
    value[CLOCK_COLUMN] += state.clock_s - begin.clock_s
    value[PLACE_COLUMNS] += state.place_m - begin.place_m
    free_sigma = np.where(np.arange(PARAMETERS) < CLOCK_COLUMN, np.degrees(spread), spread)
    correction_deg = np.degrees(Rotation.from_matrix(state.rotation @ stated.rotation.T).as_rotvec())
    turned_deg = float(np.linalg.norm(correction_deg))
    return Boresight(
        Mounting.from_rotation(three(state.place_m), state.rotation),
        three(correction_deg),
        three(sigma),
        (state.clock_s + float(fitted.values[CLOCK_COLUMN]), clock_sigma_s),
        (first_m, fitted.apart_m),
        int(settled.observed[0].cell.max()) + 1,
        bool((sigma < MAX_BORESIGHT_SIGMA_DEG).all())
        and (fitted.apart_m < MAX_COINCIDING_M or turned_deg < MAX_DRAWN_DEG),
        FreeFit(value, free_sigma, free.covariance / np.outer(spread, spread)),
        state.clock_s,
    )


@dataclass(frozen=True)
class _State:
    """Rotation (3, 3) and place (3,) of the scanner, and the time by which its clock is behind."""

    rotation: FloatArray
    place_m: FloatArray
    clock_s: float


@dataclass(frozen=True)
class _Fit:
    """Corrections of the parameters, their covariance, and the RMS of heights before."""

    values: FloatArray
    covariance: FloatArray
    apart_m: float


_Observed = tuple[GroupHeights, NDArray[np.int64], int]
"""Heights of smooth cells at several times, their numbers of returns, and the number of windows of time."""


@dataclass(frozen=True)
class _Settled:
    """Scatter at the begin; the state at which the corrections vanish, its fit, one with all free; heights there."""

    first_m: float
    state: _State
    fitted: _Fit
    free: _Fit
    observed: _Observed


def _certainly_off(free: _Fit) -> NDArray[np.bool_]:
    """(7,) which parameters are off by more than is worth a correction, and certainly."""
    off = np.abs(free.values)
    out: NDArray[np.bool_] = (off > CERTAINLY_OFF_SIGMAS * np.sqrt(np.diag(free.covariance))) & (off > MIN_OFF)
    return out


def _settled_or_turned(returns: StripReturns, carrier: Trajectory, begin: _State, stated: Mounting) -> _Settled | None:
    """Angles corrected from the stated ones.

    Where the ground does not coincide so, from other angles that may be meant, and from clocks that are off by usual
    offsets, if it fits much better with these.
    """
    angles = np.arange(PARAMETERS) < CLOCK_COLUMN
    observed = _observe(returns, carrier, begin)
    settled = observed and _settle(returns, carrier, begin, observed, angles)
    if settled is not None and settled.fitted.apart_m < MAX_COINCIDING_M:
        return settled
    best_m = settled.fitted.apart_m if settled is not None else np.inf
    first_m = settled.first_m if settled is not None else np.nan
    better: tuple[float, _State, _Observed] | None = None
    clocks = [replace(begin, clock_s=sign * off_s) for off_s in USUAL_OFFSETS_S for sign in (1.0, -1.0)]
    turns = level_mountings(returns, turned_mountings(stated), begin.place_m)
    for state in (*(replace(begin, rotation=rotation) for rotation in turns), *clocks):
        if (seen := _observe(returns, carrier, state)) is None:
            continue
        apart_m = _fit(seen, STATED_PRIOR).apart_m
        if apart_m < best_m and (better is None or apart_m < better[0]):
            better = apart_m, state, seen
    if better is not None:
        angles[CLOCK_COLUMN] = better[1].clock_s != 0.0
    turned = better and _settle(returns, carrier, better[1], better[2], angles)
    if turned is None or turned.fitted.apart_m > TURNED_SHARE * best_m:
        return settled
    return replace(turned, first_m=first_m if np.isfinite(first_m) else turned.first_m)


def _observe(returns: StripReturns, carrier: Trajectory, state: _State) -> _Observed | None:
    """Heights of cells with the scanner in a state; None where too little ground is seen at several times."""
    if state.clock_s:
        returns = at_shifted_times(returns, carrier, state.clock_s)
        if len(returns) < MIN_GROUPS:
            return None
    length_s = max(BORESIGHT_WINDOW_S, float(np.ptp(returns.t_s)) / MAX_BORESIGHT_WINDOWS)
    window = ((returns.t_s - returns.t_s[0]) / length_s).astype(np.int64)
    heights = cell_heights(returns, window, state.rotation, state.place_m)
    variance, chosen = smooth_groups(heights)
    seen, cell = np.unique(heights.cell[chosen], return_inverse=True)
    if len(chosen) < MIN_GROUPS or len(chosen) < 1.5 * len(seen):
        return None
    count = heights.count[chosen]
    design = derivatives(returns, heights, chosen, state.rotation, state.place_m)
    weight = 1.0 / (variance / count + CELL_HEIGHT_SIGMA_M**2)
    groups = GroupHeights(cell, heights.window[chosen], heights.height_m[chosen], weight, design)
    return groups, count, int(heights.window.max()) + 1


def _settle(
    returns: StripReturns, carrier: Trajectory, state: _State, observed: _Observed, corrected: NDArray[np.bool_]
) -> _Settled | None:
    """Correct some parameters, leave the others nearly as they are; None where too little ground is seen."""
    prior = np.where(corrected, FREE_PRIOR, STATED_PRIOR)
    fitted = _fit(observed, prior)
    first_m = fitted.apart_m
    for _ in range(MAX_BORESIGHT_ROUNDS):
        values = np.where(corrected, fitted.values, 0.0)
        if bool((np.abs(values) < SETTLED_CORRECTIONS).all()):
            break
        rotation = Rotation.from_rotvec(values[:3]).as_matrix() @ state.rotation
        clock_s = state.clock_s + float(values[CLOCK_COLUMN])
        state = _State(rotation, state.place_m + values[PLACE_COLUMNS], clock_s)
        if (seen := _observe(returns, carrier, state)) is None:
            return None
        observed = seen
        fitted = _fit(seen, prior)
    return _Settled(first_m, state, fitted, _fit(observed, FREE_PRIOR), observed)


def _fit(observed: _Observed, prior: FloatArray) -> _Fit:
    """Least squares of all parameters, the heights of the cells eliminated."""
    groups, count, windows = observed
    spread = np.concatenate([prior, np.full(LASER_GROUPS + windows, CELL_HEIGHT_SIGMA_M)])
    off, covariance, middle = adjust_cells(groups, spread)
    apart = groups.height_m - middle[groups.cell]
    rms = float(np.sqrt(np.average(apart**2, weights=count)))
    return _Fit(-off[:PARAMETERS], covariance[:PARAMETERS, :PARAMETERS], rms)


def boresight_notices(found: Boresight | None, stated: Mounting) -> list[Notice]:
    """The mounting of a scanner on a vehicle with an IMU: used as found, or assumed as stated."""
    if found is None or not found.certain:
        return [Notice("boresight-assumed")]
    angles, place = (", ".join(f"{k:.3f}" for k in known) for known in (found.mounting.rpy_deg, found.mounting.xyz_m))
    notices = []
    if found.differs:
        after = 1e3 * found.scatter_m[1]
        before = 1e3 * found.scatter_m[0]
        margins = ", ".join(margin(sigma, "°") for sigma in found.sigma_deg)
        notices.append(Notice("boresight-off", after_mm=after, before_mm=before, angles=angles, margins=margins))
    if found.mounting.xyz_m != stated.xyz_m:
        margins = ", ".join(margin(sigma, " m") for sigma in found.free.sigma[PLACE_COLUMNS].tolist())
        notices.append(Notice("lever-arm-off", place=place, margins=margins))
    if found.clock_used_s:
        notices.append(
            Notice(
                "scanner-clock-off",
                clock_ms=1e3 * abs(found.clock_used_s),
                is_clock_used_s=found.clock_used_s > 0.0,
                margin=margin(found.time_offset_s[1], " ms", 1e3),
            )
        )
    return notices


def held_against_mounting(
    trajectory: Trajectory, found: Boresight, camera_deg: float = math.inf
) -> tuple[Trajectory, Notice | None]:
    """The trajectory with larger standard deviations of the attitude where the IMU may be turned, and the notice.

    The ground shows by how much the scanner is turned against the IMU, not which of the two is as stated; a camera
    that is as stated says that the IMU is.

    Args:
        camera_deg: angle between the stated mounting of a camera and the one that its images show; inf without.
    """
    if not found.certain:
        apart = found.lies_apart
        return trajectory, Notice("contradiction.scattered-ground", scatter_m=found.scatter_m[1]) if apart else None
    if min(found.turned_deg, camera_deg) < MAX_DRAWN_DEG:
        return trajectory, None
    sigma = trajectory.sigma.copy()
    sigma[:, 3:] = np.hypot(sigma[:, 3:], np.abs(found.correction_deg))
    angles = ", ".join(f"{angle:.1f}" for angle in found.correction_deg)
    notice = Notice("contradiction.turned-scanner", turned_deg=found.turned_deg, angles=angles)
    return replace(trajectory, sigma=sigma), notice


def held_against_strips(
    trajectory: Trajectory, returns: StripReturns, strips: Sequence[Interval], used: Mounting
) -> tuple[Trajectory, Notice | None]:
    """The trajectory with larger standard deviations where the ground shows that positions creep, and the notice."""
    # To the IMU a creep is a motion; but where ground slopes, each strip over it is higher or lower by slope and creep.
    creep_mps = positions_creep_mps(returns, strips, used)
    length_s = trajectory.span_s[1] - trajectory.span_s[0]
    stated_m = float(np.median(np.hypot(*trajectory.sigma[:, :2].T)))
    if 0.5 * length_s * float(np.hypot(*creep_mps)) < MIN_CREEP_SIGMAS * stated_m:
        return trajectory, None
    sigma = trajectory.sigma.copy()
    # Positions may have been right at the begin or at the end.
    sigma[:, :2] = np.hypot(sigma[:, :2], np.abs(creep_mps) * length_s / np.sqrt(3.0))
    east, north = 1e3 * creep_mps
    whole_m = float(np.hypot(*creep_mps)) * length_s
    return replace(trajectory, sigma=sigma), Notice(
        "contradiction.creep", east_mmps=east, north_mmps=north, whole_m=whole_m
    )


def positions_creep_mps(returns: StripReturns, strips: Sequence[Interval], used: Mounting) -> FloatArray:
    """(2,) speed by easting and northing at which ground moves from strip to strip; zero where none is certain."""
    number = interval_numbers(strips, returns.t_s).astype(np.int64)
    number[number == 0] = -1
    since_s = returns.t_s - returns.t_s.mean()
    creep_mps = np.zeros(2)
    for _ in range(MAX_CREEP_ROUNDS):
        origin_m = returns.origin_m.copy()
        origin_m[:, :2] -= since_s[:, None] * creep_mps
        still = replace(returns, origin_m=origin_m)
        step_mps, gain = _creep_step(still, since_s, cell_heights(still, number, used.rotation, np.array(used.xyz_m)))
        if gain < MIN_CREEP_GAIN:
            break
        creep_mps = creep_mps + step_mps
    return creep_mps


def _creep_step(returns: StripReturns, since_s: FloatArray, heights: CellHeights) -> tuple[FloatArray, float]:
    """A further creep (2,) by the differences between strips, and by how much their squares fall with it."""
    variance, chosen = smooth_groups(heights)
    first, second = same_cell_pairs(heights.cell[chosen])
    if len(first) < MIN_CREEP_PAIRS:
        return np.zeros(2), 0.0
    a = chosen[first]
    b = chosen[second]
    inside = heights.member >= 0
    member = heights.member[inside]
    groups = len(heights.cell)
    at_s = np.bincount(member, since_s[inside], groups) / np.maximum(np.bincount(member, minlength=groups), 1)
    noise = variance[first] / heights.count[a] + variance[second] / heights.count[b]
    sigma = np.sqrt(noise + 2.0 * CELL_HEIGHT_SIGMA_M**2)
    later_s = at_s[b] - at_s[a]
    differ = np.column_stack([-heights.slope[a] * later_s[:, None], heights.height_m[b] - heights.height_m[a]])
    # A constant of each two strips, which their errors of height are, is eliminated.
    two = np.unique(heights.window[a] * len(returns) + heights.window[b], return_inverse=True)[1]
    robust = np.ones(len(first))
    for _ in range(ROBUST_ROUNDS):
        weight = robust / sigma**2
        mean = np.column_stack([np.bincount(two, weight * column) for column in differ.T])
        left = differ - (mean / np.bincount(two, weight)[:, None])[two]
        normal = (left * weight[:, None]).T @ left
        step_mps = np.linalg.solve(normal[:2, :2] + 1e-6 * np.eye(2), normal[:2, 2])
        residual = left[:, 2] - left[:, :2] @ step_mps
        robust = huber_weight(np.abs(residual) / sigma)
    spread = max(1.0, float(weight @ residual**2) / len(residual))
    return step_mps, float(step_mps @ normal[:2, 2]) / spread
