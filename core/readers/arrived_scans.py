"""Scans of a spinning scanner while its packets arrive."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Final

from furrowmap.core.readers.hesai.captures import HESAI
from furrowmap.core.readers.ouster.captures import sensors_and_time
from furrowmap.core.readers.ouster.packets import OusterDecoder
from furrowmap.core.readers.pcap import Datagrams
from furrowmap.core.readers.spinning.hour_clock import settle
from furrowmap.core.readers.spinning.packet_decoder import PacketDecoder
from furrowmap.core.readers.spinning.scanner_model import AngleTable, Maker
from furrowmap.core.readers.spinning.spinning_captures import SensorTraffic, survey
from furrowmap.core.readers.velodyne.captures import VELODYNE
from furrowmap.core.values.scan import Scan

CLOCK_SHOWN_S: Final = 1.2
"""Packets of so long show what the sensor's clock counts from: position packets come once or twice a second."""


class ScanStream:
    """Turns datagrams into scans, as the readers of captures of Velodyne, Hesai and Ouster do of a file.

    Args:
        capture: the capture that the datagrams are written to; metadata or angles of the scanner are beside it.
        model: the scanner's model, which overrides that in the packets.
        source: address of the scanner; of several without one, that with most packets is used.
    """

    def __init__(self, capture: Path, model: str | None, source: str | None = None) -> None:
        self._capture = capture
        self._model = model
        self._source = source
        self._held: list[Datagrams] = []
        self._decoder: PacketDecoder | OusterDecoder | None = None
        self._push: Callable[[Datagrams], list[Scan]] | None = None

    @property
    def lost_packets(self) -> int:
        """Packets that are missing between others."""
        return self._decoder.counts.lost if self._decoder is not None else 0

    @property
    def utc_minus_host_s(self) -> float:
        """UTC minus the recorder's time, of the packets that came fastest; not finite before the first scan."""
        return -self._decoder.counts.host_least_s if self._decoder is not None else math.nan

    def push(self, datagrams: Datagrams) -> list[Scan]:
        """The scans that these datagrams complete; none in the first seconds, and then all since the beginning.

        Raises:
            InputError: if there are no packets of a supported scanner or of that address, or its metadata are missing.
                Later datagrams are looked at as if they were the first.
        """
        if self._push is not None:
            return self._push(datagrams)
        self._held.append(datagrams)
        if self._held[-1].time_s[-1] - self._held[0].time_s[0] < CLOCK_SHOWN_S:
            return []
        held = self._held
        self._held = []
        push = self._push = self._started(held)
        return [scan for part in held for scan in push(part)]

    def _started(self, held: list[Datagrams]) -> Callable[[Datagrams], list[Scan]]:
        """Find out the maker and what its stamps count from; gives what decodes its packets."""
        for maker in (VELODYNE, HESAI):
            if any((maker.products(d.data, d.offset, d.length) >= 0).any() for d in held):
                return self._started_spinning(maker, held)
        sensors, time, _ = sensors_and_time(self._capture, held, Counter(), self._model, self._source)
        sender, metadata = sensors[0]
        decoder = self._decoder = OusterDecoder(metadata, time)

        def push(datagrams: Datagrams) -> list[Scan]:
            mine = sender.sort(datagrams, metadata)
            return decoder.push(datagrams.data, datagrams.offset[mine], datagrams.time_s[mine])

        return push

    def _started_spinning(self, maker: Maker, held: list[Datagrams]) -> Callable[[Datagrams], list[Scan]]:
        senders, packets = survey(maker, [self._capture], self._source, held, Counter())
        clock, _ = settle(*packets)
        angles = AngleTable.beside([self._capture]) if maker.calibrated else None
        decoder = PacketDecoder(maker, self._model, angles=angles, clock=clock, where=str(self._capture))
        self._decoder = decoder
        traffic = SensorTraffic(maker, decoder)

        def push(datagrams: Datagrams) -> list[Scan]:
            product = traffic.sort(datagrams, senders[0])
            mine = product >= 0
            return decoder.push_at(datagrams.data, datagrams.offset[mine], product[mine], datagrams.time_s[mine])

        return push
