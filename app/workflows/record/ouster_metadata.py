"""Asking Ouster sensors for their metadata, without which their packets cannot be decoded."""

import io
import queue
import re
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from http.client import HTTPException, HTTPResponse
from ipaddress import IPv4Address
from typing import Final

from furrowmap.core.readers.ouster.metadata import Metadata
from furrowmap.core.runtime.supervised import SupervisedThread
from furrowmap.workflows.record.small_files import SmallFiles

ASK_AGAIN_S: Final = 10.0
ANSWER_S: Final = 5.0
"""For the whole answer, however slowly it comes."""
MAX_BYTES: Final = 1 << 20
MAX_ASKED: Final = 8
"""Sensors: whoever forges the addresses of packets must not let this machine ask all others."""
HTTP_PORT: Final = 80
_PATH: Final = "/api/v1/sensor/metadata"
_CONTENT_LENGTH: Final = re.compile(rb"\r\ncontent-length:[ \t]*([0-9]{1,9})[ \t]*\r\n", re.IGNORECASE)
_NEW_SENSOR_S: Final = 0.25


class MetadataAsker:
    """Asks sensors in a thread until they answer, and keeps what they say beside their captures.

    Args:
        small: where the files go.
        told: is called by the thread where it was ended by an exception, before it begins again.

    Attributes:
        asked: stems of the captures of the sensors that are, or were, asked.
    """

    def __init__(self, small: SmallFiles, told: Callable[[SupervisedThread], None] = lambda _: None) -> None:
        self._small = small
        self.asked: tuple[str, ...] = ()
        self._new: queue.SimpleQueue[tuple[str, str]] = queue.SimpleQueue()
        self._due_s: dict[tuple[str, str], float] = {}
        self.thread = SupervisedThread("metadata", self._ask_all, told)
        self.thread.ensure()

    def ask(self, address: str, stem: str) -> None:
        """Let the sensor at an address be asked, whose captures have that stem; once."""
        if stem not in self.asked and len(self.asked) < MAX_ASKED and not IPv4Address(address).is_global:
            self.asked = (*self.asked, stem)
            self._new.put((address, stem))

    def stop(self) -> None:
        """Ask no longer."""
        self.thread.stop(2.0 * ANSWER_S)

    def _ask_all(self) -> None:
        while not self.thread.stopping.is_set():
            with suppress(queue.Empty):
                self._due_s[self._new.get(timeout=_NEW_SENSOR_S)] = 0.0
            for sensor, due_s in list(self._due_s.items()):
                if time.monotonic() < due_s or self.thread.stopping.is_set():
                    continue
                self._due_s[sensor] = time.monotonic() + ASK_AGAIN_S  # also where the answer ends this thread
                address, stem = sensor
                text = sensor_metadata(address)
                if text:
                    self._small.replace(f"{stem}.json", text, durable=True)
                    del self._due_s[sensor]


def sensor_metadata(address: str, port: int = HTTP_PORT, within_s: float = ANSWER_S) -> str:
    """The metadata of an Ouster sensor, by its HTTP API (firmware 2.1 and later); empty where it does not answer.

    Only the address itself is asked: no proxy is used, and no redirection followed. The answer has to be whole within
    `within_s`, and have `MAX_BYTES` at most.
    """
    try:
        with HTTPResponse(_Received(_answer(address, port, time.monotonic() + within_s))) as response:  # type: ignore[arg-type]  # it calls makefile only
            response.begin()
            text = response.read(MAX_BYTES).decode() if response.status == 200 else ""
        return text if text and Metadata.parse(text, address) else ""
    except (OSError, ValueError, HTTPException, RecursionError):
        return ""


class _Received:
    """What came over a connection, as :class:`HTTPResponse` reads it."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    def makefile(self, _mode: str) -> io.BytesIO:
        """The bytes as a file."""
        return io.BytesIO(self._data)


def _answer(address: str, port: int, until_s: float) -> bytes:
    """The bytes of the answer until it is whole, too long, or the time is over. Raises OSError."""

    def left_s() -> float:
        left = until_s - time.monotonic()
        if left <= 0.0:
            raise TimeoutError
        return left

    with socket.create_connection((address, port), left_s()) as connection:
        request = f"GET {_PATH} HTTP/1.1\r\nHost: {address}\r\nAccept: application/json\r\nConnection: close\r\n\r\n"
        connection.sendall(request.encode("ascii"))
        data = bytearray()
        while len(data) < 2 * MAX_BYTES:
            connection.settimeout(left_s())
            piece = connection.recv(1 << 16)
            data += piece
            head, blank, _ = bytes(data[:65536]).partition(b"\r\n\r\n")
            length = _CONTENT_LENGTH.search(head + b"\r\n")
            whole = blank and length is not None and len(data) >= len(head) + 4 + int(length[1])
            if not piece or whole:
                break
        return bytes(data)
