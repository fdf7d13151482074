"""Rows of inertial measurements and of attitudes to a track, and what the measurements show about themselves.

An IMU that turns sees gravity turn the other way: the change of the specific force over a second is what the angular
rate says, but for accelerations, which come and go. That compares units, signs and axes of both sensors.
"""

from collections.abc import Callable
from dataclasses import replace
from itertools import permutations, product
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.epochs import timing_facts, utc_facts
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.clock import runs_forward
from furrowmap.core.values.inertial import (
    FORCE_UNITS,
    RATE_UNITS,
    STANDARD_GRAVITY_MPS2,
    UNITS_OF_FORMAT,
    InertialTrack,
    StatedUnits,
)
from furrowmap.core.values.pose_track import AttitudeTrack

MAX_GRAVITY_DEVIATION: Final = 0.05
"""Share by which the mean specific force may differ from gravity: biases are below 30 mg, slow motion adds little."""
MAX_WITHOUT_GRAVITY_MPS2: Final = 5.0
MIN_STEADY_SHARE: Final = 0.5
"""Share of the specific force that keeps its direction in the axes of an IMU: gravity, in any vehicle."""
SPIN_RADPS: Final = 8.7
MIN_SPIN_SHARE: Final = 0.05
"""No vehicle turns as fast for so much of the time (500 °/s); its rates are in degrees per second."""
MIN_UNSEEN_TURN_RAD: Final = 1.0
UNSEEN_TIMES: Final = 5.0
"""Turns within a second (RMS) so much larger than those of gravity are none. Multirotors accelerate along their own
axis, so that gravity hides smaller turns from their IMU."""
RESAMPLED_STEP_S: Final = 0.1
TURN_STEPS: Final = 10
"""Steps over which turns are compared: a second."""
MAX_CHECKED_S: Final = 1200.0
"""More than this is not needed."""
MIN_TURN_RAD: Final = 0.02
"""RMS turn of gravity in a window from which units and axes show."""
MAX_RESIDUAL_RATIO: Final = 0.6
"""Residuals by which other axes must be better than those stated."""
MIN_EXPLAINED_SHARE: Final = 0.5
"""Share of gravity's turn that must be explained for an answer to be named."""
MAX_JITTER: Final = 0.3
"""Scatter of the intervals, in shares of one, from which times are those of arrival."""
MIN_PAUSE_INTERVALS: Final = 10.0
"""Intervals of so many usual ones are pauses, not bursts."""
BURST_INTERVALS: Final = 20
MIN_FROZEN_S: Final = 0.5
MAX_FROZEN_CHANCE: Final = 1e-9
"""An axis that keeps its value for so long is frozen, if that is so unlikely by how often values repeat elsewhere."""
_UNIT_MISTAKES: Final = {
    Text("they were in degrees per second instead of radians"): ("rad/s", "deg/s"),
    Text("they were in radians per second instead of degrees"): ("deg/s", "rad/s"),
}
"""Units that angular rates may have been read with, and those that they are in."""


def imu_notices(track: InertialTrack) -> list[Notice]:
    """What is wrong with measurements, and what to write in the session or in the file."""
    name = track.source or "The IMU"
    return [*_gravity(track, name), *_rates(track, name), *_times(track, name)]


def shown_units(track: InertialTrack) -> StatedUnits:
    """The units that measurements are in by what they show; None where those that they were read with are right."""
    force = _force_unit(track)
    rate = _rate_unit(track)
    return StatedUnits(rate[1] if rate is not None else None, force[1] if force is not None else None)


def _force_unit(track: InertialTrack) -> tuple[str, str] | None:
    """The unit that specific forces were read with, and the one that they are in if their size is gravity's then."""
    size, steady = _force_size(track)
    if steady < MIN_STEADY_SHARE * size:
        return None
    for (read, read_mps2), (other, other_mps2) in permutations(FORCE_UNITS.items(), 2):
        if abs(size * other_mps2 / (read_mps2 * STANDARD_GRAVITY_MPS2) - 1.0) < MAX_GRAVITY_DEVIATION:
            return read, other
    return None


def _force_size(track: InertialTrack) -> tuple[float, float]:
    """Median of the specific force at rest or in slow motion, and the size of its median vector; 0 without any."""
    if len(track) < 2:
        return 0.0, 0.0
    force = _resampled(track)[1]
    return float(np.median(np.linalg.norm(force, axis=1))), float(np.linalg.norm(np.median(force, axis=0)))


def _rate_unit(track: InertialTrack) -> tuple[str, str] | None:
    """The unit that angular rates were read with, and the one that they are in; None where nothing shows another."""
    turn, force = _resampled(track)
    spins = np.linalg.norm(turn, axis=1) > SPIN_RADPS * RESAMPLED_STEP_S
    if len(turn) > 1 and spins.mean() > MIN_SPIN_SHARE:
        return "rad/s", "deg/s"
    if len(force) < 3 * TURN_STEPS:
        return None
    middle, seen, swept = _turns(turn, force)
    seen_rad = float(np.sqrt((seen**2).sum(axis=1).mean()))
    said = np.cross(swept - np.median(swept, axis=0), middle)
    said_rad = float(np.sqrt((said**2).sum(axis=1).mean()))
    if said_rad > max(MIN_UNSEEN_TURN_RAD, UNSEEN_TIMES * seen_rad):
        return "rad/s", "deg/s"
    better = _better_axes(middle, seen, swept)
    return _UNIT_MISTAKES.get(better[0]) if better is not None else None


def _gravity(track: InertialTrack, name: str) -> list[Notice]:
    """Whether the specific force at rest or in slow motion is gravity."""
    size, _ = _force_size(track)
    share = size / STANDARD_GRAVITY_MPS2
    if abs(share - 1.0) < MAX_GRAVITY_DEVIATION:
        return []
    found = {"name": name, "force_mps2": size, "gravity_mps2": STANDARD_GRAVITY_MPS2}
    units = _force_unit(track)
    if units is not None:
        return [Notice("imu-gravity.other-unit", **found, read=units[0], unit=units[1])]
    if size < MAX_WITHOUT_GRAVITY_MPS2:
        return [Notice("imu-gravity.removed", **found)]
    return [Notice("imu-gravity.wrong-scale", **found, share=share, mended=1.0 / share)]


def _rates(track: InertialTrack, name: str) -> list[Notice]:
    """Whether angular rate and specific force have the same axes, and the rate its unit."""
    turn, force = _resampled(track)
    units = _rate_unit(track)
    if units is not None:
        usual_dps = float(np.degrees(np.median(np.linalg.norm(turn, axis=1)) / RESAMPLED_STEP_S))
        return [Notice("imu-rate-unit", name=name, usual_dps=usual_dps, read=units[0], unit=units[1])]
    better = _better_axes(*_turns(turn, force)) if len(force) >= 3 * TURN_STEPS else None
    if better is None:
        return []
    best, stated, explained = better
    return [Notice("imu-axes", name=name, value=max(0.0, stated), choices=explained, best=best)]


def _turns(turn: FloatArray, force: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """In windows of a second: the mean direction of gravity, how it turned, and how the IMU turned; (n, 3) each.

    Args:
        turn, force: (m, 3) of steps, as :func:`_resampled` gives them.
    """
    size = np.linalg.norm(force, axis=1, keepdims=True)
    up = force / np.where(size > 0.0, size, 1.0)
    swept = np.cumsum(turn, axis=0)
    swept = swept[TURN_STEPS:] - swept[:-TURN_STEPS]
    return 0.5 * (up[TURN_STEPS:] + up[:-TURN_STEPS]), up[TURN_STEPS:] - up[:-TURN_STEPS], swept


def _better_axes(middle: FloatArray, seen: FloatArray, swept: FloatArray) -> tuple[Text, float, float] | None:
    """What would make turns (n, 3) fit those of gravity, and the share that is explained as stated and then.

    None where they fit as stated, or gravity hardly turns, or nothing makes them fit.
    """
    whole = float((seen**2).sum())
    if whole < MIN_TURN_RAD**2 * len(seen):
        return None
    stated = _misfit(middle, seen, swept)
    choices = {words: _misfit(middle, seen, factor * swept @ matrix.T) for words, factor, matrix in _alternatives()}
    best = min(choices, key=lambda words: choices[words])
    if choices[best] > MAX_RESIDUAL_RATIO * stated or choices[best] > (1.0 - MIN_EXPLAINED_SHARE) * whole:
        return None
    return best, 1.0 - stated / whole, 1.0 - choices[best] / whole


def _misfit(middle: FloatArray, seen: FloatArray, swept: FloatArray) -> float:
    """Squares of gravity's turns (n, 3) that turns of the IMU (n, 3) leave unexplained."""
    return float(((seen + np.cross(swept, middle)) ** 2).sum())


def _alternatives() -> list[tuple[Text, float, FloatArray]]:
    """What may be wrong with the rates: in words, and the factor and matrix that mend it; the simplest first."""
    same = np.eye(3)
    out = [
        *((words, RATE_UNITS[unit] / RATE_UNITS[read], same) for words, (read, unit) in _UNIT_MISTAKES.items()),
        (Text("they had the other sign"), -1.0, same),
    ]
    for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        matrix = np.zeros((3, 3))
        matrix[range(3), order] = signs
        if not (np.array_equal(matrix, same) or np.array_equal(matrix, -same)):
            axes = ", ".join(f"{'−' if sign < 0 else ''}{'xyz'[k]}" for sign, k in zip(signs, order, strict=True))
            out.append((Text("their x, y, z were {axes}", axes=axes), 1.0, matrix))
    return out


def _times(track: InertialTrack, name: str) -> list[Notice]:
    """Times of arrival, and pauses."""
    step = np.diff(track.t_s)
    if len(step) < 3 * BURST_INTERVALS:
        return []
    mean = float(np.median(track.t_s[BURST_INTERVALS:] - track.t_s[:-BURST_INTERVALS])) / BURST_INTERVALS
    scatter = float(np.mean(np.abs(step[step < MIN_PAUSE_INTERVALS * mean] - mean)))
    notices = []
    if scatter > MAX_JITTER * mean:
        notices.append(Notice("imu-times-of-arrival", name=name, scatter_ms=1e3 * scatter, mean_ms=1e3 * mean))
    pauses = step[step >= MIN_PAUSE_INTERVALS * mean]
    if len(pauses):
        notices.append(
            Notice("imu-pauses", name=name, pauses=len(pauses), in_all_s=pauses.sum(), longest_s=pauses.max())
        )
    return notices


def without_frozen(track: InertialTrack) -> tuple[InertialTrack, list[Notice]]:
    """The track without times in which one axis keeps its value to the last digit while the others go on; notices.

    At rest, values of a coarse resolution repeat on all axes.
    """
    values = np.column_stack([track.rate_radps, track.force_mps2])
    same = np.diff(values, axis=0) == 0.0
    frozen = np.zeros(len(track), np.bool_)
    axes = []
    for axis, name in enumerate([f"{kind} {axis}" for kind in ("angular rate", "specific force") for axis in "xyz"]):
        edges = np.flatnonzero(np.diff(same[:, axis], prepend=False, append=False)).reshape(-1, 2)
        repeated = max(float(same[:, axis].mean()), 1e-3)
        for first, last in edges[track.t_s[edges[:, 1]] - track.t_s[edges[:, 0]] > MIN_FROZEN_S].tolist():
            outside = max((repeated * len(same) - (last - first)) / max(len(same) - (last - first), 1), 1e-3)
            others = float(np.median(same[first:last].mean(axis=0)))
            if others < 0.5 and (last - first) * np.log(outside) < np.log(MAX_FROZEN_CHANCE):
                frozen[first : last + 1] = True
                axes += [name] if name not in axes else []
    if not frozen.any():
        return track, []
    length_s = float(np.diff(track.t_s, append=track.t_s[-1])[frozen].sum())
    source = track.source or "The IMU"
    kept = ~frozen
    rest = InertialTrack(track.t_s[kept], track.rate_radps[kept], track.force_mps2[kept], track.source)
    return rest, [Notice("imu-frozen", name=source, axes=", ".join(axes), frozen_s=length_s)]


def _resampled(track: InertialTrack) -> tuple[FloatArray, FloatArray]:
    """Turn (n, 3) within each step of the first minutes, and mean specific force (n, 3); empty steps are left out."""
    part = track.t_s < track.t_s[0] + MAX_CHECKED_S
    cell = ((track.t_s[part] - track.t_s[0]) / RESAMPLED_STEP_S).astype(np.int64)
    _, first, count = np.unique(cell, return_index=True, return_counts=True)
    rate, force = (np.add.reduceat(v[part], first) / count[:, None] for v in (track.rate_radps, track.force_mps2))
    return RESAMPLED_STEP_S * rate, force


MAX_LATE_SHARE: Final = 0.01
MAX_RATE_RADPS: Final = 100.0
MAX_FORCE_MPS2: Final = 1000.0
"""No IMU measures more: the unit is another one."""


def inspected_track(read: Callable[[StatedUnits], InertialTrack], stated: StatedUnits) -> InertialTrack:
    """The measurements that `read` gives with some units, for a look at them.

    Where no IMU measures such values in the units of the format, they are those in degrees per second if that shows in
    them: as numbers of the format, so that :func:`imu_notices` and :func:`inertial_facts` name the unit.
    """
    try:
        return read(stated)
    except InputError as error:
        if error.code != "value-out-of-range" or stated != UNITS_OF_FORMAT:
            raise
        try:
            track = read(StatedUnits(rate_unit="deg/s"))
        except InputError:
            raise error from None
        as_numbers = replace(track, rate_radps=track.rate_radps / RATE_UNITS["deg/s"])
        if _rate_unit(as_numbers) is None:
            raise
        return as_numbers


def first_beyond(values: FloatArray) -> tuple[int, int, int] | None:
    """Rows of rate and force (n, 6) that no IMU measures: how many, the first, and its first column; None without."""
    for first, largest in ((0, MAX_RATE_RADPS), (3, MAX_FORCE_MPS2)):
        wrong = np.flatnonzero((np.abs(values[:, first : first + 3]) > largest).any(axis=1))
        if len(wrong):
            return len(wrong), int(wrong[0]), first
    return None


def inertial_track(t_s: FloatArray, values: FloatArray, name: str) -> tuple[InertialTrack, list[Notice]]:
    """The track of measurements in the order of recording, and a notice of the few that are not later than all before.

    `values` (n, 6) are angular rate (rad/s) and specific force (m/s²). InputError if the times do not increase.
    """
    forward, late = _forward(t_s, "time-disorder.measurements", name)
    return InertialTrack(t_s[forward], values[forward, :3], values[forward, 3:], name), late


def attitude_track(
    t_s: FloatArray, angles_deg: FloatArray, north: str, name: str
) -> tuple[AttitudeTrack, list[Notice]]:
    """The track of attitudes in the order of recording, and a notice of the few that are not later than all before.

    `angles_deg` (n, 3) are roll, pitch, heading. InputError if the times do not increase.
    """
    forward, late = _forward(t_s, "time-disorder", name)
    roll, pitch, heading = angles_deg[forward].T
    return AttitudeTrack(t_s[forward], roll, pitch, heading, north, name), late


def _forward(t_s: FloatArray, disorder: str, name: str) -> tuple[NDArray[np.bool_], list[Notice]]:
    """Which rows (n,) are later than all before, and a notice of the others; InputError if these are too many."""
    forward = runs_forward(t_s)
    late = int((~forward).sum())
    if late > MAX_LATE_SHARE * len(t_s) or len(t_s) - late < 2:
        raise InputError(disorder, name=name, late=late, rows=len(t_s))
    return forward, [Notice("time-runs-back", name=name, late=late, rows=len(t_s))] if late else []


def inertial_facts(track: InertialTrack) -> dict[str, Any]:
    """What `inspect` reports about measurements; units where they show others than those they were read with."""
    units = shown_units(track)
    shown = {"rate_unit": units.rate_unit, "force_unit": units.force_unit}
    return {
        "measurements": len(track),
        **utc_facts(track.t_s),
        **timing_facts(track.t_s),
        "mean_force_mps2": np.round(track.force_mps2.mean(axis=0), 3).tolist(),
        "largest_rate_dps": round(float(np.degrees(np.abs(track.rate_radps).max())), 1),
        **{name: unit for name, unit in shown.items() if unit is not None},
    }


def attitude_facts(track: AttitudeTrack) -> dict[str, Any]:
    """What `inspect` reports about attitudes."""
    facts: dict[str, Any] = {"attitudes": len(track), **utc_facts(track.t_s), **timing_facts(track.t_s)}
    for name in ("roll_deg", "pitch_deg"):
        values = getattr(track, name)
        if np.isfinite(values).any():
            facts[name] = [round(float(q), 2) for q in np.nanquantile(values, [0.0, 0.5, 1.0])]
    facts["north"] = (track.north or "not stated") if track.has_heading else "no heading"
    return facts
