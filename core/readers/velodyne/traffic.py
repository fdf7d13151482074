"""The datagrams in a capture: data packets and position packets of the sensor, and other network traffic."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from ipaddress import IPv4Address
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.pcap import Capture, Datagrams
from furrowmap.core.readers.velodyne.clock import (
    POSITION_BYTES,
    PPS_LOCKED,
    SENTENCE_AT,
    PositionPacket,
    pps_states,
)
from furrowmap.core.readers.velodyne.decoder import PacketDecoder
from furrowmap.core.readers.velodyne.models import BLOCK_MARK, PACKET_BYTES, RETURN_WORDS
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.clock_readings import ClockReading
from furrowmap.core.values.scan import Clock

_POSITION_PORT: Final = 8308
_HOUR_FROM: Final = {
    Clock.SENSOR: "not confirmed by a receiver; the hour is the recorder's",
    Clock.STATED: "the hour is as stated",
    Clock.SENSOR_GPS: "",
}


@dataclass
class SensorTraffic:
    """Counts over the datagrams of a recording.

    Attributes:
        decoder: decoder of the sensor's data packets, once reading has begun.
        captures: captures that were read to their end.
        ignored: datagrams that are not the sensor's, by kind.
        pps: position packets by state of the pulse per second.
        void: position packets without a valid sentence.
        untied: position packets whose sentence is of another second than the sensor's stamp.
        first_fix: the first position packet with a valid sentence.
        last_fix: the last position packet with a valid sentence.
    """

    decoder: PacketDecoder | None = None
    captures: list[Capture] = field(default_factory=list)
    ignored: Counter[str] = field(default_factory=Counter)
    pps: Counter[int] = field(default_factory=Counter)
    void: int = 0
    untied: int = 0
    first_fix: PositionPacket | None = None
    last_fix: PositionPacket | None = None

    def sort(self, datagrams: Datagrams, sender: int) -> NDArray[np.bool_]:
        """Which datagrams are the sensor's data packets; the others are counted."""
        data, position = kinds_of(datagrams)
        mine: NDArray[np.bool_] = data & (datagrams.sender == np.uint64(sender))
        for from_, packet in position_packets(datagrams, position):
            if from_ >> 16 != sender >> 16:
                self.ignored["of another sensor"] += 1
                continue
            self.pps[packet.pps] += 1
            if not packet.valid:
                self.void += 1
                continue
            self.untied += packet.utc_s(packet.host_s) is None
            self.first_fix = self.first_fix or packet
            self.last_fix = packet
        self.ignored["of another sensor"] += int((data & ~mine).sum())
        self.ignored["other UDP datagrams"] += int((~data & ~position).sum())
        return mine

    @property
    def other_packets(self) -> dict[str, int]:
        """Frames that are not packets of the sensor, by kind."""
        counts = +self.ignored
        for capture in self.captures:
            counts.update(capture.skipped)
        return dict(counts.most_common())

    def notices(self, clock: Clock) -> list[Notice]:
        """What is unusual, if times come from that clock."""
        notices = []
        if other := self.other_packets:
            words = ", ".join(f"{n:,} {why}" for why, n in other.items())
            notices.append(Notice("other-traffic", other=sum(other.values()), words=words))
        total = self.pps.total()
        unlocked = total - self.pps[PPS_LOCKED]
        if clock is Clock.SENSOR_GPS and unlocked:
            states = pps_states(state for state in self.pps if state != PPS_LOCKED)
            notices.append(Notice("pps-unlocked", unlocked=unlocked, total=total, states=states))
        if clock is Clock.SENSOR_GPS and self.void:
            notices.append(Notice("gprmc-void", void=self.void, total=total))
        if clock is Clock.SENSOR_GPS and self.untied:
            notices.append(Notice("gprmc-disagrees", untied=self.untied, total=total))
        return notices

    def facts(self, sender: int) -> dict[str, Any]:
        """Facts for `inspect`, of the sensor with that sender."""
        assert self.decoder is not None
        counts, model = self.decoder.counts, self.decoder.model
        capture = self.captures[0]
        resolution = {1_000_000: ", microseconds", 1_000_000_000: ", nanoseconds"}.get(capture.resolution, "")
        modes = {RETURN_WORDS.get(mode, f"unknown (0x{mode:02x})"): n for mode, n in counts.modes.most_common()}
        running_s = counts.last_s - counts.first_s - counts.paused_s
        facts: dict[str, Any] = {
            "capture": capture.format + resolution,
            "model": model.name if model else None,
            "return_mode": next(iter(modes)) if len(modes) == 1 else modes,
            "sender": address_of(sender),
            "data_packets": counts.packets,
            "position_packets": self.pps.total(),
            "other_packets": self.other_packets,
            "points": counts.points,
            "scans": counts.whole + counts.cut,
            "whole_scans": counts.whole,
            "rpm": round(counts.rpm, 1),
            "revolutions": round(counts.rpm / 60.0 * running_s, 2),
            "first": iso_utc(counts.first_s),
            "last": iso_utc(counts.last_s),
            "span_s": round(counts.last_s - counts.first_s, 6),
        }
        if self.first_fix and self.first_fix.lat_deg == self.first_fix.lat_deg:
            facts["gps_position"] = {
                "lat_deg": round(self.first_fix.lat_deg, 8),
                "lon_deg": round(self.first_fix.lon_deg, 8),
            }
        return facts

    def clock_readings(self, clock: Clock) -> tuple[ClockReading, ...]:
        """Readings of the clocks in the packets, the clock that the times come from first."""
        assert self.decoder is not None
        counts = self.decoder.counts
        note = (
            f"packet times; {counts.host_least_s:+.4f} to {counts.host_most_s:+.4f} s relative to the sensor's stamps"
        )
        if clock is not Clock.RECORDER:
            note += f", {counts.host_first_s:+.3f} s at the start and {counts.host_last_s:+.3f} s at the end"
        first_s, last_s = counts.first_s + counts.host_first_s, counts.last_s + counts.host_last_s
        readings = [ClockReading(Clock.RECORDER, first_s, last_s, note)]
        if clock is not Clock.RECORDER:
            words = f"PPS {pps_states(self.pps)}" if self.pps else _HOUR_FROM[clock]
            readings.insert(0, ClockReading(clock, counts.first_s, counts.last_s, words))
        if self.first_fix and self.last_fix:
            first, last = self.first_fix, self.last_fix
            note = f"GPRMC sentences of the last second; {self.pps.total() - self.void:,} valid, {self.void:,} not"
            if clock is Clock.SENSOR_GPS and (utc_s := first.utc_s(first.host_s)) is not None:
                note += f"; the first {utc_s - first.sentence_s:.3f} s old" if first.sentence_s > 86_400 else ""
            readings.append(ClockReading(Clock.GNSS, first.sentence_s, last.sentence_s, note))
        return tuple(readings)


def kinds_of(datagrams: Datagrams) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which datagrams are data packets, and which are position packets."""
    data = datagrams.length == PACKET_BYTES
    at = datagrams.offset[data]
    data[data] = (datagrams.data[at] == BLOCK_MARK[0]) & (datagrams.data[at + 1] == BLOCK_MARK[1])
    position = datagrams.length == POSITION_BYTES
    at = datagrams.offset[position] + SENTENCE_AT
    sentence = (datagrams.data[at] == ord("$")) & (datagrams.data[at + 1] == ord("G"))
    position[position] = sentence | (datagrams.sender[position] & np.uint64(0xFFFF) == _POSITION_PORT)
    return data, position


def position_packets(datagrams: Datagrams, which: NDArray[np.bool_]) -> list[tuple[int, PositionPacket]]:
    """Sender and content of the datagrams `which` (n,) bool, which are position packets."""
    found = []
    for i in np.flatnonzero(which):
        at = datagrams.offset[i]
        payload = datagrams.data[at : at + POSITION_BYTES].tobytes()
        found.append((int(datagrams.sender[i]), PositionPacket.parse(payload, float(datagrams.time_s[i]))))
    return found


def address_of(sender: int) -> str:
    """A sender (see `Datagrams.sender`) for messages."""
    host, port = sender >> 16, sender & 0xFFFF
    return f"{IPv4Address(host) if host < 1 << 32 else 'an IPv6 address'} to port {port}"
