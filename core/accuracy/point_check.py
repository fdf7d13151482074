"""A product at surveyed points, and the internal precision of a cloud, within swaths and between overlapping ones.

ASPRS Positional Accuracy Standards, Edition 2 (2023), section 7.14; limits by section 7.4 and table 7.2.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import pyproj
from numpy.typing import NDArray

from furrowmap.core.pointclouds.survey_targets import GROUND_ALONE, Target, corners_among
from furrowmap.core.readers.chosen_survey import SurveyOptions, survey_of
from furrowmap.core.readers.raster_heights import open_heights
from furrowmap.core.readers.surveyed_points import SurveyedPoints
from furrowmap.core.runtime.arrays import FloatArray, three
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text, Words

SwathKey = Literal["times", "sources", "nothing"]

MIN_VISIT_GAP_S: Final = 20.0
"""A place not seen for this long is seen again by another swath."""
CLASS_SHARES: Final = {"within_swath_max_m": 0.60, "between_swath_m": 0.80, "between_swath_max_m": 1.60}
"""Limit of each figure as a share of the RMSE of a class."""


@dataclass(frozen=True)
class SwathHeights:
    """Heights of swaths at one place.

    Attributes:
        height_m: of the plane of each swath, by its number.
        spread_m: RMS of returns about the plane of their swath; nan where there are too few.
        range_m: greatest difference of neighbouring returns of one swath about its plane; nan likewise.
    """

    height_m: tuple[tuple[int, float], ...] = ()
    spread_m: float = float("nan")
    range_m: float = float("nan")

    @property
    def differences_m(self) -> list[float]:
        """Of each pair."""
        heights = [height for _, height in self.height_m]
        return [a - b for i, a in enumerate(heights) for b in heights[:i]]


NO_SWATHS: Final = SwathHeights()
"""A place that no swath covers."""


@dataclass(frozen=True)
class InternalPrecision:
    """RMS and greatest difference of the returns of one swath, and of two at one place; nan where unknown."""

    within_swath_m: float
    within_swath_max_m: float
    between_swath_m: float
    between_swath_max_m: float
    swath_pairs: int
    swath_key: SwathKey

    @classmethod
    def over_places(cls, places: Iterable[SwathHeights], swath_key: SwathKey) -> "InternalPrecision":
        """Over all places; nan where nothing separates the swaths."""
        seen = list(places) if swath_key != "nothing" else []
        spread = np.array([place.spread_m for place in seen])
        ranges = np.array([place.range_m for place in seen])
        differences = np.array([difference for place in seen for difference in place.differences_m])
        return cls(
            _rms(spread[np.isfinite(spread)]),
            float(np.nanmax(ranges)) if np.isfinite(ranges).any() else float("nan"),
            _rms(differences),
            float(np.abs(differences).max()) if len(differences) else float("nan"),
            len(differences),
            swath_key,
        )

    def verdicts(self, class_m: float) -> dict[str, dict[str, Any]]:
        """Each figure against its limit for a vertical accuracy class; `met` is None where unknown."""
        out: dict[str, dict[str, Any]] = {}
        for name, share in CLASS_SHARES.items():
            found = float(getattr(self, name))
            limit = share * class_m
            known = bool(np.isfinite(found))
            out[name] = {
                "found_m": round(found, 5) if known else None,
                "limit_m": round(limit, 6),
                "met": found <= limit if known else None,
            }
        return out


def find_swath_key(source: NDArray[np.uint16], t_s: FloatArray | None, *, own: bool) -> SwathKey:
    """What separates the swaths of returns (n,), by point source and time; times may be unknown, or constant.

    In clouds of furrowmap's own, point sources are passes of the implement, not swaths.
    """
    if t_s is not None and np.isfinite(t_s).any() and np.nanmax(t_s) > np.nanmin(t_s):
        return "times"
    return "sources" if not own and source.any() else "nothing"


def swath_numbers(
    source: NDArray[np.uint16], t_s: FloatArray | None, swath_key: SwathKey, *, own: bool
) -> NDArray[np.int64]:
    """Swath number of each return (n,) at one place; in clouds of other software one for each source and visit."""
    number = np.zeros(len(source), np.int64)
    if swath_key == "times" and t_s is not None and len(t_s):
        order = np.argsort(t_s)
        visit = np.cumsum(np.diff(t_s[order], prepend=t_s[order[0]]) > MIN_VISIT_GAP_S)
        number[order] = visit
    return number if own else number + (source.astype(np.int64) << 32)


def rounded(value: float | None, digits: int) -> float | None:
    """A number for JSON; None where it is unknown."""
    return round(float(value), digits) if value is not None and np.isfinite(value) else None


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


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
        found_m: of the product; nan where unknown, easting and northing without a target.
        returns: used for the height; 0 for a surface.
        why_not: why the height was not compared; else None.
        target: what was looked for at it; the ground alone without a target.
    """

    name: str
    surveyed_m: tuple[float, float, float]
    found_m: tuple[float, float, float]
    returns: int = 0
    slope: float = float("nan")
    swaths: SwathHeights = NO_SWATHS
    why_not: Text | None = None
    target: Target = GROUND_ALONE

    @property
    def error_m(self) -> FloatArray:
        """Product less survey (3,); nan where there is none."""
        return np.asarray(np.subtract(self.found_m, self.surveyed_m), np.float64)

    def row(self) -> dict[str, Any]:
        """The point as a row of a table; None where something is unknown."""
        error = [rounded(value, 4) for value in self.error_m.tolist()]
        values = (
            self.name, *(round(value, 4) for value in self.surveyed_m), *error, self.returns, rounded(self.slope, 3),
            rounded(self.swaths.spread_m, 4), len(self.swaths.height_m), str(self.why_not or ""),
        )  # fmt: skip
        return dict(zip(CHECK_COLUMNS, values, strict=True))


@dataclass(frozen=True)
class ProductAtPoints:
    """A product at all surveyed points; `survey` are the points in its CRS."""

    crs: pyproj.CRS
    points: tuple[PointCheck, ...]
    survey: SurveyedPoints
    box_m: Box
    swath_key: SwathKey
    notices: tuple[Notice, ...]


def surface_at_points(path: Path, points_file: Path, options: SurveyOptions = SurveyOptions()) -> ProductAtPoints:
    """Height of a surface at each point, bilinear between cell centres; corners of planes are not compared.

    InputError if it is no such raster, or the points cannot be read; RefusedError if PROJ has no exact transformation
    between their CRS.
    """
    with open_heights(path, _no_surface) as raster:
        box = tuple(raster.dataset.bounds)
        crs = raster.crs
        survey = survey_of(points_file, crs, options)
        corners = corners_among(survey)
        checks = []
        columns, rows = raster.columns_rows(survey.xyz_m[:, 0], survey.xyz_m[:, 1])
        for name, xyz, column, row, corner in zip(survey.name, survey.xyz_m, columns, rows, corners, strict=True):
            left = int(np.floor(column - 0.5))
            top = int(np.floor(row - 0.5))
            cells = raster.read_m((top, top + 2), (left, left + 2))
            right = column - 0.5 - left
            down = row - 0.5 - top
            share = np.outer([1.0 - down, down], [1.0 - right, right])
            height = float(np.sum(np.where(share > 0.0, cells * share, 0.0)))
            why = None if np.isfinite(height) else Text("lies where the surface has no heights")
            if corner:
                height = np.nan
                why = Text("is a corner of planes, which only a point cloud shows")
            found = (np.nan, np.nan, height)
            checks.append(PointCheck(name, three(xyz), found, why_not=why))
    return ProductAtPoints(crs, tuple(checks), survey, box, "nothing", (*raster.scale.notices, *survey.notices))


def _no_surface(path: Path, why: Words) -> InputError:
    return InputError("check-product", path=path, why=why)
