"""Points measured twice, in a product and by a survey, paired by their names."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyproj

from furrowmap.core.accuracy.point_check import PointCheck, rounded
from furrowmap.core.readers.chosen_survey import SurveyOptions, survey_of
from furrowmap.core.readers.surveyed_points import SurveyedPoints, in_degrees, read_points
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice

AXES: Final = ("x", "y", "z")
PAIR_COLUMNS: Final = (
    "name", *(f"measured_{axis}_m" for axis in AXES), *(f"surveyed_{axis}_m" for axis in AXES),
    *(f"difference_{axis}_m" for axis in AXES),
)  # fmt: skip
_PLANE: Final = pyproj.CRS.from_epsg(3857)
"""Stands for any plane: tables in the same one are not transformed."""


@dataclass(frozen=True)
class PairedPoints:
    """n points with two places (n, 3): easting (x), northing (y), height (z), measured (nan in part) and surveyed."""

    name: tuple[str, ...]
    measured_m: FloatArray
    surveyed_m: FloatArray
    unpaired: tuple[str, ...] = ()
    notices: tuple[Notice, ...] = ()

    @property
    def difference_m(self) -> FloatArray:
        """(n, 3) measured less surveyed."""
        out: FloatArray = self.measured_m - self.surveyed_m
        return out

    @property
    def rms_m(self) -> FloatArray:
        """(3,) root mean square of the differences; nan for a component that was nowhere measured."""
        return self._over_points(self.difference_m**2) ** 0.5

    @property
    def mean_m(self) -> FloatArray:
        """(3,) mean of the differences."""
        return self._over_points(self.difference_m)

    def rows(self) -> list[dict[str, Any]]:
        """A row a point; None where something was not measured."""
        numbers = np.column_stack([self.measured_m, self.surveyed_m, self.difference_m])
        return [
            dict(zip(PAIR_COLUMNS, (name, *_rounded(row)), strict=True))
            for name, row in zip(self.name, numbers.tolist(), strict=True)
        ]

    def plain(self) -> dict[str, Any]:
        """Statistics and points, as JSON has them."""
        count = np.isfinite(self.difference_m).sum(axis=0).tolist()
        return {
            "pairs": dict(zip(AXES, count, strict=True)),
            "mean_m": dict(zip(AXES, _rounded(self.mean_m), strict=True)),
            "rms_m": dict(zip(AXES, _rounded(self.rms_m), strict=True)),
            "points": self.rows(),
            "unpaired": list(self.unpaired),
        }

    def accuracy(self) -> dict[str, float | None]:
        """Root mean squares in height, in the plane and in space, under the names of a check."""
        east, north, up = self.rms_m.tolist()
        horizontal = float(np.hypot(east, north))
        values = (up, horizontal, float(np.hypot(horizontal, up)))
        names = ("rmse_vertical_m", "rmse_horizontal_m", "rmse_3d_m")
        return dict(zip(names, _rounded(values), strict=True))

    def _over_points(self, values: FloatArray) -> FloatArray:
        known = np.isfinite(values)
        total = np.where(known, values, 0.0).sum(axis=0)
        return np.where(known.any(axis=0), total / np.maximum(known.sum(axis=0), 1), np.nan)


def pairs_of_files(
    measured: Path, surveyed: Path, crs: pyproj.CRS | None = None, within: Path | None = None
) -> PairedPoints:
    """The points that two CSV or GeoPackage files name alike.

    Args:
        crs: of the plane in which they are compared, needed for longitudes and latitudes, and for polygons.

    Raises:
        InputError: if a file cannot be read, names a point twice, or both have no name in common.
        RefusedError: if PROJ has no exact transformation.
    """
    if crs is None and any(in_degrees(path) for path in (measured, surveyed)):
        raise InputError("pairs-need-crs", measured=measured.name, surveyed=surveyed.name)
    if crs is None and within is not None:
        raise InputError("pairs-need-crs.within-polygons", within=within)
    target = crs if crs is not None else _PLANE
    chosen = survey_of(surveyed, target, SurveyOptions(within=within))
    return paired(read_points(measured, target), chosen, measured, surveyed)


def paired(one: SurveyedPoints, other: SurveyedPoints, measured: Path, surveyed: Path) -> PairedPoints:
    """Points of one name in both tables, in the survey's order. Raises InputError if one is there twice, or none is."""
    for points, path in ((one, measured), (other, surveyed)):
        name, count = Counter(points.name).most_common(1)[0]
        if count > 1:
            raise InputError("pairs-repeated", path=path, name=name, count=count)
    there = {name: k for k, name in enumerate(one.name)}
    chosen = [k for k, name in enumerate(other.name) if name in there]
    if not chosen:
        raise InputError("pairs-none", measured=measured, surveyed=surveyed, one=one.name[0], other=other.name[0])
    names = tuple(other.name[k] for k in chosen)
    return PairedPoints(
        names,
        one.xyz_m[[there[name] for name in names]],
        other.xyz_m[chosen],
        tuple(sorted(set(one.name) ^ set(other.name))),
        (*one.notices, *other.notices),
    )


def pairs_of_product(points: Sequence[PointCheck], notices: tuple[Notice, ...]) -> PairedPoints:
    """The points at which a product was measured: heights, and places where targets were found."""
    seen = [point for point in points if np.isfinite(point.found_m).any()]
    return PairedPoints(
        tuple(point.name for point in seen),
        np.array([point.found_m for point in seen], np.float64).reshape(-1, 3),
        np.array([point.surveyed_m for point in seen], np.float64).reshape(-1, 3),
        tuple(point.name for point in points if not np.isfinite(point.found_m).any()),
        notices,
    )


def _rounded(values: Iterable[float]) -> list[float | None]:
    return [rounded(value, 4) for value in values]
