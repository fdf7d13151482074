"""A receiver's positions judged by those of a reference."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.evaluation.constant_offsets import offset_notices
from furrowmap.core.evaluation.continuity import Continuity
from furrowmap.core.evaluation.matching import Matched, match
from furrowmap.core.evaluation.statistics import Table, outliers, table, time_ahead_s, within_sigmas
from furrowmap.core.values.errors import InputError, Notice
from furrowmap.core.values.gnss import Fix, GnssTrack

FEW: Final = 30
"""Fewer epochs than this make figures that say little."""


@dataclass(frozen=True)
class Evaluation:
    """What came of it.

    Attributes:
        test, reference: names of the logs.
        service, reference_service: whose corrections they used, as far as the logs say it.
        antenna_offset_m: of the test's antenna from the reference's: forward, left, up.
        matched: the epochs that were compared.
        fix: (n,) int8 of the test at these epochs.
        tables: figures of all epochs ("all") and of each kind of fix of the test, by its word.
        outlier: (n,) which epochs are outliers.
        sigma_m: (n, 3) standard deviations that the test stated: east, north, up.
        age_s: (n,) of the corrections.
        within_sigmas: see :func:`furrowmap.core.evaluation.statistics.within_sigmas`.
        time_ahead_s: see :func:`furrowmap.core.evaluation.statistics.time_ahead_s`; by the fixed epochs where there are
            any, without outliers.
        continuity: of the test's log.
        reference_share_by_fix: share of the compared epochs by the reference's fix.
        left_out_by_reference_fix: epochs left out because the reference was not of the fix asked for.
        notices: what to know about these figures.
    """

    test: str
    reference: str
    service: str
    reference_service: str
    antenna_offset_m: tuple[float, float, float]
    matched: Matched
    fix: NDArray[np.int8]
    tables: dict[str, Table]
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
    """Judge a test by a reference.

    Args:
        test: the positions to be judged.
        reference: what they are judged by; each of its positions is taken for the truth.
        antenna_offset_m: see :func:`furrowmap.core.evaluation.matching.match`.
        max_gap_s: as there.
        fixed_reference_only: leave out epochs where the reference is not FIXED (or stated by hand).

    Raises:
        InputError: if there is nothing to compare.
    """
    for track in (test, reference):
        if not len(track):
            raise _nothing(f"{track.source}: there is no position in it.")
    found = match(test, reference, antenna_offset_m=antenna_offset_m, max_gap_s=max_gap_s)
    certain = np.isin(found.reference_fix, (Fix.FIXED, Fix.MANUAL, Fix.SIMULATED))
    kept = certain if fixed_reference_only else np.ones(len(found), bool)
    left_out = int(np.sum(~kept))
    if not kept.any():
        why = (
            "the reference is fixed at none of them" if left_out else "no heading is known to turn the antennas' offset"
        )
        raise _nothing(f"{test.source}: {why}.")
    found = _part(found, kept)
    fix, error = test.fix[found.epoch], found.error_m
    tables = {"all": table(error, found.along_m, found.across_m)}
    for kind in np.unique(fix).tolist():
        mine = fix == kind
        tables[Fix(kind).label] = table(error[mine], found.along_m[mine], found.across_m[mine])
    outlier = outliers(error, fix)
    # The errors of poor fixes are no noise: they drift, and would pass for an offset of the clock.
    steady = ~outlier & ((fix == Fix.FIXED) | ~np.any(fix == Fix.FIXED))
    sigma = np.column_stack([test.sigma_e_m, test.sigma_n_m, test.sigma_h_m])[found.epoch]
    return Evaluation(
        test=test.source,
        reference=reference.source,
        service=test.service,
        reference_service=reference.service,
        antenna_offset_m=antenna_offset_m,
        matched=found,
        fix=fix,
        tables=tables,
        outlier=outlier,
        sigma_m=sigma,
        age_s=test.age_s[found.epoch],
        within_sigmas=within_sigmas(error, sigma),
        time_ahead_s=time_ahead_s(found.along_m[steady], found.speed_mps[steady]),
        continuity=Continuity.of(test),
        reference_share_by_fix={
            Fix(kind).label: float(np.mean(found.reference_fix == kind)) for kind in np.unique(found.reference_fix)
        },
        left_out_by_reference_fix=left_out,
        notices=tuple(_notices(test, reference, found, certain[kept])),
    )


def _part(found: Matched, kept: NDArray[np.bool_]) -> Matched:
    """The epochs to keep."""
    arrays = ("t_s", "error_m", "along_m", "across_m", "speed_mps", "test_m", "reference_m", "epoch")
    more = ("reference_fix", "interpolated")
    return replace(found, **{name: getattr(found, name)[kept] for name in (*arrays, *more)})


def _notices(test: GnssTrack, reference: GnssTrack, found: Matched, certain: NDArray[np.bool_]) -> list[Notice]:
    notices = []
    if not certain.all():
        notices.append(
            Notice(
                "reference-not-fixed",
                f"{reference.source} has no fixed position at {np.mean(~certain):.1%} of the compared epochs: there "
                "the differences are as much its errors. --reference-fix fixed leaves those epochs out.",
            )
        )
    if found.without_heading:
        notices.append(
            Notice(
                "heading-unknown",
                f"{found.without_heading} epochs are left out: no heading is known to turn the antennas' offset by.",
            )
        )
    if not np.isfinite(found.error_m[:, 2]).any():
        notices.append(
            Notice("no-heights", "One of the logs states no ellipsoidal height, so that there are no 3D and Z figures.")
        )
    error_m = found.interpolation_m[1]
    if found.interpolated.any() and error_m > 0.1 * np.sqrt(np.mean(np.sum(found.error_m[:, :2] ** 2, axis=1))):
        notices.append(
            Notice(
                "interpolation-coarse",
                f"{np.mean(found.interpolated):.0%} of the epochs lie between those of {reference.source}, and its own "
                f"epochs deviate by up to {error_m:.3f} m (95 %) from what every other one would make of them. A "
                "reference with a higher rate gives truer figures.",
            )
        )
    if len(found) < FEW:
        notices.append(
            Notice(
                "few-epochs", f"Only {len(found)} epochs were compared: averages and percentiles of so few say little."
            )
        )
    notices += offset_notices(found.error_m, test.source, reference.source)
    covered = len(found) / len(test)
    if covered < 0.5:
        notices.append(
            Notice(
                "half-compared",
                f"Only {covered:.0%} of the positions in {test.source} were compared ({found.outside} lie outside the "
                f"reference's time, {found.in_gaps} in its gaps).",
            )
        )
    return notices


def _nothing(what: str) -> InputError:
    return InputError(
        what,
        "So there is no epoch at which the two could be compared.",
        "`furrowmap inspect` on both logs tells their times, gaps and fixes.",
        code="nothing-to-compare",
    )
