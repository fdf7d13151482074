"""Times and positions of image files by their EXIF data."""

import datetime as dt
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from furrowmap.core.readers.exposure_marks import ExposureMark, marks_beside
from furrowmap.core.readers.image_pixels import PILLOW_FORMATS, expect_pillow
from furrowmap.core.readers.image_xmp import NOTHING, UNKNOWN, ExposureXmp, exposure_xmp
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.images import Images

TAKEN: Final = 0x9003
OFFSET: Final = 0x9011
SUBSECOND: Final = 0x9291
"""EXIF DateTimeOriginal, OffsetTimeOriginal, SubSecTimeOriginal."""
MODIFIED: Final = 0x0132
"""TIFF DateTime."""
EXIF: Final = 0x8769
GPS: Final = 0x8825
"""Where the tags of EXIF and of GPS are."""
XMP: Final = 0x02BC
"""XMP in a TIFF file."""
ZONE_STEP_S: Final = 900.0
"""Time zones are multiples of this off UTC."""
MARK_AGREES_S: Final = 5.0
"""EXIF has whole seconds of a camera's clock, which a drone sets by its receiver."""


def exif_images(paths: Sequence[Path]) -> tuple[Images, list[Notice]]:
    """JPEG, TIFF or PNG files with the times in their EXIF data, those that have one; InputError without Pillow.

    The time is DateTimeOriginal with its fraction of a second. Its zone is OffsetTimeOriginal, else the quarters of an
    hour by which it differs from the time of GPS (UTC) in the file, else UTC. Exposure times and places that a drone
    wrote beside the images (:mod:`.exposure_marks`) replace those of EXIF if they agree to :data:`MARK_AGREES_S`; where
    there are none, those in XMP (:mod:`.image_xmp`) do by the same rule.
    """
    expect_pillow()
    marks, unused = marks_beside(paths)
    contradicted: list[Path] = []
    marked: list[ExposureMark] = []
    by_xmp: list[_Exposure] = []
    taken: list[tuple[Path, _Exposure]] = []
    unreadable: list[Path] = []
    timeless: list[Path] = []
    zoneless = 0
    for path in paths:
        try:
            said, xmp = _tags(path)
        except Exception:  # noqa: BLE001 (Pillow raises errors of all families on damaged files)
            unreadable.append(path)
            continue
        mark = marks.get(path)
        if mark is not None and not said.agrees_with(mark.t_s):
            contradicted.append(path)
            mark = None
        if mark is not None:
            said = said.at(mark.t_s, mark.lon_lat_h, mark.sigma_m)
            marked.append(mark)
        elif said.t_s is None or xmp.t_s is None or said.agrees_with(xmp.t_s):
            said = said.at(xmp.t_s, xmp.lon_lat_h, xmp.sigma_m, is_fixed=xmp.is_fixed)
            by_xmp += [said] if xmp != NOTHING else []
        if said.t_s is None:
            timeless.append(path)
            continue
        zoneless += not said.has_zone
        taken.append((path, said))
    count = len(paths)
    notices = []
    if unreadable:
        notices.append(
            Notice("images-unreadable.told", unreadable=len(unreadable), count=count, unreadable_first=unreadable[0])
        )
    if timeless:
        notices.append(Notice("images-without-time", timeless=len(timeless), count=count, timeless_first=timeless[0]))
    if contradicted:
        first = contradicted[0]
        notices.append(Notice("images-marked.contradicted", contradicted=len(contradicted), count=count, first=first))
    if marked:
        fixed = sum(mark.is_fixed for mark in marked)
        notices.append(Notice("images-marked", marked=len(marked), count=count, fixed=fixed))
    if unused:
        notices.append(Notice("images-marked.unused", names=", ".join(file.name for file in unused[:3])))
    if by_xmp:
        notices.append(_xmp_notice(by_xmp, count))
    if zoneless:
        notices.append(Notice("image-time-zone", zoneless=zoneless, count=count))
    times = np.array([said.t_s for _, said in taken], np.float64)
    places = np.array([said.lon_lat_h for _, said in taken], np.float64).reshape(-1, 3)
    sigmas = np.array([said.sigma_m for _, said in taken], np.float64).reshape(-1, 3)
    return Images.sorted([path for path, _ in taken], times, places, sigmas), notices


@dataclass(frozen=True)
class _Exposure:
    """What a file says of an exposure: UTC, whether its zone is known, and where the camera was."""

    t_s: float | None
    has_zone: bool
    lon_lat_h: tuple[float, float, float]
    sigma_m: tuple[float, float, float] = UNKNOWN
    is_fixed: bool = False

    def agrees_with(self, t_s: float) -> bool:
        """Whether another time may be of the same exposure; without an own time, any may."""
        if self.t_s is None:
            return True
        apart_s = self.t_s - t_s
        apart_s -= 0.0 if self.has_zone else ZONE_STEP_S * round(apart_s / ZONE_STEP_S)
        return abs(apart_s) <= MARK_AGREES_S

    def at(
        self,
        t_s: float | None,
        lon_lat_h: tuple[float, float, float],
        sigma_m: tuple[float, float, float],
        *,
        is_fixed: bool = False,
    ) -> "_Exposure":
        """With another time and place, where these are known."""
        timed = self if t_s is None else replace(self, t_s=t_s, has_zone=True)
        placed = timed if not math.isfinite(lon_lat_h[0]) else replace(timed, lon_lat_h=lon_lat_h)
        return replace(placed, sigma_m=sigma_m, is_fixed=is_fixed)


def _xmp_notice(exposures: Sequence[_Exposure], count: int) -> Notice:
    """What the XMP data of images gave."""
    sigma_m = np.array([one.sigma_m for one in exposures])
    known = sigma_m[np.isfinite(sigma_m)]
    return Notice(
        "images-marked.xmp",
        marked=len(exposures),
        count=count,
        fixed=sum(one.is_fixed for one in exposures),
        has_sigma=bool(len(known)),
        sigma_m=float(np.median(known)) if len(known) else 0.0,
    )


def _tags(path: Path) -> tuple[_Exposure, ExposureXmp]:
    """What EXIF and XMP say of an exposure."""
    from PIL import Image

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with Image.open(path, formats=PILLOW_FORMATS) as image:
            tags = image.getexif()
            inner = tags.get_ifd(EXIF)
            gps = tags.get_ifd(GPS)
            modified = tags.get(MODIFIED)
            packet = image.info.get("xmp") or tags.get(XMP) or b""
    xmp = exposure_xmp(packet.encode() if isinstance(packet, str) else bytes(packet))
    satellites = _satellite_time(gps)
    place = _place(gps)
    local = _local(inner.get(TAKEN) or modified, inner.get(SUBSECOND))
    if local is None:
        return _Exposure(satellites, has_zone=True, lon_lat_h=place), xmp
    offset_s = _offset(inner.get(OFFSET))
    if offset_s is None and satellites is not None:
        offset_s = ZONE_STEP_S * round((local - satellites) / ZONE_STEP_S)
    return _Exposure(local - (offset_s or 0.0), has_zone=offset_s is not None, lon_lat_h=place), xmp


def _local(text: Any, fraction: Any) -> float | None:
    """Seconds of `YYYY:MM:DD HH:MM:SS` in its own zone; some programs write its fraction behind it."""
    whole, _, behind = str(text).strip("\0 ").partition(".")
    try:
        stamp = dt.datetime.strptime(whole, "%Y:%m:%d %H:%M:%S").replace(tzinfo=dt.UTC)
    except ValueError:
        return None
    digits = str(fraction or "").strip("\0 ") or behind
    return stamp.timestamp() + (float(f"0.{digits}") if digits.isdecimal() and digits.isascii() else 0.0)


def _offset(text: Any) -> float | None:
    """Seconds of `+HH:MM`."""
    try:
        offset = dt.datetime.strptime(str(text).strip("\0 "), "%z").utcoffset()
    except ValueError:
        return None
    return offset.total_seconds() if offset is not None else None


def _satellite_time(gps: dict[int, Any]) -> float | None:
    """UTC of GPSDateStamp and GPSTimeStamp."""
    try:
        day = dt.datetime.strptime(str(gps[29]).strip("\0 "), "%Y:%m:%d").replace(tzinfo=dt.UTC)
        hours, minutes, seconds = (float(part) for part in gps[7])
    except (KeyError, ValueError, TypeError, ZeroDivisionError):
        return None
    within = 3600.0 * hours + 60.0 * minutes + seconds
    return day.timestamp() + within if np.isfinite(within) else None


_SIXTIETHS: Final = (1.0, 60.0, 3600.0)
_NORTH_SOUTH: Final = {"N": 1.0, "S": -1.0}
_EAST_WEST: Final = {"E": 1.0, "W": -1.0}
_BELOW: Final = (1, b"\1", 3, b"\3")
"""GPSAltitudeRef of what lies below the sea, and below the ellipsoid or sea since Exif 3.0."""


def _sign(reference: Any, signs: Mapping[str, float]) -> float:
    """1 or -1 of a reference such as N or 'south'; ValueError without one, which leaves the hemisphere open."""
    text = reference.decode("latin-1") if isinstance(reference, bytes) else str(reference)
    found = signs.get(text.strip(" \0")[:1].upper())
    if found is None:
        raise ValueError(f"{text!r} is no hemisphere")
    return found


def _place(gps: dict[int, Any]) -> tuple[float, float, float]:
    """Longitude and latitude in degrees, height in metres; nan where they are not stated."""
    try:
        lat, lon = (
            _sign(gps[ref], signs)
            * sum(float(part) / unit for part, unit in zip(gps[tag], (1.0, 60.0, 3600.0), strict=True))
            for tag, ref, signs in ((2, 1, _NORTH_SOUTH), (4, 3, _EAST_WEST))
        )
    except (KeyError, ValueError, TypeError, ZeroDivisionError):
        return (float("nan"),) * 3
    try:
        below = gps.get(5) in _BELOW
        height = float(gps[6]) * (-1.0 if below else 1.0)
    except (KeyError, ValueError, TypeError, ZeroDivisionError):
        height = float("nan")
    return lon, lat, height
