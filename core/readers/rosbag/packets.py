"""VelodyneScan messages to scans, with the same decoder as captures."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.rosbag.messages import seconds, stamp_s
from furrowmap.core.readers.rosbag.storage import BagMessage
from furrowmap.core.readers.velodyne.decoder import PacketDecoder
from furrowmap.core.readers.velodyne.models import BLOCK_MARK, PACKET_BYTES, RETURN_WORDS
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.scan import Clock, Scan

_BATCH_PACKETS: Final = 1000


class PacketScans:
    """Decodes the VelodyneScan messages of one topic into scans.

    Args:
        options: `model` and `near_s` are used.
    """

    def __init__(self, source: str, options: ReadOptions) -> None:
        self._source = source
        self._decoder = PacketDecoder(options.model, where=source, near_s=options.near_s)
        self._payloads: list[NDArray[np.uint8]] = []
        self._host_s: list[NDArray[np.float64]] = []
        self._held = self._foreign = 0

    def push(self, content: Any, message: BagMessage) -> list[Scan]:
        """The scans that this message completes."""
        payloads = np.array([packet.data for packet in content.packets], np.uint8).reshape(-1, PACKET_BYTES)
        at_s = stamp_s(content, message)
        host_s = np.array([seconds(packet.stamp) or at_s for packet in content.packets], np.float64)
        sound = (payloads[:, :2] == np.frombuffer(BLOCK_MARK, np.uint8)).all(axis=1)
        payloads, host_s = payloads[sound], host_s[sound]
        self._foreign += len(sound) - len(payloads)
        self._payloads.append(payloads)
        self._host_s.append(host_s)
        self._held += len(payloads)
        return self._decode_held() if self._held >= _BATCH_PACKETS else []

    def finish(self) -> list[Scan]:
        """The scans that are still open."""
        return self._decode_held() + self._decoder.finish()

    def _decode_held(self) -> list[Scan]:
        if not self._held:
            return []
        payloads, host_s = np.concatenate(self._payloads), np.concatenate(self._host_s)
        self._payloads, self._host_s = [], []
        self._held = 0
        return self._decoder.push(payloads, host_s)

    @property
    def clock(self) -> Clock:
        """The clock that the times come from; known with the first scan."""
        return self._decoder.kind

    def facts(self) -> dict[str, Any]:
        """What `inspect` reports."""
        counts, model = self._decoder.counts, self._decoder.model
        return {
            "model": model.name if model else None,
            "return_modes": {RETURN_WORDS.get(mode, f"0x{mode:02x}"): n for mode, n in counts.modes.items()},
            "packets": counts.packets,
            "rpm": round(counts.rpm, 1),
        }

    def notices(self) -> list[Notice]:
        """What is unusual; complete after `finish`."""
        notices = self._decoder.notices()
        if self._foreign:
            notices.append(Notice("packets-damaged", source=self._source, foreign=self._foreign))
        return notices
