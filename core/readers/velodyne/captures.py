"""Velodyne packets in captures of network traffic."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import ClassVar, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.pcap import Capture, Datagrams, capture_format
from furrowmap.core.readers.reader import FileReader, Inspection, ReadOptions
from furrowmap.core.readers.source import Head, Source
from furrowmap.core.readers.velodyne.clock import PositionPacket, settle
from furrowmap.core.readers.velodyne.decoder import PacketDecoder
from furrowmap.core.readers.velodyne.models import BLOCK_MARK, model_named
from furrowmap.core.readers.velodyne.traffic import SensorTraffic, address_of, kinds_of, position_packets
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.clock_readings import ClockReading
from furrowmap.core.values.scan import Clock, Scan

GLANCE_S: Final = 0.12
"""Duration of the packets that are read where a glance is sufficient: a revolution, in two parts."""
_SURVEY_PACKETS: Final = 4000
"""Number of data packets (3 to 5 s) that are surveyed before the first scan."""
_STRAY_SHARE: Final = 0.01
_STRAY_PACKETS: Final = 10
"""A second sensor with a smaller share of the packets, or fewer packets than this, is ignored."""


class VelodynePcap(FileReader):
    """Scans in captures of a VLP-16, Puck LITE, Puck Hi-Res, VLP-32C or HDL-32E.

    Opening it reads the first seconds to determine the sensor's address and the origin of its clock. If there are
    position packets but the sensor has no GPS lock yet, it reads up to the lock, so that scans before it have the
    correct time too.

    Raises:
        InputError: on opening, if a file is not a capture, or has no Velodyne packets or those of several sensors; on
            reading, if the model is not supported.
    """

    format: ClassVar[str] = "velodyne-pcap"
    title: ClassVar[str] = "Velodyne packets in a PCAP capture"

    def __init__(self, paths: Sequence[Path], options: ReadOptions) -> None:
        super().__init__(paths, options)
        self.share_read = 0.0
        if options.model:
            model_named(options.model)
        self._sender, self._first_packets = _survey(self.paths)
        self.clock: Clock = settle(*self._first_packets, options.near_s)[0].kind
        self.clocks: tuple[ClockReading, ...] = ()

    @classmethod
    def recognise(cls, head: Head) -> float:
        """1 for captures with a data packet in their first bytes, 0.5 for other captures."""
        if not capture_format(head.data):
            return 0.0
        at = head.data.find(BLOCK_MARK)
        while at >= 0:
            if all(head.data[at + 100 * i : at + 100 * i + 2] == BLOCK_MARK for i in range(1, 4)):
                return 1.0
            at = head.data.find(BLOCK_MARK, at + 1)
        return 0.5

    def scans(self) -> Iterator[Scan]:
        """The scans of all files, streamed; `notices` and `clocks` are complete at the end."""
        return self._read(self.paths, SensorTraffic())

    def inspect(self) -> Inspection:
        """Read the whole first file and report what it contains."""
        traffic = SensorTraffic()
        for _ in self._read(self.paths[:1], traffic):
            pass
        return Inspection(
            self.paths[0],
            self.format,
            self.title,
            traffic.facts(self._sender),
            self.clocks,
            tuple(self.notices),
        )

    def _read(self, paths: Sequence[Path], traffic: SensorTraffic) -> Iterator[Scan]:
        self.notices.clear()
        clock, clock_notices = settle(*self._first_packets, self.options.near_s)
        traffic.decoder = decoder = PacketDecoder(self.options.model, clock=clock, where=str(paths[0]))
        sizes = [path.stat().st_size for path in paths]
        for i, path in enumerate(paths):
            with Source(path) as source:
                capture = Capture(source)
                for datagrams in capture:
                    self.share_read = (sum(sizes[:i]) + sizes[i] * source.share_read) / sum(sizes)
                    mine = traffic.sort(datagrams, self._sender)
                    if self.options.glance_s is not None:
                        mine &= datagrams.time_s % self.options.glance_s < GLANCE_S
                    yield from decoder.push_at(datagrams.data, datagrams.offset[mine], datagrams.time_s[mine])
                traffic.captures.append(capture)
                self.notices += capture.notices
        yield from decoder.finish()
        self.notices += [*clock_notices, *decoder.notices(), *traffic.notices(self.clock)]
        self.clocks = traffic.clock_readings(self.clock)
        self.share_read = 1.0


_FirstPackets: TypeAlias = tuple[NDArray[np.uint32], NDArray[np.float64], list[PositionPacket]]


def _survey(paths: Sequence[Path]) -> tuple[int, _FirstPackets]:
    """The start of a recording: the sensor's sender, and its stamps, the recorder's times and position packets.

    The sender is as in `Datagrams.sender`. The stamps and times are of the first data packets; the position packets
    reach up to the first with a lock, and at least as far as the data packets.
    """
    stamps: list[NDArray[np.uint32]] = []
    senders: list[NDArray[np.uint64]] = []
    times: list[NDArray[np.float64]] = []
    positions: list[tuple[int, PositionPacket]] = []
    packets = 0
    skipped: Counter[str] = Counter()
    for datagrams in _blocks(paths, skipped):
        data, position = kinds_of(datagrams)
        if packets < _SURVEY_PACKETS:
            raw = datagrams.data[datagrams.offset[data][:, None] + np.arange(1200, 1204)]
            stamps.append(raw.view("<u4")[:, 0])
            senders.append(datagrams.sender[data])
            times.append(datagrams.time_s[data])
            packets += int(data.sum())
        positions += position_packets(datagrams, position)
        skipped["other UDP datagrams"] += int((~data & ~position).sum())
        locked = any(p.utc_s(p.host_s) is not None for _, p in positions[-100:])
        if packets >= _SURVEY_PACKETS and (locked or not positions):
            break
    if not packets:
        frames = ", ".join(f"{n:,} {why}" for why, n in skipped.most_common() if n)
        if positions:
            frames = f"{len(positions):,} position packets" + (f", {frames}" if frames else "")
        raise InputError("no-packets", paths=paths[0], frames=frames or "no packets at all")
    all_senders = np.concatenate(senders)
    sender = _only_sender(paths, all_senders)
    mine = all_senders == np.uint64(sender)
    from_sensor = [p for from_, p in positions if from_ >> 16 == sender >> 16]
    return sender, (np.concatenate(stamps)[mine], np.concatenate(times)[mine], from_sensor)


def _blocks(paths: Sequence[Path], skipped: Counter[str]) -> Iterator[Datagrams]:
    for path in paths:
        with Source(path) as source:
            capture = Capture(source)
            yield from capture
            skipped.update(capture.skipped)


def _only_sender(paths: Sequence[Path], senders: NDArray[np.uint64]) -> int:
    """The sensor that sends the packets."""
    found, counts = np.unique(senders, return_counts=True)
    order = np.argsort(-counts)
    least = max(_STRAY_SHARE * counts[order[0]], _STRAY_PACKETS)
    several = [(int(found[i]), int(counts[i])) for i in order if i == order[0] or counts[i] >= least]
    if len(several) > 1:
        words = "; ".join(f"{address_of(sender)} ({n:,} packets)" for sender, n in several)
        raise InputError(
            "two-sensors",
            paths=paths[0],
            several=len(several),
            words=words,
            value=str(address_of(several[0][0])).split(" ")[0],
        )
    return several[0][0]
