"""Comparison of a cloud or a surface with surveyed points.

ASPRS Positional Accuracy Standards for Digital Geospatial Data, Edition 2 (2023): the RMSE of a product includes the
error of the survey, RMSE² = RMSE₁² + RMSE₂², where 1 is the fit to the points and 2 that of the points themselves.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyproj

from furrowmap.core.accuracy.cloud_at_points import TargetSearch, cloud_at_points
from furrowmap.core.accuracy.point_check import (
    InternalPrecision,
    PointCheck,
    ProductAtPoints,
    rounded,
    surface_at_points,
)
from furrowmap.core.pointclouds.survey_targets import TargetKind
from furrowmap.core.readers.chosen_survey import SurveyOptions
from furrowmap.core.readers.las.cloud import is_cloud
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import CHECK_POINTS_OFF, InputError, Notice
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.progress import Progress, silent

MIN_CHECK_POINTS: Final = 30
"""Edition 2's minimum of check points for a statement of accuracy."""
BIAS_SHARE: Final = 0.25
"""A mean error above this share of the RMSE is a bias."""
MIN_BIAS_M: Final = 1e-3
"""Coordinates are written to the millimetre: what is less comes of their rounding."""


@dataclass(frozen=True)
class Component:
    """Errors along one axis.

    Attributes:
        mean_m, sigma_m: mean and (sample) standard deviation of product less survey.
        fit_m: RMSE of product less survey.
        survey_m: RMS of the standard deviations of the points; nan where none is stated.
        rmse_m: of the product, including the error of the survey where stated.
        median_m, p95_m, greatest_m: median of the errors, 95th percentile and greatest of their absolute values.
    """

    n: int
    mean_m: float
    sigma_m: float
    fit_m: float
    survey_m: float
    rmse_m: float
    median_m: float
    p95_m: float
    greatest_m: float

    @classmethod
    def from_errors(cls, error_m: FloatArray, survey_sigma_m: FloatArray) -> "Component":
        """From errors (n,), n at least 1, and standard deviations of the survey (n,), nan where unstated."""
        known = survey_sigma_m[np.isfinite(survey_sigma_m)]
        survey = float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")
        fit = float(np.sqrt(np.mean(error_m**2)))
        return cls(
            n=len(error_m),
            mean_m=float(error_m.mean()),
            sigma_m=float(error_m.std(ddof=1)) if len(error_m) > 1 else float("nan"),
            fit_m=fit,
            survey_m=survey,
            rmse_m=float(np.hypot(fit, survey)) if len(known) else fit,
            median_m=float(np.median(error_m)),
            p95_m=float(np.percentile(np.abs(error_m), 95.0)),
            greatest_m=float(np.abs(error_m).max()),
        )

    @property
    def biased(self) -> bool:
        """Whether the mean exceeds the limit of the standard and twice its standard error."""
        if self.n < 2 or not self.fit_m:
            return False
        scatter_m = 2.0 * self.sigma_m / np.sqrt(self.n)
        return bool(abs(self.mean_m) > max(BIAS_SHARE * self.rmse_m, scatter_m, MIN_BIAS_M))

    def plain(self) -> dict[str, Any]:
        """For JSON; null where unknown."""
        return {name: value if isinstance(value, int) else rounded(value, 5) for name, value in vars(self).items()}


@dataclass(frozen=True)
class Accuracy:
    """Accuracy of a product; `vertical` is None without a comparison, the horizontal components without targets."""

    vertical: Component | None
    easting: Component | None
    northing: Component | None
    precision: InternalPrecision

    @property
    def horizontal_m(self) -> float | None:
        """RMSE of easting and northing combined."""
        if self.easting is None or self.northing is None:
            return None
        return float(np.hypot(self.easting.rmse_m, self.northing.rmse_m))

    @property
    def spatial_m(self) -> float | None:
        """RMSE in three dimensions."""
        if self.horizontal_m is None or self.vertical is None:
            return None
        return float(np.hypot(self.horizontal_m, self.vertical.rmse_m))

    def plain(self) -> dict[str, Any]:
        """For JSON; null where unknown."""
        parts = {"vertical": self.vertical, "easting": self.easting, "northing": self.northing}
        return {
            **{name: part.plain() if part is not None else None for name, part in parts.items()},
            "rmse_vertical_m": rounded(self.vertical.rmse_m, 5) if self.vertical is not None else None,
            "rmse_horizontal_m": rounded(self.horizontal_m, 5),
            "rmse_3d_m": rounded(self.spatial_m, 5),
            "within_swath_m": rounded(self.precision.within_swath_m, 5),
            "within_swath_max_m": rounded(self.precision.within_swath_max_m, 5),
            "between_swath_m": rounded(self.precision.between_swath_m, 5),
            "between_swath_max_m": rounded(self.precision.between_swath_max_m, 5),
            "swath_pairs": self.precision.swath_pairs,
            "swaths_told_by": self.precision.swath_key,
        }


MIN_HELD_POINTS: Final = 3
HELD_SIGMAS: Final = 4.0
"""Standard deviations by which heights must be off surveyed points to contradict them."""
SURVEY_SIGMA_M: Final = 0.01
"""Standard deviation of surveyed heights whose file states none."""
MAX_MEAN_HEIGHT_M: Final = 2.0
"""A larger mean error in height comes from a geoid or a wrong point."""
PRECISION_LABELS: Final = {
    "within_swath_max_m": "greatest within a swath",
    "between_swath_m": "RMS between swaths",
    "between_swath_max_m": "greatest between swaths",
}


@dataclass(frozen=True)
class HeldHeights:
    """Heights of a surface held against surveyed points, compared where the surface has heights.

    `off_m` is the median of surface less survey, nan with fewer than MIN_HELD_POINTS; `sigma_m` its standard deviation,
    by what is stated and by how the points scatter.
    """

    points: int
    compared: int
    off_m: float
    sigma_m: float

    @classmethod
    def of(cls, surface: ProductAtPoints, stated_m: float) -> "HeldHeights":
        """Of a surface whose heights have a standard deviation that all points share, as those of the survey do."""
        error = np.array([point.error_m[2] for point in surface.points])
        known = np.isfinite(error)
        error = error[known]
        survey = surface.survey.sigma_m[known, 2]
        if len(error) < MIN_HELD_POINTS:
            return cls(len(known), len(error), math.nan, math.nan)
        off = float(np.median(error))
        # Of a median: 1.2533 times that of a mean.
        scatter = 1.2533 * 1.4826 * float(np.median(np.abs(error - off))) / math.sqrt(len(error))
        surveyed = float(np.median(np.where(np.isfinite(survey), survey, SURVEY_SIGMA_M)))
        return cls(len(known), len(error), off, math.hypot(stated_m, surveyed, scatter))

    def notice(self, file: str) -> Notice | None:
        """Of heights that the points contradict, or of too few points to tell."""
        if self.compared < MIN_HELD_POINTS:
            return Notice("check-points-few", file=file, compared=self.compared, points=self.points)
        if abs(self.off_m) <= HELD_SIGMAS * self.sigma_m:
            return None
        return Notice(CHECK_POINTS_OFF, file=file, off_m=self.off_m, sigma_m=self.sigma_m, compared=self.compared)

    def plain(self) -> dict[str, Any]:
        """For JSON; null where unknown."""
        return {name: value if isinstance(value, int) else rounded(value, 5) for name, value in vars(self).items()}


@dataclass(frozen=True)
class Check:
    """Result of a comparison with surveyed points; `accuracy` is from those that could be compared."""

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
    search: TargetSearch = TargetSearch(),
    class_m: float | None = None,
    progress: Progress = silent,
) -> Check:
    """Compare a cloud (LAS, LAZ, COPC) or a surface (GeoTIFF) with surveyed points.

    Args:
        search: of targets in a cloud, for the horizontal error.

    Raises:
        InputError: if a file cannot be read, names an unknown target, or no point lies in the product.
        RefusedError: if PROJ has no exact transformation between their CRS.
    """
    if not product.is_file():
        raise InputError("no-such-file", product=product, is_product=bool(product.is_dir()))
    by_cloud = is_cloud(product)
    found = (
        cloud_at_points(product, points_file, options, search, progress)
        if by_cloud
        else surface_at_points(product, points_file, options)
    )
    checks = found.points
    survey = found.survey
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
        north, east = survey.xyz_m[:, :2].T
        low_e, low_n, high_e, high_n = found.box_m
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
    notices = [*found.notices, *accuracy_notices(checks, accuracy, class_m)]
    if not by_cloud and search.targets != "none":
        notices.append(Notice("check-targets.surface"))
    if by_cloud:
        notices += precision_notices(accuracy.precision, class_m)
    return Check("cloud" if by_cloud else "surface", found.crs, checks, accuracy, tuple(notices))


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
    return [Notice("check-precision", class_cm=100 * class_m, beyond=", ".join(beyond))]


def accuracy_notices(checks: Sequence[PointCheck], accuracy: Accuracy, class_m: float | None) -> list[Notice]:
    """Notices about the errors at the points."""
    assert accuracy.vertical is not None
    notices = []
    unused = [check for check in checks if check.why_not]
    if unused:
        reasons = tuple(Text("{name} {why_not}", name=check.name, why_not=check.why_not) for check in unused[:3])
        notices.append(
            Notice("check-unused", unused=len(unused), checks=len(checks), reasons=reasons, more=len(unused) > 3)
        )
    if accuracy.vertical.n < MIN_CHECK_POINTS:
        notices.append(Notice("check-few", points=accuracy.vertical.n, fewest=MIN_CHECK_POINTS))
    if not np.isfinite(accuracy.vertical.survey_m):
        notices.append(Notice("check-survey-unknown"))
    elif class_m is not None and accuracy.vertical.survey_m > 0.5 * class_m:
        notices.append(Notice("check-survey-coarse", survey_m=accuracy.vertical.survey_m, class_cm=100 * class_m))
    for name, part in (("height", accuracy.vertical), ("easting", accuracy.easting), ("northing", accuracy.northing)):
        if part is not None and part.biased:
            geoid = name == "height" and abs(part.mean_m) > MAX_MEAN_HEIGHT_M
            notices.append(Notice("check-bias", name=name, mean_m=part.mean_m, geoid=geoid))
    for kind in (TargetKind.DISC, TargetKind.CHECKERBOARD):
        sought = [check for check in checks if check.target.kind is kind]
        missing = sum(not np.isfinite(check.found_m[0]) for check in sought)
        if missing:
            is_disc = kind is TargetKind.DISC
            size_m = sought[0].target.size_m
            notices.append(Notice("check-targets", missing=missing, sought=len(sought), is_disc=is_disc, size_m=size_m))
    return notices
