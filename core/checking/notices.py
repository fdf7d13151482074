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
        nothing = "The points have neither times nor sources that separate swaths: internal precision is unknown."
        return [Notice("check-swaths-unknown", nothing)]
    if not precision.swath_pairs:
        once = "No point is covered by two swaths: their agreement is unknown."
        return [Notice("check-swaths-single", once)]
    beyond = [
        f"{LABELS[name]} {verdict['found_m']:.3f} m of {verdict['limit_m']:.3g} m"
        for name, verdict in (precision.verdicts(class_m) if class_m is not None else {}).items()
        if verdict["met"] is False
    ]
    if not beyond or class_m is None:
        return []
    apart = f"The internal precision of the cloud does not meet the class of {100 * class_m:g} cm: {', '.join(beyond)}."
    return [Notice("check-precision", apart)]


def accuracy_notices(
    checks: Sequence[PointCheck], accuracy: Accuracy, class_m: float | None, *, targets: bool
) -> list[Notice]:
    """Notices about the errors at the points."""
    assert accuracy.vertical is not None
    notices = []
    unused = [check for check in checks if check.why_not]
    if unused:
        reasons = "; ".join(f"{check.name} {check.why_not}" for check in unused[:3])
        text = f"{len(unused)} of {len(checks)} points were not compared: {reasons}{'; …' if len(unused) > 3 else ''}."
        notices.append(Notice("check-unused", text))
    if accuracy.vertical.n < FEWEST:
        text = (
            f"{accuracy.vertical.n} points were compared; ASPRS (Edition 2, 2023) requires at least {FEWEST} for a "
            "statement of accuracy."
        )
        notices.append(Notice("check-few", text))
    if not np.isfinite(accuracy.vertical.survey_m):
        text = (
            "The accuracy of the points is not stated (columns sigma_e_m, sigma_n_m, sigma_h_m, or --points-sigma), so "
            "the figures do not include it as the standard requires."
        )
        notices.append(Notice("check-survey-unknown", text))
    elif class_m is not None and accuracy.vertical.survey_m > 0.5 * class_m:
        coarse = (
            f"The heights of the points are accurate to {accuracy.vertical.survey_m:.3f} m; the standard requires "
            f"points twice as accurate as the class of {100 * class_m:g} cm."
        )
        notices.append(Notice("check-survey-coarse", coarse))
    for name, part in (("height", accuracy.vertical), ("easting", accuracy.easting), ("northing", accuracy.northing)):
        if part is not None and part.biased:
            cause = "look for its cause"
            if name == "height" and abs(part.mean_m) > GEOID_M:
                cause = "check whether both heights are ellipsoidal or both above sea level"
            text = f"The mean error in {name} is {part.mean_m:+.3f} m, more than scatter explains: {cause}."
            notices.append(Notice("check-bias", text))
    if targets:
        found = sum(bool(np.isfinite(check.found_m[0])) for check in checks)
        if found < len(checks):
            text = f"At {len(checks) - found} of {len(checks)} points no disc was found."
            notices.append(Notice("check-targets", text))
    return notices
