"""Positions and heights in a log that no receiver measured at their times: held, interpolated or rounded ones.

A receiver's height scatters by millimetres at least from one epoch to the next, and the antenna of a vehicle that moves
sways as well. Heights that lie on a straight line in time, while the vehicle goes some way, are a value that was kept
or a line between two. This is seen before anything is adjusted: the antenna's sway would be missing in them, which
otherwise looks like another lever arm. Places that repeat, to the last digit, while the vehicle goes on are held as
well.
"""

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.geodesy.longitudes import principal_deg
from furrowmap.core.readers.implausible_positions import spans_in_words
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.trajectory.used_positions import UsedPositions, sigmas_m
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.gnss import Fix, GnssTrack, Positions

HELD_POSITIONS: Final = 30
"""Positions in a row, at a straight line, that are no chance."""
HELD_WAY_M: Final = 2.0
"""How far the vehicle goes meanwhile: standing, a receiver may hold its position."""
HELD_WITHIN_M: Final = 0.0006
"""Rounding of a log to millimetres, about a line."""
HELD_SLOPE: Final = 0.1
"""By how much of the way the ground rises or falls unseen (one standard deviation)."""
LEAST_HELD_SIGMA_M: Final = 0.5
MIN_EVERY: Final = 4
"""Positions from one that was measured to the next, in a log that draws lines between them."""
LINED_LOOKED_AT: Final = 6_000
"""Positions that show whether a log does so."""
ON_LINES_M: Final = 0.0011
"""Rounding of both to millimetres."""
ON_LINES_SHARE: Final = 0.98
"""Share of the positions that lie on the lines; the others are at gaps."""
MIN_LINES: Final = 8
MIN_BEND_M: Final = 0.006
"""Measured heights bend so much from one of them to the next (median), if the lines between are none of the vehicle's
own way: on any smooth way the bend is four times as large as what lies beside the lines."""
SAME_M: Final = 0.002
"""Heights that differ by less are the same but for the geoid's slope."""
MAX_CHANGES: Final = 0.5
"""Share of rounded heights that differ from the one before."""
ROUNDED_M: Final = 0.01
"""Heights rounded to more than this are looked at."""
ROUNDED_SIGMA: Final = 0.3
"""Standard deviation of a rounding, in steps: 1/√12."""
MIN_POSITIONS: Final = 30
MIN_HELD_PLACES: Final = 3
MIN_HELD_PLACES_S: Final = 0.4
FASTEST_MPS: Final = 150.0
"""Of any vehicle that is measured: aircraft, too."""
MIN_HELD_PLACES_M: Final = 0.5
"""Places that repeat so often, for so long, while the vehicle goes so far, are held: a receiver at a stand may hold
them rightly, and goes on from there."""
MAX_HELD_SHARE: Final = 0.5
"""Where more of them repeat, they are rounded, or written more often than they are measured."""
M_A_DEGREE: Final = 111_200.0


def held_against_motion(positions: UsedPositions, en_m: FloatArray) -> UsedPositions:
    """The positions, with standard deviations of heights that hold for held, interpolated and rounded ones.

    Args:
        en_m: (n, 2) easting and northing.
    """
    track = positions.track
    simulated = bool((track.fix == Fix.SIMULATED).all())
    if len(track) < MIN_POSITIONS or simulated or not np.isfinite(track.height_m).all():
        return positions
    sigma_m = sigmas_m(track)[:, 1]
    step_m = rounding_m(track.height_m)
    way_m = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(en_m, axis=0), axis=1)))
    if step_m > ROUNDED_M:
        rounded_m = np.hypot(sigma_m, ROUNDED_SIGMA * step_m)
        found = replace(positions, track=replace(track, sigma_h_m=rounded_m))
        if ROUNDED_SIGMA * step_m <= np.median(sigma_m):
            return found
        return found.told(Notice("gnss-heights.rounded-values", source=track.source or "The GNSS log", step_m=step_m))
    held = held_heights(track.height_m, en_m)
    if not held.any():
        return positions
    edges = np.flatnonzero(np.diff(held, prepend=False, append=False)).reshape(-1, 2)
    for first, end in edges.tolist():
        extent_m = float(np.linalg.norm(np.ptp(en_m[first:end], axis=0)))
        least_m = max(LEAST_HELD_SIGMA_M, HELD_SLOPE * extent_m)
        sigma_m[first:end] = np.hypot(sigma_m[first:end], least_m)
    notice = Notice(
        "gnss-heights.held-values",
        source=track.source or "The GNSS log",
        held=int(held.sum()),
        count=len(track),
        way_m=float(sum(way_m[end - 1] - way_m[first] for first, end in edges.tolist())),
        first=iso_utc(float(track.t_s[edges[0, 0]])),
        last=iso_utc(float(track.t_s[edges[-1, 1] - 1])),
        sigma_m=float(np.median(sigma_m[held])),
    )
    return replace(positions, track=replace(track, sigma_h_m=sigma_m)).told(notice)


def measured_heights(positions: Positions) -> NDArray[np.bool_]:
    """Which of the heights (m,) are neither held, interpolated nor rounded, so that they show the antenna's sway."""
    height_m = positions.xyz_m[:, 2]
    if rounding_m(height_m) > ROUNDED_M or lined_every(height_m):
        return np.zeros(len(positions.t_s), np.bool_)
    return ~held_heights(height_m, positions.xyz_m[:, :2])


def without_held(positions: UsedPositions) -> UsedPositions:
    """The positions without places that repeat while the vehicle moves; the first of each stays."""
    held = held_places(positions.track)
    if not held.any():
        return positions
    notice = Notice("gnss-frozen", unused=int(held.sum()), track=spans_in_words(positions.track, held))
    return positions.without(held, "held", notice)


def held_places(track: GnssTrack) -> NDArray[np.bool_]:
    """Which places (n,) are those of the position before, while the vehicle goes on.

    That it does is said by the next other place, and by the receiver's own speed, where it states one.
    """
    held = np.zeros(len(track), np.bool_)
    held[1:] = (np.diff(track.lon_deg) == 0.0) & (np.diff(track.lat_deg) == 0.0)
    edges = np.flatnonzero(np.diff(held, prepend=False, append=False)).reshape(-1, 2)
    for first, end in edges.tolist():
        last = min(end, len(track) - 1)
        north_deg = track.lat_deg[last] - track.lat_deg[first]
        east_deg = principal_deg(track.lon_deg[last] - track.lon_deg[first]) * np.cos(np.radians(track.lat_deg[first]))
        lasts_s = track.t_s[end - 1] - track.t_s[first - 1]
        speeds = track.speed_mps[first - 1 : end]
        known = np.isfinite(speeds).any()
        way_m = float(np.nanmedian(speeds)) * lasts_s if known else M_A_DEGREE * np.hypot(east_deg, north_deg)
        short = end - first < MIN_HELD_PLACES or lasts_s < MIN_HELD_PLACES_S
        if short or way_m < MIN_HELD_PLACES_M or _comes_by_jump(track, first - 1):
            held[first:end] = False
    return held if held.mean() < MAX_HELD_SHARE else np.zeros(len(track), np.bool_)


def _comes_by_jump(track: GnssTrack, at: int) -> bool:
    """Whether no vehicle comes to a position from the one before: it is a jump, and stays one where it repeats."""
    if at < 1:
        return False
    north_deg = track.lat_deg[at] - track.lat_deg[at - 1]
    east_deg = principal_deg(track.lon_deg[at] - track.lon_deg[at - 1]) * np.cos(np.radians(track.lat_deg[at]))
    return bool(M_A_DEGREE * np.hypot(east_deg, north_deg) > FASTEST_MPS * (track.t_s[at] - track.t_s[at - 1]))


def rounding_m(height_m: FloatArray) -> float:
    """The step to which heights (n,) are rounded, by those that follow each other; 0 where most of these differ."""
    step_m = np.abs(np.diff(height_m))
    changes = step_m > SAME_M
    return float(step_m[changes].min()) if changes.any() and changes.mean() < MAX_CHANGES else 0.0


def lined_every(height_m: FloatArray) -> int:
    """Number of positions from one that was measured to the next, if heights (n,) lie on lines between; 0 if not.

    Lines that last as long as those of :func:`held_heights` are left to it.
    """
    first = max(0, (len(height_m) - LINED_LOOKED_AT) // 2)
    height_m = height_m[first : first + LINED_LOOKED_AT]
    number = np.arange(len(height_m))
    for every in range(MIN_EVERY, min(HELD_POSITIONS, len(height_m) // MIN_LINES)):
        for phase in range(every):
            node_m = height_m[phase::every]
            inside = number[phase : phase + every * (len(node_m) - 1) + 1]
            beside_m = np.abs(height_m[inside] - np.interp(inside, number[phase::every], node_m))
            bend_m = np.abs(node_m[1:-1] - 0.5 * (node_m[:-2] + node_m[2:]))
            if np.mean(beside_m < ON_LINES_M) > ON_LINES_SHARE and np.median(bend_m) > MIN_BEND_M:
                return every
    return 0


def held_heights(height_m: FloatArray, en_m: FloatArray) -> NDArray[np.bool_]:
    """Which heights (n,) lie on a straight line in time with those around them while the vehicle moves.

    Args:
        en_m: (n, 2) easting and northing.
    """
    n = len(height_m)
    many = HELD_POSITIONS
    held = np.zeros(n, np.bool_)
    if n < many:
        return held
    number = np.arange(many) - 0.5 * (many - 1)
    for part in arrays.parts(n - many + 1):
        windows = np.lib.stride_tricks.sliding_window_view(height_m[part.start : part.stop + many - 1], many)
        level = windows - windows.mean(axis=1, keepdims=True)
        slope = level @ number / (number @ number)
        off_m = np.abs(level - slope[:, None] * number).max(axis=1)
        for first in (part.start + np.flatnonzero(off_m < HELD_WITHIN_M)).tolist():
            held[first : first + many] = True
    for first, end in np.flatnonzero(np.diff(held, prepend=False, append=False)).reshape(-1, 2).tolist():
        if np.linalg.norm(np.ptp(en_m[first:end], axis=0)) < HELD_WAY_M:
            held[first:end] = False
    return held
