"""Units of heights: which a CRS states, and the same CRS with another."""

import math
from pathlib import Path
from typing import Any, Final

from pyproj import CRS
from pyproj.crs import CompoundCRS
from pyproj.exceptions import CRSError

from furrowmap.core.runtime.errors import InputError

ELLIPSOIDAL_HEIGHT: Final = "ellipsoidal height"


def height_kind(crs: CRS) -> str | None:
    """What the heights of a CRS are above, whatever their unit: the name of a vertical CRS; None if it states none."""
    if crs.is_compound:
        metric = in_metres(crs)
        assert metric is not None
        return str(metric.sub_crs_list[1].name)
    return ELLIPSOIDAL_HEIGHT if len(crs.axis_info) > 2 else None


def expect_upward(crs: CRS, path: Path) -> None:
    """Raises InputError where the heights of a file count downwards, as those of CRSs of depths do."""
    vertical = crs.sub_crs_list[1] if crs.is_compound else None
    if vertical is not None and vertical.axis_info[0].direction.lower() == "down":
        raise InputError("heights-downward", path=path, vertical=vertical.name)


def vertical_unit_m(crs: CRS) -> float | None:
    """Metres in the unit of a CRS's heights; that of its map where it states none. None for degrees alone."""
    if crs.is_compound:
        return float(crs.sub_crs_list[1].axis_info[0].unit_conversion_factor)
    if len(crs.axis_info) > 2:
        return float(crs.axis_info[2].unit_conversion_factor)
    return float(crs.axis_info[0].unit_conversion_factor) if crs.is_projected else None


def with_height_unit(vertical: CRS, unit_m: float, unit_name: str) -> CRS:
    """A vertical CRS of the same datum whose heights have a unit.

    Its name then ends with that unit in brackets, unless it is the metre.
    """
    base = vertical.name.rsplit(" (", 1)[0]
    if unit_m == 1.0:
        known = _known(base)
        if known is not None and known.is_vertical and known.datum == vertical.datum:
            return known
    content: dict[str, Any] = vertical.to_json_dict()
    for name in ("id", "usages", "scope", "area", "bbox", "remarks"):
        content.pop(name, None)
    content["name"] = base if unit_m == 1.0 else f"{base} ({unit_name})"
    unit = "metre" if unit_m == 1.0 else {"type": "LinearUnit", "name": unit_name, "conversion_factor": unit_m}
    for axis in content["coordinate_system"]["axis"]:
        axis["unit"] = unit
    return CRS.from_json_dict(content)


def in_metres(crs: CRS | None) -> CRS | None:
    """A CRS of the same map and datum whose heights are in metres."""
    if crs is None or not crs.is_compound:
        return crs
    flat, vertical = crs.sub_crs_list[:2]
    if math.isclose(vertical.axis_info[0].unit_conversion_factor, 1.0):
        return crs
    metric = with_height_unit(vertical, 1.0, "metre")
    return compound_crs(flat, metric)


def compound_crs(flat: CRS, vertical: CRS) -> CRS:
    """A CRS of a map and of heights."""
    # a CompoundCRS itself has no to_2d (pyproj 3.7)
    return CRS.from_json(CompoundCRS(f"{flat.name} + {vertical.name}", [flat, vertical]).to_json())


def _known(name: str) -> CRS | None:
    try:
        return CRS.from_user_input(name)
    except CRSError:
        return None
