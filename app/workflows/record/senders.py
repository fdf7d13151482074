"""Who sends packets, and whose are recorded: foreign senders must not take the place of a scanner."""

import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final

from furrowmap.core.readers.arrived_packets import ArrivedPackets, Packet, packet_maker
from furrowmap.workflows.record.series import Series, Waiting

MAX_SCANNERS: Final = 8
"""Senders of packets of known makers that are recorded, besides the addresses that the machine states."""
MAX_UNKNOWN: Final = 8
"""Other senders that are recorded at a time: each has its files, and a hostile network must not make thousands."""
MAX_EVER: Final = 64
"""Of each of the two kinds, during a recording."""
MAX_UNKNOWN_BYTES: Final = 1 << 30
"""Of all others together, on the disk."""
IDLE_S: Final = 30.0
"""A sender that has sent nothing for so long gives its place to another."""
SCANNERS_WAITING_BYTES: Final = 256 << 20
"""Of all scanners in memory, where the disk takes nothing: minutes of one. Each has an equal part."""
UNKNOWN_WAITING_BYTES: Final = 2 << 20
UNKNOWN_LOOKED_BYTES: Final = 1 << 20
MAX_NAMED: Final = 1000
"""Addresses that are counted of senders that are not recorded."""


class Rank(IntEnum):
    """Whose packets come first."""

    UNKNOWN = 0
    SCANNER = 1
    """Sends packets of a known maker."""
    STATED = 2
    """Has an address that the machine states."""


@dataclass(eq=False)
class PacketBlock:
    """Records of a capture, and the packets in them."""

    records: bytearray = field(default_factory=bytearray)
    packets: list[Packet] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class HandedBlock:
    """A block of packets, and what is written of it."""

    block: PacketBlock
    waiting: Waiting


@dataclass(eq=False)
class Sender:
    """What sends packets from one address: a scanner, or anything else.

    Attributes:
        series: the captures of its packets.
        target: address of this machine's interface to it.
        ports: that it sends to.
        packets: number of its packets.
        last_s: when the last one was taken, by the monotonic clock.
        arrived: what its packets say.
        filling: takes the packets that arrive.
        handed: what is handed on to be written, until that is done.
    """

    address: str
    rank: Rank
    series: Series
    target: str
    ports: set[int] = field(default_factory=set)
    packets: int = 0
    last_s: float = 0.0
    arrived: ArrivedPackets = field(default_factory=ArrivedPackets)
    filling: PacketBlock = field(default_factory=PacketBlock, repr=False)
    handed: HandedBlock | None = field(default=None, repr=False)


class Senders:
    """The senders whose packets are recorded.

    Stated addresses always have their place; senders of packets of a known maker have places of their own, and all
    others a few, which they lose when they are silent.

    Args:
        stated: addresses of scanners.
        new_series: the series of captures of an address and a scanner.

    Attributes:
        known: by address and scanner.
        ignored: packets that were not recorded.
        ignored_of: the addresses that sent them; of a thousand at most.
        unknown_bytes: packets of unknown senders that were recorded.
    """

    def __init__(self, stated: Sequence[str], new_series: Callable[[str, int], Series]) -> None:
        self.known: dict[tuple[str, int], Sender] = {}
        self.ignored = 0
        self.ignored_of: dict[str, None] = {}
        self.unknown_bytes = 0
        self._stated = frozenset(stated)
        self._new_series = new_series
        self._ever = {Rank.SCANNER: 0, Rank.UNKNOWN: 0}

    @property
    def first_ones(self) -> list[Sender]:
        """All, stated ones first and then scanners."""
        return sorted(self.known.values(), key=lambda sender: -sender.rank)

    def admitted(self, source: tuple[str, int], scanner: int, payload: memoryview) -> Sender | None:
        """The sender of a packet; None if the packet is not recorded, which is counted."""
        sender = self.known.get((source[0], scanner))
        if sender is None:
            sender = self._with_place(source, scanner, payload)
        elif sender.rank is Rank.UNKNOWN and packet_maker(payload) and self._has_place(Rank.SCANNER):
            sender.rank = Rank.SCANNER
            sender.arrived.most_bytes = ArrivedPackets.most_bytes
            self._share_memory()
        if sender is not None and sender.rank is Rank.UNKNOWN:
            if self.unknown_bytes + len(payload) <= MAX_UNKNOWN_BYTES:
                self.unknown_bytes += len(payload)
                return sender
            sender = None
        if sender is None:
            self.ignored += 1
            if len(self.ignored_of) < MAX_NAMED:
                self.ignored_of[source[0]] = None
        return sender

    def _with_place(self, source: tuple[str, int], scanner: int, payload: memoryview) -> Sender | None:
        stated = source[0] in self._stated
        rank = Rank.STATED if stated else Rank.SCANNER if packet_maker(payload) else Rank.UNKNOWN
        if rank is not Rank.STATED:
            if self._ever[rank] >= MAX_EVER or not self._has_place(rank):
                return None
            self._ever[rank] += 1
        sender = Sender(source[0], rank, self._new_series(source[0], scanner), _interface_to(source))
        if rank is Rank.UNKNOWN:
            sender.arrived.most_bytes = UNKNOWN_LOOKED_BYTES
        sender.last_s = time.monotonic()
        self.known[source[0], scanner] = sender
        self._share_memory()
        return sender

    def _has_place(self, rank: Rank) -> bool:
        """Whether a sender of a rank has a place: a free one, or that of one which has been silent."""
        same = [(key, sender) for key, sender in self.known.items() if sender.rank is rank]
        if len(same) < (MAX_SCANNERS if rank is Rank.SCANNER else MAX_UNKNOWN):
            return True
        key, silent = min(same, key=lambda each: each[1].last_s)
        if time.monotonic() - silent.last_s < IDLE_S or silent.filling.records or silent.handed:
            return False
        silent.series.is_over = True
        del self.known[key]
        return True

    def _share_memory(self) -> None:
        """Give each scanner an equal part of the memory in which packets wait for the disk."""
        scanners = [sender for sender in self.known.values() if sender.rank is not Rank.UNKNOWN]
        for sender in self.known.values():
            sender.series.most_waiting_bytes = (
                UNKNOWN_WAITING_BYTES if sender.rank is Rank.UNKNOWN else SCANNERS_WAITING_BYTES // len(scanners)
            )


def _interface_to(source: tuple[str, int]) -> str:
    """The address of this machine's interface to a sender."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as towards:
        try:
            towards.connect(source)
            return str(towards.getsockname()[0])
        except OSError:  # no route back
            return "255.255.255.255"
