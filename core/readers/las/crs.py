"""The CRS that a LAS file states, as WKT or as GeoTIFF keys."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Final

import pyproj
from pyproj.exceptions import CRSError, ProjError

from furrowmap.core.readers.las.header import LasHeader
from furrowmap.core.readers.las.records import LasRecord
from furrowmap.core.runtime.errors import Notice

_USER_ID: Final = "LASF_Projection"
_WKT, _KEYS, _DOUBLES, _TEXTS = 2112, 34735, 34736, 34737
_MODEL, _GEOGRAPHIC, _PROJECTED = 1024, 2048, 3072
"""GeoTIFF keys: model type, code of the geographic CRS, code of the projected CRS (or 32767: user-defined)."""
_SAME: Final = 1e-3
"""Two CRS are the same if the middle of the file differs by less than this between them, in their unit."""


def stated_crs(
    path: Path, header: LasHeader, records: tuple[LasRecord, ...]
) -> tuple[pyproj.CRS | None, tuple[Notice, ...]]:
    """The CRS that the records state; None if they state none, or none that PROJ understands.

    If there are both WKT and GeoTIFF keys, the kind that the header announces is used.
    """
    notices: list[Notice] = []
    texts = [r.data for r in records if (r.user, r.number) == (_USER_ID, _WKT) and r.data.strip(b"\0 ")]
    keys = {r.number: r.data for r in reversed(records) if r.user == _USER_ID and r.number in (_KEYS, _DOUBLES, _TEXTS)}
    by_text = next(filter(None, (_from_wkt(path, text, notices) for text in texts)), None)
    by_keys = _from_keys(path, keys, notices)
    first, second = (by_text, by_keys) if header.crs_is_wkt else (by_keys, by_text)
    if first is not None and second is not None and not _same(first, second, header):
        kinds = ("WKT", "GeoTIFF keys") if header.crs_is_wkt else ("GeoTIFF keys", "WKT")
        notices.append(
            Notice(
                "crs-contradiction",
                path=path.name,
                first=first.name,
                kinds=kinds[0],
                second=second.name,
                kinds_other=kinds[1],
            )
        )
    return first or second, tuple(notices)


def _from_wkt(path: Path, data: bytes, notices: list[Notice]) -> pyproj.CRS | None:
    text = data.split(b"\0")[0].decode("utf-8", "replace").strip()
    try:
        return pyproj.CRS.from_wkt(text)
    except (CRSError, ProjError) as error:
        reason = str(error).split(":")[0][:120]
        notices.append(
            Notice(
                "crs-unreadable.wkt",
                path=path.name,
                start=text[:40],
                more=len(text) > 40,
                size_bytes=len(data),
                reason=reason,
            )
        )
        return None


def _from_keys(path: Path, records: dict[int, bytes], notices: list[Notice]) -> pyproj.CRS | None:
    """The CRS of GeoTIFF keys. GDAL reads it from a TIFF of one pixel: it knows user-defined CRS, units, old codes."""
    directory = records.get(_KEYS, b"")
    entries = struct.iter_unpack(
        "<4H", directory[8 : 8 + (len(directory) - 8) // 8 * 8] if len(directory) >= 8 else b""
    )
    keys = {key: value for key, place, _, value in entries if place == 0}
    if keys.get(_PROJECTED) or keys.get(_GEOGRAPHIC):
        import rasterio
        from rasterio.errors import RasterioError

        try:
            with (
                rasterio.Env(GTIFF_REPORT_COMPD_CS=True),
                rasterio.MemoryFile(_pixel(records), ext=".tif") as file,
                file.open(driver="GTiff") as picture,
            ):
                found = pyproj.CRS.from_wkt(picture.crs.to_wkt()) if picture.crs else None
        except (RasterioError, CRSError, ProjError, ValueError):
            found = None
        flat = found.sub_crs_list[0] if found is not None and found.is_compound else found
        # GDAL makes a local CRS from keys that name none.
        if flat is not None and (flat.is_projected or flat.is_geographic):
            return found
    elif not keys.get(_MODEL):
        return None
    notices.append(Notice("crs-unreadable", path=path.name))
    return None


def _pixel(records: dict[int, bytes]) -> bytes:
    """A TIFF of one pixel with these GeoTIFF records, without the keys that point outside them."""
    doubles = records.get(_DOUBLES, b"")[: len(records.get(_DOUBLES, b"")) // 8 * 8]
    texts = records.get(_TEXTS, b"")
    data = records[_KEYS]
    entries = [
        entry
        for entry in struct.iter_unpack("<4H", data[8 : 8 + (len(data) - 8) // 8 * 8])
        if entry[1] == 0
        or (entry[1] == _DOUBLES and (entry[2] + entry[3]) * 8 <= len(doubles))
        or (entry[1] == _TEXTS and entry[2] + entry[3] <= len(texts))
    ]
    entries = [entry for entry in sorted(entries) if entry[0]]
    directory = struct.pack("<4H", 1, 1, 0, len(entries)) + b"".join(struct.pack("<4H", *entry) for entry in entries)
    tags: list[tuple[int, int, int, bytes]] = [
        (256, 3, 1, struct.pack("<H", 1)),
        (257, 3, 1, struct.pack("<H", 1)),
        (258, 3, 1, struct.pack("<H", 8)),
        (262, 3, 1, struct.pack("<H", 1)),
        (273, 4, 1, struct.pack("<I", 8)),
        (277, 3, 1, struct.pack("<H", 1)),
        (278, 3, 1, struct.pack("<H", 1)),
        (279, 4, 1, struct.pack("<I", 1)),
        (33550, 12, 3, struct.pack("<3d", 1, 1, 0)),
        (33922, 12, 6, bytes(48)),
        (_KEYS, 3, len(directory) // 2, directory),
    ]
    tags += [(_DOUBLES, 12, len(doubles) // 8, doubles)] if doubles else []
    tags += [(_TEXTS, 2, len(texts) + 1, texts + b"\0")] if texts else []
    start = 16
    values = b""
    entries_at = b""
    for tag, kind, count, content in tags:
        place = struct.pack("<I", start + len(values)) if len(content) > 4 else content.ljust(4, b"\0")
        if len(content) > 4:
            values += content + b"\0" * (len(content) % 2)
        entries_at += struct.pack("<HHI", tag, kind, count) + place
    pixel = bytes(8)
    table = struct.pack("<H", len(tags)) + entries_at + bytes(4)
    return b"II*\0" + struct.pack("<I", start + len(values)) + pixel + values + table


def _same(one: pyproj.CRS, other: pyproj.CRS, header: LasHeader) -> bool:
    if one.equals(other, ignore_axis_order=True):
        return True
    try:
        to_other = pyproj.Transformer.from_crs(one.to_2d(), other.to_2d(), always_xy=True)
        x, y = (0.5 * (low + high) for low, high in zip(header.low[:2], header.high[:2], strict=True))
        return math.dist((x, y), to_other.transform(x, y)) < _SAME
    except (CRSError, ProjError):
        return False
