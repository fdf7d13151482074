"""UDP packets of scanners, received without loss, as records of captures."""

import selectors
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Final

from furrowmap.core.readers.arrived_packets import ArrivedPackets, Packet
from furrowmap.core.runtime.errors import RefusedError
from furrowmap.core.simulator.capture import HEADERS, frame_head
from furrowmap.workflows.record.storage import Series, Storage

USUAL_PORTS: Final = (2368, 8308, 10110, 7502, 7503, 56301, 56401, 6699, 7788)
"""Of Velodyne and Hesai (data, positions of each), Ouster and Livox (data, IMU), and RoboSense (data, settings)."""
BUFFER_BYTES: Final = 8 << 20
"""Asked for each socket: seconds of a scanner, for moments in which this machine does something else."""
AMPLE_BYTES: Final = 1 << 20
MAX_SENDERS: Final = 16
"""Each has its files, and a hostile network must not make thousands."""
MAX_HEADS: Final = 4096
MAX_PACKETS: Final = 4096
"""That are taken from one port before the others have their turn."""
PCAP_HEAD: Final = struct.pack("<IHHiIII", 0xA1B23C4D, 2, 4, 0, 0, 1 << 18, 1)
"""Of a capture of Ethernet frames with nanoseconds (draft-ietf-opsawg-pcap)."""
PCAP_RECORD: Final = struct.Struct("<IIII")
TIMESPEC: Final = struct.Struct("@qq")
STAMP_SPACE: Final = 64
SO_RCVBUFFORCE, SO_TIMESTAMPNS, SO_MEMINFO = 33, 35, 55
"""Options of Linux that Python has no names for (asm-generic/socket.h)."""
MEMINFO: Final = struct.Struct("@9I")
"""Of SO_MEMINFO (linux/sock_diag.h); the last number is that of the packets that were dropped."""


@dataclass
class Port:
    """A UDP port that is listened to, at all addresses of this machine.

    Attributes:
        scanner: number of the scanner whose port it is.
        granted_bytes: the socket's buffer. Linux counts its own overhead in: packets have half of it.
        dropped: packets for which the buffer had no space; None where the system does not say.
    """

    number: int
    scanner: int
    socket: socket.socket
    granted_bytes: int
    dropped: int | None = None

    @classmethod
    def open(cls, number: int, scanner: int = 0) -> "Port":
        """Listen to a port. Raises RefusedError if another program does, or the system forbids it."""
        opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            opened.bind(("", number))
        except OSError as error:
            opened.close()
            raise RefusedError("record-port", port=number, why=error.strerror) from None
        opened.settimeout(0.0)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        if sys.platform == "linux":
            opened.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
            with suppress(OSError):  # needs CAP_NET_ADMIN
                opened.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, BUFFER_BYTES)
        return cls(number, scanner, opened, opened.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF))

    def look(self) -> None:
        """Ask the kernel for the packets that it dropped."""
        if sys.platform == "linux":
            with suppress(OSError, struct.error):
                memory = self.socket.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, MEMINFO.size)
                self.dropped = MEMINFO.unpack(memory)[-1]


@dataclass
class Sender:
    """What sends packets from one address: a scanner, or anything else.

    Attributes:
        series: the captures of its packets.
        target: address of this machine's interface to it.
        ports: that it sends to.
        packets: number of its packets.
        last_s: when the last one was taken, by the monotonic clock.
        arrived: what its packets say.
        block: records of a capture that are not handed on yet.
        block_packets: the packets in it.
    """

    address: str
    series: Series
    target: str
    ports: set[int] = field(default_factory=set)
    packets: int = 0
    last_s: float = 0.0
    arrived: ArrivedPackets = field(default_factory=ArrivedPackets)
    block: bytearray = field(default_factory=bytearray, repr=False)
    block_packets: list[Packet] = field(default_factory=list, repr=False)


class ScannerNetwork:
    """Receives the packets of all ports in a thread, and lets them be written.

    The thread takes all packets that wait and then sleeps: a wake-up each 10 ms costs less than one a packet, and
    packets have the kernel's times of arrival. Small buffers are emptied more often.

    Args:
        ports: each with the number of its scanner: one address may have several.
        new_series: the series of captures of an address and a scanner.

    Attributes:
        senders: by address and scanner.
        ignored: packets of further senders than `MAX_SENDERS`.
    """

    def __init__(self, ports: Sequence[Port], storage: Storage, new_series: Callable[[str, int], Series]) -> None:
        self.ports = ports
        self.senders: dict[tuple[str, int], Sender] = {}
        self.ignored = 0
        self._storage, self._new_series = storage, new_series
        self._pause_s = 0.01 if all(port.granted_bytes >= AMPLE_BYTES for port in ports) else 0.002
        self._heads: dict[tuple[tuple[str, int], int, int], bytes] = {}
        self._payload = memoryview(bytearray(1 << 16))
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._receive, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Take what has arrived, and end."""
        self._stopped.set()
        self._thread.join()
        for port in self.ports:
            port.socket.close()

    def _receive(self) -> None:
        with selectors.DefaultSelector() as selector:
            for port in self.ports:
                selector.register(port.socket, selectors.EVENT_READ, port)
            ended = False
            while not ended:
                ended = self._stopped.is_set()
                for key, _ in selector.select(0.0 if ended else 0.25):
                    self._take(key.data)
                now_s = time.monotonic()
                for sender in self.senders.values():
                    if sender.block:
                        sender.last_s = now_s
                        sender.arrived.add(sender.block, sender.block_packets)
                        self._storage.put(sender.series, sender.block, now_s)
                        sender.block, sender.block_packets = bytearray(), []
                time.sleep(self._pause_s)

    def _take(self, port: Port) -> None:
        """Take the packets that wait at a port."""
        for _ in range(MAX_PACKETS):
            try:
                if sys.platform == "win32":
                    size, source = port.socket.recvfrom_into(self._payload)
                    arrived = divmod(time.time_ns(), 10**9)
                else:
                    size, stamps, _, source = port.socket.recvmsg_into([self._payload], STAMP_SPACE)
                    arrived = TIMESPEC.unpack(stamps[0][2]) if stamps else divmod(time.time_ns(), 10**9)
            except OSError:  # no packet waits, or the network is down
                return
            sender = self.senders.get((source[0], port.scanner)) or self._new_sender(source, port)
            if sender is None:
                self.ignored += 1
                continue
            head = self._heads.get((source, port.number, size))
            if head is None:
                if len(self._heads) >= MAX_HEADS:
                    self._heads.clear()
                head = frame_head(source, (sender.target, port.number), size)
                self._heads[source, port.number, size] = head
                sender.ports.add(port.number)
            block = sender.block
            block += PCAP_RECORD.pack(*arrived, HEADERS + size, HEADERS + size)
            block += head
            sender.block_packets.append((len(block), size, arrived[0] * 10**9 + arrived[1]))
            block += self._payload[:size]
            sender.packets += 1

    def _new_sender(self, source: tuple[str, int], port: Port) -> Sender | None:
        if len(self.senders) >= MAX_SENDERS:
            return None
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as towards:
            try:
                towards.connect(source)
                target = str(towards.getsockname()[0])
            except OSError:  # no route back
                target = "255.255.255.255"
        sender = Sender(source[0], self._new_series(source[0], port.scanner), target)
        self.senders[source[0], port.scanner] = sender
        return sender
