"""Errors of a receiver's positions against a reference at the same times, and the continuity of its log.

The reference is interpolated to the times of the test: by a cubic Hermite spline with three-point slopes where there
are four epochs in a row without a gap, else linearly; never across a gap.

Error statistics are those of Nakagawa et al., *LiDAR scan matching with PPP-RTK for 3D farm mapping*, tables 1 to 3,
which satisfy: RMSE² = average² + standard deviation² (of the population); RMSE(2D)² = RMSE(X)² + RMSE(Y)²; RMSE(3D)² =
RMSE(2D)² + RMSE(Z)²; averages of X, Y, Z are signed, those of 2D and 3D are of lengths. See :data:`DEFINITIONS`.
"""

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from furrowmap.core.readers.epochs import GAP_INTERVALS
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.earth import earth_centred_m, east_north_up
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.core.values.rotation import compass_direction

DEFINITIONS: Final = {
    "difference": "test minus reference at the same instant",
    "X": "towards east, at the reference's place",
    "Y": "towards north",
    "Z": "up, along the ellipsoid's normal",
    "2D": "length of (X, Y)",
    "3D": "length of (X, Y, Z)",
    "average": "arithmetic mean: of signed differences for X, Y and Z, of lengths for 2D and 3D",
    "standard deviation": "of the same quantity about its average, of the population (divided by n)",
    "RMSE": "square root of the mean square, so that RMSE² = average² + standard deviation²",
    "along": "the horizontal difference in the direction the reference travels (at 0.5 m/s or more)",
    "across": "to the left of that direction",
    "outlier": "an epoch whose X, Y or Z lies more than 3.5 scaled median absolute deviations from the median of its "
    "kind of fix (Iglewicz and Hoaglin 1993)",
}
QUANTILES: Final = (0.50, 0.68, 0.90, 0.95, 0.99)
OUTLIER_MADS: Final = 3.5
MAD_TO_SIGMA: Final = 1.4826
MIN_SPREAD_M: Final = 1e-3
"""Least spread for outlier detection: below it differences are rounding."""


@dataclass(frozen=True)
class ErrorStatistics:
    """Statistics of one quantity (:data:`DEFINITIONS`), nan without epochs; percentiles are at :data:`QUANTILES`."""

    n: int
    average_m: float
    standard_deviation_m: float
    rmse_m: float
    percentiles_m: tuple[float, ...]
    greatest_m: float

    @classmethod
    def from_values(cls, values: FloatArray) -> "ErrorStatistics":
        """Of the values (n,) that are known."""
        known = values[np.isfinite(values)]
        if not len(known):
            nothing = float("nan")
            return cls(0, nothing, nothing, nothing, (nothing,) * len(QUANTILES), nothing)
        size = np.abs(known)
        return cls(
            n=len(known),
            average_m=float(np.mean(known)),
            standard_deviation_m=float(np.std(known)),
            rmse_m=float(np.sqrt(np.mean(known**2))),
            percentiles_m=tuple(np.quantile(size, QUANTILES).tolist()),
            greatest_m=float(size.max()),
        )


ErrorTable = dict[str, ErrorStatistics]


def table(error_m: FloatArray, along_m: FloatArray, across_m: FloatArray) -> ErrorTable:
    """Statistics of errors (n, 3) and of their components along and across the track (n,)."""
    return {
        "3D": ErrorStatistics.from_values(np.sqrt(np.sum(error_m**2, axis=1))),
        "2D": ErrorStatistics.from_values(np.hypot(error_m[:, 0], error_m[:, 1])),
        "X": ErrorStatistics.from_values(error_m[:, 0]),
        "Y": ErrorStatistics.from_values(error_m[:, 1]),
        "Z": ErrorStatistics.from_values(error_m[:, 2]),
        "along": ErrorStatistics.from_values(along_m),
        "across": ErrorStatistics.from_values(across_m),
    }


def outliers(error_m: FloatArray, kind: NDArray[np.int8]) -> NDArray[np.bool_]:
    """Which epochs (n,) are outliers among those of their fix type."""
    found = np.zeros(len(error_m), bool)
    for one in np.unique(kind):
        mine = np.flatnonzero(kind == one)
        for axis in range(3):
            values = error_m[mine, axis]
            known = np.isfinite(values)
            if known.sum() < 3:
                continue
            away = np.abs(values - np.median(values[known]))
            spread_m = max(MAD_TO_SIGMA * float(np.median(away[known])), MIN_SPREAD_M)
            found[mine[known & (away > OUTLIER_MADS * spread_m)]] = True
    return found


def within_sigmas(error_m: FloatArray, sigma_m: FloatArray) -> dict[str, float] | None:
    """Share of errors (n, 3) within one, two and three stated standard deviations (n, 3); None where none is stated."""
    known = np.isfinite(error_m) & np.isfinite(sigma_m) & (sigma_m > 0.0)
    if not known.any():
        return None
    ratio = np.abs(error_m[known] / sigma_m[known])
    return {f"within_{k}_sigma": float(np.mean(ratio <= k)) for k in (1, 2, 3)}


def time_ahead_s(along_m: FloatArray, speed_mps: FloatArray) -> tuple[float, float] | None:
    """Clock offset of the test against the reference, with its standard error; None if the speed varies too little.

    A clock offset shifts positions along the track in proportion to speed, an antenna offset by a constant: it is the
    slope of the line of best fit.
    """
    known = np.isfinite(along_m) & np.isfinite(speed_mps)
    if known.sum() < 20 or np.std(speed_mps[known]) < 0.5:
        return None
    speed = speed_mps[known] - speed_mps[known].mean()
    along = along_m[known] - along_m[known].mean()
    slope = float(np.sum(speed * along) / np.sum(speed**2))
    rest = along - slope * speed
    return slope, float(np.sqrt(np.mean(rest**2) / np.sum(speed**2)))


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
    test_xyz = test_xyz - centre
    reference_xyz = reference_xyz - centre
    curve = _Curve(reference.t_s, reference_xyz, max_gap_s)
    covered, inside = curve.covers(test.t_s)
    outside = int(np.sum(~inside))
    in_gaps = int(np.sum(inside & ~covered))
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
    before = known_s[at - 1]
    behind = known_s[np.minimum(at, len(known_s) - 1)]
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
        t = self.t_s
        p = self.xyz_m
        step = t[k + 1] - t[k]
        share = ((t_s - t[k]) / step)[:, None]
        whole = step <= self.max_gap_s
        # Next to a gap only a stamp within rounding of an epoch counts.
        nearest = np.where((np.abs(t_s - t[k]) <= np.abs(t[k + 1] - t_s))[:, None], p[k], p[k + 1])
        straight = np.where(whole[:, None], p[k] + share * (p[k + 1] - p[k]), nearest)
        before = np.maximum(k - 1, 0)
        behind = np.minimum(k + 2, len(t) - 1)
        four = whole & (k >= 1) & (k + 2 < len(t)) & (share[:, 0] >= 0.0) & (share[:, 0] <= 1.0)
        four &= (t[k] - t[before] <= self.max_gap_s) & (t[behind] - t[k + 1] <= self.max_gap_s)
        if four.any():
            straight[four] = CubicHermiteSpline(t, p, np.gradient(p, t, axis=0))(t_s[four])
        return straight

    def velocity(self, t_s: FloatArray) -> FloatArray:
        """Velocities (m, 3) by central difference over half a second each way, where covered."""
        early = t_s - BASELINE_S
        late = t_s + BASELINE_S
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
        t_s = self.t_s[1::2]
        place = self.xyz_m[1::2]
        covered = half.covers(t_s)[0]
        if not covered.any():
            return np.full(2, np.nan)
        away = np.linalg.norm(half.at(t_s[covered]) - place[covered], axis=1)
        return np.asarray(np.quantile(away, [0.5, 0.95]), np.float64)


MAX_GAPS_LISTED: Final = 50


@dataclass(frozen=True)
class LogGap:
    """A gap between two positions, from the UTC of the last one before it."""

    begin_s: float
    length_s: float


@dataclass(frozen=True)
class Age:
    """Age of the corrections over the epochs that state one."""

    epochs: int
    median_s: float
    p95_s: float
    greatest_s: float


@dataclass(frozen=True)
class Continuity:
    """Continuity of one log.

    Attributes:
        first_s, last_s: UTC of the first and last.
        interval_s: median of the steps between them.
        availability: positions over the number expected at that interval.
        first_by_fix_s: seconds from the first position to the first of each fix type; the log does not state when the
            receiver was switched on.
        gaps: number of steps longer than 1.5 intervals; below, the longest and the sum of all.
        gap_list: the longest ones, in order of time.
    """

    epochs: int
    first_s: float
    last_s: float
    interval_s: float
    availability: float
    share_by_fix: dict[str, float]
    first_by_fix_s: dict[str, float]
    gaps: int
    longest_gap_s: float
    all_gaps_s: float
    gap_list: tuple[LogGap, ...]
    age: Age | None

    @classmethod
    def from_track(cls, track: GnssTrack) -> "Continuity":
        """Of a track with at least one position."""
        steps = np.diff(track.t_s)
        interval = float(np.median(steps)) if len(steps) else 0.0
        wide = np.flatnonzero(steps > GAP_INTERVALS * interval)
        span = float(track.t_s[-1] - track.t_s[0])
        kinds = [Fix(int(code)) for code in np.unique(track.fix)]
        listed = np.sort(wide[np.argsort(-steps[wide], kind="stable")[:MAX_GAPS_LISTED]])
        age = track.age_s[np.isfinite(track.age_s) & (track.fix != Fix.SINGLE)]
        return cls(
            epochs=len(track),
            first_s=float(track.t_s[0]),
            last_s=float(track.t_s[-1]),
            interval_s=interval,
            availability=min(1.0, len(track) / (round(span / interval) + 1)) if interval > 0.0 else 1.0,
            share_by_fix={kind.label: float(np.mean(track.fix == kind)) for kind in kinds},
            first_by_fix_s={
                kind.label: float(track.t_s[int(np.argmax(track.fix == kind))] - track.t_s[0]) for kind in kinds
            },
            gaps=len(wide),
            longest_gap_s=float(steps[wide].max()) if len(wide) else 0.0,
            all_gaps_s=float(steps[wide].sum()),
            gap_list=tuple(LogGap(float(track.t_s[k]), float(steps[k])) for k in listed.tolist()),
            age=Age(len(age), *(float(v) for v in (*np.quantile(age, (0.5, 0.95)), age.max()))) if len(age) else None,
        )


MIN_EPOCHS: Final = 30
"""Fewer epochs than this raise a notice."""
MAX_SAME_PLACE_M: Final = 100.0
"""A median distance beyond this means that the two logs are of different places."""
MIN_CONSTANT_OFFSET_M: Final = 0.05
CONSTANT_SIGMAS: Final = 3.0
"""A mean this many times its standard deviation counts as constant."""
MIN_GEOID_OFFSET_M: Final = 5.0
"""A larger constant difference in height is that of a geoid."""
_BY_EPOCH: Final = (
    *("t_s", "error_m", "along_m", "across_m", "speed_mps", "test_m", "reference_m", "epoch"),
    *("reference_fix", "interpolated"),
)


@dataclass(frozen=True)
class Evaluation:
    """The result of an evaluation.

    Attributes:
        antenna_offset_m: of the test antenna from the reference antenna: forward, left, up.
        tables: figures of all epochs ("all") and of each fix type of the test, by its label.
        sigma_m: (n, 3) standard deviations stated by the test: east, north, up.
        within_sigmas: share of errors within one, two and three stated standard deviations; None where none is stated.
        time_ahead_s: clock offset of the test against the reference, and its standard error; without outliers, from
            fixed epochs where there are any. None if the speed varies too little.
        reference_share_by_fix: share of the compared epochs by fix type of the reference.
        left_out_by_reference_fix: epochs skipped because the reference was not fixed.
    """

    test: str
    reference: str
    service: str
    reference_service: str
    antenna_offset_m: tuple[float, float, float]
    matched: MatchedEpochs
    fix: NDArray[np.int8]
    lon_deg: NDArray[np.float64]
    lat_deg: NDArray[np.float64]
    tables: dict[str, ErrorTable]
    outlier: NDArray[np.bool_]
    sigma_m: NDArray[np.float64]
    age_s: NDArray[np.float64]
    within_sigmas: dict[str, float] | None
    time_ahead_s: tuple[float, float] | None
    continuity: Continuity
    reference_share_by_fix: dict[str, float]
    left_out_by_reference_fix: int
    notices: tuple[Notice, ...] = field(default=())


def evaluate(
    test: GnssTrack,
    reference: GnssTrack,
    *,
    antenna_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    max_gap_s: float | None = None,
    fixed_reference_only: bool = False,
) -> Evaluation:
    """Evaluate a test against a reference, whose positions are taken as the truth, paired as by :func:`match`.

    Epochs where the reference is neither FIXED nor entered by hand may be skipped. InputError if there is nothing to
    compare.
    """
    for track in (test, reference):
        if not len(track):
            raise InputError("nothing-to-compare.no-positions", source=track.source)
    found = match(test, reference, antenna_offset_m=antenna_offset_m, max_gap_s=max_gap_s)
    certain = np.isin(found.reference_fix, (Fix.FIXED, Fix.MANUAL, Fix.SIMULATED))
    kept = certain if fixed_reference_only else np.ones(len(found), bool)
    left_out = int(np.sum(~kept))
    if not kept.any():
        raise InputError("nothing-to-compare.no-usable-epochs", source=test.source, unfixed=left_out > 0)
    arrays = {name: value[kept] for name, value in vars(found).items() if name in _BY_EPOCH}
    found = replace(found, **arrays)
    fix = test.fix[found.epoch]
    error = found.error_m
    outlier = outliers(error, fix)
    # Errors of poor fixes drift and would be taken for a clock offset.
    steady = ~outlier & ((fix == Fix.FIXED) | ~np.any(fix == Fix.FIXED))
    sigma = np.column_stack([test.sigma_e_m, test.sigma_n_m, test.sigma_h_m])[found.epoch]
    tables = {"all": table(found.error_m, found.along_m, found.across_m)}
    for kind in np.unique(fix).tolist():
        mine = fix == kind
        tables[Fix(kind).label] = table(found.error_m[mine], found.along_m[mine], found.across_m[mine])
    return Evaluation(
        test=test.source,
        reference=reference.source,
        service=test.service,
        reference_service=reference.service,
        antenna_offset_m=antenna_offset_m,
        matched=found,
        fix=fix,
        lon_deg=test.lon_deg[found.epoch],
        lat_deg=test.lat_deg[found.epoch],
        tables=tables,
        outlier=outlier,
        sigma_m=sigma,
        age_s=test.age_s[found.epoch],
        within_sigmas=within_sigmas(error, sigma),
        time_ahead_s=time_ahead_s(found.along_m[steady], found.speed_mps[steady]),
        continuity=Continuity.from_track(test),
        reference_share_by_fix={
            Fix(kind).label: float(np.mean(found.reference_fix == kind)) for kind in np.unique(found.reference_fix)
        },
        left_out_by_reference_fix=left_out,
        notices=tuple(_notices(test, reference, found, certain[kept])),
    )


def _notices(test: GnssTrack, reference: GnssTrack, found: MatchedEpochs, certain: NDArray[np.bool_]) -> list[Notice]:
    notices = []
    if not certain.all():
        notices.append(Notice("reference-not-fixed", source=reference.source, certain=np.mean(~certain)))
    if found.without_heading:
        notices.append(Notice("heading-unknown.epochs-without-heading", without_heading=found.without_heading))
    if not np.isfinite(found.error_m[:, 2]).any():
        notices.append(Notice("no-heights"))
    error_m = found.interpolation_m[1]
    if found.interpolated.any() and error_m > 0.1 * np.sqrt(np.mean(np.sum(found.error_m[:, :2] ** 2, axis=1))):
        notices.append(
            Notice(
                "interpolation-coarse",
                interpolated=np.mean(found.interpolated),
                source=reference.source,
                error_m=error_m,
            )
        )
    if len(found) < MIN_EPOCHS:
        notices.append(Notice("few-epochs", found=len(found)))
    notices += offset_notices(found.error_m, test.source, reference.source)
    covered = len(found) / len(test)
    if covered < 0.5:
        notices.append(
            Notice("half-compared", covered=covered, source=test.source, outside=found.outside, in_gaps=found.in_gaps)
        )
    return notices


def offset_notices(error_m: FloatArray, test: str, reference: str) -> list[Notice]:
    """Notices about constant parts of differences (n, 3) east, north and up; heights may be nan."""
    horizontal = error_m[:, :2]
    distance = float(np.median(np.hypot(*horizontal.T)))
    if distance > MAX_SAME_PLACE_M:
        return [Notice("not-the-same-place", test=test, distance_m=distance, reference=reference)]
    if not error_m[np.isfinite(error_m)].any():
        return [Notice("same-positions", test=test, reference=reference)]
    notices = []
    east, north = horizontal.mean(axis=0)
    length = float(np.hypot(east, north))
    scatter = float(np.hypot(*horizontal.std(axis=0)))
    if length > max(MIN_CONSTANT_OFFSET_M, CONSTANT_SIGMAS * scatter):
        way = compass_direction(float(east), float(north))
        notices.append(
            Notice("constant-offset", test=test, offset_m=length, way=way, reference=reference, scatter_m=scatter)
        )
    up = error_m[np.isfinite(error_m[:, 2]), 2]
    if len(up) and abs(up.mean()) > max(MIN_GEOID_OFFSET_M, CONSTANT_SIGMAS * up.std()):
        notices.append(Notice("heights-apart", test=test, reference=reference, off_m=up.mean()))
    return notices
