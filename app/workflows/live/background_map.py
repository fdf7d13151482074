"""The background map of a live page: raster tiles of Web Mercator in a PMTiles or MBTiles file."""

import math
import re
import sqlite3
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, Final
from urllib.parse import quote

import numpy as np

from furrowmap.core.geodesy.longitudes import unwrapped_deg
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.readers.sqlite_file import limited_steps
from furrowmap.core.runtime.errors import InputError, MissingExtraError
from furrowmap.core.runtime.languages.texts import Text, reason
from furrowmap.core.runtime.plain_reads import open_plain

TILE_KINDS: Final = {b"\x89PNG": "image/png", b"\xff\xd8\xff": "image/jpeg", b"RIFF": "image/webp"}
MAX_ZOOM: Final = 24
MAX_QUERY_STEPS: Final = 20_000_000
"""Instructions of SQLite that finding a tile may take, about a second; it takes some dozens."""
NEAR_M: Final = 500.0
"""The place of tiles is linear in the map's coordinates: this far away they are off by 2 cm, by the square of it."""


@dataclass(frozen=True)
class BackgroundMap:
    """Tiles of a file.

    Attributes:
        zooms: the least and the largest zoom.
        attribution: who is to be named, without markup.
        tile: the image with that zoom, column and row (from the north); None where there is none.
    """

    zooms: tuple[int, int]
    attribution: str
    tile: Callable[[int, int, int], bytes | None]

    def place(self, frame: MapFrame, e_m: float, n_m: float) -> dict[str, Any]:
        """How tiles lie around a place on the map: metres east and north per unit of Web Mercator (1: the world)."""
        lon, lat = frame.to_lon_lat(
            e_m + NEAR_M * np.array([0, -1, 1, 0, 0]), n_m + NEAR_M * np.array([0, 0, 0, -1, 1])
        )
        lon = unwrapped_deg(lon)
        at = np.array([lon / 360.0 + 0.5, 0.5 - np.arcsinh(np.tan(np.radians(lat))) / (2.0 * math.pi)])
        steps = np.array([at[:, 2] - at[:, 1], at[:, 4] - at[:, 3]]).T / (2.0 * NEAR_M)
        return {
            "at": at[:, 0].tolist(),
            "en_m": [e_m, n_m],
            "to_m": np.linalg.inv(steps).tolist(),
            "zooms": self.zooms,
            "attribution": self.attribution,
        }


def kind_of(tile: bytes) -> str:
    """The media type of an image; empty for what is no raster tile."""
    return next((kind for begin, kind in TILE_KINDS.items() if tile.startswith(begin)), "")


def open_background(path: Path) -> BackgroundMap:
    """The tiles of a file.

    Raises:
        InputError: if it has no raster tiles, or cannot be read.
        MissingExtraError: if it is a PMTiles file and the package to read it is not installed.
    """
    try:
        with open_plain(path) as file:
            head = file.read(16)
        if head.startswith(b"SQLite format 3"):
            found, first = _mbtiles(path)
        elif head.startswith(b"PMTiles\3"):
            found, first = _pmtiles(path)
        else:
            raise InputError("live-map", path=path, fault=Text("it is neither"))
    except (OSError, sqlite3.Error, ValueError, TypeError, KeyError, IndexError, OverflowError, EOFError) as error:
        raise InputError("live-map", path=path, fault=reason(error)) from None
    if not kind_of(first):
        raise InputError("live-map", path=path, fault=Text("its tiles are no PNG, JPEG or WebP images"))
    if not 0 <= found.zooms[0] <= found.zooms[1] <= MAX_ZOOM:
        raise InputError(
            "live-map", path=path, fault=Text("zooms {first} to {last}", first=found.zooms[0], last=found.zooms[1])
        )
    return found


def _mbtiles(path: Path) -> tuple[BackgroundMap, bytes]:
    """Tiles and one of them (MBTiles 1.3: rows count from the south)."""
    database = sqlite3.connect(f"file:{quote(str(path))}?mode=ro&immutable=1", uri=True, check_same_thread=False)
    lock = Lock()

    def row(query: str, *values: object) -> tuple[Any, ...]:
        with lock, limited_steps(database, MAX_QUERY_STEPS):  # `tiles` may be a stored query
            return database.execute(query, values).fetchone() or (None,)

    def tile(zoom: int, column: int, line: int) -> bytes | None:
        query = "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?"
        (data,) = row(query, zoom, column, (1 << zoom) - 1 - line)
        return data if isinstance(data, bytes) else None

    first, last = row("SELECT min(zoom_level), max(zoom_level) FROM tiles")
    some = row("SELECT tile_data FROM tiles LIMIT 1")[0]
    said = row("SELECT value FROM metadata WHERE name = 'attribution'")[0]
    return BackgroundMap((int(first), int(last)), _plain(said), tile), some if isinstance(some, bytes) else b""


def _pmtiles(path: Path) -> tuple[BackgroundMap, bytes]:
    """Tiles and one of them (PMTiles 3)."""
    try:
        from pmtiles.reader import MmapSource, Reader, all_tiles
    except ImportError:
        raise MissingExtraError("pmtiles", "cab", Text("PMTiles are read by it.")) from None
    with path.open("rb") as file:
        source = MmapSource(file)
    reader = Reader(source)
    header = reader.header()
    said = reader.metadata()
    _, first = next(iter(all_tiles(source)), (None, b""))
    attribution = said.get("attribution") if isinstance(said, dict) else ""
    return BackgroundMap((header["min_zoom"], header["max_zoom"]), _plain(attribution), reader.get), first


def _plain(text: object) -> str:
    """A text without its HTML tags."""
    return re.sub(r"<[^>]*>", "", text)[:120] if isinstance(text, str) else ""
