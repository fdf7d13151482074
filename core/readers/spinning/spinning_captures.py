"""Spinning scanners in captures of network traffic: data packets, position packets, and datagrams of others."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.pcap import Capture, Datagrams, address_of, counted, datagrams_of, first_datagrams
from furrowmap.core.readers.reader import FileReader, Inspection, ReadOptions
from furrowmap.core.readers.source import Head, Source
from furrowmap.core.readers.spinning.hour_clock import (
    HESAI_MARK,
    POSITION_BYTES,
    PPS_LOCKED,
    SENTENCE_AT,
    PositionPacket,
    pps_states,
    settle,
)
from furrowmap.core.readers.spinning.packet_decoder import PacketDecoder
from furrowmap.core.readers.spinning.scanner_model import AngleTable, Maker
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.iteration import concluded
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.scan import Clock, ClockReading, Scan

_POSITION_PORTS: Final = (8308, 10110)
_HOUR_FROM: Final = {
    Clock.SENSOR: "not confirmed by a receiver; the hour is the recorder's",
    Clock.STATED: "the hour is as stated",
    Clock.SENSOR_GPS: "",
}


@dataclass
class SensorTraffic:
    """Counts over the datagrams of a recording.

    Attributes:
        ignored: datagrams that are not the sensor's, by kind.
        pps: position packets by state of the pulse per second.
        void: position packets without a valid sentence.
        untied: position packets whose sentence is of another second than the sensor's stamp.
    """

    maker: Maker
    decoder: PacketDecoder | None = None
    captures: list[Capture] = field(default_factory=list)
    ignored: Counter[str] = field(default_factory=Counter)
    pps: Counter[int] = field(default_factory=Counter)
    void: int = 0
    untied: int = 0
    first_fix: PositionPacket | None = None
    last_fix: PositionPacket | None = None

    def sort(self, datagrams: Datagrams, sender: int) -> IntArray:
        """The products of the sensor's data packets, -1 of other datagrams, which are counted."""
        product, position = _kinds_of(self.maker, datagrams)
        data = product >= 0
        mine = data & (datagrams.sender == np.uint64(sender))
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
        return np.where(mine, product, -1)

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
            notices.append(Notice("other-traffic", other=sum(other.values()), words=counted(other)))
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
        counts = self.decoder.counts
        model = self.decoder.model
        capture = self.captures[0]
        resolution = {1_000_000: ", microseconds", 1_000_000_000: ", nanoseconds"}.get(capture.resolution, "")
        modes = {self.maker.mode_name(mode): n for mode, n in counts.modes.most_common()}
        running_s = counts.last_s - counts.first_s - counts.paused_s
        facts: dict[str, Any] = {
            "capture": capture.format + resolution,
            "model": model.name if model else None,
            **self.decoder.angles,
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
        note = f"{counts.host_words}sensor's stamps"
        if clock is not Clock.RECORDER:
            note += f", {counts.host_first_s:+.3f} s at the start and {counts.host_last_s:+.3f} s at the end"
        first_s = counts.first_s + counts.host_first_s
        last_s = counts.last_s + counts.host_last_s
        readings = [ClockReading(Clock.RECORDER, first_s, last_s, note)]
        if clock is not Clock.RECORDER:
            words = f"PPS {pps_states(self.pps)}" if self.pps else _HOUR_FROM[clock]
            readings.insert(0, ClockReading(clock, counts.first_s, counts.last_s, words))
        if self.first_fix and self.last_fix:
            first = self.first_fix
            last = self.last_fix
            note = f"GPRMC sentences of the last second; {self.pps.total() - self.void:,} valid, {self.void:,} not"
            if clock is Clock.SENSOR_GPS and (utc_s := first.utc_s(first.host_s)) is not None:
                note += f"; the first {utc_s - first.sentence_s:.3f} s old" if first.sentence_s > 86_400 else ""
            readings.append(ClockReading(Clock.GNSS, first.sentence_s, last.sentence_s, note))
        return tuple(readings)


def _kinds_of(maker: Maker, datagrams: Datagrams) -> tuple[IntArray, NDArray[np.bool_]]:
    """Products of data packets (-1: it is none), and which datagrams are position packets."""
    product = maker.products(datagrams.data, datagrams.offset, datagrams.length)
    position = (datagrams.length == POSITION_BYTES) & (product < 0)
    at = datagrams.offset[position]
    bytes_at = {i: datagrams.data[at + i] for i in (0, 1, SENTENCE_AT, SENTENCE_AT + 1)}
    sentence = (bytes_at[SENTENCE_AT] == ord("$")) & (bytes_at[SENTENCE_AT + 1] == ord("G"))
    marked = (bytes_at[0] == HESAI_MARK[0]) & (bytes_at[1] == HESAI_MARK[1])
    position[position] = sentence | marked | np.isin(datagrams.sender[position] & np.uint64(0xFFFF), _POSITION_PORTS)
    return product, position


def position_packets(datagrams: Datagrams, which: NDArray[np.bool_]) -> list[tuple[int, PositionPacket]]:
    """Sender and content of the datagrams `which` (n,) bool, which are position packets."""
    found = []
    for i in np.flatnonzero(which):
        at = datagrams.offset[i]
        payload = datagrams.data[at : at + POSITION_BYTES].tobytes()
        found.append((int(datagrams.sender[i]), PositionPacket.parse(payload, float(datagrams.time_s[i]))))
    return found


GLANCE_S: Final = 0.12
"""Duration of the packets that are read where a glance is sufficient: a revolution, in two parts."""
_SURVEY_PACKETS: Final = 4000
"""Number of data packets (3 to 5 s) that are surveyed before the first scan."""
_STRAY_SHARE: Final = 0.01
_STRAY_PACKETS: Final = 10
"""A second sensor with a smaller share of the packets, or fewer packets than this, is ignored."""


class SpinningPcap(FileReader):
    """Scans in captures of a spinning scanner of a maker.

    Opening it reads the first seconds to determine the sensor's address and the origin of its clock. If there are
    position packets but the sensor has no GPS lock yet, it reads up to the lock, so that scans before it have the
    correct time too. Angles come from a calibration file beside the capture, if the maker has such.

    `source` of the options chooses among several sensors by their address or UDP port. InputError on opening, if a file
    is not a capture, or has no packets of the maker or of the sensor chosen, or the calibration beside it is damaged;
    on reading, if the model is not supported, or there are several sensors and none is chosen.
    """

    maker: ClassVar[Maker]

    def __init__(self, paths: Sequence[Path], options: ReadOptions) -> None:
        super().__init__(paths, options)
        self.share_read = 0.0
        if options.model:
            self.maker.named(options.model)
        self._angles = AngleTable.beside(self.paths) if self.maker.calibrated else None
        skipped: Counter[str] = Counter()
        blocks = datagrams_of(self.paths, skipped)
        self._senders, self._first_packets = survey(self.maker, self.paths, options.source, blocks, skipped)
        self._sender = self._senders[0]
        self.clock: Clock = settle(*self._first_packets, options.near_s)[0].kind
        self.clocks: tuple[ClockReading, ...] = ()
        self._decoder: PacketDecoder | None = None

    @classmethod
    def recognise(cls, head: Head) -> float:
        """1 for captures with a data packet of the maker in their first part."""
        first = first_datagrams(head)
        return float(first is not None and (_kinds_of(cls.maker, first)[0] >= 0).any())

    def scans(self) -> Iterator[Scan]:
        """The scans of all files, streamed; `notices` and `clocks` are complete at the end."""
        if len(self._senders) > 1:
            names = [address_of(sender) for sender in self._senders]
            raise InputError("two-sensors", paths=self.name, words="; ".join(names), example=names[0], by_model=False)
        return self._read(self.paths, SensorTraffic(self.maker))

    def beam_elevations(self) -> Mapping[str, FloatArray]:
        """Elevations (lasers,) of the model in use, then of others whose packets look like its, lowest first."""
        model = self._decoder.model if self._decoder is not None else None
        if model is None:
            return {}
        alike = [
            one
            for one in self.maker.models
            if one.name != model.name and one.lasers == model.lasers and one.layout is model.layout
        ]
        return {one.name: np.sort(one.elevation_deg) for one in (model, *alike)}

    def inspect(self) -> Inspection:
        """Read the whole first file and report what it contains, of several sensors the one with most packets."""
        traffic = SensorTraffic(self.maker)
        for _ in self._read(self.paths[:1], traffic):
            pass
        facts = traffic.facts(self._sender)
        if len(self._senders) > 1:
            facts["sensors"] = [address_of(sender) for sender in self._senders]
        return Inspection(self.paths[0], self.format, self.title, facts, self.clocks, tuple(self.notices))

    def _read(self, paths: Sequence[Path], traffic: SensorTraffic) -> Iterator[Scan]:
        self.notices.clear()
        clock, clock_notices = settle(*self._first_packets, self.options.near_s)
        decoder = PacketDecoder(self.maker, self.options.model, angles=self._angles, clock=clock, where=str(paths[0]))
        traffic.decoder = decoder
        self._decoder = decoder

        def conclude() -> None:
            decoder.finish()  # of scans that nobody takes: the counts are complete
            if self.options.source is not None:
                del traffic.ignored["of another sensor"]
            self.notices += [notice for capture in traffic.captures for notice in capture.notices]
            self.notices += [*clock_notices, *self.as_read(decoder.notices()), *traffic.notices(self.clock)]
            self.clocks = traffic.clock_readings(self.clock)
            self.share_read = 1.0

        yield from concluded(self._decoded(paths, traffic, decoder), conclude)

    def _decoded(self, paths: Sequence[Path], traffic: SensorTraffic, decoder: PacketDecoder) -> Iterator[Scan]:
        sizes = [path.stat().st_size for path in paths]
        for i, path in enumerate(paths):
            with Source(path) as source:
                capture = Capture(source)
                traffic.captures.append(capture)
                for datagrams in capture:
                    self.share_read = (sum(sizes[:i]) + sizes[i] * source.share_read) / sum(sizes)
                    product = traffic.sort(datagrams, self._sender)
                    mine = product >= 0
                    if self.options.glance_s is not None:
                        mine &= datagrams.time_s % self.options.glance_s < GLANCE_S
                    yield from decoder.push_at(
                        datagrams.data, datagrams.offset[mine], product[mine], datagrams.time_s[mine]
                    )
        yield from decoder.finish()


def survey(
    maker: Maker, paths: Sequence[Path], wanted: str | None, blocks: Iterable[Datagrams], skipped: Counter[str]
) -> tuple[list[int], tuple[NDArray[np.uint32], FloatArray, list[PositionPacket]]]:
    """The sensors' senders; of that with most packets the stamps and the recorder's times of the first data packets.

    Position packets are those up to a lock.

    Args:
        wanted: address of the sensor; None for any.
        blocks: the datagrams, of which as many are taken as it needs.
        skipped: gets the frames that are none of the sensor's, by kind.

    Raises:
        InputError: if there are no packets of the maker, or none of the sensor wanted.
    """
    stamps: list[NDArray[np.uint32]] = []
    senders: list[NDArray[np.uint64]] = []
    times: list[NDArray[np.float64]] = []
    positions: list[tuple[int, PositionPacket]] = []
    packets = 0
    for datagrams in blocks:
        product, position = _kinds_of(maker, datagrams)
        data = product >= 0
        if packets < _SURVEY_PACKETS and data.any():
            kinds, count = np.unique(product[data], return_counts=True)
            layout = maker.layout_of(int(kinds[np.argmax(count)]))
            data &= ~np.isin(product, maker.differently_packed(layout))
            stamps.append(layout.stamp_us(datagrams.data, datagrams.offset[data]))
            senders.append(datagrams.sender[data])
            times.append(datagrams.time_s[data])
            packets += int(data.sum())
        positions += position_packets(datagrams, position)
        skipped["other UDP datagrams"] += int((~data & ~position).sum())
        locked = any(p.utc_s(p.host_s) is not None for _, p in positions[-100:])
        if packets >= _SURVEY_PACKETS and (locked or not positions):
            break
    if not packets:
        frames = counted({"position packets": len(positions)} | dict(skipped.most_common()))
        raise InputError("no-packets", paths=paths[0], frames=frames or Text("no packets at all"))
    all_senders = np.concatenate(senders)
    several = _senders(paths, all_senders, wanted)
    sender = several[0]
    mine = all_senders == np.uint64(sender)
    from_sensor = [p for from_, p in positions if from_ >> 16 == sender >> 16]
    return several, (np.concatenate(stamps)[mine], np.concatenate(times)[mine], from_sensor)


def _senders(paths: Sequence[Path], senders: NDArray[np.uint64], wanted: str | None) -> list[int]:
    """The sensors that send the packets, or the one wanted."""
    found, counts = np.unique(senders, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    least = max(_STRAY_SHARE * counts[order[0]], _STRAY_PACKETS)
    several = [int(found[i]) for i in order if i == order[0] or counts[i] >= least]
    if wanted is None:
        return several
    chosen = [one for one in several if wanted in (address_of(one), *address_of(one).split(" to port "))]
    if not chosen:
        there = "; ".join(map(address_of, several))
        raise InputError("sensor-not-there", path=paths[0], wanted=wanted, there=there)
    return chosen
