"""Transformation between CRS, never by a ballpark step of PROJ.

A terrestrial frame in which positions were recorded leads to that of the map at the time of each position. Plates move
by centimetres a year in the ITRF; national frames move with them. Seven parameters and their rates lead from one to the
other (for ETRS89: EUREF Technical Note 1, Altamimi 2018). PROJ has those of EPSG; what it lacks is refused.
"""

import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from pyproj import CRS, Transformer
from pyproj.aoi import AreaOfInterest
from pyproj.exceptions import CRSError, ProjError
from pyproj.transformer import TransformerGroup

from furrowmap.core.geodesy.longitudes import bounding_box_ends_deg, unwrapped_deg
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice, RefusedError
from furrowmap.core.values.clock import decimal_years
from furrowmap.core.values.crs import name_of

LOOSE_M: Final = 0.05
"""A worse stated accuracy raises a notice."""
NO_PROPOSAL: Final = {"is_output": False, "proposal": None}
"""Values of a refusal whose remedy proposes no CRS of the output."""


@dataclass(frozen=True)
class CrsChange:
    """An exact transformation of horizontal coordinates, easting or longitude first, and its steps in words.

    `accuracy_m` is that stated by its authority; 0 for a projection alone, None where unstated.
    """

    source: CRS
    target: CRS
    accuracy_m: float | None
    words: str
    transformer: Transformer

    def __call__(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Coordinates (n,) each in the target; RefusedError if one of them lies outside its domain."""
        try:
            moved_x, moved_y = self.transformer.transform(x, y, errcheck=True)
        except ProjError as error:
            raise RefusedError("crs-change-outside", target=name_of(self.target), error=error, **NO_PROPOSAL) from None
        return np.asarray(moved_x, np.float64), np.asarray(moved_y, np.float64)

    def points(self, xy: FloatArray) -> FloatArray:
        """Coordinates (n, 2) in the target, as shapely passes them."""
        return np.column_stack(self(xy[:, 0], xy[:, 1]))

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Of a transformation with a poor or unstated accuracy."""
        if self.accuracy_m is not None and self.accuracy_m <= LOOSE_M:
            return ()
        return (
            Notice(
                "crs-change-loose",
                source=name_of(self.source),
                target=name_of(self.target),
                has_accuracy_m=self.accuracy_m is not None,
                accuracy_m=self.accuracy_m if self.accuracy_m is not None else None,
                words=self.words,
            ),
        )


def crs_change(source: CRS, target: CRS, bounds: tuple[float, float, float, float]) -> CrsChange:
    """The transformation from `source` to `target`, both horizontal, at a site: least x and y, greatest x and y.

    PROJ returns an identity where a grid is missing (JGD2000 to JGD2011 on the coast that the earthquake of 2011 moved
    by metres), so its offer is compared with what it would offer with all grids. RefusedError if there is none, or it
    needs a grid that is not installed.
    """
    source = source.to_2d()
    target = target.to_2d()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # missing grids are reported below
        group = TransformerGroup(
            source, target, always_xy=True, area_of_interest=_area(source, bounds), allow_ballpark=False
        )
    missing = [operation for operation in group.unavailable_operations if _better(operation.accuracy, group)]
    if missing:
        needed = "; ".join(dict.fromkeys(grid.short_name for grid in missing[0].grids if not grid.available))
        raise RefusedError(
            "crs-change-grid",
            source=name_of(source),
            target=name_of(target),
            missing=missing[0].name,
            needed=needed,
            **NO_PROPOSAL,
        )
    if not group.transformers:
        raise RefusedError("crs-change-unknown", source=name_of(source), target=name_of(target), **NO_PROPOSAL)
    best = group.transformers[0]
    accuracy_m = best.accuracy if best.accuracy is not None and best.accuracy >= 0 else None
    if source.geodetic_crs == target.geodetic_crs:
        accuracy_m = 0.0
    steps = [step for step in best.description.split(" + ") if not step.startswith("axis order change")]
    return CrsChange(source, target, accuracy_m, ", then ".join(steps) or "no change", best)


def bounds_in(crs: CRS, xy: FloatArray) -> tuple[float, float, float, float]:
    """Least x and y, greatest x and y of positions (n, 2) in a horizontal CRS; beyond 180° across the antimeridian."""
    x = unwrapped_deg(xy[:, 0]) if crs.is_geographic else xy[:, 0]
    return float(x.min()), float(xy[:, 1].min()), float(x.max()), float(xy[:, 1].max())


def optional_crs(text: str | CRS | None) -> CRS | None:
    """As :func:`crs_of`; None for None."""
    return crs_of(text) if text is not None else None


def crs_of(text: str | CRS) -> CRS:
    """The horizontal CRS of a text in any form that PROJ reads; InputError if it is none."""
    return horizontal_part(with_heights_of(text))


def optional_with_heights(text: str | CRS | None) -> CRS | None:
    """As :func:`with_heights_of`; None for None."""
    return with_heights_of(text) if text is not None else None


def with_heights_of(text: str | CRS) -> CRS:
    """The CRS of a text, such as "EPSG:25832+7837", with its vertical part; InputError if it has no horizontal one."""
    try:
        crs = CRS.from_user_input(text)
    except CRSError as error:
        raise InputError("crs-unknown.target", text=text, error=error) from None
    if not (crs.is_projected or crs.is_geographic):
        raise InputError("crs-unknown.not-horizontal", text=text, type_name=crs.type_name)
    return crs


def horizontal_part(crs: CRS) -> CRS:
    """The two-dimensional CRS of a map, without that of heights."""
    return crs.sub_crs_list[0].to_2d() if crs.is_compound else crs.to_2d()


def _better(accuracy_m: float, group: TransformerGroup) -> bool:
    """Whether the stated accuracy of an unavailable operation is better than that of the best available one."""
    offered = [t.accuracy for t in group.transformers if t.accuracy is not None and t.accuracy >= 0]
    return accuracy_m >= 0 and (not offered or accuracy_m < min(offered))


def _area(source: CRS, bounds: tuple[float, float, float, float]) -> Any:
    """Bounds in degrees as pyproj's area of interest; None where they cannot be computed."""
    base = source.geodetic_crs
    if base is None:
        return None
    to_degrees = Transformer.from_crs(source, base.to_2d(), always_xy=True)
    west, south, east, north = to_degrees.transform_bounds(*bounds)
    west, east = bounding_box_ends_deg(west, east)
    return AreaOfInterest(west, south, east, north) if np.isfinite([west, south, east, north]).all() else None


MAX_FRAME_SIGMA_M: Final = 0.05
"""Transformations of a worse stated accuracy are refused: the motion of a plate in a year or two is as large."""
_FORM: Final = re.compile(r"\s*(.+?)\s*(?:->|→|\bto\b)\s*(.+?)\s*", re.IGNORECASE)


@dataclass(frozen=True)
class FrameChange:
    """A transformation between frames at the time of each position.

    Attributes:
        name: of the operation, as its authority names it.
    """

    name: str
    transformer: Transformer

    def to_map(
        self, t_s: FloatArray, lon_deg: FloatArray, lat_deg: FloatArray, height_m: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(longitude, latitude, change of the height), each (n,), in the frame of the map at Unix times (n,).

        Heights may be nan; a change of height is that of the place all the same.
        """
        level_m = np.where(np.isfinite(height_m), height_m, 0.0)
        moved: Any = self.transformer.transform(lon_deg, lat_deg, level_m, decimal_years(t_s))
        lon, lat, height = (np.asarray(axis, np.float64) for axis in moved[:3])
        return lon, lat, height - level_m


def frame_change(text: str, flat: CRS, frame_of: Callable[[str], CRS | None]) -> FrameChange | None:
    """The transformation that `crs.coordinates` asks for: a frame, or a frame "to" the realisation of the map's.

    Args:
        text: such as "ITRF2020", or "ITRF2020 to ETRF2000".
        flat: CRS of the map.
        frame_of: the geographic CRS of a name; None for an unknown one.

    Returns:
        None where the text is of another form.

    Raises:
        InputError: if the map's datum is an ensemble and no realisation of it is named.
        RefusedError: if PROJ has no exact transformation.
    """
    form = _FORM.fullmatch(text)
    source = frame_of(form[1] if form is not None else text.strip())
    base = flat.geodetic_crs
    if source is None or base is None:
        return None
    members = [member["name"] for member in base.to_json_dict().get("datum_ensemble", {}).get("members", [])]
    target = frame_of(form[2]) if form is not None else base
    named = form[2] if form is not None else None
    whole = target.datum.name if target is not None and target.datum is not None else None
    if (members and whole not in members) or (not members and target != base.to_2d()):
        raise InputError("frame-realization", map=base.name, named=named, members=members or [base.name])
    assert target is not None
    return _change(source, target)


def _change(source: CRS, target: CRS) -> FrameChange:
    """The best operation that PROJ offers; RefusedError if there is none, or a better one needs a grid."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # missing grids are reported below
        group = TransformerGroup(source.to_3d(), target.to_3d(), always_xy=True, allow_ballpark=False)
    best = group.transformers[0] if group.transformers else None
    known = best is not None and best.accuracy is not None and 0.0 <= best.accuracy <= MAX_FRAME_SIGMA_M
    if best is not None and known:
        steps = [step for step in best.description.split(" + ") if not step.startswith(("axis order", "Conversion"))]
        return FrameChange(", ".join(steps) or f"{source.name} to {target.name}", best)
    lacking = [grid.short_name for operation in group.unavailable_operations for grid in operation.grids]
    raise RefusedError(
        "frame-change-unknown",
        source=source.name,
        target=target.name,
        grid=lacking[0] if lacking else None,
        accuracy_m=best.accuracy if best is not None and best.accuracy >= 0.0 else None,
    )
