"""Surveyed points from a table or a GeoPackage."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyproj
import shapely

from furrowmap.core.geodesy.crs_change import crs_change
from furrowmap.core.readers.areas.area import horizontal_part, nothing_within, read_area
from furrowmap.core.readers.text_table import TextTable, read_table
from furrowmap.core.readers.vector_file import read_vector_layer
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice, RefusedError

MAX_SURVEY_BYTES: Final = 50_000_000
_SURVEY_COLUMNS: Final = {
    "name": ("name", "id", "point", "point_id", "label", "点名"),
    "x": ("e_m", "easting", "e", "x", "east", "y座標", "lon_deg", "lon", "longitude"),
    "y": ("n_m", "northing", "n", "y", "north", "x座標", "lat_deg", "lat", "latitude"),
    "h": ("h_m", "height", "h", "z", "elevation", "elev", "height_m", "alt", "標高"),
    "sigma_x": ("sigma_e_m", "sigma_e", "sd_e"),
    "sigma_y": ("sigma_n_m", "sigma_n", "sd_n"),
    "sigma_h": ("sigma_h_m", "sigma_h", "sd_h"),
}
"""Accepted column names, in any case, without units in brackets. X is the easting, unlike in Japanese surveying."""
_DEGREE_COLUMNS: Final = ("lon_deg", "lon", "longitude")


@dataclass(frozen=True)
class SurveyedPoints:
    """n points (n, 3) in the CRS of a product, and the standard deviations that the survey states, nan without."""

    name: tuple[str, ...]
    xyz_m: FloatArray
    sigma_m: FloatArray
    notices: tuple[Notice, ...] = ()

    def __len__(self) -> int:
        return len(self.name)


@dataclass(frozen=True)
class SurveyOptions:
    """What a user states about a file of surveyed points.

    Attributes:
        crs: of a file without one, and of a cloud without one.
        sigma_m: standard deviation along each axis, where the file states none.
        within: vector file, or CSV of corners, in whose polygons the points lie; None for all.
    """

    crs: pyproj.CRS | None = None
    sigma_m: float | None = None
    within: Path | None = None


def survey_of(path: Path, target: pyproj.CRS, options: SurveyOptions) -> SurveyedPoints:
    """The points of a file in the CRS of a product, without those outside the polygons.

    Errors as :func:`read_points`; InputError if the polygons cannot be read, or hold none of the points.
    """
    survey = read_points(path, target, options.crs)
    if options.within is None:
        return survey
    area = read_area(options.within, target)
    kept = area.contains(survey.xyz_m)
    if not kept.any():
        east, north, _ = survey.xyz_m[0].tolist()
        raise nothing_within(area, f"{len(survey)} points in {path.name}", (east, north))
    names = tuple(name for name, inside in zip(survey.name, kept, strict=True) if inside)
    return replace(survey, name=names, xyz_m=survey.xyz_m[kept], sigma_m=survey.sigma_m[kept])


def read_points(path: Path, target: pyproj.CRS, crs: pyproj.CRS | None = None) -> SurveyedPoints:
    """Surveyed points of a CSV or GeoPackage, in the horizontal CRS of a product.

    Args:
        path: of the file. A CSV has columns such as name, e_m, n_m, h_m (or lon_deg, lat_deg, h_m), sigma_h_m.
        crs: of a file without one; by default `target` for eastings and northings, and its geographic base CRS for
            longitudes and latitudes.

    Raises:
        InputError: if the file cannot be read, or has no points with heights.
        RefusedError: if PROJ has no exact transformation from the CRS of the points, or the height systems differ.
    """
    if not path.is_file():
        raise _unreadable(path, "is a folder" if path.is_dir() else "is not there")
    if path.stat().st_size > MAX_SURVEY_BYTES:
        raise _unreadable(path, f"has {path.stat().st_size:,} bytes: too many for a survey")
    if path.read_bytes()[:16].startswith(b"SQLite format 3"):
        try:
            layer = read_vector_layer(path, times_as_text=True)
        except Exception as error:  # noqa: BLE001 the errors of GDAL have no family of their own
            raise _unreadable(path, f"cannot be read ({str(error)[:100]})") from None
        if not len(layer) or not all(isinstance(shape, shapely.Point) for shape in layer.shapes):
            raise _unreadable(path, "holds other geometries than points in its first layer")
        cells = {name.strip().casefold(): values.astype(str).tolist() for name, values in layer.columns.items()}
        _, columns = _columns(TextTable(cells, list(range(1, 1 + len(layer))), decimal_comma=False))
        columns["x"], columns["y"], z = layer.coordinates.T
        columns["h"] = np.where(np.isfinite(z), z, columns["h"])
        stated = layer.crs
    else:
        table = read_table(path, lambda why: _unreadable(path, f"is no table: {why}"))
        found, columns = _columns(table)
        missing = [_SURVEY_COLUMNS[key][0] for key in "xyh" if found[key] is None]
        if missing:
            raise _unreadable(path, f"has no column {', '.join(missing)} (its columns: {table.names})")
        degrees = found["x"] in _DEGREE_COLUMNS
        if not all(np.isfinite(columns[key]).any() for key in "xyh"):
            faults = [(column, table.first_fault(column)) for key in "xyh" if (column := found[key]) is not None]
            said = [f"line {at[0]} holds {at[1]!r} under {column}" for column, at in faults if at is not None]
            raise _unreadable(path, "has no point with easting, northing and height" + (f": {said[0]}" if said else ""))
        if degrees and np.nanmax(np.abs(columns["y"])) > 90.0:
            raise _unreadable(
                path, f"has latitudes such as {np.nanmax(columns['y']):g}: longitude and latitude are swapped"
            )
        stated = horizontal_part(target).geodetic_crs if degrees and crs is None else None
    source = stated or crs or target
    xyz = np.column_stack([columns["x"], columns["y"], columns["h"]])
    whole = np.isfinite(xyz).all(axis=1)
    if not whole.any():
        raise _unreadable(path, "has no point with easting, northing and height")
    notices = [] if whole.all() else [Notice("points-incomplete", path=path.name, whole=int((~whole).sum()))]
    xyz = xyz[whole]
    kept, sigma = np.flatnonzero(whole), np.column_stack([columns[f"sigma_{k}"] for k in "xyh"])[whole]
    names = tuple(str(columns["name"][k]) for k in kept)
    kinds = [crs.sub_crs_list[1].name if crs.is_compound else None for crs in (source, target)]
    if None not in kinds and kinds[0] != kinds[1]:
        raise RefusedError("check-heights", path=path, kinds=kinds[0], kinds_other=kinds[1])
    flat, wanted = horizontal_part(source), horizontal_part(target)
    if not flat.equals(wanted, ignore_axis_order=True):
        low, high = xyz[:, :2].min(axis=0), xyz[:, :2].max(axis=0)
        change = crs_change(flat, wanted, (float(low[0]), float(low[1]), float(high[0]), float(high[1])))
        xyz = np.column_stack([change.points(xyz[:, :2]), xyz[:, 2]])
        notices += change.notices
    return SurveyedPoints(names, xyz, np.where(sigma > 0.0, sigma, np.nan), tuple(notices))


def in_degrees(path: Path) -> bool:
    """Whether a table has longitudes and latitudes; false for a GeoPackage, and for what cannot be read."""
    try:
        with path.open("rb") as file:
            if file.read(16).startswith(b"SQLite format 3"):
                return False
        table = read_table(path, partial(_unreadable, path))
    except (InputError, OSError):
        return False
    return table.find(_SURVEY_COLUMNS["x"]) in _DEGREE_COLUMNS


def _columns(table: TextTable) -> tuple[dict[str, str | None], dict[str, Any]]:
    """Names of the columns that are there, and their values; nan, or numbers as names, for the others."""
    found = {key: table.find(names) for key, names in _SURVEY_COLUMNS.items()}
    n, name = len(table.lines), found["name"]
    columns: dict[str, Any] = {
        key: table.numbers(column) if column is not None else np.full(n, np.nan)
        for key, column in found.items()
        if key != "name"
    }
    columns["name"] = np.array(table.columns[name], object) if name is not None else np.arange(1, n + 1).astype(str)
    return found, columns


def _unreadable(path: Path, why: str) -> InputError:
    return InputError("points-unreadable", path=path, why=why)
