"""True orthophotos as cloud-optimised GeoTIFF."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from rasterio.enums import ColorInterp
from rasterio.windows import Window

from furrowmap.core.images.colouring import OPAQUE, Colours
from furrowmap.core.readers.geotiff import open_geotiff
from furrowmap.core.runtime.background import in_turn
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.languages.texts import Words
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.runtime.settings import threads
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters.cog import COG_BLOCK, scratch_raster
from furrowmap.exporters.rasters.windows import windows

PART_CELLS: Final = 200
"""Cells of the surface across a part that is coloured at once."""
ORTHOPHOTO_TITLE: Final = "Orthophoto: the surface in the colours of the images"
_SCRATCH_RGBA: Final = {
    "driver": "GTiff", "dtype": "uint8", "count": 4, "tiled": True, "blockxsize": 256, "blockysize": 256,
    "interleave": "pixel", "photometric": "RGB", "alpha": "YES", "SPARSE_OK": "TRUE", "BIGTIFF": "IF_SAFER",
}  # fmt: skip
_JPEG_OPTIONS: Final = {
    "driver": "COG",
    "BLOCKSIZE": str(COG_BLOCK),
    "COMPRESS": "JPEG",
    "QUALITY": "90",
    "OVERVIEW_RESAMPLING": "AVERAGE",
    "BIGTIFF": "IF_SAFER",
}


def write_orthophoto(
    path: Path,
    surface: Path,
    colours: Colours,
    origin_m: tuple[float, float, float],
    origin: Origin,
    progress: Progress = silent,
) -> float:
    """Write the orthophoto of a surface (a GeoTIFF of this program): red, green, blue, and a mask of the picture.

    Memory is some hundred megabytes, regardless of the size. Returns the area with a picture in square metres of the
    map; raises InputError if the surface cannot be read.
    """
    covered = 0
    with open_geotiff(surface, _unusable, with_heights=False) as heights:
        cell_m = heights.transform.a
        west = heights.transform.c
        north = heights.transform.f
        grid = Grid(cell_m, round(west / cell_m), round(north / cell_m), (heights.height, heights.width))
        finer = colours.pixels_a_cell(cell_m)
        whole = Grid(cell_m / finer, grid.west * finer, grid.north * finer, (grid.rows * finer, grid.columns * finer))
        profile = {**_SCRATCH_RGBA, "crs": heights.crs}
        with scratch_raster(path, whole, profile, _JPEG_OPTIONS, replace(origin, title=ORTHOPHOTO_TITLE)) as raster:
            raster.colorinterp = [ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha]
            done = 0
            for part, picture in _pictures(heights, grid, colours, finer, origin_m):
                rows, columns = part.window_in(grid)
                raster.write(picture, window=Window(columns.start * finer, rows.start * finer, *picture.shape[:0:-1]))
                covered += int(np.count_nonzero(picture[3] == OPAQUE))
                done += part.rows * part.columns
                progress("making orthophoto", done / (grid.rows * grid.columns))
    return covered * whole.cell_area_m2


def _pictures(
    heights: Any, grid: Grid, colours: Colours, finer: int, origin_m: tuple[float, float, float]
) -> Iterator[tuple[Grid, NDArray[np.uint8]]]:
    """The parts of the orthophoto, several of them made at once."""
    read = (
        (wide, heights.read(1, window=Window.from_slices(*wide.window_in(grid)), masked=False).astype(np.float32), part)
        for part, wide in windows(grid, 1, PART_CELLS)
    )
    known = (one for one in read if np.isfinite(one[1]).any())
    with ThreadPoolExecutor(threads()) as pool:
        yield from in_turn(pool, lambda one: (one[2], colours.orthophoto(*one, finer, origin_m)), known, threads() + 1)


def _unusable(path: Path, fault: Words) -> InputError:
    return InputError("not-a-surface.for-this-work", path=path, fault=fault)
