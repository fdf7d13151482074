"""What the packets of a scanner say while they arrive: its maker, how many are missing, and the state of its PPS."""

from collections import deque
from dataclasses import dataclass, field
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.hesai.captures import HESAI
from furrowmap.core.readers.ouster.captures import data_lengths
from furrowmap.core.readers.ouster.metadata import heads
from furrowmap.core.readers.spinning.hour_clock import POSITION_BYTES, PositionPacket, pps_states
from furrowmap.core.readers.spinning.scanner_model import Maker
from furrowmap.core.readers.velodyne.captures import VELODYNE
from furrowmap.core.runtime.arrays import IntArray
from furrowmap.core.values.clock import HOUR_S

ByteArray = NDArray[np.uint8]
Packet = tuple[int, int, int]
"""Where the payload of a packet begins in its block, its length, and nanoseconds since 1970 of its arrival."""

_MAX_WAITING_BYTES: Final = 64 << 20
_MAX_WAITING_PACKETS: Final = 200_000
"""That wait to be looked at, at most: a second of the fastest scanners."""
_UNREAD_HEAD: Final = 3
_HESAI_HEAD: Final = b"\xee\xff"
_OUSTER_LIDAR: Final = b"\1\0"
"""What data packets of an Ouster begin with, those of old firmware excepted."""
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
        most_bytes: that wait to be looked at, at most; what comes in excess is left out.
    """

    maker: str = ""
    unread: str = ""
    lost: int = 0
    pps: str = ""
    most_bytes: int = _MAX_WAITING_BYTES
    _waiting: deque[tuple[bytes, list[Packet]]] = field(default_factory=deque, repr=False)
    _added: tuple[int, int] = (0, 0)
    """Bytes and packets that were added since the last look."""
    _is_cut: bool = False
    _last: NDArray[np.int64] | None = None
    _open_turn: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    _turns: int | None = None
    _turn_packets: int = 0
    """Packets of the fullest turn."""
    _arrived: int = 0
    _lost_before: int = 0

    def add(self, block: bytes, packets: list[Packet]) -> None:
        """Keep the packets in a block for `look`. Another thread may call it."""
        size, number = self._added
        if size + len(block) > self.most_bytes or number + len(packets) > _MAX_WAITING_PACKETS:
            self._is_cut = True
            return
        self._added = (size + len(block), number + len(packets))
        self._waiting.append((block, packets))

    def look(self) -> None:
        """Look at the packets that were added.

        They are gone also where looking fails, which hostile packets may do: the next ones are looked at afresh.
        """
        try:
            self._look()
        except BaseException:
            self._begin_anew()
            raise

    def _look(self) -> None:
        if self._is_cut:  # some were left out: they are not missing
            self._is_cut = False
            self._begin_anew()
        self._added = (0, 0)
        blocks = list[bytes]()
        packets = list[Packet]()
        size = 0
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
            head = data[offset[-1] : offset[-1] + min(length[-1], _UNREAD_HEAD)].tobytes()
            self.unread = _unread_maker(head, int(length[-1]))

    def _begin_anew(self) -> None:
        """Follow the next packets without those before."""
        self._last = None
        self._lost_before = self.lost
        self._arrived = 0
        self._turns = None
        self._open_turn = np.empty(0, np.int64)

    def _follow_spinning(
        self, maker: Maker, product: IntArray, data: ByteArray, offset: IntArray, length: IntArray, arrived_ns: IntArray
    ) -> None:
        model = next((model for model in maker.models if model.product == product.max()), None)
        if model is None:
            return
        mine = product == model.product
        layout = model.layout
        offset = offset[mine]
        length = length[mine]
        arrived_ns = arrived_ns[mine]
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
        self.lost = self._lost_before + (self._turns or 0) * self._turn_packets - self._arrived


@cache
def _data_lengths() -> frozenset[int]:
    """Lengths of data packets of all makers that are read."""
    spinning = {size for maker in (VELODYNE, HESAI) for model in maker.models for size in model.layout.lengths}
    return frozenset(spinning | data_lengths().keys())


def packet_maker(payload: bytes | memoryview) -> str:
    """The maker of the scanner that a packet is of; empty for packets that are not, or do not show it."""
    if len(payload) in _data_lengths() or payload[:2] == _HESAI_HEAD:
        data = np.frombuffer(payload, np.uint8)
        offset = np.zeros(1, np.int64)
        length = np.full(1, len(data))
        for maker in (VELODYNE, HESAI):
            if maker.products(data, offset, length)[0] >= 0:
                return maker.name
        legacy = data_lengths().get(len(data))
        if legacy or (legacy is False and bytes(data[:2]) == _OUSTER_LIDAR):
            return "Ouster"
    return _unread_maker(bytes(payload[:_UNREAD_HEAD]), len(payload))


def _unread_maker(head: bytes, size: int) -> str:
    """Livox (SDK2: version 0, then the length) or RoboSense (55 AA), by the beginning of a packet; else empty."""
    if head.startswith(b"\x55\xaa"):
        return "RoboSense"
    return "Livox" if head[:1] == b"\0" and head[1:3] == size.to_bytes(2, "little") else ""
