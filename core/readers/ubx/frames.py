"""UBX frames: two bytes of synchronisation, class, id, length, payload, and Fletcher's checksum over all behind those.

(u-blox, interface description of the ZED-F9P, "UBX frame structure" and "UBX checksum".)
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

LONGEST: Final = 8192
"""Bytes of payload above which a length is not believed; the longest messages (RXM-RAWX) take half of it."""
_SYNC_1, _SYNC_2 = 0xB5, 0x62
_FRAME = 8


def scan(data: NDArray[np.uint8], last: bool) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """The intact frames in a piece of a stream, as :data:`furrowmap.core.readers.frames.Scan` says.

    The kind of a frame is 256 × class + id. A checksum is the difference of two running sums, so that it costs the same
    whatever length a frame claims, and a hostile file is not read over and over.
    """
    frames = np.empty((len(data) // _FRAME + 1, 3), np.int64)
    counts = np.zeros(3, np.int64)
    rows, used = _scan(data, last, frames, counts)
    return frames[:rows].copy(), counts, used


@njit(cache=True, nogil=True)
def _scan(data: Any, last: Any, frames: Any, counts: Any) -> tuple[int, int]:
    size = len(data)
    one = np.zeros(size + 1, np.uint8)
    two = np.zeros(size + 1, np.uint8)
    for k in range(size):
        one[k + 1] = (one[k] + data[k]) & 255
        two[k + 1] = (two[k] + one[k + 1]) & 255
    rows = 0
    i: Any = 0
    while i + 1 < size:
        if data[i] != _SYNC_1 or data[i + 1] != _SYNC_2:
            i += 1
            continue
        length = np.int64(LONGEST + 1)
        if i + 6 <= size:
            length = np.int64(data[i + 4]) + 256 * np.int64(data[i + 5])
            if length > LONGEST:
                counts[0] += 1
                i += 2
                continue
        end = i + 6 + length
        if i + 6 > size or end + 2 > size:
            if not last:
                return rows, i
            counts[1] += 1
            i += 2
            continue
        a = (np.int64(one[end]) - np.int64(one[i + 2])) & 255
        b = (np.int64(two[end]) - np.int64(two[i + 2]) - (end - i - 2) * np.int64(one[i + 2])) & 255
        if a != data[end] or b != data[end + 1]:
            counts[0] += 1
            i += 2
            continue
        frames[rows, 0] = 256 * np.int64(data[i + 2]) + np.int64(data[i + 3])
        frames[rows, 1] = i + 6
        frames[rows, 2] = length
        rows += 1
        counts[2] += length + 8
        i = end + 2
    if i < size and not last and data[i] == _SYNC_1:
        return rows, i
    return rows, size
