"""Scans of a spinning scanner while its packets come in."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import Final

from furrowmap.core.readers.hesai.models import HESAI
from furrowmap.core.readers.pcap import Datagrams
from furrowmap.core.readers.spinning.captures import SensorTraffic, survey
from furrowmap.core.readers.spinning.clock import settle
from furrowmap.core.readers.spinning.decoder import PacketDecoder
from furrowmap.core.readers.velodyne.models import VELODYNE
from furrowmap.core.values.scan import Scan

STREAMED_MAKERS: Final = (VELODYNE, HESAI)
MAKER_SHOWN_S: Final = 1.2
"""Packets of so long show what the sensor's clock counts from: position packets come once or twice a second."""


class ScanStream:
    """Turns datagrams into scans, as :class:`~furrowmap.core.readers.spinning.captures.SpinningPcap` does of a file.

    Args:
        model: the scanner's model, which overrides that in the packets.
        source: address of the scanner; of several without one, that with most packets is used.

    Attributes:
        utc_minus_host_s: UTC minus the recorder's time; nan before the first scan.
    """

    def __init__(self, model: str | None, source: str | None = None) -> None:
        self._model, self._source = model, source
        self._held: list[Datagrams] = []
        self._traffic: SensorTraffic | None = None
        self._sender = 0
        self.utc_minus_host_s = math.nan

    @property
    def lost_packets(self) -> int:
        """Packets that are missing between others."""
        return self._traffic.decoder.counts.lost if self._traffic is not None and self._traffic.decoder else 0

    def push(self, datagrams: Datagrams) -> list[Scan]:
        """The scans that these datagrams complete; none in the first seconds.

        Raises:
            InputError: if the model is not supported, or the scanner of that address sends nothing.
        """
        if self._traffic is None:
            self._held.append(datagrams)
            if self._held[-1].time_s[-1] - self._held[0].time_s[0] < MAKER_SHOWN_S or not self._start():
                return []
            held, self._held = self._held, []
            return [scan for part in held for scan in self.push(part)]
        product = self._traffic.sort(datagrams, self._sender)
        mine = product >= 0
        assert self._traffic.decoder is not None
        return self._traffic.decoder.push_at(
            datagrams.data, datagrams.offset[mine], product[mine], datagrams.time_s[mine]
        )

    def _start(self) -> bool:
        """Find out the maker and what its stamps count from; False if there are no packets of a known maker."""
        for maker in STREAMED_MAKERS:
            products = [maker.products(d.data, d.offset, d.length) for d in self._held]
            if any((product >= 0).any() for product in products):
                senders, packets = survey(maker, [Path("live")], self._source, self._held, Counter())
                self._sender = senders[0]
                clock, _ = settle(*packets)
                self.utc_minus_host_s = clock.utc_minus_host_s
                self._traffic = SensorTraffic(maker, PacketDecoder(maker, self._model, clock=clock, where="live"))
                return True
        self._held.clear()
        return False
