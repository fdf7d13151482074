"""From one CRS to another, never by a step that PROJ only guesses."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.aoi import AreaOfInterest
from pyproj.exceptions import CRSError, ProjError
from pyproj.transformer import TransformerGroup

from furrowmap.core.values.crs_name import name_of
from furrowmap.core.values.errors import InputError, Notice, RefusedError

FloatArray = NDArray[np.float64]

LOOSE_M: Final = 0.05
"""A change whose authority states a worse accuracy than this is told to the user."""


@dataclass(frozen=True)
class CrsChange:
    """A change of horizontal coordinates that PROJ can vouch for.

    Attributes:
        source: easting or longitude first, as everywhere here.
        target: likewise.
        accuracy_m: as its authority states it; 0 for a projection alone, None where nobody states one.
        words: the steps, as PROJ's database calls them.
    """

    source: CRS
    target: CRS
    accuracy_m: float | None
    words: str
    transformer: Transformer

    def __call__(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Coordinates (n,) each in the target.

        Raises:
            RefusedError: if one of them has no place there.
        """
        try:
            moved_x, moved_y = self.transformer.transform(x, y, errcheck=True)
        except ProjError as error:
            raise RefusedError(
                f"Some of the coordinates have no place in {name_of(self.target)} ({error}).",
                "They would come out as infinite, so nothing was written.",
                "Choose a CRS that is made for the place.",
                code="crs-change-outside",
            ) from None
        return np.asarray(moved_x, np.float64), np.asarray(moved_y, np.float64)

    def points(self, xy: FloatArray) -> FloatArray:
        """Coordinates (n, 2) in the target, as shapely passes them."""
        return np.column_stack(self(xy[:, 0], xy[:, 1]))

    @property
    def notices(self) -> tuple[Notice, ...]:
        """What a user should know of this change."""
        if self.accuracy_m is not None and self.accuracy_m <= LOOSE_M:
            return ()
        known = (
            "whose accuracy nobody states"
            if self.accuracy_m is None
            else f"stated to be accurate to {self.accuracy_m:g} m"
        )
        return (
            Notice(
                "crs-change-loose",
                f"From {name_of(self.source)} to {name_of(self.target)} the datum changes by a step {known} ("
                f"{self.words}).",
            ),
        )


def crs_change(source: CRS, target: CRS, bounds: tuple[float, float, float, float]) -> CrsChange:
    """The change from `source` to `target` for a place.

    PROJ answers with an identity where the way needs a grid that it does not have (JGD2000 to JGD2011 on the coast that
    the earthquake of 2011 moved by metres), so what it offers is compared with what it would offer had it all grids.

    Args:
        source: horizontal.
        target: horizontal.
        bounds: of the place in `source`: least x and y, greatest x and y; a point's if it is one.

    Raises:
        RefusedError: if there is no way, or the right one needs a grid that is not installed.
    """
    source, target = source.to_2d(), target.to_2d()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of missing grids, of which more is said below
        group = TransformerGroup(
            source, target, always_xy=True, area_of_interest=_area(source, bounds), allow_ballpark=False
        )
    missing = [operation for operation in group.unavailable_operations if _better(operation.accuracy, group)]
    if missing:
        needed = "; ".join(dict.fromkeys(grid.short_name for grid in missing[0].grids if not grid.available))
        raise RefusedError(
            f"The way from {name_of(source)} to {name_of(target)} here is '{missing[0].name}', whose grid ({needed}) "
            "PROJ does not have.",
            "Without it PROJ would leave the coordinates as they are and call that the answer.",
            "Put the grid into PROJ's data folder (`projsync` fetches free ones), or stay in the session's CRS.",
            code="crs-change-grid",
        )
    if not group.transformers:
        raise RefusedError(
            f"PROJ knows no way from {name_of(source)} to {name_of(target)} at this place.",
            "A guess could be off by hundreds of metres.",
            "Choose another CRS.",
            code="crs-change-unknown",
        )
    best = group.transformers[0]
    accuracy_m = best.accuracy if best.accuracy is not None and best.accuracy >= 0 else None
    if source.geodetic_crs == target.geodetic_crs:
        accuracy_m = 0.0
    steps = [step for step in best.description.split(" + ") if not step.startswith("axis order change")]
    return CrsChange(source, target, accuracy_m, ", then ".join(steps) or "no change", best)


def crs_of(text: str) -> CRS:
    """The horizontal CRS that a user names, in any form that PROJ reads.

    Raises:
        InputError: if it is none.
    """
    try:
        return CRS.from_user_input(text).to_2d()
    except CRSError as error:
        raise InputError(
            f"{text!r} is no CRS that PROJ knows ({error}).",
            "Coordinates cannot be changed into it.",
            'Write an EPSG code such as "EPSG:4326", or a WKT text.',
            code="crs-unknown",
        ) from None


def _better(accuracy_m: float, group: TransformerGroup) -> bool:
    """Whether an operation that cannot be had is stated to be better than the best that can."""
    offered = [t.accuracy for t in group.transformers if t.accuracy is not None and t.accuracy >= 0]
    return accuracy_m >= 0 and (not offered or accuracy_m < min(offered))


def _area(source: CRS, bounds: tuple[float, float, float, float]) -> Any:
    """The place in degrees (pyproj's types have two of that name); None where the CRS cannot say."""
    base = source.geodetic_crs
    if base is None:
        return None
    to_degrees = Transformer.from_crs(source, base.to_2d(), always_xy=True)
    west, south, east, north = to_degrees.transform_bounds(*bounds)
    return AreaOfInterest(west, south, east, north) if np.isfinite([west, south, east, north]).all() else None
