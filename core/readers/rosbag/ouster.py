"""Messages of single Ouster packets to scans, with the same decoder as captures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.ouster.captures import looks_like_data, sensors_of
from furrowmap.core.readers.ouster.metadata import Metadata, metadata_beside
from furrowmap.core.readers.ouster.packets import OusterDecoder
from furrowmap.core.readers.pcap import Datagrams
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.rosbag.storage import BagMessage
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.scan import Clock, Scan

_BATCH: Final = 640
"""Packets that are decoded together, a second of most modes."""


class OusterMessages:
    """Decodes the messages of one topic into scans.

    Args:
        texts: name and text of messages of the bag that may be the sensor's metadata; without any, they are sought in
            the folder of the bag.
        options: `model` is used.
    """

    def __init__(self, path: Path, texts: Sequence[tuple[str, str]], options: ReadOptions) -> None:
        self._path = path
        self._options = options
        self._texts = texts
        self._decoder: OusterDecoder | None = None
        self._length = 0
        self._payloads: list[NDArray[np.uint8]] = []
        self._host_s: list[float] = []
        self._uncertain: list[Notice] = []

    def push(self, content: Any, message: BagMessage) -> list[Scan]:
        """The scans that this message completes."""
        self._payloads.append(np.asarray(content.buf, np.uint8))
        self._host_s.append(message.received_ns * 1e-9)
        return self._decode_held() if len(self._payloads) >= _BATCH else []

    def finish(self) -> list[Scan]:
        """The scans that are still open."""
        return self._decode_held() + (self._decoder.finish() if self._decoder else [])

    def _decode_held(self) -> list[Scan]:
        if not self._payloads:
            return []
        length = np.array([len(payload) for payload in self._payloads])
        data, offset = np.concatenate(self._payloads), np.cumsum(length) - length
        host_s = np.array(self._host_s)
        self._payloads, self._host_s = [], []
        if self._decoder is None:
            self._start(Datagrams(data, offset, length, host_s, np.zeros(len(length), np.uint64)))
        assert self._decoder is not None
        mine = length == self._length
        return self._decoder.push(data, offset[mine], host_s[mine])

    def _start(self, datagrams: Datagrams) -> None:
        """Find the metadata of the sensor that sends these packets."""
        found = looks_like_data(datagrams)
        if not found:
            frames = f"{len(datagrams):,} other messages"
            raise InputError("no-packets", paths=self._path, frames=frames)
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
        self._decoder = OusterDecoder(sensors[0].metadata)

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
