"""UTC of the stamps of an Ouster sensor.

Stamps count nanoseconds: since the sensor's start, or since 1970 if a receiver (PPS and GPRMC) or PTP sets the clock. A
PTP grandmaster usually counts TAI, which is ahead of UTC by an offset that its announce messages state (IEEE 1588-2019,
clauses 7.2.4 and 13.5); `nmea_leap_seconds` of the metadata is what the sensor adds to the receiver's UTC.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from furrowmap.core.readers.ouster.metadata import Metadata
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.scan import Clock

FROM_PTP: Final = "TIME_FROM_PTP_1588"
FROM_PULSE: Final = "TIME_FROM_SYNC_PULSE_IN"
PTP_PORT: Final = 320
_ANNOUNCE: Final = 0x0B
_ANNOUNCE_BYTES: Final = 64
_OFFSET_VALID, _PTP_TIMESCALE = 0x04, 0x08
_OFFSET_AT: Final = 44
_EPOCH_NS: Final = 946_684_800 * 10**9
"""2000-01-01: smaller stamps count from the sensor's start."""
_TAI_S: Final = 37.0
_FITS_S: Final = 2.0


@dataclass(frozen=True)
class SensorTime:
    """What the stamps count from: UTC is the stamp minus `minus_ns`; `note` says it for people."""

    kind: Clock
    minus_ns: int
    note: str


def announced_s(payload: bytes) -> int | None:
    """TAI minus UTC by a PTP message; None for one that does not state it."""
    if len(payload) < _ANNOUNCE_BYTES or payload[0] & 0x0F != _ANNOUNCE or payload[1] & 0x0F != 2:
        return None
    if payload[7] & (_OFFSET_VALID | _PTP_TIMESCALE) != _OFFSET_VALID | _PTP_TIMESCALE:
        return None
    return int.from_bytes(payload[_OFFSET_AT : _OFFSET_AT + 2], "big", signed=True)


def settle(
    stamp_ns: IntArray, host_s: FloatArray, metadata: Metadata, tai_s: int | None
) -> tuple[SensorTime, list[Notice]]:
    """What the stamps count from, and what is unusual about it.

    Args:
        stamp_ns: (m,) stamps of the first packets, m > 0.
        host_s: (m,) the recorder's times of these.
        tai_s: TAI minus UTC as PTP announced it; None if it did not.
    """
    mode = metadata.timestamp_mode
    if np.median(stamp_ns) < _EPOCH_NS:
        apart_ns = stamp_ns - np.round(host_s * 1e9).astype(np.int64)
        why = f"set by nothing ({mode or 'mode not stated'})"
        return SensorTime(Clock.RECORDER, int(np.median(apart_ns)), why), [
            Notice("ouster-clock-own", mode=mode or None)
        ]
    ahead_s = float(np.median(stamp_ns * 1e-9 - host_s))
    if mode == FROM_PULSE:
        leap_s = metadata.leap_s
        return SensorTime(Clock.SENSOR_GPS, leap_s * 10**9, f"set by pulse and GPRMC, {leap_s} s added"), []
    if tai_s is not None:
        return SensorTime(Clock.SENSOR, tai_s * 10**9, f"set by PTP, which announces TAI - UTC = {tai_s} s"), []
    notices = []
    if abs(ahead_s - _TAI_S) < _FITS_S:
        notices.append(Notice("ouster-clock-tai", ahead_s=ahead_s, tai_s=_TAI_S))
    elif abs(ahead_s) > _FITS_S:
        notices.append(Notice("ouster-clock-apart", ahead_s=ahead_s, mode=mode or None))
    return SensorTime(Clock.SENSOR, 0, f"set by {'PTP' if mode == FROM_PTP else 'an unstated source'}"), notices
