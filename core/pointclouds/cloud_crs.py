"""The CRS that several clouds have in common: that of each file, and what takes its points to the CRS of the output.

Files state a CRS as an EPSG code, in WKT 1 or WKT 2, with or without heights, a local one, or none at all. `--crs` says
what they do not state, and `--dst-crs` which CRS the output has.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Final

import numpy as np
import pyproj

from furrowmap.core.geodesy.crs_change import CrsChange, bounds_in, crs_change
from furrowmap.core.geodesy.measurable_crs import Bounds, expect_map, proposed_crs
from furrowmap.core.geodesy.projection import is_in_area
from furrowmap.core.readers.las.cloud import CloudFile
from furrowmap.core.runtime.errors import InputError, Notice, RefusedError
from furrowmap.core.values.crs import full_name_of, name_of
from furrowmap.core.values.height_units import compound_crs, expect_upward, in_metres, vertical_unit_m
from furrowmap.core.values.no_heights import NO_HEIGHTS, far_from_heights, is_any

SAME_PLACE_M: Final = 1e-4
SAME_UNIT: Final = 1e-5
"""The international and the US survey foot differ by 2e-6 of their length."""
MAX_DEGREES: Final = 1_000.0
"""Larger coordinates are no angles that a program got wrong, but those of a map."""
MAX_FAR_SHARE: Final = 0.001
"""Largest share of points that are left out."""


@dataclass(frozen=True)
class CloudSource:
    """The CRS of a file of several, and what takes its points to that of all.

    Attributes:
        crs: as the file states it, or the user where it states none.
        flat: its horizontal part.
        change: transformation from `flat`; None where that is the CRS of all.
        unit_m: metres in the unit of the heights.
        no_heights: heights in the file, in its unit, that are none.
    """

    crs: pyproj.CRS
    flat: pyproj.CRS
    change: CrsChange | None
    unit_m: float
    no_heights: tuple[float, ...] = ()


@dataclass(frozen=True)
class CommonCrs:
    """The CRS of several files together.

    Attributes:
        crs: of the output, projected in metres, with a vertical part where known.
        sources: of each file, by its path.
        notices: what a user should know of the choice.
    """

    crs: pyproj.CRS
    sources: Mapping[Path, CloudSource]
    notices: tuple[Notice, ...]


def common_crs(
    files: Sequence[CloudFile], crs: pyproj.CRS | None, dst_crs: pyproj.CRS | None, *, without_option: bool
) -> CommonCrs:
    """The CRS of the output of some files, and of each of them.

    Arguments and errors are those of :func:`.clouds.open_clouds`.
    """
    found = [_source_crs(file, crs) for file in files]
    whole = [source for source, _ in found]
    notices = [notice for _, own in found for notice in own]
    vertical = _common_heights(files, whole)
    places = _places(files, whole)
    for file, place in zip(files, places, strict=True):
        notices += _expect_place(file, place)
    if dst_crs is None:
        target = _common_map(files, places)
        changes: dict[pyproj.CRS, CrsChange | None] = {place.flat: None for place in places}
        stated_by = str(files[0].path) if files[0].crs is not None else f"{files[0].path} (--crs)"
        notices += expect_map(target, _known(places)[:1], stated_by=stated_by)
    else:
        target = horizontal_and_vertical(dst_crs)[0]
        if not without_option:
            _expect_heights(dst_crs, vertical, target)
        changes, changed = _changes(places, target, without_option=without_option)
        notices += changed
    sources: dict[Path, CloudSource] = {}
    for file, source, place in zip(files, whole, places, strict=True):
        expect_upward(source, file.path)
        # without a vertical CRS heights have the unit of the horizontal one, as is usual in LAS files
        unit_m = vertical_unit_m(source) or 1.0
        if unit_m != 1.0:
            notices.append(Notice("heights-in-feet", unit_m=unit_m))
        none = _no_heights(file, unit_m)
        if none:
            values = ", ".join(f"{value:.7g}" for value in none)
            notices.append(Notice("nodata-undeclared.cloud", path=file.path.name, values=values))
        sources[file.path] = CloudSource(source, place.flat, changes[place.flat], unit_m, none)
    output = target if vertical is None else compound_crs(target, vertical)
    return CommonCrs(output, sources, tuple(notices))


def _no_heights(file: CloudFile, unit_m: float) -> tuple[float, ...]:
    """The least or greatest height of a file, in its unit, where programs write it for none, and others are far off.

    Only numbers are looked for that are no land on Earth, in metres: others may be those of some points of many.
    """
    ends = np.array([file.header.low[2], file.header.high[2]])
    written = np.array([number for number in NO_HEIGHTS if number <= -999.0 or number >= 9999.0])
    near = np.abs(ends[:, None] - written) <= file.header.scale[2]
    found = ends[near.any(axis=1)]
    if not len(found):
        return ()
    z = np.concatenate([np.empty(0), *(batch.xyz_m[:, 2] for batch in islice(file.batches(batch_points=10_000), 1))])
    z = z[~is_any(z, found, file.header.scale[2])]
    if not len(z):
        return ()
    far = far_from_heights(found, float(z.min()), float(z.max()), unit_m, with_zero=False)
    return tuple(far.tolist())


def _source_crs(file: CloudFile, crs: pyproj.CRS | None) -> tuple[pyproj.CRS, list[Notice]]:
    """The CRS of a file: its own, or the stated one where it has none of a place on the Earth."""
    if file.crs is None:
        if crs is None:
            raise InputError(
                "crs-missing", file=file.path, is_file=any(notice.code == "crs-unreadable" for notice in file.notices)
            )
        return crs, []
    flat, height = horizontal_and_vertical(file.crs)
    if flat.is_geocentric:
        raise InputError("crs-geocentric", file=file.path, crs=full_name_of(file.crs))
    if not (flat.is_projected or flat.is_geographic):
        return _georeferenced(file, crs)
    if height is not None or crs is None or vertical_unit_m(file.crs) != 1.0:
        return file.crs, []
    stated, stated_height = horizontal_and_vertical(crs)
    if stated_height is None or not _same_map(flat, stated, first_bounds([file], flat)):
        return file.crs, []
    return compound_crs(flat, stated_height), []


def _georeferenced(file: CloudFile, crs: pyproj.CRS | None) -> tuple[pyproj.CRS, list[Notice]]:
    """The stated CRS of a file in a local one, or in one of heights alone."""
    assert file.crs is not None
    own = full_name_of(file.crs)
    if crs is None:
        raise InputError("crs-local", file=file.path, crs=own)
    flat, height = horizontal_and_vertical(file.crs)
    stated, stated_height = horizontal_and_vertical(crs)
    if flat.is_vertical:
        return crs if stated_height is not None else compound_crs(stated, flat), []
    units_m = [one.axis_info[0].unit_conversion_factor for one in (flat, stated)]
    names = [one.axis_info[0].unit_name for one in (flat, stated)]
    if not stated.is_geographic and not math.isclose(*units_m, rel_tol=SAME_UNIT):
        raise InputError(
            "crs-local.foreign-unit", file=file.path, crs=own, unit=names[0], stated=name_of(crs), other=names[1]
        )
    taken = crs if height is None or stated_height is not None else compound_crs(stated, height)
    return taken, [Notice("crs-of-local", path=file.path.name, crs=own, stated=name_of(crs))]


def _common_heights(files: Sequence[CloudFile], whole: Sequence[pyproj.CRS]) -> pyproj.CRS | None:
    """The vertical CRS of all files, in metres; None where none states one."""
    found = [horizontal_and_vertical(in_metres(crs) or crs)[1] for crs in whole]
    first = found[0]
    for file, crs, other in zip(files, whole, found, strict=True):
        if other is first or (first is not None and other is not None and _same_heights(first, other)):
            continue
        option = None
        if first is None or other is None:
            option = _compound_code(whole[0] if first is None else crs, first or other)
        raise InputError(
            "heights-differ-in-clouds",
            first_file=files[0].path,
            first=first.name if first is not None else None,
            file=file.path,
            other=other.name if other is not None else None,
            option=option,
        )
    return first


def _same_heights(one: pyproj.CRS, other: pyproj.CRS) -> bool:
    """Whether two vertical CRSs in metres are the same, whatever the names that WKT 1 gives them."""
    if one.equals(other):
        return True
    codes = [crs.to_epsg(min_confidence=20) for crs in (one, other)]
    return codes[0] is not None and codes[0] == codes[1]


def _same_map(one: pyproj.CRS, other: pyproj.CRS, bounds: Bounds | None) -> bool:
    """Whether two horizontal CRSs are the same, whatever the names that WKT 1 gives them."""
    if one.equals(other, ignore_axis_order=True):
        return True
    bases = [crs.geodetic_crs for crs in (one, other)]
    if bounds is None or bases[0] is None or bases[1] is None or one.is_projected != other.is_projected:
        return False
    codes = [base.to_epsg(min_confidence=20) for base in bases if base is not None]
    if codes[0] is None or codes[0] != codes[1]:
        return False
    at = 0.5 * (bounds[0] + bounds[2]), 0.5 * (bounds[1] + bounds[3])
    there = pyproj.Transformer.from_crs(one, other, always_xy=True).transform(*at)
    return math.dist(at, there) < SAME_PLACE_M


def _compound_code(flat: pyproj.CRS, vertical: pyproj.CRS | None) -> str | None:
    """The codes of a CRS and of heights as --crs takes them; None where one has no code."""
    codes = [crs.to_authority() for crs in (horizontal_and_vertical(flat)[0], vertical) if crs is not None]
    if len(codes) < 2 or codes[0] is None or codes[1] is None or codes[0][0] != codes[1][0]:
        return None
    return f"{codes[0][0]}:{codes[0][1]}+{codes[1][1]}"


@dataclass(frozen=True)
class _FilePlace:
    """The horizontal CRS of a file, and the bounds of some of the points in it; None without points."""

    flat: pyproj.CRS
    bounds: Bounds | None


def _places(files: Sequence[CloudFile], whole: Sequence[pyproj.CRS]) -> list[_FilePlace]:
    """Where the files are; the first points of files of one CRS stand for all of them."""
    found: dict[pyproj.CRS, _FilePlace] = {}
    for crs in whole:
        flat = horizontal_and_vertical(crs)[0]
        if flat not in found:
            same = [file for file, other in zip(files, whole, strict=True) if horizontal_and_vertical(other)[0] == flat]
            bounds = first_bounds(same, flat)
            found[flat] = _FilePlace(_identify_crs(flat, bounds) if bounds is not None else flat, bounds)
    return [found[horizontal_and_vertical(crs)[0]] for crs in whole]


def _expect_place(file: CloudFile, place: _FilePlace) -> list[Notice]:
    """A notice where the CRS that the user stated for a file puts it where that CRS is not used.

    Raises InputError where its coordinates are no degrees, though its CRS has degrees.
    """
    if place.bounds is None:
        return []
    x, y = place.bounds[:2]
    if place.flat.is_geographic and max(abs(x), abs(y)) > MAX_DEGREES:
        raise InputError(
            "not-degrees.in-cloud",
            path=file.path,
            x=x,
            y=y,
            crs=full_name_of(place.flat),
            is_stated=file.crs is None,
        )
    area = place.flat.area_of_use
    base = place.flat.geodetic_crs
    if file.crs is not None or area is None or base is None:
        return []
    lon, lat = pyproj.Transformer.from_crs(place.flat, base.to_2d(), always_xy=True).transform(x, y)
    if is_in_area(area.bounds, lon, lat):
        return []
    return [
        Notice(
            "crs-stated-elsewhere",
            path=file.path.name,
            crs=full_name_of(place.flat),
            area=area.name,
            is_known=bool(np.isfinite([lon, lat]).all()),
            lat=lat if math.isfinite(lat) else None,
            lon=lon if math.isfinite(lon) else None,
        )
    ]


def _common_map(files: Sequence[CloudFile], places: Sequence[_FilePlace]) -> pyproj.CRS:
    """The horizontal CRS that all files have; InputError if they have several."""
    first = places[0].flat
    for file, place in zip(files, places, strict=True):
        if not _same_map(first, place.flat, place.bounds):
            raise InputError(
                "crs-mixed",
                first_file=files[0].path,
                first=full_name_of(first),
                file=file.path,
                other=full_name_of(place.flat),
                proposal=proposed_crs(_known(places)),
            )
    return first


def _changes(
    places: Sequence[_FilePlace], target: pyproj.CRS, *, without_option: bool
) -> tuple[dict[pyproj.CRS, CrsChange | None], list[Notice]]:
    """The transformation from each horizontal CRS of the files to another one; None where they are the same."""
    known = _known(places)
    changes: dict[pyproj.CRS, CrsChange | None] = {}
    try:
        notices = expect_map(target, known)
        for place in places:
            if place.flat in changes:
                continue
            change = None
            if not _same_map(place.flat, target, place.bounds):
                change = crs_change(place.flat, target, place.bounds or (0.0, 0.0, 0.0, 0.0))
                notices += change.notices
            changes[place.flat] = change
    except RefusedError as error:
        if without_option or error.code not in ("crs-change-grid", "crs-change-unknown", "crs-change-outside"):
            raise
        remedy = {"is_output": True, "proposal": proposed_crs(known)}
        raise RefusedError(error.code, **(error.values | remedy)) from None
    return changes, notices


def _known(places: Sequence[_FilePlace]) -> list[tuple[pyproj.CRS, Bounds]]:
    """Where files with points are, a place for each horizontal CRS."""
    found = {place.flat: place.bounds for place in places}
    return [(flat, bounds) for flat, bounds in found.items() if bounds is not None]


def _expect_heights(dst_crs: pyproj.CRS, vertical: pyproj.CRS | None, target: pyproj.CRS) -> None:
    """Refuse a CRS of the output with other heights than those of the files: they are not transformed."""
    stated = horizontal_and_vertical(dst_crs)[1]
    if stated is None or (vertical is not None and _same_heights(stated, vertical)):
        return
    raise InputError(
        "heights-not-transformed",
        stated=stated.name,
        own=vertical.name if vertical is not None else None,
        flat=name_of(target),
    )


def horizontal_and_vertical(crs: pyproj.CRS) -> tuple[pyproj.CRS, pyproj.CRS | None]:
    """Horizontal and vertical part."""
    if crs.is_compound:
        horizontal, vertical = crs.sub_crs_list[:2]
        return horizontal.to_2d(), vertical
    return crs.to_2d(), None


def _identify_crs(flat: pyproj.CRS, place: Bounds) -> pyproj.CRS:
    """The EPSG definition of a CRS that files give as WKT 1 only, where it is the same; else the CRS itself."""
    # WKT 1 has no axis order and no conversion names, so that equal CRS do not compare as equal.
    code = flat.to_epsg(min_confidence=20) if flat.to_epsg() is None else None
    if code is None:
        return flat
    known = pyproj.CRS.from_epsg(code)
    x = 0.5 * (place[0] + place[2])
    y = 0.5 * (place[1] + place[3])
    there = pyproj.Transformer.from_crs(flat, known, always_xy=True).transform(x, y)
    return known if known.name == flat.name and math.dist((x, y), there) < SAME_PLACE_M else flat


def first_bounds(files: Sequence[CloudFile], flat: pyproj.CRS) -> Bounds | None:
    """Bounds of the first points but a few that may lie far off; those of headers may be wrong. None without points."""
    for file in files:
        for batch in file.batches(batch_points=10_000):
            if len(batch):
                xy = batch.xyz_m[:, :2]
                low = np.quantile(xy, MAX_FAR_SHARE, axis=0, method="lower")
                high = np.quantile(xy, 1.0 - MAX_FAR_SHARE, axis=0, method="higher")
                return bounds_in(flat, xy[((xy >= low) & (xy <= high)).all(axis=1)])
    return None
