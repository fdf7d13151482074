"""The one way in for points with heights: tables, vector files, and the heights of a field folder of AgOpenGPS."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
import pyproj
import shapely
from numpy.typing import NDArray

from furrowmap.core.geodesy.crs_change import bounds_in, crs_change, horizontal_part
from furrowmap.core.geodesy.longitudes import FEWEST_METRES, SaidBy, expect_degrees
from furrowmap.core.readers.agopengps import elevation_file, read_elevations
from furrowmap.core.readers.column_names import ELLIPSOIDAL_H, SEA_LEVEL_H, in_units, means, standard_name, without_unit
from furrowmap.core.readers.text_table import TextTable, is_spreadsheet, read_table
from furrowmap.core.readers.vector_file import is_vector, read_points_of_layer, said_by
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import FurrowmapError, InputError, Notice, RefusedError
from furrowmap.core.runtime.languages.texts import Text, Words, reason
from furrowmap.core.runtime.plain_reads import open_plain
from furrowmap.core.values.crs import full_name_of
from furrowmap.core.values.height_units import (
    ELLIPSOIDAL_HEIGHT,
    compound_crs,
    expect_upward,
    height_kind,
    vertical_unit_m,
)
from furrowmap.core.values.no_heights import are_no_heights

MAX_SURVEY_BYTES: Final = 50_000_000
_NAME_COLUMNS: Final = (
    "name", "id", "point", "point_id", "label", "点名", "nom", "punkt", "punktnummer", "punto", "nombre",
)  # fmt: skip
_PLACE_COLUMNS: Final = (
    ("e_m", "n_m"), ("easting", "northing"), ("e", "n"), ("x", "y"), ("east", "north"), ("y座標", "x座標"),
    ("lon_deg", "lat_deg"), ("lon", "lat"), ("longitude", "latitude"),
)  # fmt: skip
"""Accepted names of columns, in any case, without units in brackets. X is the easting, unlike in Japanese surveying."""
_DEGREE_COLUMNS: Final = ("lon_deg", "lon", "longitude")
_ELLIPSOIDAL: Final = ("ellipsoidal height", "ellipsoidal_height", "ellipsoid_height", "ell_height", "楕円体高")
_HEIGHT_COLUMNS: Final = (
    "h_m", "height", "h", "z", "elevation", "elev", "height_m", "alt", "標高", "altitude", "elevation_m", "z_m",
    "altitude_m", "alt_m", "orthometric height", "orthometric_height", "höhe", "hoehe", *_ELLIPSOIDAL,
)  # fmt: skip
_MEANT_HEIGHTS: Final = ("h_m", SEA_LEVEL_H, ELLIPSOIDAL_H)
_ROLE_COLUMNS: Final = ("role", "point_role", "point_type", "gcp_type", "役割", "用途")
"""Of a column that says which points are of control and which are to check."""
_TARGET_COLUMNS: Final = ("target", "target_type", "ターゲット")
"""Of a column that says what lies at the points."""
_DEVIATION_COLUMNS: Final = (
    ("sigma_e_m", "sigma_e", "sd_e", "easting rms"),
    ("sigma_n_m", "sigma_n", "sd_n", "northing rms"),
    ("sigma_h_m", "sigma_h", "sd_h", "elevation rms"),
)
"""Standard deviations along the axes; those of Emlid's programs among them."""
_MOST_DEGREES: Final = (360.0, 90.0)
_SAME_HEIGHT_M: Final = 0.001
_OTHER_HEIGHT_M: Final = 0.01


@dataclass(frozen=True)
class SurveyedPoints:
    """n points (n, 3) in the CRS of a product, and the standard deviations that the survey states, nan without.

    Attributes:
        role: of each, as the file writes it; empty where no column has roles.
        target: what lies at each, likewise.
    """

    name: tuple[str, ...]
    xyz_m: FloatArray
    sigma_m: FloatArray
    role: tuple[str, ...] = ()
    target: tuple[str, ...] = ()
    notices: tuple[Notice, ...] = ()

    def __len__(self) -> int:
        return len(self.name)


def read_points(path: Path, target: pyproj.CRS, crs: pyproj.CRS | None = None) -> SurveyedPoints:
    """Surveyed points of a CSV or a vector file, in the horizontal CRS of a product.

    Args:
        path: of a GeoPackage, FlatGeobuf, Shapefile, GeoJSON or KML; of a CSV or spreadsheet, which has columns such
            as name, e_m, n_m, h_m (or lon_deg, lat_deg, h_m), sigma_h_m; or of the heights of AgOpenGPS.
        crs: of a file without one; by default `target` for eastings and northings, and its geographic base CRS for
            longitudes and latitudes.

    Raises:
        InputError: if the file cannot be read, or has no points with heights.
        RefusedError: if PROJ has no exact transformation from the CRS of the points, or the height systems differ.
    """
    rows = _rows_of(path, crs or target)
    source = rows.crs or _crs_of_rows(path, rows, crs or target)
    expect_upward(source, path)
    unit_m = 1.0 if rows.metres else vertical_unit_m(source) or 1.0
    none = are_no_heights(rows.xyz[:, 2], unit_m)
    whole = np.isfinite(rows.xyz).all(axis=1) & ~none
    if not whole.any():
        raise _unreadable(path, Text("has no point with easting, northing and height"))
    flat = horizontal_part(source)
    xyz = rows.xyz[whole]
    xyz[:, :2], converted = in_units(flat, xyz[:, :2], rows.units_m)
    notices = [*rows.notices, *converted]
    if none.any():
        values = ", ".join(f"{value:.7g}" for value in np.unique(rows.xyz[none, 2])[:5])
        notices.append(Notice("nodata-undeclared.points", path=path.name, count=int(none.sum()), values=values))
    if not (whole | none).all():
        notices.append(Notice("points-incomplete", path=path.name, whole=int((~(whole | none)).sum())))
    sigma = rows.sigma[whole]
    kept = np.flatnonzero(whole)
    names, roles, targets = (_of_points(said, kept) for said in (rows.names, rows.roles, rows.targets))
    if unit_m != 1.0:
        xyz = xyz * np.array([1.0, 1.0, unit_m])
        sigma = sigma * np.where(rows.sigma_metres, 1.0, unit_m)
        notices.append(Notice("heights-in-feet", unit_m=unit_m))
    kinds = [height_kind(source), height_kind(target)]
    if rows.ellipsoidal:
        kinds[0] = ELLIPSOIDAL_HEIGHT
    if None not in kinds and kinds[0] != kinds[1]:
        raise RefusedError("check-heights", path=path, kinds=kinds[0], kinds_other=kinds[1])
    wanted = horizontal_part(target)
    if flat.is_geographic:
        expect_degrees(path, xyz[:, :2], flat, rows.said_by)
    if not flat.equals(wanted, ignore_axis_order=True):
        change = crs_change(flat, wanted, bounds_in(flat, xyz[:, :2]))
        xyz = np.column_stack([change.points(xyz[:, :2]), xyz[:, 2]])
        notices += change.notices
    return SurveyedPoints(names, xyz, np.where(sigma > 0.0, sigma, np.nan), roles, targets, tuple(notices))


def _crs_of_rows(path: Path, rows: "_SurveyRows", stated: pyproj.CRS) -> pyproj.CRS:
    """The CRS of the rows of a table; of longitudes and latitudes the geographic base of a stated map."""
    flat = horizontal_part(stated)
    base = flat.geodetic_crs
    if flat.is_geographic and (np.nanmax(np.abs(rows.xyz[:, :2]), axis=0, initial=0.0) > _MOST_DEGREES).any():
        raise InputError("points-crs-missing", path=path, flat=full_name_of(flat))
    if not rows.degrees or flat.is_geographic or base is None:
        return stated
    return compound_crs(base.to_2d(), stated.sub_crs_list[1]) if stated.is_compound else base.to_2d()


def in_degrees(path: Path) -> bool:
    """Whether a file has longitudes and latitudes without a CRS; false for what cannot be read."""
    try:
        return _rows_of(path).degrees
    except FurrowmapError:
        return False


@dataclass(frozen=True)
class _SurveyRows:
    """The n points of a file as it has them: coordinates (n, 3) and standard deviations (n, 3), nan where unknown.

    Attributes:
        ellipsoidal: whether the column of heights says that they are above the ellipsoid.
        metres: whether they are in metres, as it says; else in the unit of the CRS.
        said_by: what says that the coordinates are degrees, if they are.
        sigma_metres: whether the standard deviations along each axis are in metres, as their columns say.
        units_m: of eastings and northings, in metres, None where they are in that of the CRS.
    """

    names: list[str]
    xyz: FloatArray
    sigma: FloatArray
    degrees: bool = False
    ellipsoidal: bool = False
    metres: bool = False
    sigma_metres: tuple[bool, ...] = (False, False, False)
    crs: pyproj.CRS | None = None
    units_m: tuple[float | None, float | None] = (None, None)
    notices: tuple[Notice, ...] = ()
    said_by: SaidBy = "table"
    roles: tuple[str, ...] = ()
    targets: tuple[str, ...] = ()


def _rows_of(path: Path, otherwise: pyproj.CRS | None = None) -> _SurveyRows:
    """The points of a file or of a field folder of AgOpenGPS, as it has them; `otherwise` is the CRS of one without."""
    heights = elevation_file(path)
    if heights is not None:
        return _rows_of_agopengps(heights)
    if not path.is_file():
        raise _unreadable(path, "is a folder" if path.is_dir() else Text("is not there"))
    if path.stat().st_size > MAX_SURVEY_BYTES:
        raise _unreadable(path, Text("has {size:,} bytes: too many for a survey", size=path.stat().st_size))
    with open_plain(path) as file:
        head = file.read(4096)
    if not is_vector(head) or is_spreadsheet(path):
        above_ellipsoid = otherwise is not None and height_kind(otherwise) == ELLIPSOIDAL_HEIGHT
        return _rows_of_table(path, above_ellipsoid=above_ellipsoid)
    return replace(_rows_of_layer(path, otherwise), said_by=said_by(head))


def _rows_of_agopengps(path: Path) -> _SurveyRows:
    found = read_elevations(path, partial(_unreadable, path))
    count = len(found.lon_lat_h)
    names = [str(k) for k in range(1, count + 1)]
    notice = Notice("points-of-guidance", path=path.name, points=count, unfixed=count - found.fixed)
    unknown = np.full((count, 3), np.nan)
    return _SurveyRows(names, found.lon_lat_h, unknown, degrees=True, metres=True, notices=(notice,))


def _rows_of_layer(path: Path, otherwise: pyproj.CRS | None) -> _SurveyRows:
    try:
        layer = read_points_of_layer(path)
    except RefusedError:
        raise
    except InputError as error:
        raise _unreadable(path, Text("cannot be read ({why:clause})", why=error.words("what"))) from None
    except Exception as error:  # noqa: BLE001 the errors of GDAL have no family of their own
        why = reason(error)
        raise _unreadable(path, why if isinstance(why, Text) else Text("cannot be read ({why})", why=why)) from None
    if not any(shape is not None for shape in layer.shapes):
        raise _unreadable(path, Text("holds no point"))
    notices: list[Notice] = []
    cells = {name.strip().casefold(): list(map(_text, values.tolist())) for name, values in layer.columns.items()}
    table = TextTable(cells, list(range(1, 1 + len(layer))), decimal_comma=False)
    parts = shapely.get_num_geometries(layer.shapes)
    members = np.maximum(parts, 1)
    feature = np.repeat(np.arange(len(layer)), members)
    single = np.full(len(feature), None, object)
    single[(parts > 0)[feature]] = shapely.get_parts(layer.shapes)
    single[shapely.is_empty(single)] = None
    names = _names(table)
    labels = [
        names[k] if members[k] == 1 else f"{names[k]}/{part}"
        for k, many in enumerate(members.tolist())
        for part in range(1, many + 1)
    ]
    if (several := int((members > 1).sum())) > 0:
        notices.append(Notice("points-split", path=path.name, several=several, points=int(members[members > 1].sum())))
    xyz: FloatArray = np.column_stack([part(single) for part in (shapely.get_x, shapely.get_y, shapely.get_z)])
    column = _first_filled(table, _HEIGHT_COLUMNS) or table.find([_HEIGHT_COLUMNS[0], "z"])
    stated = None
    crs = layer.crs or otherwise
    own_m = vertical_unit_m(crs) if crs is not None else None
    if column is not None:
        unit_m = table.unit_m(column)
        stated = table.numbers(column)[feature] * ((unit_m or 1.0) / (own_m or 1.0) if unit_m is not None else 1.0)
        is_told = unit_m not in (None, 1.0) and own_m in (None, 1.0)
        notices += [Notice("heights-in-feet", unit_m=unit_m)] if is_told else []
        notices += _other_heights(table, column, path)
    xyz[:, 2], about = _heights(path, xyz[:, 2], column, stated)
    sigma, in_metres = _sigmas(table)
    found = (*notices, *layer.notices, *about)
    roles, targets = (_of_points(_said(table, names), feature) for names in (_ROLE_COLUMNS, _TARGET_COLUMNS))
    rows = _SurveyRows(labels, xyz, sigma[feature], sigma_metres=in_metres, crs=layer.crs, notices=found)
    return replace(rows, roles=roles, targets=targets)


def _text(value: object) -> str:
    """A value as the cell of a table; whole numbers without decimals, as names are."""
    if value is None or value != value:
        return ""
    return str(int(value)) if isinstance(value, float) and value.is_integer() else str(value)


def _heights(
    path: Path, z: FloatArray, column: str | None, stated: FloatArray | None
) -> tuple[FloatArray, list[Notice]]:
    """Heights (n,) of points with z or without, and of a column (n,) if there is one.

    Programs write z = 0 where no height was put in, and the height in a column.
    """
    with_z = np.isfinite(z)
    empty = with_z & (z == 0.0)
    if stated is None:
        nothing = bool(with_z.sum() > 1 and empty.sum() == with_z.sum())
        return z, [Notice("points-zero", path=path.name)] if nothing else []
    both = with_z & ~empty & np.isfinite(stated)
    apart = np.abs(z - stated)[both]
    agree = not len(apart) or bool((apart <= _SAME_HEIGHT_M).all())
    heights = np.where(with_z & ~(empty & agree & np.isfinite(stated)), z, stated)
    if not len(apart) or float(np.median(apart)) <= _OTHER_HEIGHT_M:
        return heights, []
    return heights, [Notice("points-two-heights", path=path.name, column=column, apart_m=float(np.median(apart)))]


def _rows_of_table(path: Path, *, above_ellipsoid: bool) -> _SurveyRows:
    table = read_table(path, lambda why: _unreadable(path, Text("is no table: {why}", why=why)))
    place = _place(table)
    preferred = [name for name in _HEIGHT_COLUMNS if _is_ellipsoidal(table, name) == above_ellipsoid]
    height = _first_filled(table, (*preferred, *_HEIGHT_COLUMNS)) or table.find((*_HEIGHT_COLUMNS, ELLIPSOIDAL_H))
    missing = [*(_PLACE_COLUMNS[0] if place is None else ()), *(_HEIGHT_COLUMNS[:1] if height is None else ())]
    if place is None or height is None:
        raise _unreadable(
            path, Text("has no column {missing} (its columns: {names})", missing=", ".join(missing), names=table.names)
        )
    wanted = (*place, height)
    if not all(_filled(table, name) for name in wanted):
        fault = table.first_fault(wanted)
        raise _unreadable(path, Text("has no point with easting, northing and height{fault:: {fault}|}", fault=fault))
    xyz = np.column_stack([table.numbers(name) for name in wanted])
    degrees = any(means(table.written.get(place[0], place[0]), name) for name in _DEGREE_COLUMNS)
    if degrees and 90.0 < (largest := np.nanmax(np.abs(xyz[:, 1]))) <= FEWEST_METRES:
        raise _unreadable(
            path, Text("has latitudes such as {largest:g}: longitude and latitude are swapped", largest=largest)
        )
    unit_m = table.unit_m(height)
    xyz[:, 2] *= unit_m or 1.0
    notices = [*table.notices, *([Notice("heights-in-feet", unit_m=unit_m)] if unit_m not in (None, 1.0) else [])]
    notices += _other_heights(table, height, path)
    units = (None, None) if degrees else (table.unit_m(place[0]), table.unit_m(place[1]))
    sigma, in_metres = _sigmas(table)
    told = (degrees, _is_ellipsoidal(table, height), unit_m is not None, in_metres)
    rows = _SurveyRows(_names(table), xyz, sigma, *told, units_m=units, notices=tuple(notices))
    return replace(rows, roles=_said(table, _ROLE_COLUMNS), targets=_said(table, _TARGET_COLUMNS))


def _is_ellipsoidal(table: TextTable, name: str) -> bool:
    """Whether a column says that its heights are above the ellipsoid."""
    return name in _ELLIPSOIDAL or standard_name(table.written.get(name, name)) == ELLIPSOIDAL_H


def _other_heights(table: TextTable, used: str, path: Path) -> list[Notice]:
    """Notices of further columns of heights that differ from those that are used."""
    found = []
    used_m = table.numbers(used) * (table.unit_m(used) or 1.0)
    for name in table.columns:
        written = table.written.get(name, name)
        meant = standard_name(written) or without_unit(written)
        if name == used or (name not in _HEIGHT_COLUMNS and meant not in _MEANT_HEIGHTS):
            continue
        apart_m = np.abs(table.numbers(name) * (table.unit_m(name) or 1.0) - used_m)
        apart_m = apart_m[np.isfinite(apart_m)]
        if len(apart_m) and np.median(apart_m) > _OTHER_HEIGHT_M:
            column = table.written.get(used, used)
            values = {"path": path.name, "column": column, "other": written, "apart_m": float(np.median(apart_m))}
            found.append(Notice("points-two-heights.columns", **values))
    return found


def _place(table: TextTable) -> tuple[str, str] | None:
    """The columns of the places: those that are named as furrowmap does and are filled, else any that mean it."""
    pairs = [pair for pair in _PLACE_COLUMNS if set(pair) <= set(table.columns)]
    place = next((pair for pair in pairs if all(_filled(table, name) for name in pair)), None)
    for pair in () if place else _PLACE_COLUMNS:
        east, north = (table.find([name]) for name in pair)
        if east is not None and north is not None:
            return east, north
    return place or next(iter(pairs), None)


def _filled(table: TextTable, name: str) -> bool:
    return bool(np.isfinite(table.numbers(name)).any())


def _first_filled(table: TextTable, names: Sequence[str]) -> str | None:
    return next((name for name in names if name in table.columns and _filled(table, name)), None)


def _names(table: TextTable) -> list[str]:
    """The names of points, their numbers without."""
    column = table.find(_NAME_COLUMNS)
    return [str(k) for k in range(1, len(table.lines) + 1)] if column is None else table.columns[column]


def _said(table: TextTable, names: Sequence[str]) -> tuple[str, ...]:
    """What a column says of each point; empty without the column."""
    column = table.find(names)
    return () if column is None else tuple(text.strip() for text in table.columns[column])


def _of_points(said: Sequence[str], rows: NDArray[np.intp]) -> tuple[str, ...]:
    """What a column says of the points of some rows."""
    return tuple(said[k] for k in rows) if said else ()


def _sigmas(table: TextTable) -> tuple[FloatArray, tuple[bool, ...]]:
    """Standard deviations (n, 3), and whether those of each axis are in metres, as their columns say."""
    found = [_first_filled(table, names) or table.find(names[:1]) for names in _DEVIATION_COLUMNS]
    unknown = np.full(len(table.lines), np.nan)
    units_m = [None if name is None else table.unit_m(name) for name in found]
    columns = [
        unknown if name is None else table.numbers(name) * (unit_m or 1.0)
        for name, unit_m in zip(found, units_m, strict=True)
    ]
    return np.column_stack(columns), tuple(unit_m is not None for unit_m in units_m)


def _unreadable(path: Path, why: Words) -> InputError:
    return InputError("points-unreadable", path=path, why=why)
