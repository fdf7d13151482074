"""The records of a binary time log: their offsets, damage between them, and all values.

ISO 11783-10:2015, annex D. Records are of different lengths, so each is found from the one before.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray


def find_records(
    data: NDArray[np.uint8], width: int, places: tuple[int, int], channels: int
) -> tuple[NDArray[np.int64], int, int]:
    """Offset of each record (n,), number of bytes that are not records, and in how many places.

    A record is plausible if its time is within a day, its position is on the Earth or missing, its values are among the
    header's, and its day is within a year of the record before. After damage, reading resumes at the next two plausible
    records in a row.

    Args:
        data: (m,) the file.
        width: bytes before the number of values.
        places: offsets of latitude and longitude in a record; −1 if it has none.
        channels: number of values in the header.
    """
    starts, lost, breaks = _records(data, width, np.array(places, np.int64), channels)
    return starts, int(lost), int(breaks)


def read_values(
    data: NDArray[np.uint8], starts: NDArray[np.int64], width: int
) -> tuple[NDArray[np.int64], NDArray[np.uint8], NDArray[np.int32]]:
    """(record, channel, value), each (k,), of all values in the records at the offsets `starts` (n,)."""
    count = int(data[starts + width].astype(np.int64).sum()) if len(starts) else 0
    record, channel, value = _values(data, starts, width, count)
    return record, channel, value


@numba.njit(cache=True, nogil=True)
def _record_end(data: Any, at: int, width: int, offsets: Any, channels: int) -> Any:
    """End of the record at an offset; −1 if it is not plausible, −2 if the file ends within it."""
    size = len(data)
    if at + width + 1 > size:
        return -2
    millis = data[at] + (data[at + 1] << 8) + (data[at + 2] << 16) + (np.int64(data[at + 3]) << 24)
    if millis > 86_400_999:
        return -1
    end = at + width + 1 + 5 * np.int64(data[at + width])
    if end > size:
        return -2
    for k in range(at + width + 1, end, 5):
        if data[k] >= channels:
            return -1
    for k in range(2):
        if offsets[k] >= 0:
            place = at + offsets[k]
            raw = np.int32(
                np.uint32(data[place])
                | (np.uint32(data[place + 1]) << np.uint32(8))
                | (np.uint32(data[place + 2]) << np.uint32(16))
                | (np.uint32(data[place + 3]) << np.uint32(24))
            )
            limit = 900_000_000 if k == 0 else 1_800_000_000
            # values around 0x7FFFFFFF stand for no position
            if (raw > limit or raw < -limit) and raw < 0x7FFFFFF0 and raw > -0x7FFFFFF0:
                return -1
    return end


@numba.njit(cache=True, nogil=True)
def _day(data: Any, at: int) -> Any:
    return np.int64(data[at + 4]) + (np.int64(data[at + 5]) << 8)


@numba.njit(cache=True, nogil=True)
def _records(data: Any, width: int, offsets: Any, channels: int) -> Any:
    """Offset of each record (n,), number of bytes that are not records, and in how many places."""
    size = len(data)
    starts = np.empty(size // (width + 1) + 1, np.int64)
    n, at, lost, breaks = 0, 0, 0, 0
    broken = False
    while at < size:
        end = _record_end(data, at, width, offsets, channels)
        good = end > 0
        if good and (broken or n > 0) and n > 0 and abs(_day(data, at) - _day(data, starts[n - 1])) > 366:
            good = False  # a log does not span years: this is damage
        if good and broken:
            # after damage, resume at two records in a row on neighbouring days
            follower = _record_end(data, end, width, offsets, channels) if end < size else -1
            good = follower > 0 and abs(_day(data, end) - _day(data, at)) <= 1
        if good:
            starts[n] = at
            n += 1
            at = end
            broken = False
        else:
            if not broken:
                breaks += 1
            broken = True
            lost += 1
            at += 1
    return starts[:n].copy(), lost, breaks


@numba.njit(cache=True, nogil=True)
def _values(data: Any, starts: Any, width: int, count: int) -> Any:
    """(record, channel, value) of all values."""
    record = np.empty(count, np.int64)
    channel = np.empty(count, np.uint8)
    value = np.empty(count, np.int32)
    k = 0
    for n in range(len(starts)):
        at = starts[n] + width
        for _ in range(np.int64(data[at])):
            place = at + 1
            record[k] = n
            channel[k] = data[place]
            value[k] = np.int32(
                np.uint32(data[place + 1])
                | (np.uint32(data[place + 2]) << np.uint32(8))
                | (np.uint32(data[place + 3]) << np.uint32(16))
                | (np.uint32(data[place + 4]) << np.uint32(24))
            )
            at += 5
            k += 1
    return record, channel, value
