"""Which positions of a receiver are used, how good each one is, and heights that contradict a vehicle on wheels."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.implausible_positions import spans_in_words, strays
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice, RefusedError
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.gnss import Fix, GnssTrack, Positions, assumed_sigma_m

HEIGHT_FACTOR: Final = 2.0
"""Heights are this much worse than positions where the receiver states none."""
WHITE_SHARE: Final = 0.3
"""How much of a position's error changes from epoch to epoch where the positions themselves do not show it."""
DRIFT_SHARE: Final = 0.3
"""How much of it varies slowly at least, where positions scatter by all of it or more."""
WHITE_STEP_S: Final = 0.25
"""Positions further apart than this differ by the vehicle's own accelerations, not by noise."""
WHITE_EPOCHS: Final = 30
WHITE_FLOOR_M: Final = 0.004
MEDIAN_OF_MEAN: Final = {1: 0.6745, 2: 0.77}
"""Median of the mean of one or two absolute normal deviates, in their standard deviation."""
NOT_MOTION_M: Final = 0.1
"""A noise between positions, at most WHITE_STEP_S apart, that no motion of an antenna looks like."""
RATE_REPORTED_S: Final = 0.25
MAX_POSITION_STEP_S: Final = 2.0
"""In more time than this between positions a tractor turns round."""
JUMP_FLOOR_M: Final = 0.3
HEIGHT_JUMP_FLOOR_M: Final = 1.0
JUMP_SIGMAS: Final = 6.0
MIN_POSITIONS_FOR_STEPS: Final = 10
AROUND: Final = (-3, -2, -1, 1, 2, 3)
"""Positions, or steps, beside one, whose median is that of the vehicle."""
MAX_STEP_INTERVALS: Final = 5.5
"""Steps across gaps longer than this many intervals show nothing."""
MAX_DRIVE_SPEED_MPS: Final = 15.0
MAX_ACCELERATION_MPS2: Final = 3.0
"""A position that is further from its neighbours than a tractor's speed and acceleration explain is a jump."""
CLIMB_WINDOWS_S: Final = (3.0, 10.0, 30.0)
MAX_CLIMB: Final = 0.45
"""Slope that vehicles on wheels climb at most for so long: steep vineyards are worked by winch from there on."""
CLIMB_FLOOR_M: Final = 1.0
"""For slow errors, which stated standard deviations do not hold."""
CLIMB_SIGMAS: Final = 3.0
CLIMB_GAP_S: Final = 2.0
"""Over longer pauses, if they are also longer than CLIMB_GAP_INTERVALS usual intervals, the way is not known."""
CLIMB_GAP_INTERVALS: Final = 5.0


@dataclass(frozen=True)
class Offsets:
    """Runs of positions whose slowly varying error is continuous, and those that a step shows to be off.

    Attributes:
        run: (n,) number of the run that each position belongs to, from 0.
        off_m: (n,) by how much the positions of its run are off, by the step to those beside it; 0 where none is.
        notices: about such steps.
    """

    run: NDArray[np.intp]
    off_m: FloatArray
    notices: tuple[Notice, ...] = ()


def offsets(track: GnssTrack, en_m: FloatArray) -> Offsets:
    """Steps between positions (n, 2) that no drive explains: of the two sides the one of worse quality is off.

    Of equal qualities it is the side of fewer positions. Float solutions may be metres off with a stated standard
    deviation of decimetres, which the step to the next fixed position shows.
    """
    t_s = track.t_s
    sigma = sigmas_m(track)[:, 0]
    new = np.diff(track.fix, prepend=track.fix[:1]) != 0
    off = np.zeros(len(t_s))
    if len(t_s) < MIN_POSITIONS_FOR_STEPS:
        return Offsets(np.cumsum(new), off)
    dt = np.diff(t_s)
    speed = np.diff(en_m, axis=0) / dt[:, None]
    around = np.clip(np.arange(len(dt))[:, None] + np.array(AROUND), 0, len(dt) - 1)
    step = np.hypot(*((speed - np.median(speed[around], axis=1)) * dt[:, None]).T)
    follows = dt < MAX_STEP_INTERVALS * np.median(dt)
    reach = (
        np.maximum(JUMP_FLOOR_M, JUMP_SIGMAS * np.maximum(sigma[1:], sigma[:-1])) + 0.5 * MAX_ACCELERATION_MPS2 * dt**2
    )
    steps = np.flatnonzero(follows & (step > reach))
    border = new.copy()
    border[1:] |= ~follows
    border[steps + 1] = True
    unit = np.cumsum(border)
    for i in steps.tolist():
        sides = [unit == unit[i], unit == unit[i + 1]]
        rank = [(round(float(np.median(sigma[side])), 3), -int(np.count_nonzero(side))) for side in sides]
        worse = sides[int(rank[1] > rank[0])]
        off[worse] = np.maximum(off[worse], step[i])
        new[[i + 1, int(np.argmax(worse))]] = True
    if not len(steps):
        return Offsets(np.cumsum(new), off)
    there = np.flatnonzero(off)
    first, last = (iso_utc(float(t_s[there[i]])) for i in (0, -1))
    sigma_m = np.median(sigma[there])
    notice = Notice("gnss-steps", there=len(there), first=first, last=last, off_m=off.max(), sigma_m=sigma_m)
    return Offsets(np.cumsum(new), off, (notice,))


def positions_of(
    track: GnssTrack, en_m: FloatArray, white_m: FloatArray, heading_deg: FloatArray, steps: Offsets
) -> Positions:
    """Positions en_m (m, 2) with errors split into what changes and what stays, and grid headings (m,), nan without."""
    sigma = sigmas_m(track)
    # Differences from one epoch to the next do not show what multipath does to heights within seconds: the usual share
    # of their sigma is the least.
    shown = white_noise_m(track, track.height_m[:, None], sigma[:, 1])
    white_h = np.maximum(shown, WHITE_SHARE * sigma[:, 1])
    white = np.column_stack([white_m, white_m, white_h])
    stated = sigma[:, [0, 0, 1]]
    drift = np.sqrt(np.maximum(stated**2 - white**2, np.maximum(WHITE_FLOOR_M, DRIFT_SHARE * stated) ** 2))
    # Only where a run begins: within it the error changes no faster than that of other positions.
    begins = np.flatnonzero(np.diff(steps.run, prepend=-1))
    drift[begins] = np.hypot(drift[begins], steps.off_m[begins, None])
    return Positions(
        t_s=track.t_s,
        xyz_m=np.column_stack([en_m, track.height_m]),
        white_m=white,
        drift_m=drift,
        run=steps.run,
        fix=track.fix,
        yaw_rad=np.radians(90.0 - heading_deg),
    )


def positions_without_steps(track: GnssTrack, en_m: FloatArray) -> Positions:
    """The positions (m,) of a track without a heading, whose error is continuous in each run of equal quality."""
    white = white_noise_m(track, en_m, sigmas_m(track)[:, 0])
    runs = Offsets(quality_runs(track.fix), np.zeros(len(track)))
    return positions_of(track, en_m, white, np.full(len(track), np.nan), runs)


def quality_runs(fix: NDArray[np.int8]) -> NDArray[np.intp]:
    """(n,) number of the run of equal qualities that each position belongs to, from 0."""
    return np.cumsum(np.diff(fix, prepend=fix[:1]) != 0)


def fixes_from_labels(labels: tuple[str, ...]) -> tuple[Fix, ...]:
    """The qualities that a session names. Raises InputError if a name is no quality."""
    known = {fix.label: fix for fix in Fix if fix is not Fix.NONE}
    for label in labels:
        if label not in known:
            raise InputError("session-value.fix-label", label=label, known=", ".join(known))
    return tuple(known[label] for label in labels)


def quality_words(fix: NDArray[np.int8]) -> dict[str, int]:
    """How many positions (n,) there are of each quality, by its word."""
    return {Fix(f).label: count for f, count in sorted(Counter(fix.tolist()).items())}


@dataclass(frozen=True)
class UsedPositions:
    """The positions of a log that are used, after one step after another has left out or changed some.

    Attributes:
        unused: how many were left out, by the word of their quality, "jump" or "held".
        levels_m: by how much levels of heights differed at most, before they were made one.
        notices: about what was left out and changed.
    """

    track: GnssTrack
    unused: dict[str, int] = field(default_factory=dict)
    levels_m: float = 0.0
    notices: tuple[Notice, ...] = ()

    def without(self, left_out: NDArray[np.bool_], why: str, notice: Notice) -> UsedPositions:
        """The positions but for some (n,), which are counted under `why`."""
        unused = {**self.unused, why: int(left_out.sum())}
        return replace(self, track=self.track[~left_out], unused=unused, notices=(*self.notices, notice))

    def told(self, *notices: Notice) -> UsedPositions:
        """The same with more notices."""
        return replace(self, notices=(*self.notices, *notices))


def usable(track: GnssTrack, fixes: tuple[Fix, ...] | None) -> UsedPositions:
    """The positions of the qualities to use. Raises InputError if there are fewer than two with heights."""
    notices: tuple[Notice, ...] = ()
    positioned = np.isfinite(track.lon_deg) & np.isfinite(track.lat_deg) & np.isfinite(track.height_m)
    positioned &= track.fix != Fix.NONE
    if fixes is None:
        good = np.isin(track.fix, (Fix.FIXED, Fix.SIMULATED))
        wanted = np.isin(track.fix, (Fix.FIXED, Fix.SIMULATED, Fix.FLOAT)) if good.any() else np.ones(len(track), bool)
        if len(track) and not good.any():
            best = Counter(Fix(f).label for f in track.fix[positioned].tolist()).most_common(1)
            notices = (Notice("gnss-quality", best=best[0][0] if best else "none"),)
    else:
        wanted = np.isin(track.fix, fixes)
    use = positioned & wanted
    if use.sum() >= 2:
        return UsedPositions(track[use], quality_words(track.fix[~use]), notices=notices)
    source = track.source or "The GNSS log"
    placed = np.isfinite(track.lon_deg) & (track.fix != Fix.NONE)
    count = int(positioned.sum())
    if placed.sum() >= 2 and count < 2:
        raise InputError("gnss-no-heights", source=source, placed=int(placed.sum()))
    if count < 2:
        raise InputError("gnss-no-positions.too-few-2", source=source, positioned=count, track=len(track))
    found = Counter(Fix(f).label for f in track.fix[positioned].tolist()).most_common()
    words = ", ".join(f"{number} {label}" for label, number in found)
    raise InputError("gnss-no-positions.too-few", source=source, use=int(use.sum()), track=len(track), words=words)


def rate_notices(track: GnssTrack) -> tuple[Notice, ...]:
    """About positions that come seldom. Raises RefusedError if a tractor might have turned between two of them."""
    step_s = float(np.median(np.diff(track.t_s)))
    if step_s > MAX_POSITION_STEP_S:
        raise RefusedError("gnss-rate", source=track.source or "The GNSS log", step_s=step_s)
    return (Notice("gnss-rate.slow", step_s=step_s),) if step_s > RATE_REPORTED_S else ()


def white_noise_m(track: GnssTrack, axes_m: FloatArray, sigma_m: FloatArray) -> FloatArray:
    """Noise (n,) from position to position, by quality: what the positions themselves show.

    Up to NOT_MOTION_M it is no more than their sigma: an antenna sways by as much.

    Third differences of positions in equal steps are free of speed and acceleration; white noise makes their variance
    20 times its own (the sum of the squares of 1, 3, 3, 1). Their median deviation stands above jumps.

    Args:
        axes_m: (n, 2) easting and northing, or (n, 1) height.
    """
    white = np.maximum(WHITE_FLOOR_M, WHITE_SHARE * sigma_m)
    step = np.diff(track.t_s)
    if len(step) < WHITE_EPOCHS or np.median(step) > WHITE_STEP_S:
        return white
    third = np.abs(np.diff(axes_m, 3, axis=0)).mean(axis=1)
    even = np.abs(step - np.median(step)) < 0.1 * np.median(step)
    same = (track.fix[3:] == track.fix[:-3]) & even[2:] & even[1:-1] & even[:-2]
    for fix in np.unique(track.fix):
        chosen = third[same & (track.fix[3:] == fix)]
        if len(chosen) >= WHITE_EPOCHS:
            shown = float(np.median(chosen)) / MEDIAN_OF_MEAN[axes_m.shape[1]] / np.sqrt(20.0)
            mine = track.fix == fix
            most = np.inf if shown > NOT_MOTION_M else np.maximum(sigma_m[mine], WHITE_FLOOR_M)
            white[mine] = np.clip(shown, WHITE_FLOOR_M, most)
    return white


def jumps(t_s: FloatArray, xyz_m: FloatArray, sigma_m: FloatArray) -> NDArray[np.bool_]:
    """Positions (n, 3) that no drive leads to from the median of their neighbours, by sigmas (n, 2), map and height."""
    n = len(t_s)
    if n < 7:
        return np.zeros(n, bool)
    # Mirrored at both ends, where a position would else be three of its neighbour's neighbours.
    around = np.abs(np.arange(n)[:, None] + np.array(AROUND))
    around = n - 1 - np.abs(n - 1 - around)
    off = np.abs(xyz_m - np.median(xyz_m[around], axis=1))
    dt = t_s[around] - t_s[:, None]
    reach = 0.5 * MAX_ACCELERATION_MPS2 * (dt**2).max(axis=1) + MAX_DRIVE_SPEED_MPS * np.abs(dt.mean(axis=1))
    limit = reach[:, None] + np.maximum([JUMP_FLOOR_M, HEIGHT_JUMP_FLOOR_M], JUMP_SIGMAS * sigma_m)
    with np.errstate(invalid="ignore"):
        return np.asarray((np.hypot(off[:, 0], off[:, 1]) > limit[:, 0]) | (off[:, 2] > limit[:, 1]))


def without_jumps(positions: UsedPositions, en_m: FloatArray) -> tuple[UsedPositions, FloatArray]:
    """Positions (n,) and map coordinates (n, 2) without jumps. Raises InputError if most of them are."""
    track = positions.track
    sigma = sigmas_m(track)
    bad = strays(track.t_s, en_m, sigma[:, 0])
    rest = ~bad
    bad[rest] = jumps(track.t_s[rest], np.column_stack([en_m, track.height_m])[rest], sigma[rest])
    if not bad.any():
        return positions, en_m
    if bad.mean() > 0.5:
        raise InputError("gnss-unsteady", source=track.source or "The GNSS log", bad=int(bad.sum()), track=len(track))
    notice = Notice("gnss-jumps", unused=int(bad.sum()), track=spans_in_words(track, bad))
    return positions.without(bad, "jump", notice), en_m[~bad]


def sigmas_m(track: GnssTrack) -> FloatArray:
    """(n, 2) standard deviations of a position's horizontal axes and of its height, stated or by quality."""
    default = assumed_sigma_m(track.fix)
    horizontal = np.hypot(track.sigma_e_m, track.sigma_n_m) / np.sqrt(2.0)
    horizontal = np.where(np.isfinite(horizontal) & (horizontal > 0), horizontal, default)
    vertical = np.where(
        np.isfinite(track.sigma_h_m) & (track.sigma_h_m > 0), track.sigma_h_m, HEIGHT_FACTOR * horizontal
    )
    return np.column_stack([horizontal, vertical])


def climb_notices(track: GnssTrack, en_m: FloatArray) -> list[Notice]:
    """A notice where heights rise or fall by more than MAX_CLIMB along the way and their standard deviations allow.

    The way is the sum of the steps between positions: noise makes it longer, never shorter.
    """
    known = np.isfinite(track.height_m)
    if known.sum() < 2:
        return []
    track = track[known]
    en_m = en_m[known]
    t_s = track.t_s
    sigma_m = sigmas_m(track)[:, 1]
    step_s = np.diff(t_s)
    way_m = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(en_m, axis=0), axis=1)))
    gaps = np.append(0, np.cumsum(step_s > max(CLIMB_GAP_S, CLIMB_GAP_INTERVALS * float(np.median(step_s)))))
    steep = np.zeros(len(t_s), bool)
    worst = 0.0
    worst_at = (0, 0)
    for window_s in CLIMB_WINDOWS_S:
        first = np.arange(len(t_s))
        last = np.searchsorted(t_s, t_s + window_s, side="right") - 1
        first, last = first[whole := gaps[last] == gaps], last[whole]
        allowed_m = (
            CLIMB_FLOOR_M
            + MAX_CLIMB * (way_m[last] - way_m[first])
            + CLIMB_SIGMAS * np.hypot(sigma_m[first], sigma_m[last])
        )
        beyond_m = np.abs(track.height_m[last] - track.height_m[first]) - allowed_m
        steep[first] |= beyond_m > 0.0
        at = int(np.argmax(beyond_m))
        if beyond_m[at] > worst:
            worst = float(beyond_m[at])
            worst_at = (int(first[at]), int(last[at]))
    if not steep.any():
        return []
    a, b = worst_at
    return [
        Notice(
            "gnss-heights",
            source=track.source or "The GNSS log",
            height_m=track.height_m[b] - track.height_m[a],
            way_m=way_m[b] - way_m[a],
            begin=iso_utc(t_s[a]),
            end=iso_utc(t_s[b]),
            steepest_percent=100.0 * MAX_CLIMB,
            sigma_m=max(sigma_m[a], sigma_m[b]),
            steep=int(steep.sum()),
            t_s_count=len(t_s),
        )
    ]
