"""Notices of a check with surveyed points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from furrowmap.core.checking.internal_precision import InternalPrecision
from furrowmap.core.checking.point_check import PointCheck
from furrowmap.core.checking.positional_accuracy import FEWEST, Accuracy
from furrowmap.core.runtime.errors import Notice

GEOID_M: Final = 2.0
"""A larger mean error in height comes from a geoid or a wrong point."""
LABELS: Final = {
    "within_swath_max_m": "greatest within a swath",
    "between_swath_m": "RMS between swaths",
    "between_swath_max_m": "greatest between swaths",
}


def precision_notices(precision: InternalPrecision, class_m: float | None) -> list[Notice]:
    """Notices about internal precision."""
    if precision.swath_key == "nothing":
        return [Notice("check-swaths-unknown")]
    if not precision.swath_pairs:
        return [Notice("check-swaths-single")]
    beyond = [
        f"{LABELS[name]} {verdict['found_m']:.3f} m of {verdict['limit_m']:.3g} m"
        for name, verdict in (precision.verdicts(class_m) if class_m is not None else {}).items()
        if verdict["met"] is False
    ]
    if not beyond or class_m is None:
        return []
    return [Notice("check-precision", class_m=100 * class_m, beyond=", ".join(beyond))]


def accuracy_notices(
    checks: Sequence[PointCheck], accuracy: Accuracy, class_m: float | None, *, targets: bool
) -> list[Notice]:
    """Notices about the errors at the points."""
    assert accuracy.vertical is not None
    notices = []
    unused = [check for check in checks if check.why_not]
    if unused:
        reasons = "; ".join(f"{check.name} {check.why_not}" for check in unused[:3])
        notices.append(
            Notice("check-unused", unused=len(unused), checks=len(checks), reasons=reasons, more=len(unused) > 3)
        )
    if accuracy.vertical.n < FEWEST:
        notices.append(Notice("check-few", n=accuracy.vertical.n, fewest=FEWEST))
    if not np.isfinite(accuracy.vertical.survey_m):
        notices.append(Notice("check-survey-unknown"))
    elif class_m is not None and accuracy.vertical.survey_m > 0.5 * class_m:
        notices.append(Notice("check-survey-coarse", survey_m=accuracy.vertical.survey_m, class_m=100 * class_m))
    for name, part in (("height", accuracy.vertical), ("easting", accuracy.easting), ("northing", accuracy.northing)):
        if part is not None and part.biased:
            geoid = name == "height" and abs(part.mean_m) > GEOID_M
            notices.append(Notice("check-bias", name=name, mean_m=part.mean_m, geoid=geoid))
    if targets:
        found = sum(bool(np.isfinite(check.found_m[0])) for check in checks)
        if found < len(checks):
            notices.append(Notice("check-targets", checks=len(checks) - found, checks_count=len(checks)))
    return notices
