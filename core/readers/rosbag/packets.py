"""Messages of packets of spinning scanners to scans, with the same decoders as captures."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.hesai.models import HESAI
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.rosbag.messages import PACKET_SCANS, seconds, stamp_s
from furrowmap.core.readers.rosbag.storage import BagMessage
from furrowmap.core.readers.spinning.angles import AngleTable
from furrowmap.core.readers.spinning.decoder import PacketDecoder
from furrowmap.core.readers.velodyne.models import VELODYNE
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.scan import Clock, Scan

_BATCH_PACKETS: Final = 1000
_MAKERS: Final = {maker.name: maker for maker in (VELODYNE, HESAI)}


class PacketScans:
    """Decodes the packet messages of one topic into scans.

    Args:
        path: the bag, beside which a calibration may be.
        kind: type of the messages.
        options: `model` and `near_s` are used.
    """

    def __init__(self, source: str, path: Path, kind: str, options: ReadOptions) -> None:
        maker = _MAKERS[PACKET_SCANS[kind]]
        angles = AngleTable.beside([path]) if maker.calibrated else None
        self._maker = maker
        self._decoder = PacketDecoder(maker, options.model, angles=angles, where=source, near_s=options.near_s)
        self._payloads: list[NDArray[np.uint8]] = []
        self._host_s: list[float] = []

    def push(self, content: Any, message: BagMessage) -> list[Scan]:
        """The scans that this message completes."""
        at_s = stamp_s(content, message)
        for packet in content.packets:
            data = np.asarray(packet.data, np.uint8)
            self._payloads.append(data[: packet.size] if hasattr(packet, "size") else data)
            self._host_s.append(seconds(packet.stamp) or at_s)
        return self._decode_held() if len(self._payloads) >= _BATCH_PACKETS else []

    def finish(self) -> list[Scan]:
        """The scans that are still open."""
        return self._decode_held() + self._decoder.finish()

    def _decode_held(self) -> list[Scan]:
        if not self._payloads:
            return []
        length = np.array([len(payload) for payload in self._payloads])
        data, offset = np.concatenate(self._payloads), np.cumsum(length) - length
        host_s = np.array(self._host_s)
        self._payloads, self._host_s = [], []
        return self._decoder.push_at(data, offset, self._maker.products(data, offset, length), host_s)

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
