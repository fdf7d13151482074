"""Damaged tables of images, and damaged images."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, Final

from PIL import Image

from furrowmap.core.readers.exif import exif_images
from furrowmap.core.readers.exposure_marks import read_marks
from furrowmap.core.readers.image_pixels import image_size, read_pixels
from furrowmap.core.readers.image_table import is_image_table, read_image_table
from furrowmap.core.readers.reader import Recognised
from furrowmap.core.runtime.errors import InputError
from furrowmap.workflows.live.background_map import open_background
from furrowmap.workflows.live.server import tile_of
from tests.app.live.map_tiles import TILE, mbtiles, pmtiles
from tests.core.readers.image_bags import filmed
from tests.core.readers.small_bags import ROS1, write_bag1, write_bag2
from tests.fuzz.trials import Entry


def table() -> bytes:
    rows = [f"{k:04}.jpg,{1779529272.0 + k:.3f},2026-05-23T09:41:{12 + k}Z" for k in range(20)]
    return "\n".join(["file,time_unix_s,time", *rows, ""]).encode()


def photo(kind: str) -> bytes:
    """A small image with a time and a position."""
    exif = Image.Exif()
    exif.get_ifd(0x8769).update({0x9003: "2026:05:23 11:41:12", 0x9291: "25", 0x9011: "+02:00"})
    exif.get_ifd(0x8825).update({1: "N", 2: (55.0, 20.0, 30.0), 3: "E", 4: (11.0, 23.0, 6.0), 6: 12.5})
    names = {"RtkFlag": 50, "GpsLatitude": 55.3, "GpsLongitude": 11.4, "AbsoluteAltitude": 99.5, "RtkStdLon": 0.01}
    said = " ".join(f'drone-dji:{name}="{value}"' for name, value in names.items())
    xmp = f'<x xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/" {said}/>'.encode()
    packet = {"xmp": xmp} if kind == "JPEG" else {}
    out = io.BytesIO()
    Image.linear_gradient("L").resize((24, 16)).convert("RGB").save(out, kind, exif=exif, **packet)
    return out.getvalue()


def read_table(path: Path) -> None:
    """As a session does."""
    is_image_table(path)
    read_image_table(path, path.parent)


def read_photo(path: Path) -> None:
    """Time, position and pixels; a run counts images that cannot be read."""
    exif_images([path])
    try:
        read_pixels(path, 2)
    except ValueError as error:
        raise InputError("not-an-image", what=str(error), meaning="It is counted.", remedy="Use others.") from None


def bags(folder: Path) -> list[dict[str, bytes]]:
    """Bags of ROS 1 and 2 with raw and packed images."""
    first = write_bag1(folder / "images.bag", filmed("jpeg", store=ROS1))
    second = write_bag2(folder / "images", filmed("bayer_rggb8"))
    return [{path.name: path.read_bytes()} for path in (first, next(second.glob("*.mcap")))]


def read_bag(path: Path) -> None:
    """Images, camera and pixels, as a session with `camera.topic` does."""
    reader: Any = Recognised.by_content(path).open()
    images = reader.images()
    for image in images.paths:
        try:
            read_pixels(image, 1)
        except ValueError:
            image_size(image)
    reader.camera()


def maps(folder: Path) -> list[dict[str, bytes]]:
    """Background maps of a live page."""
    paths = mbtiles(folder / "map.mbtiles"), pmtiles(folder / "map.pmtiles")
    return [{path.name: path.read_bytes()} for path in paths]


def read_map(path: Path) -> None:
    """As the server of the page does, which answers with nothing where a tile cannot be read."""
    tile_of(open_background(path), *TILE)


def marks() -> bytes:
    """Exposure times beside an image with the number 1."""
    tail = "35.1,Lat\t139.1,Lon\t99.5,Ellh\t0.01, 0.01, 0.02\t50,Q"
    return "".join(f"{n}\t{554_000 + n}.5\t[2420]\t 1,N\t 2,E\t 3,V\t{tail}\n" for n in range(1, 9)).encode()


def read_marked(path: Path) -> None:
    """An image beside them; lines of another form are left out."""
    image = path.parent / "a_0001.jpg"
    image.write_bytes(photo("JPEG"))
    exif_images([image])
    if len(read_marks(path)) < 8:
        raise InputError("not-an-image", what="A mark is lost.", meaning="EXIF counts.", remedy="Copy it again.")


IMAGES: Final = (
    Entry("exposure-marks", lambda _: [{"a_Timestamp.MRK": marks()}], read_marked, trials=50),
    Entry("rosbag-images", bags, read_bag, trials=60),
    Entry("map-tiles", maps, read_map, trials=60),
    Entry("image-table", lambda _: [{"images.csv": table()}], read_table, trials=50),
    Entry("exif-jpeg", lambda _: [{"a.jpg": photo("JPEG")}], read_photo, trials=50),
    Entry("exif-tiff", lambda _: [{"a.tif": photo("TIFF")}], read_photo, trials=50),
)
