"""UDP packets of scanners, received without loss, as records of captures."""

import selectors
import socket
import struct
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from furrowmap.core.runtime.errors import RefusedError
from furrowmap.core.runtime.supervised import SupervisedThread
from furrowmap.core.simulator.capture import HEADERS, frame_head
from furrowmap.workflows.record.recording_files import Storage
from furrowmap.workflows.record.senders import HandedBlock, PacketBlock, Sender, Senders

USUAL_PORTS: Final = (2368, 8308, 10110, 7502, 7503, 56301, 56401, 6699, 7788)
"""Of Velodyne and Hesai (data, positions of each), Ouster and Livox (data, IMU), and RoboSense (data, settings)."""
BUFFER_BYTES: Final = 8 << 20
"""Asked for each socket: seconds of a scanner, for moments in which this machine does something else."""
AMPLE_BYTES: Final = 1 << 20
MAX_HEADS: Final = 4096
MAX_PACKETS: Final = 4096
"""That are taken from one port before the others have their turn."""
PCAP_HEAD: Final = struct.pack("<IHHiIII", 0xA1B23C4D, 2, 4, 0, 0, 1 << 18, 1)
"""Of a capture of Ethernet frames with nanoseconds (draft-ietf-opsawg-pcap)."""
PCAP_RECORD: Final = struct.Struct("<IIII")
TIMESPEC: Final = struct.Struct("@qq")
STAMP_SPACE: Final = 64
SO_RCVBUFFORCE: Final = 33
SO_TIMESTAMPNS: Final = 35
SO_MEMINFO: Final = 55
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


class ScannerNetwork:
    """Receives the packets of all ports in a thread, and lets them be written.

    The thread takes all packets that wait and then sleeps: a wake-up each 10 ms costs less than one a packet, and
    packets have the kernel's times of arrival. Small buffers are emptied more often.

    Args:
        ports: each with the number of its scanner: one address may have several.
        senders: whose packets are recorded.
        told: is called by the thread where it was ended by an exception, before it begins again.
    """

    def __init__(
        self,
        ports: Sequence[Port],
        storage: Storage,
        senders: Senders,
        told: Callable[[SupervisedThread], None] = lambda _: None,
    ) -> None:
        self.ports = ports
        self.senders = senders
        self._storage = storage
        self._pause_s = 0.01 if all(port.granted_bytes >= AMPLE_BYTES for port in ports) else 0.002
        self._heads: dict[tuple[tuple[str, int], int, int], bytes] = {}
        self._payload = memoryview(bytearray(1 << 16))
        self.thread = SupervisedThread("packets", self._receive, told)
        self.thread.ensure()

    def stop(self) -> None:
        """Take what has arrived, and end."""
        self.thread.stop()
        self._hand_on()
        for port in self.ports:
            port.socket.close()

    def _receive(self) -> None:
        with selectors.DefaultSelector() as selector:
            for port in self.ports:
                selector.register(port.socket, selectors.EVENT_READ, port)
            ended = False
            while not ended:
                ended = self.thread.stopping.is_set()
                for key, _ in selector.select(0.0 if ended else 0.25):
                    self._take(key.data)
                self._hand_on()
                time.sleep(self._pause_s)

    def _hand_on(self) -> None:
        """Let the packets that were taken be written: first that, then they are looked at."""
        for sender in list(self.senders.known.values()):
            while sender.handed is not None or sender.filling.records:
                _hand_on_block(self._storage, sender)

    def _take(self, port: Port) -> None:
        """Take the packets that wait at a port."""
        for _ in range(MAX_PACKETS):
            try:
                if sys.platform == "win32":
                    size, source = port.socket.recvfrom_into(self._payload)
                    arrived = divmod(time.time_ns(), 10**9)
                else:
                    size, stamps, _, source = port.socket.recvmsg_into([self._payload], STAMP_SPACE)
                    arrived = _arrival(stamps)
            except OSError:  # no packet waits, or the network is down
                return
            payload = self._payload[:size]
            sender = self.senders.admitted(source, port.scanner, payload)
            if sender is None:
                continue
            head = self._heads.get((source, port.number, size))
            if head is None:
                if len(self._heads) >= MAX_HEADS:
                    self._heads.clear()
                head = frame_head(source, (sender.target, port.number), size)
                self._heads[source, port.number, size] = head
                sender.ports.add(port.number)
            # The record in one step: an exception between its parts would damage all that follow in the capture.
            record = PCAP_RECORD.pack(*arrived, HEADERS + size, HEADERS + size) + head
            at = len(sender.filling.records) + len(record)
            sender.filling.records += record + payload
            sender.filling.packets.append((at, size, arrived[0] * 10**9 + arrived[1]))
            sender.packets += 1


def _hand_on_block(storage: Storage, sender: Sender) -> None:
    """Let a block be written once, even where this thread is ended at any of these lines and comes here again."""
    handed = sender.handed
    if handed is None:
        handed = HandedBlock(sender.filling, (bytes(sender.filling.records), time.monotonic()))
        sender.handed = handed
    if sender.filling is handed.block:
        sender.filling = PacketBlock()
    storage.put(sender.series, handed.waiting)
    sender.last_s = handed.waiting[1]
    sender.handed = None
    sender.arrived.add(handed.waiting[0], handed.block.packets)


def _arrival(stamps: Sequence[tuple[int, int, bytes]]) -> tuple[int, int]:
    """Seconds and nanoseconds since 1970 at which a packet arrived: the kernel's, or where it gives none, now."""
    for _, _, stamp in stamps:
        if len(stamp) == TIMESPEC.size:
            seconds, nanoseconds = TIMESPEC.unpack(stamp)
            return seconds & 0xFFFFFFFF, nanoseconds
    return divmod(time.time_ns(), 10**9)
