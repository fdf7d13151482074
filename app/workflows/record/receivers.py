"""GNSS receivers at serial devices, TCP servers and UDP ports: their bytes as they arrive."""

import os
import re
import select
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Final, TypeAlias

from furrowmap.core.readers.arrived_positions import ArrivedPositions
from furrowmap.core.runtime.errors import UsageError
from furrowmap.workflows.record.storage import Series, Storage

Read: TypeAlias = Callable[[], bytes]
"""Returns what arrived, or nothing after `WAIT_S`. Raises OSError where the connection has ended."""

WAIT_S: Final = 0.25
REOPEN_S: Final = 1.0
"""Between two attempts to open a source."""
CONNECTION_SILENT_S: Final = 10.0
"""Without bytes a TCP connection is opened anew: a server that lost its power says no farewell."""
USUAL_BAUD: Final = 115_200
_NETWORK: Final = re.compile(r"(tcp|udp)://([^:/\s]*):(\d{1,5})/?")
_SERIAL_SOURCE: Final = re.compile(r"([^:]+?)(?::(\d+))?")
_PIECE: Final = 1 << 16


@dataclass(frozen=True)
class GnssSource:
    """Where a receiver is: "serial" by device and baud, "tcp" or "udp" by host ("" for all of UDP) and port."""

    kind: str
    name: str
    number: int

    @classmethod
    def parse(cls, text: str) -> "GnssSource":
        """The place in a text: DEVICE, DEVICE:BAUD, tcp://HOST:PORT or udp://:PORT. Raises UsageError."""
        network, serial = _NETWORK.fullmatch(text), _SERIAL_SOURCE.fullmatch(text)
        if network and 0 < int(network[3]) < 1 << 16 and (network[2] or network[1] == "udp"):
            return cls(network[1], network[2], int(network[3]))
        if serial and "//" not in text and sys.platform != "win32":
            import termios

            baud = int(serial[2] or USUAL_BAUD)
            if hasattr(termios, f"B{baud}"):
                return cls("serial", serial[1], baud)
        raise UsageError("usage.gnss-source", text=text)

    @contextmanager
    def open(self) -> Iterator[Read]:
        """Open it. Raises OSError."""
        if self.kind == "serial":
            with _serial(self.name, self.number) as read:
                yield read
            return
        if self.kind == "tcp":
            connection = socket.create_connection((self.name, self.number), 5.0)
        else:
            connection = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with closing(connection):
            if self.kind == "udp":
                connection.bind((self.name, self.number))
            connection.settimeout(WAIT_S)
            heard_s = time.monotonic()

            def read() -> bytes:
                nonlocal heard_s
                try:
                    data = connection.recv(_PIECE)
                except TimeoutError:
                    if self.kind == "tcp" and time.monotonic() - heard_s > CONNECTION_SILENT_S:
                        raise
                    return b""
                if not data and self.kind == "tcp":
                    raise ConnectionResetError(None, "the connection was closed")
                heard_s = time.monotonic()
                return data

            yield read


@contextmanager
def _serial(device: str, baud: int) -> Iterator[Read]:
    """A serial device: eight bits, no parity, as bytes. Raises OSError."""
    if sys.platform == "win32":
        raise OSError(None, "serial devices need Linux or macOS")
    else:
        import termios
        import tty

        descriptor = os.open(device, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            try:
                tty.setraw(descriptor)
                attributes = termios.tcgetattr(descriptor)
                attributes[2] |= termios.CLOCAL | termios.CREAD
                attributes[4] = attributes[5] = getattr(termios, f"B{baud}")
                termios.tcsetattr(descriptor, termios.TCSANOW, attributes)
            except termios.error as error:
                raise OSError(*error.args) from None

            def read() -> bytes:
                if not select.select([descriptor], [], [], WAIT_S)[0]:
                    return b""
                data = os.read(descriptor, _PIECE)
                if not data:
                    raise ConnectionResetError(None, "the device was removed")
                return data

            yield read
        finally:
            os.close(descriptor)


class GnssReceiver:
    """Reads a GNSS receiver in a thread and lets its bytes be written; a source that is lost is opened again.

    Attributes:
        source: as the user named it.
        series: the logs.
        arrived: what the bytes say.
        fault: why the source cannot be opened, or was lost; empty while it is open.
        last_s: when the last bytes arrived, by the monotonic clock; the start before any.
    """

    def __init__(self, source: str, storage: Storage, series: Series) -> None:
        self.source, self.series = source, series
        self.arrived = ArrivedPositions()
        self.fault = ""
        self.last_s = time.monotonic()
        self._where, self._storage = GnssSource.parse(source), storage
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._receive, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End reading."""
        self._stopped.set()
        self._thread.join()

    def _receive(self) -> None:
        while not self._stopped.is_set():
            try:
                with self._where.open() as read:
                    self.fault = ""
                    while not self._stopped.is_set():
                        if data := read():
                            self.last_s = time.monotonic()
                            self._storage.put(self.series, data, self.last_s)
                            self.arrived.add(data, time.time())
            except OSError as error:
                self.fault = error.strerror or str(error)
                self._stopped.wait(REOPEN_S)
