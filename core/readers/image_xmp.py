"""Positions and times of exposures in the XMP data of images, as drones with RTK write them.

DJI (its user manuals, "XMP"; prefix `drone-dji`): `RtkFlag` is 50 to 63 for fixed, 32 to 49 for float and 16 for single
solutions, 0 for none; `GpsLatitude`, `GpsLongitude` (`GpsLongtitude` in early firmware) in degrees, `AbsoluteAltitude`
above the ellipsoid where there is RTK, `RtkStdLon`, `RtkStdLat`, `RtkStdHgt` in metres, `UTCAtExposure`. Pix4D's
(prefix `Camera`; senseFly, Parrot): `GPSXYAccuracy` and `GPSZAccuracy` in metres, of the position in EXIF.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from furrowmap.core.readers.csv_file import unix_time
from furrowmap.core.readers.exposure_marks import FIXED_FROM
from furrowmap.core.readers.isoxml.xml import Element, parse_xml
from furrowmap.core.runtime.errors import InputError

MAX_XMP_BYTES: Final = 1 << 20
"""A segment of a JPEG file has 64 kB; more is no metadata of a camera."""
MAX_SIGMA_M: Final = 1e4
UNKNOWN: Final = (math.nan, math.nan, math.nan)
_DJI: Final = "drone-dji"
_PIX4D: Final = "Camera"


@dataclass(frozen=True)
class ExposureXmp:
    """What the XMP data of an image say of its exposure.

    Attributes:
        t_s: UTC; None where it is not stated.
        lon_lat_h: degrees, metres above the ellipsoid; nan without a position of an RTK receiver.
        sigma_m: standard deviations of easting, northing and height, of this position or of that in EXIF; nan where
            they are not stated.
        is_fixed: whether the position is of a fixed solution.
    """

    t_s: float | None = None
    lon_lat_h: tuple[float, float, float] = UNKNOWN
    sigma_m: tuple[float, float, float] = UNKNOWN
    is_fixed: bool = False


NOTHING: Final = ExposureXmp()


def exposure_xmp(data: bytes) -> ExposureXmp:
    """What a packet of XMP says of the exposure; nothing where it is damaged, hostile, or of other makers."""
    if not data or len(data) > MAX_XMP_BYTES:
        return NOTHING
    try:
        root = parse_xml(data.strip(b"\0 \r\n"), "XMP")
    except InputError:
        return NOTHING
    said = dict(_properties(root))
    across, up = (_sigma_m(said.get(f"{_PIX4D}:{name}", "")) for name in ("GPSXYAccuracy", "GPSZAccuracy"))
    flag = _number(said.get(f"{_DJI}:RtkFlag", ""))
    t_s = _time_s(said.get(f"{_DJI}:UTCAtExposure", ""))
    names = ("GpsLongitude", "GpsLatitude", "AbsoluteAltitude")
    lon, lat, height = (_number(said.get(f"{_DJI}:{name}", "")) for name in names)
    if math.isnan(lon):
        lon = _number(said.get(f"{_DJI}:GpsLongtitude", ""))
    is_place = abs(lon) <= 180.0 and abs(lat) <= 90.0 and (lon, lat) != (0.0, 0.0)
    if not flag > 0.0 or not is_place:
        return ExposureXmp(t_s, UNKNOWN, (across, across, up))
    east, north, upward = (_sigma_m(said.get(f"{_DJI}:RtkStd{axis}", "")) for axis in ("Lon", "Lat", "Hgt"))
    return ExposureXmp(t_s, (lon, lat, height), (east, north, upward), flag >= FIXED_FROM)


def _properties(element: Element) -> Iterator[tuple[str, str]]:
    """Names with their prefix and values, of attributes and of elements: XMP has both forms."""
    yield from element.attributes.items()
    if element.text:
        yield element.tag, element.text
    for child in element.children:
        yield from _properties(child)


def _number(text: str) -> float:
    """A finite number; nan for anything else."""
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def _sigma_m(text: str) -> float:
    """A standard deviation; nan where it is none, or 0 for unknown."""
    value = _number(text)
    return value if 0.0 < value < MAX_SIGMA_M else math.nan


def _time_s(text: str) -> float | None:
    """UTC in seconds."""
    try:
        return unix_time(text.strip()) if text else None
    except (ValueError, OverflowError):
        return None
