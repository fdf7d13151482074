"""Comparison of a cloud or a surface with surveyed points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pyproj

from furrowmap.core.checking.cloud_at_points import Targets, cloud_at_points
from furrowmap.core.checking.internal_precision import InternalPrecision
from furrowmap.core.checking.point_check import PointCheck
from furrowmap.core.checking.positional_accuracy import MIN_CHECK_POINTS, Accuracy, Component
from furrowmap.core.checking.surface_at_points import surface_at_points
from furrowmap.core.readers.las.header import SIGNATURE
from furrowmap.core.readers.surveyed_points import SurveyOptions
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.progress import Progress, silent

MAX_MEAN_HEIGHT_M: Final = 2.0
"""A larger mean error in height comes from a geoid or a wrong point."""
PRECISION_LABELS: Final = {
    "within_swath_max_m": "greatest within a swath",
    "between_swath_m": "RMS between swaths",
    "between_swath_max_m": "greatest between swaths",
}


@dataclass(frozen=True)
class Check:
    """Result of a comparison with surveyed points.

    Attributes:
        accuracy: from those that could be compared.
    """

    kind: str
    crs: pyproj.CRS
    points: tuple[PointCheck, ...]
    accuracy: Accuracy
    notices: tuple[Notice, ...]


def check_product(
    product: Path,
    points_file: Path,
    options: SurveyOptions = SurveyOptions(),
    *,
    targets: Targets = "none",
    diameter_m: float = 0.3,
    class_m: float | None = None,
    progress: Progress = silent,
) -> Check:
    """Compare a cloud (LAS, LAZ, COPC) or a surface (GeoTIFF) with surveyed points.

    Args:
        targets: attribute in which discs are detected, for the horizontal error.
        progress: receives the share of the cloud that was read.

    Raises:
        InputError: if a file cannot be read, or no point lies in the product.
        RefusedError: if PROJ has no exact transformation between their CRS.
    """
    if not product.is_file():
        raise InputError("no-such-file", product=product, is_product=bool(product.is_dir()))
    with product.open("rb") as file:
        is_cloud = file.read(4) == SIGNATURE
    found = (
        cloud_at_points(product, points_file, options, targets, diameter_m, progress)
        if is_cloud
        else surface_at_points(product, points_file, options)
    )
    checks, survey = found.points, found.survey
    stated = np.where(
        np.isfinite(survey.sigma_m), survey.sigma_m, np.nan if options.sigma_m is None else options.sigma_m
    )
    error = np.array([check.error_m for check in checks])
    easting, northing, vertical = (
        Component.from_errors(error[known, axis], stated[known, axis]) if known.any() else None
        for axis, known in enumerate(np.isfinite(error).T)
    )
    precision = InternalPrecision.over_places((check.swaths for check in checks), found.swath_key)
    accuracy = Accuracy(vertical, easting, northing, precision)
    if accuracy.vertical is None:
        (north, east), (low_e, low_n, high_e, high_n) = survey.xyz_m[:, :2].T, found.box_m
        swapped = int(((east >= low_e) & (east <= high_e) & (north >= low_n) & (north <= high_n)).sum())
        raise InputError(
            "check-nowhere",
            count=len(survey),
            points_file=points_file.name,
            product=product.name,
            first=checks[0].name,
            why_not=checks[0].why_not,
            swapped=swapped or None,
        )
    notices = [*found.notices, *accuracy_notices(checks, accuracy, class_m, targets=targets != "none")]
    if is_cloud:
        notices += precision_notices(accuracy.precision, class_m)
    return Check("cloud" if is_cloud else "surface", found.crs, checks, accuracy, tuple(notices))


def precision_notices(precision: InternalPrecision, class_m: float | None) -> list[Notice]:
    """Notices about internal precision."""
    if precision.swath_key == "nothing":
        return [Notice("check-swaths-unknown")]
    if not precision.swath_pairs:
        return [Notice("check-swaths-single")]
    beyond = [
        f"{PRECISION_LABELS[name]} {verdict['found_m']:.3f} m of {verdict['limit_m']:.3g} m"
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
    if accuracy.vertical.n < MIN_CHECK_POINTS:
        notices.append(Notice("check-few", n=accuracy.vertical.n, fewest=MIN_CHECK_POINTS))
    if not np.isfinite(accuracy.vertical.survey_m):
        notices.append(Notice("check-survey-unknown"))
    elif class_m is not None and accuracy.vertical.survey_m > 0.5 * class_m:
        notices.append(Notice("check-survey-coarse", survey_m=accuracy.vertical.survey_m, class_m=100 * class_m))
    for name, part in (("height", accuracy.vertical), ("easting", accuracy.easting), ("northing", accuracy.northing)):
        if part is not None and part.biased:
            geoid = name == "height" and abs(part.mean_m) > MAX_MEAN_HEIGHT_M
            notices.append(Notice("check-bias", name=name, mean_m=part.mean_m, geoid=geoid))
    if targets:
        found = sum(bool(np.isfinite(check.found_m[0])) for check in checks)
        if found < len(checks):
            notices.append(Notice("check-targets", checks=len(checks) - found, checks_count=len(checks)))
    return notices
