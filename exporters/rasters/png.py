"""Small images as PNG (ISO/IEC 15948), to embed in a page."""

from __future__ import annotations

import base64
import struct
import zlib
from typing import Final

import numpy as np
from numpy.typing import NDArray

_COLOUR_TYPES: Final = {1: 0, 2: 4, 3: 2, 4: 6}
"""By the number of channels: grey, grey with alpha, RGB, RGB with alpha."""


def data_uri(picture: NDArray[np.uint8]) -> str:
    """An image (rows, columns, channels), first row on top, as a data URI."""
    return "data:image/png;base64," + base64.b64encode(png(picture)).decode("ascii")


def png(picture: NDArray[np.uint8]) -> bytes:
    """An image (rows, columns, channels) with 1 to 4 channels, first row on top, as a PNG file."""
    rows, columns, channels = picture.shape
    head = struct.pack(">IIBBBBB", columns, rows, 8, _COLOUR_TYPES[channels], 0, 0, 0)
    lines = np.zeros((rows, 1 + columns * channels), np.uint8)  # each line begins with its filter: none
    lines[:, 1:] = picture.reshape(rows, -1)
    body = zlib.compress(lines.tobytes(), 9)
    return b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", head) + _chunk(b"IDAT", body) + _chunk(b"IEND", b"")


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
