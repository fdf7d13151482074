"""Ouster packets in captures of network traffic, with the metadata of the sensor beside them."""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, ClassVar, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.ouster.metadata import (
    LEGACY,
    PROFILES,
    PTP_PORT,
    Metadata,
    SensorTime,
    announced_s,
    heads,
    metadata_beside,
    packet_bytes,
    settle,
)
from furrowmap.core.readers.ouster.packets import ByteArray, OusterDecoder
from furrowmap.core.readers.pcap import Capture, Datagrams, address_of, counted, datagrams_of, first_datagrams
from furrowmap.core.readers.reader import FileReader, Inspection, ReadOptions
from furrowmap.core.readers.source import Head, Source
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.iteration import concluded
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.scan import Clock, ClockReading, Scan

BEAM_COUNTS: Final = (16, 32, 64, 128)
_PACKET_COLUMNS: Final = 16
_FIRST_PACKETS: Final = 2000
"""Number of data packets (1 to 3 s) that are surveyed before the first scan."""
_HEAD_BYTES: Final = 64
"""Of a data packet, in which all is that tells sensors and clocks apart."""
_STRAY_SHARE: Final = 0.01
_HALF_FANS_DEG: Final = {"OS0": 45.0, "OS1": 22.5, "OS1 (first generation)": 16.6, "OS2": 11.25}
"""Half of the vertical field of view of the maker's lines, with beams spread evenly."""
_OTHER_LINE_DEG: Final = 2.0
"""Elevations that differ more are another line's: those of a sensor are within half a degree of even ones."""
_GLANCE_S: Final = 0.12
"""Duration of the packets that are read where a glance is sufficient: a turn, in two parts."""


@cache
def data_lengths() -> dict[int, bool]:
    """Lengths of data packets of all models and profiles, and whether they are LEGACY."""
    return {packet_bytes(name, n, _PACKET_COLUMNS): name == LEGACY for name in PROFILES for n in BEAM_COUNTS}


@dataclass(frozen=True)
class PacketSender:
    """What sends data packets of one kind.

    Attributes:
        sender: as in :class:`~furrowmap.core.readers.pcap.Datagrams`.
        serial: serial number in their headers; 0 if they have none.
        init_id: number of the sensor's start there; 0 if they have none.
    """

    sender: int
    length: int
    serial: int = 0
    init_id: int = 0

    def sort(self, datagrams: Datagrams, metadata: Metadata) -> NDArray[np.bool_]:
        """Which datagrams are its data packets."""
        mine: NDArray[np.bool_] = (datagrams.length == self.length) & (datagrams.sender == np.uint64(self.sender))
        if self.serial:
            head = metadata.heads(datagrams.data, datagrams.offset[mine])
            mine[mine] = head.serial == self.serial
        return mine

    def belongs_to(self, metadata: Metadata) -> bool:
        """Whether that sensor may send such packets."""
        if self.length != metadata.packet_bytes:
            return False
        if self.serial and metadata.serial:
            return self.serial == metadata.serial
        return not (self.init_id and metadata.init_id) or self.init_id == metadata.init_id

    @property
    def name(self) -> str:
        """For messages."""
        return f"serial number {self.serial}" if self.serial else address_of(self.sender)

    @property
    def names(self) -> tuple[str, ...]:
        """Serial number, address and port."""
        return (str(self.serial), address_of(self.sender), *address_of(self.sender).split(" to port "))


MAKER: Final = "Ouster"


class OusterSensor(NamedTuple):
    """A sender and the metadata of its sensor."""

    sender: PacketSender
    metadata: Metadata

    @property
    def name(self) -> str:
        """For messages."""
        return f"{self.metadata.product or MAKER}, {self.sender.name}"

    @property
    def names(self) -> tuple[str, ...]:
        """What a session may state as its source."""
        return (self.name, self.sender.name, *self.sender.names)


def looks_like_data(datagrams: Datagrams) -> Counter[PacketSender]:
    """Senders of what looks like data packets, and their number."""
    found: Counter[PacketSender] = Counter()
    for length in set(np.unique(datagrams.length).tolist()) & set(data_lengths()):
        at = np.flatnonzero(datagrams.length == length)
        offset = datagrams.offset[at]
        senders = datagrams.sender[at].tolist()
        if data_lengths()[length]:
            size = length // _PACKET_COLUMNS
            first, second = (heads(datagrams.data, offset + k * size, legacy=True, fusa=False) for k in (0, 1))
            sound = (second.frame == first.frame) & (second.column == first.column + 1)
            found.update(PacketSender(senders[i], length) for i in np.flatnonzero(sound).tolist())
            continue
        kind = datagrams.data[offset]
        second_byte = datagrams.data[offset + 1]
        for fusa, sound in ((False, (kind == 1) & (second_byte == 0)), (True, (kind == 1) & (second_byte != 0))):
            head = heads(datagrams.data, offset[sound], legacy=False, fusa=fusa)
            rows = zip(np.flatnonzero(sound).tolist(), head.serial.tolist(), head.init_id.tolist(), strict=True)
            found.update(PacketSender(senders[i], length, serial, init_id) for i, serial, init_id in rows)
    return found


class OusterReader(FileReader, ABC):
    """Base of the readers of files with data of Ouster sensors; opening one finds the sensors and their clock."""

    _sensors: list[OusterSensor]
    """The sensors in the files, the one that is read first."""
    _time: SensorTime
    _uncertain: list[Notice]

    def __init__(self, paths: Sequence[Path], options: ReadOptions) -> None:
        super().__init__(paths, options)
        self.share_read = 0.0
        self.clocks: tuple[ClockReading, ...] = ()

    @abstractmethod
    def _packets(
        self, path: Path, others: Counter[str]
    ) -> Generator[tuple[ByteArray, IntArray, FloatArray, float], None, None]:
        """Batches of the first sensor's data packets for :meth:`OusterDecoder.push`, and the share of the file read.

        What else there is, is counted in `others`.
        """

    def _decoder(self) -> OusterDecoder:
        return OusterDecoder(self._sensors[0].metadata, self._time)

    def beam_elevations(self) -> Mapping[str, FloatArray]:
        """Elevations (beams,) by the metadata in use, then of the maker's lines with as many, lowest first."""
        metadata = self._sensors[0].metadata
        stated = np.sort(metadata.elevation_deg)
        lines = {name: np.linspace(-half, half, len(stated)) for name, half in _HALF_FANS_DEG.items()}
        others = {name: evenly for name, evenly in lines.items() if np.abs(evenly - stated).max() > _OTHER_LINE_DEG}
        return {metadata.product or "Ouster": stated, **others}

    @property
    def clock(self) -> Clock:
        """The clock that the times come from."""
        return self._time.kind

    def scans(self) -> Iterator[Scan]:
        """The scans of all files, streamed; `notices` and `clocks` are complete at the end."""
        if len(self._sensors) > 1:
            words = "; ".join(sensor.name for sensor in self._sensors)
            example = next(
                (str(m.serial) for _, m in self._sensors if m.serial), self._sensors[0].metadata.product or MAKER
            )
            raise InputError("two-sensors", paths=self.name, words=words, example=example, by_model=True)
        return self._read(self.paths, self._decoder(), Counter())

    def inspect(self) -> Inspection:
        """Read the whole first file and report what it contains, of several sensors the first one."""
        decoder = self._decoder()
        others = Counter[str]()
        for _ in self._read(self.paths[:1], decoder, others):
            pass
        facts: dict[str, Any] = decoder.facts() | {
            "profile": self._sensors[0].metadata.profile,
            "sender": self._sensors[0].name,
            "other_packets": dict(others.most_common()),
            "first": iso_utc(decoder.counts.first_s),
            "last": iso_utc(decoder.counts.last_s),
            "span_s": round(decoder.counts.last_s - decoder.counts.first_s, 6),
        }
        if len(self._sensors) > 1:
            facts["sensors"] = [sensor.name for sensor in self._sensors]
        return Inspection(self.paths[0], self.format, self.title, facts, self.clocks, tuple(self.notices))

    def _read(self, paths: Sequence[Path], decoder: OusterDecoder, others: Counter[str]) -> Iterator[Scan]:
        self.notices.clear()
        yield from concluded(self._decoded(paths, decoder, others), partial(self._conclude, paths[0], decoder, others))

    def _decoded(self, paths: Sequence[Path], decoder: OusterDecoder, others: Counter[str]) -> Iterator[Scan]:
        sizes = [path.stat().st_size for path in paths]
        for i, path in enumerate(paths):
            with closing(self._packets(path, others)) as batches:
                for data, offset, host_s, share in batches:
                    self.share_read = (sum(sizes[:i]) + sizes[i] * share) / sum(sizes)
                    if self.options.glance_s is not None:
                        glanced = host_s % self.options.glance_s < _GLANCE_S
                        offset = offset[glanced]
                        host_s = host_s[glanced]
                    yield from decoder.push(data, offset, host_s)
        yield from decoder.finish()

    def _conclude(self, path: Path, decoder: OusterDecoder, others: Counter[str]) -> None:
        """Set notices and clocks to what was read."""
        decoder.finish()  # of scans that nobody takes: the counts are complete
        self.notices += [*self._uncertain, *self.as_read(decoder.notices())]
        counts = decoder.counts
        if not counts.packets:
            raise InputError("no-packets", paths=path, frames=counted(others) or Text("no packets at all"))
        first_s, last_s = (end_s + counts.host_least_s for end_s in (counts.first_s, counts.last_s))
        readings = [ClockReading(Clock.RECORDER, first_s, last_s, f"{counts.host_words}stamps")]
        if self.clock is not Clock.RECORDER:
            readings.insert(0, ClockReading(self.clock, counts.first_s, counts.last_s, self._time.note))
        self.clocks = tuple(readings)
        self.share_read = 1.0


class OusterPcap(OusterReader):
    """Scans in captures of an OS0, OS1, OS2 or OSDome, with the sensor's metadata as JSON in the same folder.

    Opening it reads the first seconds to find the sensors, those with most packets first, and what sets their clocks.
    Options choose among several: `model` by product line or serial number, `source` by serial number, address or port.
    InputError on opening, if a file is not a capture, or has no Ouster packets; if the metadata of their sensor are
    missing or damaged; on reading, if there are several sensors and none is chosen.
    """

    format: ClassVar[str] = "ouster-pcap"
    title: ClassVar[Text] = Text("Ouster packets in a PCAP capture")

    def __init__(self, paths: Sequence[Path], options: ReadOptions) -> None:
        super().__init__(paths, options)
        skipped = Counter[str]()
        self._sensors, self._time, self._uncertain = sensors_and_time(
            self.paths[0], datagrams_of(self.paths, skipped), skipped, options.model, options.source
        )

    @classmethod
    def recognise(cls, head: Head) -> float:
        """0.9 for captures with an Ouster data packet among the first datagrams."""
        first = first_datagrams(head)
        return 0.9 if first is not None and looks_like_data(first) else 0.0

    def _packets(
        self, path: Path, others: Counter[str]
    ) -> Generator[tuple[ByteArray, IntArray, FloatArray, float], None, None]:
        sender, metadata = self._sensors[0]
        with Source(path) as source:
            capture = Capture(source)
            try:
                for datagrams in capture:
                    mine = sender.sort(datagrams, metadata)
                    others["other UDP datagrams"] += int((~mine).sum())
                    yield datagrams.data, datagrams.offset[mine], datagrams.time_s[mine], source.share_read
            finally:  # also where no more packets are wanted
                others.update(capture.skipped)
                self.notices += capture.notices
        for key, count in [*others.items()]:
            if not count:
                del others[key]


def _beginnings(datagrams: Datagrams) -> Datagrams:
    """The first bytes of datagrams as long as data packets."""
    kept = np.isin(datagrams.length, list(data_lengths()))
    data = datagrams.data[datagrams.offset[kept][:, None] + np.arange(_HEAD_BYTES)]
    offset = _HEAD_BYTES * np.arange(len(data), dtype=np.int64)
    return Datagrams(data.reshape(-1), offset, datagrams.length[kept], datagrams.time_s[kept], datagrams.sender[kept])


def sensors_and_time(
    path: Path, blocks: Iterable[Datagrams], skipped: Counter[str], model: str | None, source: str | None
) -> tuple[list[OusterSensor], SensorTime, list[Notice]]:
    """The sensors that send data packets, the clock of the first one, and what is uncertain about them.

    Args:
        blocks: its datagrams, of which as many are taken as it needs.
        skipped: gets the frames that are no data packets, by kind.
        model, source: choose among several sensors.

    Raises:
        InputError: if there are no packets of an Ouster, no metadata of their sensor, or no sensor of that name.
    """
    found: Counter[PacketSender] = Counter()
    first = list[Datagrams]()
    tai_s = None
    rest = iter(blocks)
    for datagrams in rest:
        first.append(_beginnings(datagrams))
        skipped["other UDP datagrams"] += len(datagrams) - len(first[-1])
        found.update(looks_like_data(datagrams))
        for i in np.flatnonzero(datagrams.sender & np.uint64(0xFFFF) == PTP_PORT).tolist():
            at = int(datagrams.offset[i])
            payload = datagrams.data[at : at + int(datagrams.length[i])].tobytes()
            tai_s = tai_s if (said_s := announced_s(payload)) is None else said_s
        if found.total() >= _FIRST_PACKETS:
            break
    if not found:
        frames = counted(dict(skipped.most_common()))
        raise InputError("no-packets", paths=path, frames=frames or Text("no packets at all"))
    sensors, uncertain = sensors_of(path, found, metadata_beside(path), model)
    sensors = chosen_by_source(sensors, path, source)
    sender, metadata = sensors[0]
    stamps, times = zip(*(_times_of(datagrams, sender, metadata) for datagrams in first), strict=True)
    stamp_ns = np.concatenate(stamps)
    host_s = np.concatenate(times)
    while not (stamp_ns > 0).any() and (further := next(rest, None)) is not None:  # no valid column so far
        stamp_ns, host_s = _times_of(further, sender, metadata)
    time, clock_notices = settle(stamp_ns, host_s, metadata, tai_s)
    return sensors, time, uncertain + clock_notices


def _times_of(datagrams: Datagrams, sender: PacketSender, metadata: Metadata) -> tuple[IntArray, FloatArray]:
    """Stamps (m,) of the data packets of a sensor, and the recorder's times (m,) of these."""
    mine = sender.sort(datagrams, metadata)
    return metadata.heads(datagrams.data, datagrams.offset[mine]).stamp_ns, datagrams.time_s[mine]


def chosen_by_source(sensors: list[OusterSensor], path: Path, source: str | None) -> list[OusterSensor]:
    """The sensor that a session names by its source, all without a name; InputError if it is none of them."""
    chosen = [sensor for sensor in sensors if source is None or source in sensor.names]
    if not chosen:
        there = "; ".join(sensor.name for sensor in sensors)
        raise InputError("sensor-not-there", path=path, wanted=source, there=there)
    return chosen


def sensors_of(
    path: Path, found: Counter[PacketSender], beside: tuple[list[Metadata], list[str]], model: str | None
) -> tuple[list[OusterSensor], list[Notice]]:
    """The sensors that send data packets, those with most packets first, and what is uncertain about their metadata.

    Args:
        beside: metadata that may be theirs, and what is wrong with others.
        model: chooses among several sensors.

    Raises:
        InputError: if there are no metadata of any of them, or it is not clear which are theirs.
    """
    largest = max(found.values())
    sensors: dict[int, OusterSensor] = {}
    unknown = []
    notices = []
    for sender, count in found.most_common():
        key = sender.serial or -sender.sender
        if count < _STRAY_SHARE * largest or key in sensors:
            continue
        fitting = [metadata for metadata in beside[0] if sender.belongs_to(metadata)]
        if not fitting:
            unknown.append(sender.name)
            continue
        stem = path.name.partition(".pcap")[0].casefold()
        its = Path(fitting[0].name).stem.casefold()
        named = stem.startswith(its) or its.startswith(stem)
        if not sender.serial and not named:
            if any(not fitting[0].same_geometry(other) for other in fitting[1:]):
                names = ", ".join(metadata.name for metadata in fitting)
                raise InputError("ouster-metadata-ambiguous", path=path, sender=sender.name, names=names)
            notices.append(Notice("ouster-metadata-unproven", sender=sender.name, name=fitting[0].name))
        sensors[key] = OusterSensor(sender, fitting[0])
    chosen = [sensor for sensor in sensors.values() if model is None or sensor.metadata.fits(model)]
    if not chosen:
        if sensors:
            there = "; ".join(sensor.name for sensor in sensors.values())
            raise InputError("ouster-other-sensor", path=path, model=model, there=there)
        others = ", ".join(
            f"{m.name} ({m.product or MAKER}, serial number {m.serial or 'not stated'})" for m in beside[0]
        )
        raise InputError(
            "ouster-no-metadata",
            path=path,
            senders="; ".join(unknown),
            others=others or None,
            faults="; ".join(beside[1]) or None,
        )
    if unknown:
        notices.append(Notice("ouster-sensor-unknown", senders="; ".join(unknown)))
    return chosen, notices
