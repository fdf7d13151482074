"""Errors of a receiver's positions against a reference, and the continuity of its log."""

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.checking.matching import MatchedEpochs, match
from furrowmap.core.checking.statistics import ErrorTable, outliers, table, time_ahead_s, within_sigmas
from furrowmap.core.readers.facts import GAP_INTERVALS
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.core.values.rotation import compass_direction

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
            raise InputError("nothing-to-compare.empty", source=track.source)
    found = match(test, reference, antenna_offset_m=antenna_offset_m, max_gap_s=max_gap_s)
    certain = np.isin(found.reference_fix, (Fix.FIXED, Fix.MANUAL, Fix.SIMULATED))
    kept = certain if fixed_reference_only else np.ones(len(found), bool)
    left_out = int(np.sum(~kept))
    if not kept.any():
        raise InputError("nothing-to-compare.unmatched", source=test.source, unfixed=left_out > 0)
    arrays = {name: value[kept] for name, value in vars(found).items() if name in _BY_EPOCH}
    found = replace(found, **arrays)
    fix, error = test.fix[found.epoch], found.error_m
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
        notices.append(Notice("heading-unknown.epochs", without_heading=found.without_heading))
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
        return [Notice("not-the-same-place", test=test, distance=distance, reference=reference)]
    if not error_m[np.isfinite(error_m)].any():
        return [Notice("same-positions", test=test, reference=reference)]
    notices = []
    east, north = horizontal.mean(axis=0)
    length, scatter = float(np.hypot(east, north)), float(np.hypot(*horizontal.std(axis=0)))
    if length > max(MIN_CONSTANT_OFFSET_M, CONSTANT_SIGMAS * scatter):
        way = compass_direction(float(east), float(north))
        notices.append(
            Notice("constant-offset", test=test, length=length, way=way, reference=reference, scatter=scatter)
        )
    up = error_m[np.isfinite(error_m[:, 2]), 2]
    if len(up) and abs(up.mean()) > max(MIN_GEOID_OFFSET_M, CONSTANT_SIGMAS * up.std()):
        notices.append(Notice("heights-apart", test=test, reference=reference, up=up.mean()))
    return notices
