"""Positions that the recording cannot have: off the Earth's surface, or far from all others."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.earth import earth_centred_m
from furrowmap.core.values.gnss import GnssTrack

FloatArray = NDArray[np.float64]

FARTHEST_M: Final = 100_000.0
"""Positions this far from the middle of all count only where the others lead to them."""
LONGEST_STEP_M: Final = 20_000.0
"""From one position to the next, and past a minute of foreign ones on an aircraft."""
LOWEST_M: Final = -1_000.0
HIGHEST_M: Final = 20_000.0
NOWHERE_DEG: Final = 1e-4
"""Receivers and converters write 0° N 0° E, in the Gulf of Guinea, for 'unknown'."""
REACH_MPS: Final = 100.0
STRAY_FLOOR_M: Final = 20.0
STRAY_SIGMAS: Final = 6.0
"""A position further from another than anything moves in the time between, and these allow, is out of its reach."""
STRAY_ANCHORS: Final = 5
MOST_STRETCHES: Final = 10_000
FEWEST: Final = 7
"""Of fewer positions it is not clear which ones are the rest."""
LISTED: Final = 5


def elsewhere(lon_deg: FloatArray, lat_deg: FloatArray, height_m: FloatArray) -> NDArray[np.bool_]:
    """Which positions (n,) the recording cannot have; those that are not finite are not among them.

    That are latitudes beyond a pole, longitudes beyond 180°, heights that no vehicle reaches, 0° N 0° E, and whatever
    is more than :data:`FARTHEST_M` from the middle of the others and not reached from there, see
    :func:`far_from_middle`.

    Args:
        lon_deg: (n,) longitudes, in the order of time.
        lat_deg: (n,) latitudes.
        height_m: (n,) heights, nan where unknown.
    """
    known = np.isfinite(lon_deg) & np.isfinite(lat_deg)
    with np.errstate(invalid="ignore"):
        bad = (np.abs(lat_deg) > 90.0) | (np.abs(lon_deg) > 180.0) | (height_m < LOWEST_M) | (height_m > HIGHEST_M)
        bad |= (np.abs(lat_deg) < NOWHERE_DEG) & (np.abs(lon_deg) < NOWHERE_DEG)
    bad &= known
    rest = known & ~bad
    if rest.any():
        bad[rest] = far_from_middle(earth_centred_m(lon_deg[rest], lat_deg[rest], np.zeros(int(rest.sum()))))
    return np.asarray(bad)


def far_from_middle(xyz_m: FloatArray) -> NDArray[np.bool_]:
    """Which places (n, 3), in the order of time, are more than :data:`FARTHEST_M` from the middle of all.

    Those that steps of at most :data:`LONGEST_STEP_M` lead to from nearer ones are not among them: a survey flight or
    a ship goes further. The steps lead past others that are far from all, unless there are more than
    :data:`MOST_STRETCHES` such.
    """
    far = np.asarray(np.linalg.norm(xyz_m - np.median(xyz_m, axis=0), axis=1) > FARTHEST_M)
    if not far.any() or far.all():
        return far
    first = np.append(0, np.flatnonzero(np.linalg.norm(np.diff(xyz_m, axis=0), axis=1) > LONGEST_STEP_M) + 1)
    last = np.append(first[1:], len(xyz_m)) - 1
    kept = ~np.logical_and.reduceat(far, first)
    if len(first) <= MOST_STRETCHES:
        for stretches, near, other in (
            (range(len(first)), first, last),
            (range(len(first) - 1, -1, -1), last, first),
        ):
            at = None
            for k in stretches:
                kept[k] |= at is not None and bool(np.linalg.norm(xyz_m[near[k]] - xyz_m[at]) <= LONGEST_STEP_M)
                at = int(other[k]) if kept[k] else at
    return np.repeat(~kept, last - first + 1)


def strays(t_s: FloatArray, xyz_m: FloatArray, sigma_m: FloatArray) -> NDArray[np.bool_]:
    """Positions (n,) in stretches that no drive connects with the rest.

    A stretch ends where the next position is out of reach. From one of the longest stretches outwards, those are kept
    that begin, by the median of some positions, within reach of the end of the one kept before; of these choices, the
    one that keeps most counts. Of more than :data:`MOST_STRETCHES` none is kept.

    Args:
        t_s: (n,) times.
        xyz_m: (n, 2 or 3) places.
        sigma_m: (n,) standard deviation of an axis.
    """
    table = np.column_stack([t_s, sigma_m, xyz_m])
    if len(table) < FEWEST:
        return np.zeros(len(table), bool)
    first = np.append(0, np.flatnonzero(_apart(table[:-1], table[1:])) + 1)
    if len(first) > MOST_STRETCHES:
        return np.ones(len(table), bool)
    last = np.append(first[1:], len(table)) - 1
    size = last - first + 1
    some = np.arange(FEWEST)
    begin = np.median(table[np.minimum(first[:, None] + some, last[:, None])], axis=1)
    end = np.median(table[np.maximum(last[:, None] - some, first[:, None])], axis=1)
    best = np.zeros(len(first), bool)
    for anchor in np.argsort(-size, kind="stable")[:STRAY_ANCHORS].tolist():
        kept = np.zeros(len(first), bool)
        kept[anchor] = True
        for way, near, far in (
            (range(anchor + 1, len(first)), begin, end),
            (range(anchor - 1, -1, -1), end, begin),
        ):
            at = far[anchor]
            for k in way:
                if not _apart(at, near[k]):
                    kept[k], at = True, far[k]
        if size[kept].sum() > size[best].sum():
            best = kept
    return np.repeat(~best, size)


def _apart(one: FloatArray, other: FloatArray) -> NDArray[np.bool_]:
    """Whether positions (..., time, sigma and place) are out of reach of each other."""
    off = np.abs(other - one)
    allowed_m = STRAY_FLOOR_M + STRAY_SIGMAS * np.maximum(one[..., 1], other[..., 1])
    return np.asarray(np.linalg.norm(off[..., 2:], axis=-1) > REACH_MPS * off[..., 0] + allowed_m)


def without_elsewhere(
    track: GnssTrack, when: Callable[[float], str] = iso_utc
) -> tuple[GnssTrack, NDArray[np.bool_], list[Notice]]:
    """The track without such positions, which of its epochs (n,) are kept, and a notice that lists the others.

    Args:
        track: of any receiver.
        when: words of a time of the track.

    Raises:
        InputError: if that is more than half of the positions.
    """
    bad = elsewhere(track.lon_deg, track.lat_deg, track.height_m)
    if not bad.any():
        return track, ~bad, []
    places = spans_in_words(track, bad, when)
    if 2 * bad.sum() > np.isfinite(track.lat_deg).sum():
        raise InputError(
            "positions-impossible",
            source=track.source or "The GNSS log",
            bad=int(bad.sum()),
            track=len(track),
            farthest_m=FARTHEST_M / 1e3,
            places=places,
        )
    return (
        track[~bad],
        ~bad,
        [
            Notice(
                "positions-elsewhere",
                source=track.source or "The GNSS log",
                bad=int(bad.sum()),
                track=len(track),
                farthest_m=FARTHEST_M / 1e3,
                places=places,
            )
        ],
    )


def spans_in_words(track: GnssTrack, chosen: NDArray[np.bool_], when: Callable[[float], str] = iso_utc) -> str:
    """Times, numbers and places of the runs of chosen epochs (n,) of a track, the first :data:`LISTED` of them."""
    edges = np.flatnonzero(np.diff(chosen, prepend=False, append=False)).reshape(-1, 2).tolist()
    words = []
    for begin, end in edges[:LISTED]:
        span = when(float(track.t_s[begin]))
        if end - begin > 1:
            span += f" to {when(float(track.t_s[end - 1]))} ({end - begin} positions)"
        words.append(f"{span} at {track.lat_deg[begin]:.5f}, {track.lon_deg[begin]:.5f}")
    more = [f"and {len(edges) - LISTED} more times"] if len(edges) > LISTED else []
    return "; ".join([*words, *more])
