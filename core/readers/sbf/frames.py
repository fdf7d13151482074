"""SBF blocks: ``$@``, CRC, block number and revision, length, body; the CRC is over all behind itself.

(Septentrio, SBF reference guide, "SBF block header format" and "CRC field": CRC-CCITT, polynomial 1021 hexadecimal,
beginning with 0.)
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

LONGEST: Final = 1 << 15
"""Bytes of a block above which a length is not believed; measurement epochs of all satellites take a quarter of it."""
HEADER: Final = 8
_DOLLAR, _AT = 0x24, 0x40
_POLYNOMIAL = 0x1021


def scan(data: NDArray[np.uint8], last: bool) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """The intact blocks in a piece of a stream, as :data:`furrowmap.core.readers.frames.Scan` says.

    The kind of a block is its number without the revision; its content begins at ``$``. The CRC comes from running ones
    (that of a piece is the one up to its end, less the one up to its beginning moved along), so that it costs the same
    whatever length a block claims, and a hostile file is not read over and over.
    """
    frames = np.empty((len(data) // HEADER + 1, 3), np.int64)
    counts = np.zeros(3, np.int64)
    rows, used = _scan(data, last, frames, counts)
    return frames[:rows].copy(), counts, used


@njit(cache=True, nogil=True)
def _scan(data: Any, last: Any, frames: Any, counts: Any) -> tuple[int, int]:
    size = len(data)
    table = np.zeros(256, np.int64)
    for value in range(256):
        crc = value << 8
        for _ in range(8):
            crc = ((crc << 1) ^ _POLYNOMIAL) & 0xFFFF if crc & 0x8000 else crc << 1
        table[value] = crc
    running = np.zeros(size + 1, np.uint16)
    crc = 0
    for k in range(size):
        crc = ((crc << 8) & 0xFFFF) ^ table[(crc >> 8) ^ np.int64(data[k])]
        running[k + 1] = crc
    moved = np.zeros(LONGEST + 1, np.int64)  # x to the power of 8 n, modulo the polynomial
    moved[0] = 1
    for n in range(LONGEST):
        moved[n + 1] = ((moved[n] << 8) & 0xFFFF) ^ table[moved[n] >> 8]
    rows = 0
    i: Any = 0
    while i + 1 < size:
        if data[i] != _DOLLAR or data[i + 1] != _AT:
            i += 1
            continue
        length = np.int64(0)
        if i + HEADER <= size:
            length = np.int64(data[i + 6]) + 256 * np.int64(data[i + 7])
            if length > LONGEST or length < HEADER or length % 4:
                counts[0] += 1
                i += 2
                continue
        if i + HEADER > size or i + length > size:
            if not last:
                return rows, i
            counts[1] += 1
            i += 2
            continue
        wanted = np.int64(data[i + 2]) + 256 * np.int64(data[i + 3])
        crc = np.int64(running[i + length]) ^ _product(np.int64(running[i + 4]), moved[length - 4])
        if crc != wanted:
            counts[0] += 1
            i += 2
            continue
        frames[rows, 0] = (np.int64(data[i + 4]) + 256 * np.int64(data[i + 5])) & 0x1FFF
        frames[rows, 1] = i
        frames[rows, 2] = length
        rows += 1
        counts[2] += length
        i += length
    if i < size and not last and data[i] == _DOLLAR:
        return rows, i
    return rows, size


@njit(cache=True, nogil=True)
def _product(a: int, b: int) -> int:
    """Of two polynomials over GF(2), modulo that of the CRC."""
    out = 0
    while b:
        if b & 1:
            out ^= a
        b >>= 1
        a = ((a << 1) ^ _POLYNOMIAL) & 0xFFFF if a & 0x8000 else a << 1
    return out
