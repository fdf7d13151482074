"""Metadata of an Ouster sensor, the JSON beside a recording with the angles of its beams, and UTC of its stamps.

Formats: Ouster Sensor Documentation, firmware 3.1, "Sensor Metadata", and the flat JSON of firmware 1.13 to 2.x.

Stamps count nanoseconds: since the sensor's start, or since 1970 if a receiver (PPS and GPRMC) or PTP sets the clock. A
PTP grandmaster usually counts TAI, which is ahead of UTC by an offset that its announce messages state (IEEE 1588-2019,
clauses 7.2.4 and 13.5); `nmea_leap_seconds` of the metadata is what the sensor adds to the receiver's UTC.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.file_names import found_beside
from furrowmap.core.runtime.plain_reads import read_plain_text
from furrowmap.core.values.scan import MAX_LASERS, Clock

LEGACY: Final = "LEGACY"
_FUSA: Final = "FUSA"


class PixelProfile(NamedTuple):
    """How a pixel of a packet holds its returns.

    Attributes:
        range_bits: lowest bits of the first two or four bytes that are the range.
        range_step_mm: distance per count.
        second_at: byte of a second return, which is like the first; 0 for none.
    """

    pixel_bytes: int
    range_bits: int
    range_step_mm: int
    reflectivity_at: int
    second_at: int


_RNG19: Final = PixelProfile(12, 19, 1, 4, 0)
_RNG19_DUAL: Final = PixelProfile(16, 19, 1, 3, 4)
_RNG15: Final = PixelProfile(4, 15, 8, 2, 0)
_RNG15_DUAL: Final = PixelProfile(8, 15, 8, 2, 4)
PROFILES: Final = {
    LEGACY: PixelProfile(12, 20, 1, 4, 0), "RNG19_RFL8_SIG16_NIR16": _RNG19, "RNG19_RFL8_SIG16_NIR16_ZONE16": _RNG19,
    "RNG19_RFL8_SIG16_NIR16_DUAL": _RNG19_DUAL, "RNG19_RFL8_SIG16_ZONE16_DUAL": _RNG19_DUAL,
    "RNG19_RFL8_SIG16_NIR16_RGB16": PixelProfile(16, 19, 1, 3, 0),
    "RNG19_RFL8_SIG16_NIR16_RGB16_DUAL": PixelProfile(20, 19, 1, 3, 4),
    "FIVE_WORD_PIXEL": PixelProfile(20, 19, 1, 3, 4), "RNG15_RFL8_NIR8": _RNG15, "RNG15_RFL8_WIN8": _RNG15,
    "RNG15_RFL8_NIR8_ZONE16": PixelProfile(8, 15, 8, 2, 0), "RNG15_RFL8_NIR8_DUAL": _RNG15_DUAL,
    "FUSA_RNG15_RFL8_NIR8_DUAL": _RNG15_DUAL,
}  # fmt: skip


class ColumnLayout(NamedTuple):
    """Where a data packet has its columns, in bytes.

    Attributes:
        columns: in a packet.
        begin: of the first column.
        size: of a column.
        head: bytes of a column before its pixels.
        status_at: where a column states whether it is valid.
    """

    columns: int
    begin: int
    size: int
    head: int
    status_at: int
    pixel: PixelProfile


STAMP: Final = (1 << 62) - 1
"""Bits of a stamp that are used: those of the years to 2116."""
_HEADER_BYTES: Final = 32
"""Of header and footer of a packet."""
_MODERN_COLUMN: Final = 12
_LEGACY_COLUMN: Final = 16
_LEGACY_STATUS: Final = 4
_MAX_COLUMNS: Final = 4096
_MAX_BYTES: Final = 1 << 20
_MAX_FILES: Final = 256
_GEN1_BEAMS_MM: Final = 12.163
"""Distance of the beams' origins from the axis where the metadata of old firmware do not state it."""
_USUAL_TO_SENSOR: Final = (-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 36.18, 0, 0, 0, 1)


def packet_bytes(profile: str, beams: int, columns: int) -> int:
    """Length of the payload of a data packet."""
    pixels = beams * PROFILES[profile].pixel_bytes
    if profile == LEGACY:
        return columns * (_LEGACY_COLUMN + pixels + _LEGACY_STATUS)
    return 2 * _HEADER_BYTES + columns * (_MODERN_COLUMN + pixels)


class Heads(NamedTuple):
    """Headers of m data packets, each (m,) int64.

    Serial number and number of the sensor's start are 0 where they are none. Frame is the number of the turn; column
    and stamp are those of the first column.
    """

    frame: IntArray
    column: IntArray
    stamp_ns: IntArray
    serial: IntArray
    init_id: IntArray


def heads(data: NDArray[np.uint8], offset: IntArray, *, legacy: bool, fusa: bool) -> Heads:
    """The headers of packets that begin at `offset` (m,) in `data`."""

    def number(at: int, size: int) -> IntArray:
        raw = data[offset[:, None] + (at + np.arange(size))].astype(np.int64)
        return np.asarray((raw << (8 * np.arange(size))).sum(axis=1), np.int64)

    if legacy:
        none = np.zeros(len(offset), np.int64)
        return Heads(number(10, 2), number(8, 2), number(0, 8) & STAMP, none, none)
    frame, serial, init_id = (number(4, 4), 11, 1) if fusa else (number(2, 2), 7, 4)
    return Heads(frame, number(40, 2), number(32, 8) & STAMP, number(serial, 5), number(init_id, 3))


@dataclass(frozen=True)
class Metadata:
    """What the metadata of a sensor say.

    Attributes:
        product: product line, such as "OS-1-32-U0"; empty if it is not stated.
        init_id: number of the sensor's start in the headers of its packets; 0 if it is not stated.
        fusa: whether packets have the header of functional safety.
        timestamp_mode: what sets the clock, such as "TIME_FROM_PTP_1588"; empty if it is not stated.
        leap_s: seconds that the sensor adds to UTC.
        window: first and last column that are measured.
        turns_a_second: of the lidar mode; nan if it is not stated.
        elevation_deg: (n,) of the beams, in the order of the packets.
        azimuth_deg: (n,) clockwise from above, against the column.
        beam_m: (2,) origin of the beams beside and above the axis of the lidar frame.
        to_sensor: (3, 4) from the lidar frame to the sensor frame, in metres.
    """

    name: str
    product: str
    serial: int
    init_id: int
    firmware: str
    profile: str
    fusa: bool
    timestamp_mode: str
    leap_s: int
    columns: int
    packet_columns: int
    window: tuple[int, int]
    turns_a_second: float
    elevation_deg: FloatArray
    azimuth_deg: FloatArray
    beam_m: FloatArray
    to_sensor: FloatArray

    @property
    def packet_bytes(self) -> int:
        """Length of the payload of a data packet."""
        return packet_bytes(self.profile, len(self.elevation_deg), self.packet_columns)

    @property
    def frame_packets(self) -> int:
        """Packets of a turn, those of columns outside the window not counted."""
        first, last = (column // self.packet_columns for column in self.window)
        return (last - first) % -(-self.columns // self.packet_columns) + 1

    @cached_property
    def layout(self) -> ColumnLayout:
        """Of its packets."""
        pixel = PROFILES[self.profile]
        pixels = len(self.elevation_deg) * pixel.pixel_bytes
        if self.profile == LEGACY:
            size = _LEGACY_COLUMN + pixels + _LEGACY_STATUS
            return ColumnLayout(self.packet_columns, 0, size, _LEGACY_COLUMN, size - _LEGACY_STATUS, pixel)
        return ColumnLayout(self.packet_columns, _HEADER_BYTES, _MODERN_COLUMN + pixels, _MODERN_COLUMN, 10, pixel)

    @cached_property
    def beams(self) -> FloatArray:
        """(n, 5) direction of each beam at column 0 in the lidar frame; columns by which it is ahead; its rank."""
        elevation = np.radians(self.elevation_deg)
        azimuth = -np.radians(self.azimuth_deg)
        ahead = np.round(self.azimuth_deg * (self.columns / 360.0))
        rank = np.empty(len(elevation))
        rank[np.argsort(self.elevation_deg, kind="stable")] = np.arange(len(elevation))
        flat = np.cos(elevation)
        return np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation), ahead, rank])

    @cached_property
    def turned(self) -> FloatArray:
        """(columns, 3, 4) of each column, from directions at column 0 to the sensor frame, and its beams' origin."""
        angle = 2.0 * math.pi * (1.0 - np.arange(self.columns) / self.columns)
        cos = np.cos(angle)
        sin = np.sin(angle)
        zero = np.zeros(self.columns)
        one = np.ones(self.columns)
        turn = np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, one], axis=1).reshape(-1, 3, 3)
        rotation = self.to_sensor[:, :3]
        origin = turn @ (self.beam_m[0], 0.0, self.beam_m[1])
        place = origin @ rotation.T + self.to_sensor[:, 3]
        return np.ascontiguousarray(np.concatenate([rotation @ turn, place[..., None]], axis=2))

    @classmethod
    def parse(cls, text: str, name: str) -> "Metadata | None":
        """What a JSON text says.

        None if it is not an Ouster's metadata; ValueError if angles are missing or implausible.
        """
        try:
            said = json.loads(text)
        except (ValueError, RecursionError):
            return None
        if not isinstance(said, Mapping):
            return None
        beams = _table(said, "beam_intrinsics")
        info = _table(said, "sensor_info")
        if "beam_altitude_angles" not in beams:
            return None
        config = _table(said, "config_params")
        layout = _table(said, "lidar_data_format", "data_format")
        try:
            return _metadata(name, beams, info, config, layout, _table(said, "lidar_intrinsics"))
        except (KeyError, TypeError, AttributeError, OverflowError) as error:
            raise ValueError(f"{type(error).__name__} {error}") from None

    def heads(self, data: NDArray[np.uint8], offset: IntArray) -> Heads:
        """The headers of its packets that begin at `offset` (m,) in `data`."""
        return heads(data, offset, legacy=self.profile == LEGACY, fusa=self.fusa)

    def same_geometry(self, other: "Metadata") -> bool:
        """Whether packets are decoded alike with other metadata."""
        return (
            self.columns == other.columns
            and np.array_equal(self.beams, other.beams)
            and np.array_equal(self.turned, other.turned)
        )

    def fits(self, model: str) -> bool:
        """Whether a model stated in a session may be it: its product line, its serial number, or the maker's name.

        Metadata without a product line (firmware before 1.14, reduced ones) contradict no model.
        """
        plain = "".join(c for c in model.casefold() if c.isalnum()).removeprefix("ouster")
        product = "".join(c for c in self.product.casefold() if c.isalnum())
        return plain == str(self.serial) or not product or product.startswith(plain)


def _table(said: Mapping[str, Any], *names: str) -> Mapping[str, Any]:
    """A table of the metadata; all of them in those of old firmware, which are flat."""
    table = next((said[name] for name in names if name in said), said)
    return table if isinstance(table, Mapping) else {}


def _metadata(
    name: str,
    beams: Mapping[str, Any],
    info: Mapping[str, Any],
    config: Mapping[str, Any],
    layout: Mapping[str, Any],
    lidar: Mapping[str, Any],
) -> Metadata:
    elevation = _numbers(beams["beam_altitude_angles"])
    azimuth = _numbers(beams["beam_azimuth_angles"])
    mode = str(config.get("lidar_mode") or info.get("lidar_mode") or "")
    columns = int(layout.get("columns_per_frame") or mode.partition("x")[0])
    first, last = (int(end) for end in layout.get("column_window") or (0, columns - 1))
    packet_columns = int(layout.get("columns_per_packet") or 16)
    profile = str(layout.get("udp_profile_lidar") or LEGACY)
    if profile not in PROFILES:
        raise ValueError(f"profile {profile[:40]!r} of the packets is not supported")
    if not 0 < len(elevation) == len(azimuth) <= MAX_LASERS or (np.abs([*elevation, *azimuth]) > 180.0).any():
        raise ValueError(f"{len(elevation)} elevations and {len(azimuth)} azimuths of beams")
    if not (1 < columns <= _MAX_COLUMNS and 0 <= first < columns and 0 <= last < columns):
        raise ValueError(f"{columns} columns per frame, of which {first} to {last} are measured")
    if not 0 < packet_columns <= columns or packet_bytes(profile, len(elevation), packet_columns) > 65_535:
        raise ValueError(f"{packet_columns} columns per packet")
    beside_mm = float(beams.get("lidar_origin_to_beam_origin_mm", _GEN1_BEAMS_MM))
    to_lidar = _numbers(beams.get("beam_to_lidar_transform") or (1, 0, 0, beside_mm, *12 * (0,)), 16)
    to_sensor = _numbers(lidar.get("lidar_to_sensor_transform") or _USUAL_TO_SENSOR, 16).reshape(4, 4)[:3].copy()
    to_sensor[:, 3] *= 1e-3
    if not np.allclose(to_sensor[:, :3] @ to_sensor[:, :3].T, np.eye(3), atol=1e-3):
        raise ValueError("the transform from lidar to sensor is no rotation")
    rate = mode.partition("x")[2]
    return Metadata(
        name,
        str(info.get("prod_line") or "")[:40],
        _whole(info.get("prod_sn")),
        _whole(info.get("initialization_id", info.get("init_id"))),
        str(info.get("build_rev") or "")[:40],
        profile,
        profile.startswith(_FUSA) or layout.get("header_type") == _FUSA,
        str(config.get("timestamp_mode") or ""),
        _whole(config.get("nmea_leap_seconds")),
        columns,
        packet_columns,
        (first, last),
        float(rate) if rate.isdecimal() else math.nan,
        elevation,
        azimuth,
        1e-3 * to_lidar[[3, 11]],
        to_sensor,
    )


def _numbers(values: Sequence[Any], count: int | None = None) -> FloatArray:
    found = np.array(values, np.float64)
    if found.ndim != 1 or not np.isfinite(found).all() or count not in (None, len(found)):
        raise ValueError("a list is not one of finite numbers")
    return found


def _whole(value: Any) -> int:
    return int(value) if str(value).isdecimal() and len(str(value)) < 16 else 0


def metadata_beside(path: Path) -> tuple[list[Metadata], list[str]]:
    """The metadata in the folder of a recording, those with its name first; and what is wrong with others."""
    stem = path.name.partition(".pcap")[0].casefold()
    texts = sorted(
        found_beside(path.parent, "*.json"), key=lambda other: (-_alike(other.stem.casefold(), stem), other.name)
    )
    found = []
    faults = []
    for other in texts[:_MAX_FILES]:
        try:
            if other.stat().st_size <= _MAX_BYTES:
                metadata = Metadata.parse(read_plain_text(other, "utf-8-sig"), other.name)
                if metadata is not None:
                    found.append(metadata)
        except (OSError, ValueError) as error:
            faults.append(f"{other.name}: {error}")
    return found, faults


def _alike(a: str, b: str) -> int:
    """Number of characters with which two names begin alike."""
    return next((i for i, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b)))


FROM_PTP: Final = "TIME_FROM_PTP_1588"
FROM_PULSE: Final = "TIME_FROM_SYNC_PULSE_IN"
PTP_PORT: Final = 320
_ANNOUNCE: Final = 0x0B
_ANNOUNCE_BYTES: Final = 64
_OFFSET_VALID: Final = 0x04
_PTP_TIMESCALE: Final = 0x08
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
        stamp_ns: (m,) stamps of the first packets, m > 0; those of 0 are of packets without a valid column.
        host_s: (m,) the recorder's times of these.
        tai_s: TAI minus UTC as PTP announced it; None if it did not.
    """
    mode = metadata.timestamp_mode
    known = stamp_ns > 0
    if known.any():
        stamp_ns = stamp_ns[known]
        host_s = host_s[known]
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
