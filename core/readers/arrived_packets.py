"""What the packets of a scanner say while they arrive: its maker, how many are missing, and the state of its PPS."""

from collections import deque
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.hesai.captures import HESAI
from furrowmap.core.readers.ouster.captures import data_lengths
from furrowmap.core.readers.ouster.metadata import heads
from furrowmap.core.readers.spinning.clock import POSITION_BYTES, PositionPacket, pps_states
from furrowmap.core.readers.spinning.model import Maker
from furrowmap.core.readers.velodyne.captures import VELODYNE
from furrowmap.core.runtime.arrays import IntArray
from furrowmap.core.values.clock import HOUR_S

ByteArray = NDArray[np.uint8]
Packet = tuple[int, int, int]
"""Where the payload of a packet begins in its block, its length, and nanoseconds since 1970 of its arrival."""

_MAX_WAITING: Final = 4096
"""Blocks that wait to be looked at, at most."""
_PAUSE_S: Final = 1.0
"""After a longer time without packets none are counted as missing: the scanner sent none, or its cable was out."""
_APART_S: Final = 0.1
"""A step of the scanner's stamps that differs more from that of the times of arrival: the clock was set."""
_MAX_STEP: Final = 1 << 16
"""A larger step of the packets' numbers is a restart of the scanner."""


@dataclass
class ArrivedPackets:
    """Follows the packets of one scanner.

    Packets are missing where the stamps of a Velodyne take a multiple of their usual step, where the numbers in the
    packets of a Hesai leave some out, and where a turn of an Ouster has fewer packets than another.

    Attributes:
        maker: of the scanner; empty while no packet shows it.
        unread: maker of a scanner whose packets no reader decodes; empty for none.
        lost: number of missing data packets.
        pps: state of the pulse per second in the last position packet; empty without one.
    """

    maker: str = ""
    unread: str = ""
    lost: int = 0
    pps: str = ""
    _waiting: deque[tuple[bytearray, list[Packet]]] = field(default_factory=deque, repr=False)
    _last: NDArray[np.int64] | None = None
    _open_turn: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    _turns: int | None = None
    _turn_packets: int = 0
    """Packets of the fullest turn."""
    _arrived: int = 0

    def add(self, block: bytearray, packets: list[Packet]) -> None:
        """Keep the packets in a block for `look`. Another thread may call it."""
        if len(self._waiting) < _MAX_WAITING:
            self._waiting.append((block, packets))

    def look(self) -> None:
        """Look at the packets that were added."""
        if len(self._waiting) >= _MAX_WAITING:  # some were left out
            self._last = None
        blocks, packets, size = list[bytearray](), list[Packet](), 0
        for _ in range(len(self._waiting)):
            block, inside = self._waiting.popleft()
            packets += [(size + at, length, arrived_ns) for at, length, arrived_ns in inside]
            blocks.append(block)
            size += len(block)
        if not packets:
            return
        data = np.frombuffer(b"".join(blocks), np.uint8)
        offset, length, arrived_ns = np.array(packets, np.int64).T
        for maker in (VELODYNE, HESAI):
            product = maker.products(data, offset, length)
            if (product >= 0).any():
                self.maker = maker.name
                self._follow_spinning(maker, product, data, offset, length, arrived_ns)
                self._follow_positions(data, offset[(length == POSITION_BYTES) & (product < 0)])
                return
        turned = np.isin(length, list(data_lengths()))
        if turned.any():
            self.maker = "Ouster"
            self._follow_turns(data, offset[turned], legacy=data_lengths()[int(length[turned][0])])
        elif not self.maker:
            self.unread = _unread_maker(data[offset[-1] : offset[-1] + length[-1]].tobytes())

    def _follow_spinning(
        self, maker: Maker, product: IntArray, data: ByteArray, offset: IntArray, length: IntArray, arrived_ns: IntArray
    ) -> None:
        model = next((model for model in maker.models if model.product == product.max()), None)
        if model is None:
            return
        mine = product == model.product
        layout, offset, length, arrived_ns = model.layout, offset[mine], length[mine], arrived_ns[mine]
        numbered = maker is HESAI and bool((length == layout.lengths[0]).all())
        if numbered:
            number = data[(offset + length - 4)[:, None] + np.arange(4)].view("<u4")[:, 0].astype(np.int64)
        else:
            number = layout.stamp_us(data, offset).astype(np.int64)
        rows = np.column_stack([number, arrived_ns // 1000])
        if self._last is not None:
            rows = np.vstack([self._last, rows])
        self._last = rows[-1]
        step, arrived_us = np.diff(rows, axis=0).T
        if numbered:
            step %= 1 << 32
            self.lost += int((step[(step > 1) & (step < _MAX_STEP)] - 1).sum())
            return
        step %= int(HOUR_S * 1e6)
        usable = (step > 0) & (step < _PAUSE_S * 1e6) & (np.abs(step - arrived_us) < _APART_S * 1e6)
        if usable.any():
            step = step[usable]
            self.lost += int((np.rint(step / np.quantile(step, 0.25)) - 1.0).clip(0.0).sum())

    def _follow_positions(self, data: ByteArray, offset: IntArray) -> None:
        if len(offset):
            packet = data[offset[-1] : offset[-1] + POSITION_BYTES].tobytes()
            self.pps = pps_states([PositionPacket.parse(packet, 0.0).pps])

    def _follow_turns(self, data: ByteArray, offset: IntArray, *, legacy: bool) -> None:
        frame = np.append(self._open_turn, heads(data, offset, legacy=legacy, fusa=False).frame)
        ends = np.flatnonzero(np.diff(frame)) + 1
        self._open_turn = frame[ends[-1] :] if len(ends) else frame
        packets = np.diff(ends, prepend=0)
        if self._turns is None:  # the first turn had begun before
            packets = packets[1:]
        self._turns = (self._turns or 0) + len(packets) if len(ends) else self._turns
        self._turn_packets = max([self._turn_packets, *packets.tolist()])
        self._arrived += int(packets.sum())
        self.lost = (self._turns or 0) * self._turn_packets - self._arrived


def _unread_maker(payload: bytes) -> str:
    """Livox (SDK2: version 0, then the length) or RoboSense (55 AA), by the beginning of a packet; else empty."""
    if payload.startswith(b"\x55\xaa"):
        return "RoboSense"
    return "Livox" if payload[:1] == b"\0" and payload[1:3] == len(payload).to_bytes(2, "little") else ""
