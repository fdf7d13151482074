"""Pixels as sensors give them: the encodings of `sensor_msgs/Image` (sensor_msgs/image_encodings.hpp)."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.values.images import RawLayout

CHANNELS: Final = {
    "rgb8": (0, 1, 2),
    "bgr8": (2, 1, 0),
    "rgba8": (0, 1, 2),
    "bgra8": (2, 1, 0),
    "8UC3": (2, 1, 0),
    "mono8": (0, 0, 0),
    "8UC1": (0, 0, 0),
    "mono16": (0, 0, 0),
    "16UC1": (0, 0, 0),
}
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


def raw_pixels(data: memoryview | bytes, layout: RawLayout) -> NDArray[np.uint8]:
    """Red, green, blue (height, width, 3) uint8; of values with 16 bits the upper eight.

    Mosaics of a Bayer filter are interpolated by OpenCV, bilinearly.

    Raises:
        ValueError: if the bytes are no such image.
        ImportError: if OpenCV is needed and not installed.
    """
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
