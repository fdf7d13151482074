"""GeoTIFFs of any software, opened without trusting what they state."""

import re
import struct
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, Final

import numpy as np
from pyproj.exceptions import CRSError, ProjError

from furrowmap.core.readers.raster_neighbours import expect_no_links, with_checked_neighbours
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.languages.texts import Text, Words, reason
from furrowmap.core.runtime.memory import expect_memory
from furrowmap.core.runtime.plain_reads import expect_plain_file
from furrowmap.core.values.crs import crs_of_file

HEIGHT_BAND_NAME: Final = "height"
"""Name of the first band of furrowmap's surfaces, and of none of its other rasters."""

_HEIGHT_WORDS: Final = re.compile(
    r"height|elev|altitude|\bd[stehu]m\b|^[zh]$|h(ö|oe)he|altitud|hauteur|標高|高さ", re.IGNORECASE
)
"""In the descriptions of bands that hold heights."""
_BIG_TIFF: Final = 43
_KEY_DIRECTORY: Final = 34735
_MOST_TAGS: Final = 4096


@contextmanager
def open_geotiff(
    path: Path, unusable: Callable[[Path, Words], InputError], *, with_heights: bool = True
) -> Iterator[Any]:
    """A dataset of rasterio, within which whatever GDAL, PROJ and rasterio raise becomes an error of ours.

    No other format is opened, whatever its name, and no file that it refers to: a VRT may refer to any.

    Args:
        with_heights: whether its CRS includes that of its heights, where the file states one.

    Raises:
        InputError: if it is no GeoTIFF, is damaged, refers to other files, or its cells have no extent.
        RefusedError: if one of its blocks takes more than half of the free memory.
    """
    import rasterio
    from rasterio.errors import RasterioError

    try:
        expect_plain_file(path)
    except OSError as error:
        raise unusable(path, Text("cannot be read ({why})", why=error.strerror)) from None
    try:
        # An option of the process: stated either way, and only while the file is opened, which reads the CRS. Held by
        # several open files, with other environments in between, it outlived them all (rasterio 1.4).
        with ExitStack() as stack:
            own, options = stack.enter_context(with_checked_neighbours(path))
            with rasterio.Env(GTIFF_REPORT_COMPD_CS=with_heights, **options):
                raster = stack.enter_context(rasterio.open(own, driver="GTiff"))
            expect_no_links(raster)
            if raster.crs is not None:
                crs_of_file(raster.crs.to_wkt())
            if not np.isfinite(raster.transform).all() or raster.transform.is_degenerate:
                raise unusable(path, Text("states cells without an extent"))
            scale = raster.scales[0]
            offset = raster.offsets[0]
            if scale == 0.0 or not np.isfinite([scale, offset]).all():
                raise unusable(
                    path, Text("states the scale {scale:g} and offset {offset:g}", scale=scale, offset=offset)
                )
            block = max(rows * columns for rows, columns in raster.block_shapes)
            expect_memory(
                Text("A block of {path}", path=path), block * max(np.dtype(kind).itemsize for kind in raster.dtypes)
            )
            yield raster
    except (RasterioError, CRSError, ProjError, ValueError) as error:
        raise unusable(path, Text("cannot be read as a GeoTIFF ({why})", why=reason(error))) from None


def short_keys(path: Path) -> dict[int, int]:
    """The GeoTIFF keys of a file that have one number, such as a code; none where its first directory is damaged."""
    with path.open("rb") as file, suppress(struct.error, KeyError, OverflowError, OSError):
        order, kind = struct.unpack("2s2s", file.read(4))
        end = {b"II": "<", b"MM": ">"}[order]
        big = struct.unpack(f"{end}H", kind)[0] == _BIG_TIFF
        file.seek(8 if big else 4)
        word, count = (f"{end}Q", f"{end}Q") if big else (f"{end}I", f"{end}H")
        file.seek(struct.unpack(word, file.read(struct.calcsize(word)))[0])
        tags = struct.unpack(count, file.read(struct.calcsize(count)))[0]
        entry = f"{end}HHQQ" if big else f"{end}HHII"
        for _ in range(min(tags, _MOST_TAGS)):
            tag, _, numbers, place = struct.unpack(entry, file.read(struct.calcsize(entry)))
            if tag == _KEY_DIRECTORY and 4 <= numbers <= _MOST_TAGS:
                file.seek(place)
                directory = struct.unpack(f"{end}{numbers}H", file.read(2 * numbers))
                keys = zip(*(iter(directory[4 : 4 + (numbers - 4) // 4 * 4]),) * 4, strict=True)
                return {key: value for key, where, _, value in keys if where == 0}
    return {}


def expect_crs(raster: Any, path: Path) -> None:
    """Raises InputError where a raster has no CRS."""
    if raster.crs is None:
        raise InputError("raster-no-crs", path=path)


def expect_heights(raster: Any, path: Path, unusable: Callable[[Path, Words], InputError]) -> None:
    """Raises InputError where a raster has no CRS, or its first band says that it holds no heights above a datum."""
    expect_crs(raster, path)
    band = raster.descriptions[0]
    if raster.tags().get("TIFFTAG_SOFTWARE", "").startswith("furrowmap") and band != HEIGHT_BAND_NAME:
        raise unusable(path, Text("holds {band!r} and no heights above a datum", band=band))
    shown = [kind.name for kind in raster.colorinterp]
    if shown[:3] == ["red", "green", "blue"] or shown[0] == "palette":
        raise unusable(
            path, Text("holds {classes:classes|colours} and no heights above a datum", classes=shown[0] == "palette")
        )
    if band and not _HEIGHT_WORDS.search(band):
        heights = [k for k, name in enumerate(raster.descriptions, start=1) if name and _HEIGHT_WORDS.search(name)]
        if heights:
            raise unusable(
                path,
                Text(
                    "has {band!r} in its first band and heights in band {number}, {name!r}; the first is read: write "
                    "that band to a file of its own",
                    band=band,
                    number=heights[0],
                    name=raster.descriptions[heights[0] - 1],
                ),
            )
