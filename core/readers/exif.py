"""Image files and raw images of sensors (sensor_msgs/image_encodings.hpp): pixels; times and positions by EXIF.

Tables of images are CSV with the file and the time of each.
"""

import datetime as dt
import io
import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.csv_file import TIMES, read_small, text_rows, unix_time
from furrowmap.core.readers.csv_text import header_of
from furrowmap.core.readers.epochs import utc_of
from furrowmap.core.readers.exposure_marks import ExposureMark, marks_beside
from furrowmap.core.readers.image_xmp import NOTHING, UNKNOWN, ExposureXmp, exposure_xmp
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.source import Source
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.file_names import leads_out
from furrowmap.core.runtime.memory import expect_growth
from furrowmap.core.values.images import ImageFile, Images, RawLayout, StoredImage

FILES: Final = ("file", "image", "filename", "name")
_TIMES: Final = (*TIMES, "time")
"""Names of the columns; `time` is ISO 8601, UTC without a zone."""
MAX_TABLE_BYTES: Final = 1 << 26


def read_image_table(path: Path, folder: Path, notices: list[Notice]) -> Images:
    """The images in a folder that a table names, relative to its own, those that exist; others are noticed.

    InputError if columns are missing, a field is no time, or an image lies outside the folder.
    """
    try:
        data, _ = read_small(path, MAX_TABLE_BYTES, notices)
    except ValueError as error:
        raise InputError("not-a-table", path=path, why=str(error)) from None
    table = text_rows(data, path, notices)
    names = table.names
    cells = table.rows
    file = next((name for name in FILES if name in names), None)
    time = next((name for name in _TIMES if name in names), None)
    if file is None or time is None:
        raise InputError("missing-column.images", path=path, names=", ".join(names)[:80])
    rows = [(line, row[file], row[time]) for line, row in cells if row.get(file) and row.get(time)]
    if len(rows) < len(cells):
        notices.append(Notice("rows-incomplete", source=path, whole=len(cells) - len(rows), rows=len(cells)))
    seconds = []
    paths = []
    for line, name, text in rows:
        try:
            seconds.append(float(text) if time in TIMES else unix_time(text))
        except ValueError:
            seconds.append(math.nan)
        if not math.isfinite(seconds[-1]):
            raise InputError("not-a-time", where=f"{path}, line {line}", column=time, text=text[:40])
        paths.append(path.parent / name.replace("\\", "/"))
        if "\0" in name or leads_out(paths[-1], folder):
            raise InputError("session-path-outside", table=path, name=name[:80])
    times = utc_of(np.array(seconds, np.float64), TIMES.get(time, "unix"), str(path), ReadOptions())
    there = np.array([_is_file(image) for image in paths], bool)
    if not there.all():
        first = rows[int(np.argmin(there))][1]
        notices.append(Notice("images-missing", path=path, there=int((~there).sum()), rows=len(rows), first=first))
    return Images.sorted([image for image, is_there in zip(paths, there, strict=True) if is_there], times[there])


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # the name is too long
        return False


def is_image_table(path: Path) -> bool:
    """Whether the first line of a CSV has the columns of a table of images."""
    with Source(path) as source:
        names = header_of(source.read(4096).split(b"\n")).names
    return not set(FILES).isdisjoint(names) and not set(_TIMES).isdisjoint(names)


CHANNELS: Final = {
    "rgb8": (0, 1, 2), "bgr8": (2, 1, 0), "rgba8": (0, 1, 2), "bgra8": (2, 1, 0), "8UC3": (2, 1, 0), "mono8": (0, 0, 0),
    "8UC1": (0, 0, 0), "mono16": (0, 0, 0), "16UC1": (0, 0, 0),
}  # fmt: skip
"""Channels that are red, green and blue; 8UC3 is OpenCV's order."""
BAYER: Final = {"bayer_rggb": "BG", "bayer_bggr": "RG", "bayer_gbrg": "GR", "bayer_grbg": "GB"}
"""OpenCV names a pattern by the second and third pixel of its second row, ROS by the first four."""
YUV: Final = {"yuv422": "UYVY", "uyvy": "UYVY", "yuv422_yuy2": "YUYV", "yuyv": "YUYV"}
_VALUES_PER_PIXEL: Final = {"rgba8": 4, "bgra8": 4, "rgb8": 3, "bgr8": 3, "8UC3": 3, **dict.fromkeys(YUV, 2)}


def layout_fault(layout: RawLayout, size: int) -> str:
    """Why so many bytes are no image of a layout; "" where they are one."""
    if layout.encoding not in CHANNELS and layout.encoding not in YUV and _mosaic(layout.encoding) is None:
        return f"the encoding {layout.encoding[:20]!r} is not supported"
    if min(layout.width, layout.height) < 2 or layout.step < layout.width * _values(layout) * _bytes(layout):
        return f"{layout.width} × {layout.height} pixels do not fit into rows of {layout.step} bytes"
    if layout.step * layout.height > size:
        return f"{layout.height} rows of {layout.step} bytes are stated, there are {size} bytes"
    if layout.encoding in YUV and layout.width % 2:
        return f"{layout.width} columns of {layout.encoding} are not even"
    return ""


def _raw_pixels(data: memoryview | bytes, layout: RawLayout) -> NDArray[np.uint8]:
    """Red, green, blue (height, width, 3), of 16 bits the upper eight; Bayer mosaics are interpolated bilinearly."""
    fault = layout_fault(layout, len(data))
    if fault:
        raise ValueError(fault)
    rows = np.frombuffer(data, np.uint8, layout.step * layout.height).reshape(layout.height, layout.step)
    rows = rows[:, : layout.width * _values(layout) * _bytes(layout)]
    if _bytes(layout) == 2:
        # The byte of the greater value.
        rows = rows[:, 0 if layout.big_endian else 1 :: 2]
    pixels = np.ascontiguousarray(rows).reshape(layout.height, layout.width, _values(layout))
    if layout.encoding in CHANNELS:
        return np.ascontiguousarray(pixels[:, :, CHANNELS[layout.encoding]])
    import cv2

    pattern = _mosaic(layout.encoding)
    code = f"COLOR_Bayer{pattern}2RGB" if pattern is not None else f"COLOR_YUV2RGB_{YUV[layout.encoding]}"
    out = cv2.cvtColor(pixels[:, :, 0] if pattern is not None else pixels, getattr(cv2, code))
    return np.asarray(out, np.uint8)


def _mosaic(encoding: str) -> str | None:
    """OpenCV's name of a Bayer pattern; None of other encodings."""
    return BAYER.get(encoding.removesuffix("16").removesuffix("8")) if encoding.endswith(("8", "16")) else None


def _bytes(layout: RawLayout) -> int:
    """Bytes of a value."""
    return 2 if layout.encoding.endswith("16") or layout.encoding == "16UC1" else 1


def _values(layout: RawLayout) -> int:
    """Values of a pixel."""
    return _VALUES_PER_PIXEL.get(layout.encoding, 1)


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
PILLOW_FORMATS: Final = ("JPEG", "PNG", "TIFF")
MARK_AGREES_S: Final = 5.0
"""EXIF has whole seconds of a camera's clock, which a drone sets by its receiver."""
MAX_PIXELS: Final = 300_000_000
"""Of the largest aerial cameras; more would exhaust the memory."""


def exif_images(paths: Sequence[Path], notices: list[Notice]) -> Images:
    """JPEG, TIFF or PNG files with the times in their EXIF data, those that have one; InputError without Pillow.

    The time is DateTimeOriginal with its fraction of a second. Its zone is OffsetTimeOriginal, else the quarters of an
    hour by which it differs from the time of GPS (UTC) in the file, else UTC. Exposure times and places that a drone
    wrote beside the images (:mod:`.exposure_marks`) replace those of EXIF if they agree to :data:`MARK_AGREES_S`; where
    there are none, those in XMP (:mod:`.image_xmp`) do by the same rule.
    """
    expect_pillow()
    marks = marks_beside(paths)
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
    if by_xmp:
        notices.append(_xmp_notice(by_xmp, count))
    if zoneless:
        notices.append(Notice("image-time-zone", zoneless=zoneless, count=count))
    times = np.array([said.t_s for _, said in taken], np.float64)
    places = np.array([said.lon_lat_h for _, said in taken], np.float64).reshape(-1, 3)
    sigmas = np.array([said.sigma_m for _, said in taken], np.float64).reshape(-1, 3)
    return Images.sorted([path for path, _ in taken], times, places, sigmas)


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


def read_pixels(path: ImageFile, reduction: int) -> NDArray[np.uint8]:
    """The pixels (height, width, 3) of an image as they are stored, red, green, blue; not turned as EXIF may say.

    A pixel is the mean of `reduction` by `reduction`; a rest at the right and at the bottom is cut off. ValueError if
    it is no image, is damaged or cut, or has too many pixels.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with _opened(path) as image:
                width, height = image.size
                if not isinstance(path, StoredImage):
                    expect_growth(path, path.stat().st_size, 3 * width * height)
                pixels = image.convert("RGB") if width * height <= MAX_PIXELS else None
                if pixels is not None and reduction > 1:
                    whole = (width // reduction * reduction, height // reduction * reduction)
                    pixels = pixels.reduce(reduction, (0, 0, *whole))
                found = np.asarray(pixels, np.uint8) if pixels is not None else None
    except Exception as error:  # noqa: BLE001 (as above)
        raise ValueError(f"{path}: {error}") from None
    if found is None:
        raise ValueError(f"{path}: {width} × {height} pixels")
    return found


def image_size(path: ImageFile) -> tuple[int, int] | None:
    """Width and height of an image, None if it cannot be read; InputError if Pillow is not installed."""
    expect_pillow()
    if isinstance(path, StoredImage) and path.layout is not None:
        return path.layout.width, path.layout.height
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with _opened(path) as image:
                return int(image.width), int(image.height)
    except Exception:  # noqa: BLE001 (as above)
        return None


def _opened(path: ImageFile) -> Any:
    """An image by Pillow, to be used in a `with`."""
    from PIL import Image

    if not isinstance(path, StoredImage):
        return Image.open(path, formats=PILLOW_FORMATS)
    if path.layout is None:
        return Image.open(io.BytesIO(path.data), formats=PILLOW_FORMATS)
    return Image.fromarray(_raw_pixels(path.data, path.layout))


def expect_pillow() -> None:
    """Raise InputError where Pillow, which reads images, is not installed."""
    if find_spec("PIL") is None:
        raise InputError("extra-missing.expect-pillow")


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


def _place(gps: dict[int, Any]) -> tuple[float, float, float]:
    """Longitude and latitude in degrees, height in metres; nan where they are not stated."""
    try:
        lat, lon = (
            sign * sum(float(part) / unit for part, unit in zip(gps[tag], (1.0, 60.0, 3600.0), strict=True))
            for tag, sign in ((2, -1.0 if gps[1] == "S" else 1.0), (4, -1.0 if gps[3] == "W" else 1.0))
        )
    except (KeyError, ValueError, TypeError, ZeroDivisionError):
        return (float("nan"),) * 3
    try:
        below = gps.get(5) in (1, b"\1")
        height = float(gps[6]) * (-1.0 if below else 1.0)
    except (KeyError, ValueError, TypeError, ZeroDivisionError):
        height = float("nan")
    return lon, lat, height
