"""Pictures in the file formats of web pages, by GDAL."""

import base64
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.errors import NotGeoreferencedWarning
from rasterio.io import MemoryFile


def encode_image(pixels: NDArray[np.uint8], driver: str, **options: str) -> bytes:
    """An image (rows, columns, channels), first row on top, as a file of a driver of GDAL such as "PNG" or "WEBP"."""
    rows, columns, channels = pixels.shape
    profile: dict[str, Any] = {"width": columns, "height": rows, "count": channels, "dtype": "uint8"}
    with rasterio.Env(GDAL_PAM_ENABLED=False), MemoryFile() as memory, catch_warnings():
        simplefilter("ignore", NotGeoreferencedWarning)
        with memory.open(driver=driver, **profile, **options) as image:
            image.write(np.moveaxis(pixels, -1, 0))
        return bytes(memory.read())


def data_uri(pixels: NDArray[np.uint8]) -> str:
    """An image (rows, columns, channels) with 1 to 4 channels, first row on top, as a PNG in a data URI."""
    return "data:image/png;base64," + base64.b64encode(encode_image(pixels, "PNG", ZLEVEL="9")).decode("ascii")
