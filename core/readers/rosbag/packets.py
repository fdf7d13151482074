"""Messages of packets to scans, with the same decoders as captures."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from furrowmap.core.readers.hesai.models import HESAI
from furrowmap.core.readers.ouster.captures import looks_like_data, sensors_of
from furrowmap.core.readers.ouster.metadata import Metadata, metadata_beside
from furrowmap.core.readers.ouster.packets import OusterDecoder
from furrowmap.core.readers.pcap import Datagrams
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.rosbag.messages import PACKET_SCANS, seconds, stamp_s
from furrowmap.core.readers.rosbag.storage import BagMessage
from furrowmap.core.readers.spinning.angles import AngleTable
from furrowmap.core.readers.spinning.decoder import PacketDecoder
from furrowmap.core.readers.spinning.model import ByteArray
from furrowmap.core.readers.velodyne.models import VELODYNE
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.scan import Clock, Scan

_BATCH_PACKETS: Final = 1000
_MAKERS: Final = {maker.name: maker for maker in (VELODYNE, HESAI)}


class _PacketMessages(ABC):
    """Decodes the messages of one topic into scans, many packets together."""

    def __init__(self) -> None:
        self._held: list[tuple[ByteArray, float]] = []

    @abstractmethod
    def _packets(self, content: Any, message: BagMessage) -> Iterator[tuple[ByteArray, float]]:
        """The packets of a message, and when the recorder or the driver received each."""

    @abstractmethod
    def _decode(self, packets: Datagrams) -> list[Scan]:
        """The scans that packets complete."""

    def push(self, content: Any, message: BagMessage) -> list[Scan]:
        """The scans that this message completes."""
        self._held += self._packets(content, message)
        return self._decode_held() if len(self._held) >= _BATCH_PACKETS else []

    def _decode_held(self) -> list[Scan]:
        if not self._held:
            return []
        payloads = [payload for payload, _ in self._held]
        length, host_s = np.array([len(payload) for payload in payloads]), np.array([at_s for _, at_s in self._held])
        self._held = []
        senders = np.zeros(len(length), np.uint64)
        return self._decode(Datagrams(np.concatenate(payloads), np.cumsum(length) - length, length, host_s, senders))


class PacketScans(_PacketMessages):
    """Packets of spinning scanners.

    Args:
        path: the bag, beside which a calibration may be.
        kind: type of the messages.
        options: `model` and `near_s` are used.
    """

    def __init__(self, source: str, path: Path, kind: str, options: ReadOptions) -> None:
        super().__init__()
        maker = _MAKERS[PACKET_SCANS[kind]]
        angles = AngleTable.beside([path]) if maker.calibrated else None
        self._maker = maker
        self._decoder = PacketDecoder(maker, options.model, angles=angles, where=source, near_s=options.near_s)

    def _packets(self, content: Any, message: BagMessage) -> Iterator[tuple[ByteArray, float]]:
        at_s = stamp_s(content, message)
        for packet in content.packets:
            data = np.asarray(packet.data, np.uint8)
            yield data[: packet.size] if hasattr(packet, "size") else data, seconds(packet.stamp) or at_s

    def _decode(self, packets: Datagrams) -> list[Scan]:
        product = self._maker.products(packets.data, packets.offset, packets.length)
        return self._decoder.push_at(packets.data, packets.offset, product, packets.time_s)

    def finish(self) -> list[Scan]:
        """The scans that are still open."""
        return self._decode_held() + self._decoder.finish()

    @property
    def clock(self) -> Clock:
        """The clock that the times come from; known with the first scan."""
        return self._decoder.kind

    def facts(self) -> dict[str, Any]:
        """What `inspect` reports."""
        counts, model = self._decoder.counts, self._decoder.model
        return {
            "model": model.name if model else None,
            **self._decoder.angles,
            "return_modes": {self._maker.mode_name(mode): n for mode, n in counts.modes.items()},
            "packets": counts.packets,
            "rpm": round(counts.rpm, 1),
        }

    def notices(self) -> list[Notice]:
        """What is unusual; complete after `finish`."""
        return self._decoder.notices()


class OusterMessages(_PacketMessages):
    """Messages of single packets of an Ouster.

    Args:
        texts: name and text of messages of the bag that may be the sensor's metadata; without any, they are sought in
            the folder of the bag.
        options: `model` is used.
    """

    def __init__(self, path: Path, texts: Sequence[tuple[str, str]], options: ReadOptions) -> None:
        super().__init__()
        self._path, self._texts, self._options = path, texts, options
        self._decoder: OusterDecoder | None = None
        self._length = 0
        self._uncertain: list[Notice] = []

    def _packets(self, content: Any, message: BagMessage) -> Iterator[tuple[ByteArray, float]]:
        yield np.asarray(content.buf, np.uint8), message.received_ns * 1e-9

    def _decode(self, packets: Datagrams) -> list[Scan]:
        if self._decoder is None:
            self._decoder = self._started(packets)
        mine = packets.length == self._length
        return self._decoder.push(packets.data, packets.offset[mine], packets.time_s[mine])

    def finish(self) -> list[Scan]:
        """The scans that are still open."""
        return self._decode_held() + (self._decoder.finish() if self._decoder else [])

    def _started(self, packets: Datagrams) -> OusterDecoder:
        """The decoder with the metadata of the sensor that sends these packets."""
        found = looks_like_data(packets)
        if not found:
            raise InputError("no-packets", paths=self._path, frames=f"{len(packets):,} other messages")
        told, faults = list[Metadata](), list[str]()
        for name, text in self._texts:
            try:
                metadata = Metadata.parse(text, f"{self._path.name} {name}")
            except ValueError as error:
                faults.append(f"{name}: {error}")
            else:
                told += [metadata] if metadata else []
        beside = (told, faults) if told else metadata_beside(self._path)
        sensors, self._uncertain = sensors_of(self._path, found, beside, self._options.model)
        self._length = sensors[0].sender.length
        return OusterDecoder(sensors[0].metadata)

    @property
    def clock(self) -> Clock:
        """The clock that the times come from; known with the first scan."""
        return self._decoder.clock if self._decoder else Clock.RECORDER

    def facts(self) -> dict[str, Any]:
        """What `inspect` reports."""
        return self._decoder.facts() if self._decoder else {}

    def notices(self) -> list[Notice]:
        """What is unusual; complete after `finish`."""
        return [*self._uncertain, *(self._decoder.notices() if self._decoder else [])]
