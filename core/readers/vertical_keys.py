"""Heights by GeoTIFF keys: the code of their CRS and, beside it, that of their unit, of which GDAL heeds only one."""

import math
from collections.abc import Mapping
from functools import cache
from typing import Final

import pyproj
from pyproj.database import get_units_map
from pyproj.exceptions import CRSError

from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.height_units import compound_crs, vertical_unit_m, with_height_unit

_VERTICAL: Final = 4096
"""Code of the vertical CRS or, in older files, of its datum."""
_VERTICAL_UNIT: Final = 4099
_SAME_UNIT: Final = 1e-9
_UNKNOWN: Final = 'VERTCRS["unknown",VDATUM["unknown"],CS[vertical,1],AXIS["up",up],LENGTHUNIT["metre",1]]'


def heights_by_keys(
    path_name: str, codes: Mapping[int, int], found: pyproj.CRS | None
) -> tuple[pyproj.CRS | None, tuple[Notice, ...]]:
    """The vertical CRS that keys state, in the unit that they state; None if they state neither.

    Args:
        codes: values of the keys that have one number.
        found: the CRS that GDAL reads from all keys; it drops the unit beside the code of a vertical CRS.
    """
    code = codes.get(_VERTICAL, 0)
    own = _vertical(code)
    vertical = found.sub_crs_list[1] if found is not None and found.is_compound else own
    unit = _units().get(codes.get(_VERTICAL_UNIT, 0))
    if unit is None:
        return vertical, ()
    unit_m, unit_name = unit
    base = vertical or pyproj.CRS.from_wkt(_UNKNOWN)
    base_m = float(base.axis_info[0].unit_conversion_factor)
    if math.isclose(base_m, unit_m, rel_tol=_SAME_UNIT):
        return base, ()
    changed = with_height_unit(base, unit_m, unit_name)
    if own is None:  # a datum, whose heights may have any unit
        return changed, ()
    return changed, heights_differ(path_name, changed, own, ("VerticalUnits", f"VerticalCSType {code}"))


def with_heights(crs: pyproj.CRS, vertical: pyproj.CRS) -> pyproj.CRS:
    """The map of a CRS with the heights of another; a compound CRS gets these instead of its own."""
    flat = crs.sub_crs_list[0] if crs.is_compound else crs
    return compound_crs(flat, vertical)


def tells_more(crs: pyproj.CRS, vertical: pyproj.CRS) -> bool:
    """Whether heights have a datum, or another unit than those of a CRS that states none have."""
    unit_m = float(vertical.axis_info[0].unit_conversion_factor)
    named = vertical.datum is not None and vertical.datum.name != "unknown"
    return named or not math.isclose(vertical_unit_m(crs) or 1.0, unit_m, rel_tol=_SAME_UNIT)


def heights_differ(
    path_name: str, first: pyproj.CRS, second: pyproj.CRS, stated_by: tuple[str, str]
) -> tuple[Notice, ...]:
    """A notice where two vertical CRSs that a file states have different units."""
    unit_m, other_m = (float(one.axis_info[0].unit_conversion_factor) for one in (first, second))
    if math.isclose(unit_m, other_m, rel_tol=_SAME_UNIT):
        return ()
    names = {"stated_by": stated_by[0], "other_by": stated_by[1]}
    return (Notice("height-units-differ", path=path_name, unit_m=unit_m, other_m=other_m, **names),)


@cache
def _units() -> dict[int, tuple[float, str]]:
    """Metres in units of length and their names, by EPSG's codes."""
    units = get_units_map(auth_name="EPSG", category="linear", allow_deprecated=True)
    return {int(one.code): (one.conv_factor, name) for name, one in units.items()}


def _vertical(code: int) -> pyproj.CRS | None:
    try:
        crs = pyproj.CRS.from_epsg(code) if code else None
    except CRSError:
        return None
    return crs if crs is not None and crs.is_vertical else None
