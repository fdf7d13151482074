"""A product at surveyed points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pyproj

from furrowmap.core.checking.internal_precision import NO_SWATHS, SwathHeights, SwathKey, rounded
from furrowmap.core.readers.surveyed_points import SurveyedPoints
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice

Box = tuple[float, float, float, float]
"""West, south, east, north."""
CHECK_COLUMNS: Final = (
    "name", "e_m", "n_m", "h_m", "error_e_m", "error_n_m", "error_h_m", "returns", "slope", "spread_m", "swaths",
    "why_not",
)  # fmt: skip


@dataclass(frozen=True)
class PointCheck:
    """One surveyed point and the product there.

    Attributes:
        surveyed_m: easting, northing, height.
        found_m: of the product; nan where unknown, easting and northing without a target.
        returns: used for the height; 0 for a surface.
        slope: of the plane; nan for a surface.
        swaths: heights by swath.
        why_not: why the height was not compared; else empty.
    """

    name: str
    surveyed_m: tuple[float, float, float]
    found_m: tuple[float, float, float]
    returns: int = 0
    slope: float = float("nan")
    swaths: SwathHeights = NO_SWATHS
    why_not: str = ""

    @property
    def error_m(self) -> FloatArray:
        """Product less survey (3,); nan where there is none."""
        return np.asarray(np.subtract(self.found_m, self.surveyed_m), np.float64)

    def row(self) -> dict[str, Any]:
        """The point as a row of a table; None where something is unknown."""
        error = [rounded(value, 4) for value in self.error_m.tolist()]
        values = (
            self.name, *(round(value, 4) for value in self.surveyed_m), *error, self.returns, rounded(self.slope, 3),
            rounded(self.swaths.spread_m, 4), len(self.swaths.height_m), self.why_not,
        )  # fmt: skip
        return dict(zip(CHECK_COLUMNS, values, strict=True))


@dataclass(frozen=True)
class ProductAtPoints:
    """A product at all surveyed points.

    Attributes:
        survey: the points, in that CRS.
    """

    crs: pyproj.CRS
    points: tuple[PointCheck, ...]
    survey: SurveyedPoints
    box_m: Box
    swath_key: SwathKey
    notices: tuple[Notice, ...]


def three(xyz: FloatArray) -> tuple[float, float, float]:
    """Coordinates (3,) as a tuple."""
    return float(xyz[0]), float(xyz[1]), float(xyz[2])
