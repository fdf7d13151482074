"""CRSs in which lengths, slopes and areas can be measured, and which one to propose where a CRS is none of them."""

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final, TypeAlias

import numpy as np
from pyproj import CRS, Proj, Transformer
from pyproj.aoi import AreaOfInterest
from pyproj.database import query_crs_info
from pyproj.enums import PJType
from pyproj.exceptions import CRSError, ProjError

from furrowmap.core.geodesy.crs_change import crs_change
from furrowmap.core.geodesy.crs_choice import choose_crs, choose_utm
from furrowmap.core.geodesy.longitudes import principal_deg
from furrowmap.core.geodesy.projection import MAX_SCALE_ERROR
from furrowmap.core.runtime.errors import FurrowmapError, InputError, Notice
from furrowmap.core.values.crs import full_name_of, name_of

MAX_DISTORTION: Final = 0.01
"""Largest scale error in any direction: national grids stay within it, maps of continents and of the world do not."""

Bounds: TypeAlias = tuple[float, float, float, float]
"""Least x and y, greatest x and y in a horizontal CRS; of longitudes beyond 180° across the antimeridian."""


def is_in_metres(flat: CRS) -> bool:
    """Whether a horizontal CRS is projected in metres."""
    return flat.is_projected and all(axis.unit_conversion_factor == 1.0 for axis in flat.axis_info)


def scales_at(flat: CRS, bounds: Bounds) -> tuple[float, float]:
    """Least and largest scale in any direction in the middle of a place: axes of Tissot's indicatrix.

    Map distance over distance on the ellipsoid; nan where the place lies outside the projection's domain.
    """
    west, south, east, north = bounds
    try:
        projection = Proj(flat.to_2d())
        place = projection(0.5 * (west + east), 0.5 * (south + north), inverse=True)
        factors: Any = projection.get_factors(*place)
        scales = float(factors.tissot_semiminor), float(factors.tissot_semimajor)
    except (CRSError, ProjError):
        return math.nan, math.nan
    return scales if np.isfinite(scales).all() else (math.nan, math.nan)


def expect_map(
    target: CRS, sources: Sequence[tuple[CRS, Bounds]], option: str = "--dst-crs", stated_by: str = ""
) -> list[Notice]:
    """A notice where the scale of a map differs from one by more than those of furrowmap's own runs.

    Args:
        target: a horizontal CRS, that of the sources or another.
        sources: places and their horizontal CRSs.
        option: with which a user chooses another CRS.
        stated_by: what states the CRS; the option by default.

    Raises:
        InputError: if it is not projected in metres, or its scale differs by more than :data:`MAX_DISTORTION`.
        RefusedError: as of :func:`.crs_change`.
    """
    if not is_in_metres(target):
        units = " and ".join(sorted({axis.unit_name for axis in target.axis_info}))
        raise InputError(
            "crs-not-metres",
            stated_by=stated_by or option,
            flat=full_name_of(target),
            units=units,
            option=option,
            proposal=proposed_crs(sources),
        )
    notices: list[Notice] = []
    for source, bounds in sources:
        same = source.equals(target, ignore_axis_order=True)
        least, largest = scales_at(target, bounds if same else moved_bounds(source, bounds, target))
        if max(1.0 - least, largest - 1.0) > MAX_DISTORTION:
            raise InputError(
                "crs-distorted",
                stated_by=stated_by or option,
                flat=full_name_of(target),
                least=least,
                largest=largest,
                areas=least * largest,
                option=option,
                proposal=proposed_crs(sources),
            )
        notices += _scale_notices(target, least, largest)
    return notices


def _scale_notices(flat: CRS, least: float, largest: float) -> list[Notice]:
    error = max(1.0 - least, largest - 1.0)
    if error > MAX_SCALE_ERROR:
        return [Notice("map-scale", flat=name_of(flat), least=least, largest=largest)]
    return []


def proposed_crs(sources: Sequence[tuple[CRS, Bounds]]) -> str | None:
    """The code of a CRS in which places in horizontal CRSs can be measured, such as "EPSG:26918"; None for none.

    PROJ transforms all places to it without further grids. The first choices are on the datum of the places, where a
    projection alone is needed, then the map of the country, then UTM.
    """
    for source, bounds in sources:
        for candidate in _candidates(source, bounds):
            if all(_is_reached(one, around, candidate) for one, around in sources):
                return name_of(candidate)
    return None


def _is_reached(source: CRS, bounds: Bounds, target: CRS) -> bool:
    """Whether PROJ transforms a place to a CRS that can be measured in."""
    try:
        moved = moved_bounds(source, bounds, target)
    except FurrowmapError:
        return False
    least, largest = scales_at(target, moved)
    return max(1.0 - least, largest - 1.0) <= MAX_DISTORTION


def moved_bounds(source: CRS, bounds: Bounds, target: CRS) -> Bounds:
    """The middle of a place in another CRS, as bounds; RefusedError as of :func:`.crs_change`."""
    west, south, east, north = bounds
    middle = np.array([0.5 * (west + east)]), np.array([0.5 * (south + north)])
    x, y = crs_change(source, target, bounds)(*middle)
    return float(x[0]), float(y[0]), float(x[0]), float(y[0])


def _candidates(source: CRS, bounds: Bounds) -> Iterator[CRS]:
    """Projected CRSs in metres around a place, the best first."""
    if is_in_metres(source):
        yield source
    base = source.geodetic_crs
    if base is None:
        return
    west, south, east, north = bounds
    to_degrees = Transformer.from_crs(source, base.to_2d(), always_xy=True)
    lon, lat = to_degrees.transform(0.5 * (west + east), 0.5 * (south + north))
    if not (math.isfinite(lon) and abs(lat) <= 90.0):
        return
    lon = principal_deg(lon)
    choices = [choice for choose in (choose_crs, choose_utm) if (choice := choose(lon, lat)) is not None]
    maps = [CRS(choice.code) for choice in choices]
    code = base.to_epsg(min_confidence=20)
    own = CRS.from_epsg(code).to_2d() if code is not None else base.to_2d()
    for chosen in maps:
        if chosen.geodetic_crs is not None and chosen.geodetic_crs.to_2d().equals(own, ignore_axis_order=True):
            yield chosen
    yield from _of_datum(own.name, lon, lat)
    yield from maps


def _of_datum(name: str, lon: float, lat: float) -> list[CRS]:
    """The CRSs of EPSG on a geographic CRS whose areas of use have a place, UTM first, then by their distortion."""
    area: Any = AreaOfInterest(lon, lat, lon, lat)
    found = query_crs_info(auth_name="EPSG", pj_types=PJType.PROJECTED_CRS, area_of_interest=area)
    ranked = []
    for info in found:
        if not info.name.startswith(f"{name} / "):
            continue
        crs = CRS.from_epsg(info.code)
        if not is_in_metres(crs) or crs.is_compound:
            continue
        x, y = Transformer.from_crs(crs.geodetic_crs, crs, always_xy=True).transform(lon, lat)
        least, largest = scales_at(crs, (x, y, x, y))
        if max(1.0 - least, largest - 1.0) <= MAX_SCALE_ERROR:
            ranked.append(("UTM" not in info.name, largest - least, abs(largest - 1.0), info.code, crs))
    return [crs for *_, crs in sorted(ranked, key=lambda row: row[:-1])]
