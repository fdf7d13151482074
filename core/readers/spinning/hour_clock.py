"""UTC of a sensor's stamps, as microseconds of an hour.

The stamp of a sensor with PPS and GPRMC from a GNSS receiver counts from the full hour of UTC, and its position packets
contain the hour (VLP-16 User Manual 63-9243 Rev. E, sections 9.3.1.6 and 9.3.3; PandarXT User Manual, GPS data packet).
The stamp of other sensors counts from power-on, and UTC comes from the recorder's time of each packet. Of stamps with
a date only the place in the hour is used: the recorder knows the hour, and a sensor without a receiver no date.
"""

import datetime as dt
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import reduce
from operator import xor
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.clock import DAY_S, HOUR_S, iso_utc, nearest_in_cycle
from furrowmap.core.values.scan import Clock

POSITION_BYTES: Final = 512
"""Length of a position packet's payload."""
STAMP_AT: Final = 198
SENTENCE_AT: Final = 206
HESAI_MARK: Final = b"\xff\xee"
"""First bytes of a position packet ("GPS data packet") of a Hesai."""

PPS_STATES: Final = ("absent", "synchronising", "locked", "error")
PPS_LOCKED: Final = 2

_SENTENCE_AGE_S: Final = 2.0
"""A GPRMC sentence is of the last second; if it differs more, the device stamp does not count from an hour of UTC."""
_JUMP_S: Final = 2.0
"""The recorder receives packets late and in bursts; if they differ more, the sensor's clock was reset."""
_DISCIPLINED_S: Final = 2.0
"""Stamps this close to the recorder's time past the hour count from the hour: by chance, one sensor in 900 does."""
_TAI_S: Final = 37.0
"""TAI minus UTC since 2017. PTP counts TAI."""
_SAME_S: Final = 0.05
"""Stamps even closer were set by the recorder, or result in the same times."""
_LATE_S: Final = 0.02
"""A stamp earlier than its predecessor by less than this is a packet out of order."""
_NEXT_S: Final = 0.25
"""A stamp later than its predecessor by less than this is not compared with the recorder's time."""
_FIRST_PLAUSIBLE_S: Final = 946_684_800.0
"""2000-01-01: a recorder with an earlier time has no clock."""

_GPRMC: Final = re.compile(
    rb"\$G[A-Z]RMC,(\d{2})(\d{2})(\d{2}(?:\.\d*)?),([AV]),"
    rb"(?:(\d{2})(\d{2}(?:\.\d*)?))?,([NS]?),(?:(\d{3})(\d{2}(?:\.\d*)?))?,([EW]?),"
    rb"[^,]*,[^,]*,(?:(\d{2})(\d{2})(\d{2}))?[^*$]*\*([0-9A-Fa-f]{2})"
)


@dataclass(frozen=True)
class PositionPacket:
    """The content of a position packet.

    Attributes:
        device_s: the sensor's time, seconds of its hour.
        pps: state of the pulse per second, an index into `PPS_STATES`.
        sentence_s: UTC of its GPRMC sentence; a time of day (0 to 86,400) without a date; nan without a sentence.
        valid: whether the receiver marked that sentence as valid (A).
    """

    host_s: float
    device_s: float
    pps: int
    sentence_s: float
    valid: bool
    lat_deg: float
    lon_deg: float

    @classmethod
    def parse(cls, payload: bytes, host_s: float) -> "PositionPacket":
        """Decode a position packet of a Velodyne or a Hesai; a damaged sentence is ignored."""
        if payload[:2] == HESAI_MARK:
            # Two digits each, the lower one first: year, month, day, second, minute, hour; then microseconds.
            second, minute = (payload[at] - 48 + 10 * (payload[at + 1] - 48) for at in (8, 10))
            device_s = minute * 60 + second + int.from_bytes(payload[14:18], "little") * 1e-6
            pps = PPS_LOCKED if payload[507] == 1 else 0
        else:
            device_s = int.from_bytes(payload[STAMP_AT : STAMP_AT + 4], "little") * 1e-6
            pps = payload[STAMP_AT + 4]
        sentence_s = lat_deg = lon_deg = float("nan")
        valid = False
        found = _GPRMC.search(payload)
        if found and reduce(xor, payload[found.start() + 1 : found.end() - 3]) == int(found[14], 16):
            sentence_s = int(found[1]) * 3600 + int(found[2]) * 60 + float(found[3])
            valid = found[4] == b"A" and sentence_s < DAY_S
            if found[11]:
                try:
                    date = dt.datetime(2000 + int(found[13]), int(found[12]), int(found[11]), tzinfo=dt.UTC)
                    sentence_s += date.timestamp()
                except ValueError:
                    valid = False
            if found[5] and found[8]:
                lat_deg = (int(found[5]) + float(found[6]) / 60) * (-1 if found[7] == b"S" else 1)
                lon_deg = (int(found[8]) + float(found[9]) / 60) * (-1 if found[10] == b"W" else 1)
        return cls(host_s, device_s, pps, sentence_s, valid, lat_deg, lon_deg)

    def utc_s(self, near_s: float) -> float | None:
        """UTC of the device stamp, with the hour of the sentence; None if the two do not match.

        `near_s` is a time within twelve hours, for sentences without a date.
        """
        if not self.valid:
            return None
        sentence_s = self.sentence_s
        if sentence_s < DAY_S:
            sentence_s = float(nearest_in_cycle(sentence_s, near_s, DAY_S))
        utc_s = float(nearest_in_cycle(self.device_s, sentence_s, HOUR_S))
        return utc_s if abs(utc_s - sentence_s) <= _SENTENCE_AGE_S else None


@dataclass
class SensorClock:
    """Converts device stamps, batch by batch in the order of the recording, to UTC.

    Rollovers of the hour and pauses are resolved with the recorder's time. If the sensor's clock is reset (it locks to
    GPS, or is restarted), time continues by the recorder's clock, and `jumps` records it.

    Attributes:
        home_s: UTC of the start of the sensor's hour, modulo an hour; 0 for a sensor that counts from the full hour.
        utc_minus_host_s: approximate UTC minus the recorder's time.
        jumps: UTC and size in seconds of each reset of the sensor's clock.
    """

    kind: Clock
    home_s: float
    utc_minus_host_s: float
    jumps: list[tuple[float, float]] = field(default_factory=list)
    _offset_s: float = 0.0
    _device_s: float = float("nan")
    _host_s: float = float("nan")

    def utc_s(self, device_us: NDArray[np.uint32], host_s: FloatArray) -> FloatArray:
        """UTC (m,) of stamps (m,), microseconds of the hour, of packets that the recorder timed (m,)."""
        if not len(device_us):
            return np.empty(0)
        device_s = device_us.astype(np.float64) * 1e-6
        step_s = np.diff(device_s, prepend=self._device_s)
        rolled = np.abs(step_s + HOUR_S) < _NEXT_S
        smooth = rolled | ((step_s > -_LATE_S) & (step_s < _NEXT_S))
        offset_s: FloatArray = self._offset_s + HOUR_S * np.cumsum(rolled, dtype=np.float64)
        for i in np.flatnonzero(~smooth).tolist():
            offset_s[i:] += self._step(i, device_s, host_s, offset_s)
        self._device_s = float(device_s[-1])
        self._host_s = float(host_s[-1])
        self._offset_s = float(offset_s[-1])
        return device_s + offset_s

    def _step(self, i: int, device_s: FloatArray, host_s: FloatArray, offset_s: FloatArray) -> float:
        """Change of the offset at packet `i`, whose stamp does not directly follow the one before."""
        first = i == 0 and np.isnan(self._device_s)
        if first:
            predicted_s = float(host_s[0]) + self.utc_minus_host_s
        elif i == 0:
            predicted_s = self._device_s + self._offset_s + float(host_s[0]) - self._host_s
        else:
            predicted_s = float(device_s[i - 1] + offset_s[i - 1] + host_s[i] - host_s[i - 1])
        bases_s = (self.home_s,) if first else (float(offset_s[i]), self.home_s)
        for base_s in bases_s:
            utc_s = float(nearest_in_cycle(device_s[i] + base_s, predicted_s, HOUR_S))
            if abs(utc_s - predicted_s) <= _JUMP_S:
                break
        else:
            utc_s = predicted_s
        change_s = utc_s - float(device_s[i] + offset_s[i])
        if not first and abs(change_s - HOUR_S * round(change_s / HOUR_S)) > _JUMP_S:
            self.jumps.append((utc_s, -change_s))
        return change_s


def settle(
    device_us: NDArray[np.uint32], host_s: FloatArray, positions: list[PositionPacket], near_s: float | None = None
) -> tuple[SensorClock, list[Notice]]:
    """Determine the origin of the sensor's stamps (m,), those of the first packets, and what is unusual about it.

    More of them reduce the recorder's jitter; `near_s` is a time near the recording, for recorders without a clock.
    """
    near = float(np.median(host_s))
    if near_s is not None and near < _FIRST_PLAUSIBLE_S:
        near = near_s
    tied = [utc_s - p.host_s for p in positions if (utc_s := p.utc_s(near)) is not None]
    if tied:
        ahead_s = float(np.median(tied))
        first_s = float(host_s[0]) + ahead_s
        follows = abs(float(nearest_in_cycle(device_us[0] * 1e-6, first_s, HOUR_S)) - first_s) <= _JUMP_S
        notices = [] if follows else [Notice("clock-before-lock", ahead_s=ahead_s)]
        return SensorClock(Clock.SENSOR_GPS, 0.0, ahead_s), notices
    if near_s is not None and float(np.median(host_s)) < _FIRST_PLAUSIBLE_S:
        utc_s = float(nearest_in_cycle(device_us[0] * 1e-6, near_s, HOUR_S))
        notice = Notice("clock-stated", host_time=iso_utc(float(host_s[0])), near_time=iso_utc(near_s))
        return SensorClock(Clock.STATED, 0.0, utc_s - float(host_s[0])), [notice]
    apart_s = host_s - device_us * 1e-6
    apart_s = nearest_in_cycle(apart_s, float(np.median(apart_s)), HOUR_S)
    home_s = float(np.median(apart_s))
    past_hour_s = home_s - HOUR_S * round(home_s / HOUR_S)
    if _SAME_S < abs(past_hour_s) < _DISCIPLINED_S:
        notice = Notice("clock-sensor", positions=_no_receiver(positions), past_hour_s=past_hour_s)
        return SensorClock(Clock.SENSOR, 0.0, -past_hour_s), [notice]
    tai_s = past_hour_s + _TAI_S
    if abs(tai_s) < _DISCIPLINED_S:
        return SensorClock(Clock.SENSOR, -_TAI_S, -tai_s), [Notice("clock-tai", past_hour_s=-past_hour_s)]
    key = "clock-recorder" if abs(past_hour_s) <= _SAME_S else "clock-recorder.off-the-hour"
    notice = Notice(key, receiver=_no_receiver(positions), apart_s=abs(past_hour_s))
    return SensorClock(Clock.RECORDER, home_s, 0.0), [notice]


def _no_receiver(positions: list[PositionPacket]) -> Text:
    """Why it is uncertain whether a receiver sets the sensor's clock."""
    if not positions:
        return Text("There are no position packets")
    if all(np.isnan(p.sentence_s) for p in positions):
        return Text(
            "The position packets have no GPRMC sentence (PPS {pps})",
            pps=pps_states(p.pps for p in positions),
        )
    if not any(p.valid for p in positions):
        return Text(
            "The receiver marks all its GPRMC sentences as void (PPS {pps})",
            pps=pps_states(p.pps for p in positions),
        )
    return Text("The sensor's stamps do not match the GPRMC sentences in its position packets")


def pps_states(states: Iterable[int]) -> str:
    """Names of the states of the pulse per second that occur."""
    return ", ".join(PPS_STATES[pps] if pps < len(PPS_STATES) else f"state {pps}" for pps in sorted(set(states)))
