"""Field folders of AgOpenGPS: the field's boundary, and the heights of the ground along its drives.

`Field.txt` has the origin of the field's plane in degrees below `StartFix`; `Boundary.txt` has a flag, a number of
corners, and east, north and heading of each, for the boundary and then for each hole. `Elevation.txt` has latitude,
longitude, height of the ground (of the receiver above its geoid, less the height of the antenna) and kind of fix each
1.7 m. No file of the folder has times.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import shapely

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.languages.texts import Text, Words
from furrowmap.core.runtime.plain_reads import open_plain, read_plain_text

ORIGIN_FILE: Final = "Field.txt"
BOUNDARY_FILE: Final = "Boundary.txt"
ELEVATION_FILE: Final = "Elevation.txt"
PARTS: Final = (b"$FieldDir", b"$Boundary", b"$RecPath", b"$Contour")
"""Begin the files, those of the first kind behind a line with the date."""
_MAX_FIELD_BYTES: Final = 1 << 26
_MAX_FROM_ORIGIN_M: Final = 100_000.0
_FLAGS: Final = ("true", "false")
_FIXED: Final = 4
"""The kind of fix of NMEA's GGA."""
_ELEVATION_HEADER: Final = "Latitude,Longitude,Elevation,"
_ELEVATION_HEAD_BYTES: Final = 4096


@dataclass(frozen=True)
class Elevations:
    """Longitude, latitude in degrees and height in metres (n, 3), and how many of them are of fixed ambiguities."""

    lon_lat_h: FloatArray
    fixed: int


def is_field_folder(path: Path) -> bool:
    """Whether a folder is that of a field of AgOpenGPS."""
    try:
        with open_plain(path / ORIGIN_FILE) as file:
            return PARTS[0] in file.read(256)
    except OSError:
        return False


def read_outline(folder: Path, unreadable: Callable[[Words], InputError]) -> shapely.Polygon:
    """The boundary of a field without its holes, in longitude and latitude; holes to drive through belong to it.

    The error of `unreadable` if there is no boundary, or a file is damaged.
    """
    lines = _lines(folder / ORIGIN_FILE, unreadable)
    below = next((k + 1 for k, line in enumerate(lines) if line.startswith("StartFix")), len(lines))
    try:
        lat_deg, lon_deg = (float(word) for word in lines[below].split(",")[:2])
    except (IndexError, ValueError):
        raise unreadable(Text("{name} has no origin (StartFix)", name=ORIGIN_FILE)) from None
    if not (abs(lat_deg) < 90.0 and abs(lon_deg) <= 180.0):
        raise unreadable(
            Text("{name} has the origin {lat_deg:g}, {lon_deg:g}", name=ORIGIN_FILE, lat_deg=lat_deg, lon_deg=lon_deg)
        )
    rings = _rings(_lines(folder / BOUNDARY_FILE, unreadable), unreadable)
    if not rings:
        raise unreadable(Text("{name} has no boundary", name=BOUNDARY_FILE))
    origin = lon_deg, lat_deg
    outline, *holes = (_lon_lat(en_m, origin) for _, en_m in rings)
    kept = [hole for (through, _), hole in zip(rings[1:], holes, strict=True) if not through]
    return shapely.Polygon(outline, kept)


def elevation_file(path: Path) -> Path | None:
    """The file of heights that a path is, or that a field folder has; None of any other path."""
    if path.is_dir():
        return path / ELEVATION_FILE if is_field_folder(path) else None
    try:
        with open_plain(path) as file:
            head = file.read(_ELEVATION_HEAD_BYTES)
    except OSError:
        return None
    return path if PARTS[0] in head and _ELEVATION_HEADER.encode() in head else None


def read_elevations(path: Path, unreadable: Callable[[Words], InputError]) -> Elevations:
    """The heights of the ground in an `Elevation.txt`; a last line that is cut is left out.

    The error of `unreadable` if there is none, or it is damaged.
    """
    lines = _lines(path, unreadable)
    below = next((k + 1 for k, line in enumerate(lines) if line.startswith(_ELEVATION_HEADER)), len(lines))
    rows = []
    for k, line in enumerate(lines[below:], start=below):
        # some versions group the digits of metres from the origin by commas: only the first four are certain
        cells = line.split(",")
        try:
            lat_deg, lon_deg, height_m, fix = (float(cell) for cell in cells[:4])
        except ValueError:
            if k == len(lines) - 1:
                break
            raise unreadable(Text("{name} is damaged at {text!r}", name=path.name, text=line[:40])) from None
        rows.append((lon_deg, lat_deg, height_m, fix))
    if not rows:
        raise unreadable(Text("{name} has no heights: AgOpenGPS writes them if they are switched on", name=path.name))
    found = np.array(rows)
    if not (np.isfinite(found).all() and (np.abs(found[:, 1]) <= 90.0).all() and (np.abs(found[:, 0]) <= 180.0).all()):
        raise unreadable(Text("{name} has impossible positions", name=path.name))
    return Elevations(found[:, :3], int((found[:, 3] == _FIXED).sum()))


def _lon_lat(en_m: FloatArray, origin: tuple[float, float]) -> FloatArray:
    """Longitude and latitude (n, 2) of places (n, 2) in the plane of a field, as AgOpenGPS (LocalPlane.cs) has them.

    Metres per degree of latitude are those at the origin, of longitude those at the latitude of each place.
    """
    lon_deg, lat_deg = origin
    at_origin = np.radians(lat_deg)
    lat_degree_m = (
        111132.92 - 559.82 * np.cos(2 * at_origin) + 1.175 * np.cos(4 * at_origin) - 0.0023 * np.cos(6 * at_origin)
    )
    place_lat_deg = lat_deg + en_m[:, 1] / lat_degree_m
    angle = np.radians(place_lat_deg)
    lon_degree_m = 111412.84 * np.cos(angle) - 93.5 * np.cos(3 * angle) + 0.118 * np.cos(5 * angle)
    place: FloatArray = np.column_stack([lon_deg + en_m[:, 0] / lon_degree_m, place_lat_deg])
    return place


def _lines(path: Path, unreadable: Callable[[Words], InputError]) -> list[str]:
    try:
        if path.stat().st_size > _MAX_FIELD_BYTES:
            raise unreadable(Text("{name} is larger than a field's", name=path.name))
        return [line.strip() for line in read_plain_text(path, "utf-8-sig", "replace").splitlines() if line.strip()]
    except OSError as error:
        raise unreadable(f"{path.name}: {error.strerror}") from None


def _rings(lines: list[str], unreadable: Callable[[Words], InputError]) -> list[tuple[bool, FloatArray]]:
    """Rings with at least three corners: whether one drives through, and (n, 2) east and north in metres."""
    rings = []
    k = int(bool(lines) and lines[0].startswith("$"))
    while k < len(lines):
        through = False
        while k < len(lines) and lines[k].casefold() in _FLAGS:  # some versions wrote the flag twice
            through = lines[k].casefold() == _FLAGS[0]
            k = k + 1
        try:
            count = int(lines[k])
            rows = [line.split(",")[:2] for line in lines[k + 1 : k + 1 + count]]
            en_m = np.array(rows, np.float64).reshape(-1, 2)
        except (IndexError, ValueError):
            raise unreadable(
                Text("{name} is damaged at {text!r}", name=BOUNDARY_FILE, text=lines[min(k, len(lines) - 1)][:40])
            ) from None
        if len(en_m) != count or not (np.abs(en_m) < _MAX_FROM_ORIGIN_M).all():
            raise unreadable(
                Text(
                    "{name} has {there} corners of {count}, or corners far from the origin",
                    name=BOUNDARY_FILE,
                    there=len(en_m),
                    count=count,
                )
            )
        if count > 2:
            rings.append((through, en_m))
        k += 1 + count
    return rings
