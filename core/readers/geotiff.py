"""GeoTIFFs of any software, opened without trusting what they state."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from pyproj.exceptions import CRSError, ProjError

from furrowmap.core.readers.raster_neighbours import expect_no_links, with_checked_neighbours
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.memory import expect_memory
from furrowmap.core.values.crs import crs_of_file

HEIGHT_BAND_NAME: Final = "height"
"""Name of the first band of furrowmap's surfaces, and of none of its other rasters."""


@contextmanager
def open_geotiff(
    path: Path, unusable: Callable[[Path, str], InputError], *, with_heights: bool = True
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
                raise unusable(path, "states cells without an extent")
            block = max(rows * columns for rows, columns in raster.block_shapes)
            expect_memory(f"A block of {path}", block * max(np.dtype(kind).itemsize for kind in raster.dtypes))
            yield raster
    except (RasterioError, CRSError, ProjError, ValueError) as error:
        raise unusable(path, f"cannot be read as a GeoTIFF ({' '.join(str(error).split())[:200]})") from None


def expect_heights(raster: Any, path: Path, unusable: Callable[[Path, str], InputError]) -> None:
    """Raises InputError where a raster has no CRS, or is one of furrowmap's that holds no heights above a datum."""
    if raster.crs is None:
        raise unusable(path, "has no CRS")
    band = raster.descriptions[0]
    if raster.tags().get("TIFFTAG_SOFTWARE", "").startswith("furrowmap") and band != HEIGHT_BAND_NAME:
        raise unusable(path, f"holds {band!r} and no heights above a datum")
