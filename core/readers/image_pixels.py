"""Pixels of image files, and of raw images of sensors (sensor_msgs/image_encodings.hpp)."""

import io
import warnings
from importlib.util import find_spec
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.errors import MissingExtraError
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.memory import expect_growth
from furrowmap.core.values.images import ImageFile, RawLayout, StoredImage

PILLOW_FORMATS: Final = ("JPEG", "PNG", "TIFF")
MAX_PIXELS: Final = 300_000_000
"""Of the largest aerial cameras; more would exhaust the memory."""
CHANNELS: Final = {
    "rgb8": (0, 1, 2), "bgr8": (2, 1, 0), "rgba8": (0, 1, 2), "bgra8": (2, 1, 0), "8UC3": (2, 1, 0), "mono8": (0, 0, 0),
    "8UC1": (0, 0, 0), "mono16": (0, 0, 0), "16UC1": (0, 0, 0),
}  # fmt: skip
"""Channels that are red, green and blue; 8UC3 is OpenCV's order."""
BAYER: Final = {"bayer_rggb": "BG", "bayer_bggr": "RG", "bayer_gbrg": "GR", "bayer_grbg": "GB"}
"""OpenCV names a pattern by the second and third pixel of its second row, ROS by the first four."""
YUV: Final = {"yuv422": "UYVY", "uyvy": "UYVY", "yuv422_yuy2": "YUYV", "yuyv": "YUYV"}
_VALUES_PER_PIXEL: Final = {"rgba8": 4, "bgra8": 4, "rgb8": 3, "bgr8": 3, "8UC3": 3, **dict.fromkeys(YUV, 2)}


def layout_fault(layout: RawLayout, size: int) -> Text | None:
    """Why so many bytes are no image of a layout; None where they are one."""
    if layout.encoding not in CHANNELS and layout.encoding not in YUV and _mosaic(layout.encoding) is None:
        return Text("the encoding {encoding!r} is not supported", encoding=layout.encoding[:20])
    if min(layout.width, layout.height) < 2 or layout.step < layout.width * _values(layout) * _bytes(layout):
        return Text(
            "{width} × {height} pixels do not fit into rows of {step} bytes",
            width=layout.width,
            height=layout.height,
            step=layout.step,
        )
    if layout.step * layout.height > size:
        return Text(
            "{height} rows of {step} bytes are stated, there are {size} bytes",
            height=layout.height,
            step=layout.step,
            size=size,
        )
    if layout.encoding in YUV and layout.width % 2:
        return Text("{width} columns of {encoding} are not even", width=layout.width, encoding=layout.encoding)
    return None


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
    except Exception as error:  # noqa: BLE001 (Pillow raises errors of all families on damaged files)
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
    except Exception:  # noqa: BLE001 (Pillow raises errors of all families on damaged files)
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
        raise MissingExtraError("Pillow", "photo", Text("Images are read by it."))
