"""Implausible positions: off the Earth's surface, or far from all others."""

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.earth import earth_centred_m
from furrowmap.core.values.gnss import GnssTrack

MAX_FROM_MIDDLE_M: Final = 100_000.0
"""Positions further than this from the median of all are kept only if steps of :data:`MAX_STEP_M` lead to them."""
MAX_STEP_M: Final = 20_000.0
"""Longest distance between consecutive positions; also across a minute of wrong ones on an aircraft."""
MIN_HEIGHT_M: Final = -1_000.0
MAX_HEIGHT_M: Final = 20_000.0
NULL_ISLAND_DEG: Final = 1e-4
"""Receivers and converters write 0° N 0° E, in the Gulf of Guinea, for 'unknown'."""
MAX_SPEED_MPS: Final = 100.0
STRAY_FLOOR_M: Final = 20.0
STRAY_SIGMAS: Final = 6.0
"""Two positions further apart than this speed times their time difference, plus a floor and their sigmas, are
unreachable from each other."""
STRAY_ANCHORS: Final = 5
MAX_STRETCHES: Final = 10_000
MIN_STRAY_POSITIONS: Final = 7
"""Fewer positions are not searched for strays."""
LISTED_SPANS: Final = 5


def is_implausible(lon_deg: FloatArray, lat_deg: FloatArray, height_m: FloatArray) -> NDArray[np.bool_]:
    """Which positions (n,), in the order of time, are implausible; those that are not finite are not.

    Implausible are latitudes beyond a pole, longitudes beyond 180°, heights that no vehicle reaches, 0° N 0° E, and
    whatever is more than :data:`MAX_FROM_MIDDLE_M` from the middle of the others and not reached from there, see
    :func:`far_from_middle`.
    """
    known = np.isfinite(lon_deg) & np.isfinite(lat_deg)
    with np.errstate(invalid="ignore"):
        bad = (
            (np.abs(lat_deg) > 90.0) | (np.abs(lon_deg) > 180.0) | (height_m < MIN_HEIGHT_M) | (height_m > MAX_HEIGHT_M)
        )
        bad |= (np.abs(lat_deg) < NULL_ISLAND_DEG) & (np.abs(lon_deg) < NULL_ISLAND_DEG)
    bad &= known
    rest = known & ~bad
    if rest.any():
        bad[rest] = far_from_middle(earth_centred_m(lon_deg[rest], lat_deg[rest], np.zeros(int(rest.sum()))))
    return np.asarray(bad)


def far_from_middle(xyz_m: FloatArray) -> NDArray[np.bool_]:
    """Which places (n, 3), in the order of time, are more than :data:`MAX_FROM_MIDDLE_M` from the middle of all.

    Those that steps of at most :data:`MAX_STEP_M` lead to from nearer ones are not among them: a survey flight or
    a ship goes further. The steps lead past others that are far from all, unless there are more than
    :data:`MAX_STRETCHES` such.
    """
    far = np.asarray(np.linalg.norm(xyz_m - np.median(xyz_m, axis=0), axis=1) > MAX_FROM_MIDDLE_M)
    if not far.any() or far.all():
        return far
    first = np.append(0, np.flatnonzero(np.linalg.norm(np.diff(xyz_m, axis=0), axis=1) > MAX_STEP_M) + 1)
    last = np.append(first[1:], len(xyz_m)) - 1
    kept = ~np.logical_and.reduceat(far, first)
    if len(first) <= MAX_STRETCHES:
        for stretches, near, other in ((range(len(first)), first, last), (range(len(first) - 1, -1, -1), last, first)):
            at = None
            for k in stretches:
                kept[k] |= at is not None and bool(np.linalg.norm(xyz_m[near[k]] - xyz_m[at]) <= MAX_STEP_M)
                at = int(other[k]) if kept[k] else at
    return np.repeat(~kept, last - first + 1)


def strays(t_s: FloatArray, xyz_m: FloatArray, sigma_m: FloatArray) -> NDArray[np.bool_]:
    """Which positions (n, 2 or 3), with a sigma of an axis (n,), lie in stretches out of reach of the rest.

    A stretch ends where the next position is out of reach. From one of the longest stretches outwards, those are kept
    that begin, by the median of some positions, within reach of the end of the one kept before; of these choices, the
    one that keeps most counts. Of more than :data:`MAX_STRETCHES` none is kept.
    """
    table = np.column_stack([t_s, sigma_m, xyz_m])
    if len(table) < MIN_STRAY_POSITIONS:
        return np.zeros(len(table), bool)
    first = np.append(0, np.flatnonzero(_apart(table[:-1], table[1:])) + 1)
    if len(first) > MAX_STRETCHES:
        return np.ones(len(table), bool)
    last = np.append(first[1:], len(table)) - 1
    size = last - first + 1
    some = np.arange(MIN_STRAY_POSITIONS)
    begin = np.median(table[np.minimum(first[:, None] + some, last[:, None])], axis=1)
    end = np.median(table[np.maximum(last[:, None] - some, first[:, None])], axis=1)
    best = np.zeros(len(first), bool)
    for anchor in np.argsort(-size, kind="stable")[:STRAY_ANCHORS].tolist():
        kept = np.zeros(len(first), bool)
        kept[anchor] = True
        for way, near, far in ((range(anchor + 1, len(first)), begin, end), (range(anchor - 1, -1, -1), end, begin)):
            at = far[anchor]
            for k in way:
                if not _apart(at, near[k]):
                    kept[k] = True
                    at = far[k]
        if size[kept].sum() > size[best].sum():
            best = kept
    return np.repeat(~best, size)


def _apart(one: FloatArray, other: FloatArray) -> NDArray[np.bool_]:
    """Whether positions (..., time, sigma and place) are unreachable from each other."""
    off = np.abs(other - one)
    allowed_m = STRAY_FLOOR_M + STRAY_SIGMAS * np.maximum(one[..., 1], other[..., 1])
    return np.asarray(np.linalg.norm(off[..., 2:], axis=-1) > MAX_SPEED_MPS * off[..., 0] + allowed_m)


def drop_implausible_positions(
    track: GnssTrack, when: Callable[[float], str] = iso_utc
) -> tuple[GnssTrack, NDArray[np.bool_], list[Notice]]:
    """The track without implausible positions, which of its epochs (n,) are kept, and a notice that lists the others.

    InputError if that is more than half of the positions.
    """
    bad = is_implausible(track.lon_deg, track.lat_deg, track.height_m)
    if not bad.any():
        return track, ~bad, []
    found = {
        "source": track.source or "The GNSS log",
        "bad": int(bad.sum()),
        "track": len(track),
        "farthest_km": MAX_FROM_MIDDLE_M / 1e3,
        "places": spans_in_words(track, bad, when),
    }
    if 2 * bad.sum() > np.isfinite(track.lat_deg).sum():
        raise InputError("positions-impossible", **found)
    return track[~bad], ~bad, [Notice("positions-elsewhere", **found)]


def spans_in_words(
    track: GnssTrack, chosen: NDArray[np.bool_], when: Callable[[float], str] = iso_utc
) -> tuple[Text, ...]:
    """Times, numbers and places of the first :data:`LISTED_SPANS` runs of chosen epochs (n,) of a track."""
    edges = np.flatnonzero(np.diff(chosen, prepend=False, append=False)).reshape(-1, 2).tolist()
    words = [
        Text(
            "{first}{last: to {last} ({positions} positions)|} at {lat_deg:.5f}, {lon_deg:.5f}",
            first=when(float(track.t_s[begin])),
            last=when(float(track.t_s[end - 1])) if end - begin > 1 else None,
            positions=end - begin,
            lat_deg=track.lat_deg[begin],
            lon_deg=track.lon_deg[begin],
        )
        for begin, end in edges[:LISTED_SPANS]
    ]
    more = len(edges) - LISTED_SPANS
    return (*words, *([Text("and {more} more times", more=more)] if more > 0 else []))
