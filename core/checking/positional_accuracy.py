"""Positional accuracy from surveyed points.

ASPRS Positional Accuracy Standards for Digital Geospatial Data, Edition 2 (2023): the RMSE of a product includes the
error of the survey, RMSE² = RMSE₁² + RMSE₂², where 1 is the fit to the points and 2 that of the points themselves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from furrowmap.core.checking.internal_precision import InternalPrecision, rounded
from furrowmap.core.runtime.arrays import FloatArray

MIN_CHECK_POINTS: Final = 30
"""Edition 2's minimum of check points for a statement of accuracy."""
BIAS_SHARE: Final = 0.25
"""A mean error above this share of the RMSE is a bias."""


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
    def from_errors(cls, error_m: FloatArray, survey_sigma_m: FloatArray) -> Component:
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
        return bool(abs(self.mean_m) > max(BIAS_SHARE * self.rmse_m, 2.0 * self.sigma_m / np.sqrt(self.n)))

    def plain(self) -> dict[str, Any]:
        """For JSON; null where unknown."""
        return {name: value if isinstance(value, int) else rounded(value, 5) for name, value in vars(self).items()}


@dataclass(frozen=True)
class Accuracy:
    """Accuracy of a product.

    Attributes:
        vertical: None where no point could be compared.
        easting, northing: None where no target was found.
    """

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
