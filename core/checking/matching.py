"""A receiver's positions paired with those of a reference at the same times.

The reference is interpolated to the times of the test: by a cubic Hermite spline with three-point slopes where there
are four epochs in a row without a gap, else linearly; never across a gap.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from furrowmap.core.readers.facts import GAP_INTERVALS
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.earth import earth_centred_m, east_north_up
from furrowmap.core.values.gnss import Fix, GnssTrack

EQUAL_S: Final = 1e-6
"""Times closer than this are equal."""
MAX_EXTRAPOLATION_S: Final = 1e-3
"""A reference is extrapolated by this much at both ends, as stamps are rounded to milliseconds."""
MIN_MOVING_MPS: Final = 0.5
"""Below this speed positions give no direction of travel."""
BASELINE_S: Final = 0.5
"""Direction of travel is that between the positions this long before and after."""


@dataclass(frozen=True)
class MatchedEpochs:
    """The n epochs of a test that a reference covers.

    Attributes:
        error_m: (n, 3) test minus reference: east, north, up; up is nan where either height is unknown.
        along_m, across_m: (n,) horizontal error in the direction of travel, and to the left of it; nan below
            :data:`MIN_MOVING_MPS`.
        speed_mps: (n,) of the reference.
        test_m: (n, 3) test positions, east, north, up of the first matched reference position.
        reference_m: (n, 3) reference positions likewise, shifted to the test antenna.
        reference_fix: (n,) int8, the poorer of the reference epochs around.
        interpolated: (n,) whether the reference has no epoch at that time.
        outside: epochs of the test outside the time span of the reference.
        in_gaps: epochs of the test in gaps of the reference.
        without_heading: epochs skipped because the antenna offset could not be rotated.
        interpolation_m: (2,) median and 95 % of the reference's own interpolation error at twice its interval, an upper
            bound; nan where it cannot be computed.
    """

    t_s: FloatArray
    error_m: FloatArray
    along_m: FloatArray
    across_m: FloatArray
    speed_mps: FloatArray
    test_m: FloatArray
    reference_m: FloatArray
    epoch: NDArray[np.intp]
    reference_fix: NDArray[np.int8]
    interpolated: NDArray[np.bool_]
    outside: int
    in_gaps: int
    without_heading: int
    max_gap_s: float
    interpolation_m: FloatArray

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def unbroken(self) -> list[int]:
        """Indices at which runs of epochs without a gap begin, and the number of epochs."""
        step = np.diff(self.t_s)
        wide = np.flatnonzero(step > max(1.0, 3.0 * float(np.median(step)))) + 1 if len(step) else np.empty(0, np.intp)
        return [0, *wide.tolist(), len(self)]


def at_rest(lon_deg: float, lat_deg: float, height_m: float, like: GnssTrack, name: str) -> GnssTrack:
    """A reference at a known fixed position, with the epochs of a test."""
    n = len(like)
    return GnssTrack.build(
        like.t_s,
        source=name,
        service="",
        lon_deg=np.full(n, lon_deg),
        lat_deg=np.full(n, lat_deg),
        height_m=np.full(n, height_m),
        fix=np.full(n, Fix.MANUAL, np.int8),
    )


def match(
    test: GnssTrack,
    reference: GnssTrack,
    *,
    antenna_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    max_gap_s: float | None = None,
) -> MatchedEpochs:
    """Pair the epochs of a test with a reference.

    Args:
        reference: taken as the truth.
        antenna_offset_m: of the test antenna from the reference antenna: forward, left, up. Forward is the heading of
            the reference, else of the test, else the direction of travel, which is kept while standing.
        max_gap_s: longer intervals of the reference are gaps; None for 1.5 times its median interval.

    Raises:
        InputError: if no epoch of the test lies between epochs of the reference.
    """
    if max_gap_s is None:
        max_gap_s = GAP_INTERVALS * float(np.median(np.diff(reference.t_s))) if len(reference) > 1 else 1.0
    # Earth-centred coordinates about the middle of the reference; unknown heights are the median.
    known = np.concatenate([reference.height_m, test.height_m])
    height = float(np.median(known[np.isfinite(known)])) if np.isfinite(known).any() else 0.0
    test_xyz, reference_xyz = (
        earth_centred_m(track.lon_deg, track.lat_deg, np.where(np.isfinite(track.height_m), track.height_m, height))
        for track in (test, reference)
    )
    centre = np.median(reference_xyz, axis=0)
    test_xyz, reference_xyz = test_xyz - centre, reference_xyz - centre
    curve = _Curve(reference.t_s, reference_xyz, max_gap_s)
    covered, inside = curve.covers(test.t_s)
    outside, in_gaps = int(np.sum(~inside)), int(np.sum(inside & ~covered))
    if not covered.any():
        if in_gaps:
            raise InputError("reference-gaps", source=reference.source, in_gaps=in_gaps, test_source=test.source)
        spans = [f"{iso_utc(float(track.t_s[0]))} to {iso_utc(float(track.t_s[-1]))}" for track in (test, reference)]
        raise InputError(
            "no-time-in-common",
            source=test.source,
            spans=spans[0],
            reference_source=reference.source,
            spans_other=spans[1],
        )
    t_s = test.t_s[covered]
    place = curve.at(t_s)
    turn = east_north_up(*_directions(reference, t_s))
    velocity = np.einsum("nij,nj->ni", turn, curve.velocity(t_s))
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    with np.errstate(invalid="ignore", divide="ignore"):
        ahead = np.where((speed >= MIN_MOVING_MPS)[:, None], velocity[:, :2] / speed[:, None], np.nan)
    offset = _offset(antenna_offset_m, ahead, test, reference, t_s)
    epoch = np.flatnonzero(covered)
    place = place + np.einsum("nji,nj->ni", turn, np.nan_to_num(offset))
    error = np.einsum("nij,nj->ni", turn, test_xyz[covered] - place)
    heights = np.isfinite(test.height_m[covered]) & curve.known(t_s, np.isfinite(reference.height_m))
    error[~heights, 2] = np.nan
    kept = np.isfinite(offset).all(axis=1)
    local = east_north_up(*_directions(reference, t_s[:1]))[0]
    return MatchedEpochs(
        t_s=t_s[kept],
        error_m=error[kept],
        along_m=np.sum(error[kept, :2] * ahead[kept], axis=1),
        across_m=error[kept, 1] * ahead[kept, 0] - error[kept, 0] * ahead[kept, 1],
        speed_mps=speed[kept],
        test_m=((test_xyz[covered] - place[0]) @ local.T)[kept],
        reference_m=((place - place[0]) @ local.T)[kept],
        epoch=epoch[kept],
        reference_fix=curve.poorer(t_s, reference.fix)[kept],
        interpolated=curve.between(t_s)[kept],
        outside=outside,
        in_gaps=in_gaps,
        without_heading=int(np.sum(~kept)),
        max_gap_s=max_gap_s,
        interpolation_m=curve.interpolation_error(),
    )


def _directions(reference: GnssTrack, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Longitude and latitude (n,) that define east, north and up."""
    lon = np.interp(t_s, reference.t_s, np.unwrap(reference.lon_deg, period=360.0))
    return lon, np.interp(t_s, reference.t_s, reference.lat_deg)


def _offset(
    offset_m: tuple[float, float, float], ahead: FloatArray, test: GnssTrack, reference: GnssTrack, t_s: FloatArray
) -> FloatArray:
    """East, north, up (n, 3) of the test antenna from the reference antenna; nan where the heading is unknown."""
    forward, left, up = offset_m
    if forward == 0.0 and left == 0.0:
        return np.tile([0.0, 0.0, up], (len(t_s), 1))
    stated = next((track for track in (reference, test) if np.isfinite(track.heading_deg).any()), None)
    if stated is not None:
        known = np.isfinite(stated.heading_deg)
        heading = np.radians(np.unwrap(stated.heading_deg[known], period=360.0))
        angle = np.interp(t_s, stated.t_s[known], heading)
        ahead = np.column_stack([np.sin(angle), np.cos(angle)])
        nearest = _nearest(stated.t_s[known], t_s)
        ahead[np.abs(nearest - t_s) > 2.0] = np.nan
    else:
        # Directions of travel are kept while standing; the first one also before it is known.
        known = np.isfinite(ahead[:, 0])
        last = np.maximum.accumulate(np.where(known, np.arange(len(ahead)), -1))
        ahead = ahead[np.where(last >= 0, last, int(np.argmax(known)))]
    east = forward * ahead[:, 0] - left * ahead[:, 1]
    north = forward * ahead[:, 1] + left * ahead[:, 0]
    return np.column_stack([east, north, np.full(len(t_s), up)])


def _nearest(known_s: FloatArray, t_s: FloatArray) -> FloatArray:
    at = np.clip(np.searchsorted(known_s, t_s), 1, max(len(known_s) - 1, 1))
    before, behind = known_s[at - 1], known_s[np.minimum(at, len(known_s) - 1)]
    return np.where(t_s - before < behind - t_s, before, behind)


@dataclass(frozen=True)
class _Curve:
    """Interpolation of a reference with times (n,) and positions (n, 3); longer steps than `max_gap_s` are gaps."""

    t_s: FloatArray
    xyz_m: FloatArray
    max_gap_s: float

    def _step(self, t_s: FloatArray) -> NDArray[np.intp]:
        """Index of the interval that holds each time."""
        at = np.searchsorted(self.t_s, t_s + EQUAL_S, side="right") - 1
        return np.clip(at, 0, max(len(self.t_s) - 2, 0))

    def between(self, t_s: FloatArray) -> NDArray[np.bool_]:
        """Whether each time has no epoch of its own."""
        return np.asarray(np.abs(_nearest(self.t_s, t_s) - t_s) > EQUAL_S)

    def covers(self, t_s: FloatArray) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which times lie within an interval that is no gap; and which lie within the time span at all."""
        near = np.abs(_nearest(self.t_s, t_s) - t_s) <= MAX_EXTRAPOLATION_S
        inside = near | ((t_s >= self.t_s[0]) & (t_s <= self.t_s[-1]))
        if len(self.t_s) < 2:
            return near, near
        k = self._step(t_s)
        return inside & (near | (self.t_s[k + 1] - self.t_s[k] <= self.max_gap_s)), inside

    def at(self, t_s: FloatArray) -> FloatArray:
        """Positions (m, 3): linear between two epochs, cubic among four."""
        if len(self.t_s) < 2:
            return np.repeat(self.xyz_m, len(t_s), axis=0)
        k = self._step(t_s)
        t, p = self.t_s, self.xyz_m
        step = t[k + 1] - t[k]
        share = ((t_s - t[k]) / step)[:, None]
        whole = step <= self.max_gap_s
        # Next to a gap only a stamp within rounding of an epoch counts.
        nearest = np.where((np.abs(t_s - t[k]) <= np.abs(t[k + 1] - t_s))[:, None], p[k], p[k + 1])
        straight = np.where(whole[:, None], p[k] + share * (p[k + 1] - p[k]), nearest)
        before, behind = np.maximum(k - 1, 0), np.minimum(k + 2, len(t) - 1)
        four = whole & (k >= 1) & (k + 2 < len(t)) & (share[:, 0] >= 0.0) & (share[:, 0] <= 1.0)
        four &= (t[k] - t[before] <= self.max_gap_s) & (t[behind] - t[k + 1] <= self.max_gap_s)
        if four.any():
            straight[four] = CubicHermiteSpline(t, p, np.gradient(p, t, axis=0))(t_s[four])
        return straight

    def velocity(self, t_s: FloatArray) -> FloatArray:
        """Velocities (m, 3) by central difference over half a second each way, where covered."""
        early, late = t_s - BASELINE_S, t_s + BASELINE_S
        early = np.where(self.covers(early)[0], early, t_s)
        late = np.where(self.covers(late)[0], late, t_s)
        with np.errstate(invalid="ignore", divide="ignore"):
            velocity: FloatArray = (self.at(late) - self.at(early)) / (late - early)[:, None]
        return velocity

    def known(self, t_s: FloatArray, flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Whether a flag (n,) holds for both epochs around each time."""
        k = self._step(t_s)
        both: NDArray[np.bool_] = flags[k] & flags[np.minimum(k + 1, len(flags) - 1)]
        return both

    def poorer(self, t_s: FloatArray, fix: NDArray[np.int8]) -> NDArray[np.int8]:
        """Fix type of the epoch at each time; between two epochs, the one that is not FIXED."""
        k = self._step(t_s)
        behind = np.minimum(k + 1, len(fix) - 1)
        at_first = np.abs(t_s - self.t_s[k]) <= MAX_EXTRAPOLATION_S
        at_second = np.abs(self.t_s[behind] - t_s) <= MAX_EXTRAPOLATION_S
        around = np.where(fix[k] != Fix.FIXED, fix[k], fix[behind])
        found: NDArray[np.int8] = np.where(at_first, fix[k], np.where(at_second, fix[behind], around)).astype(np.int8)
        return found

    def interpolation_error(self) -> FloatArray:
        """Median and 95 % of the errors of epochs interpolated from every other one."""
        if len(self.t_s) < 6:
            return np.full(2, np.nan)
        half = _Curve(self.t_s[::2], self.xyz_m[::2], 2.0 * self.max_gap_s)
        t_s, place = self.t_s[1::2], self.xyz_m[1::2]
        covered = half.covers(t_s)[0]
        if not covered.any():
            return np.full(2, np.nan)
        away = np.linalg.norm(half.at(t_s[covered]) - place[covered], axis=1)
        return np.asarray(np.quantile(away, [0.5, 0.95]), np.float64)
