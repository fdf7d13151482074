"""Small background maps, written by other programs' libraries."""

from __future__ import annotations

import io
import sqlite3
from pathlib import Path

from PIL import Image
from pmtiles.tile import Compression, TileType, zxy_to_tileid
from pmtiles.writer import write

TILE = (17, 116_500, 50_852)


def image(kind: str = "PNG") -> bytes:
    out = io.BytesIO()
    Image.linear_gradient("L").convert("RGB").save(out, kind)
    return out.getvalue()


def mbtiles(path: Path, tile: bytes = image()) -> Path:
    zoom, column, row = TILE
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE metadata (name text, value text)")
        database.execute("CREATE TABLE tiles (zoom_level int, tile_column int, tile_row int, tile_data blob)")
        database.execute("INSERT INTO metadata VALUES ('attribution', '<a href=\"x\">The Survey</a>')")
        database.execute("INSERT INTO tiles VALUES (?, ?, ?, ?)", (zoom, column, 2**zoom - 1 - row, tile))
    database.close()
    return path


def pmtiles(path: Path, tile: bytes = image()) -> Path:
    header = {"tile_type": TileType.PNG, "tile_compression": Compression.NONE, "center_zoom": 17}
    header |= {f"{end}_{axis}_e7": 0 for end in ("min", "max", "center") for axis in ("lon", "lat")}
    with write(str(path)) as writer:
        writer.write_tile(zxy_to_tileid(*TILE), tile)
        writer.finalize(header, {"attribution": "The Survey"})
    return path
