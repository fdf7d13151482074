"""Where a GNSS receiver is, and what comes from there: serial devices, TCP servers and UDP ports."""

import os
import re
import select
import socket
import stat
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from ipaddress import AddressValueError, IPv4Address, IPv6Address
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias

from furrowmap.core.runtime.errors import UsageError


class GnssBytes(NamedTuple):
    """Bytes that arrived, the address that sent them (of UDP only), and whether it is another one than that stated."""

    data: bytes = b""
    sender: str = ""
    is_foreign: bool = False


Read: TypeAlias = Callable[[], GnssBytes]
"""Returns what arrived, or nothing after `WAIT_S`. Raises OSError where the connection has ended."""

WAIT_S: Final = 0.25
CONNECT_S: Final = 5.0
CONNECTION_SILENT_S: Final = 10.0
"""Without bytes a TCP connection is opened anew: a server that lost its power says no farewell."""
USUAL_BAUD: Final = 115_200
_NETWORK: Final = re.compile(r"(tcp|udp)://(\[[^\]]*\]|[^:/\s\[\]]*):([0-9]{1,5})/?")
_SERIAL_SOURCE: Final = re.compile(r"([^:\0-\x1f]+?)(?::([0-9]{1,7}))?")
_LABEL: Final = re.compile(r"(?!-)[a-z0-9_-]{1,63}(?<!-)", re.IGNORECASE)
_IPV6: Final = re.compile(r"([0-9a-f:.]+)(%[a-z0-9_.-]{1,32})?", re.IGNORECASE)
_MAX_NAME: Final = 253
_PIECE: Final = 1 << 16


@dataclass(frozen=True)
class GnssSource:
    """Where a receiver is: "serial" by device and baud, "tcp" or "udp" by host ("" for any sender of UDP) and port."""

    kind: str
    name: str
    number: int

    @classmethod
    def parse(cls, text: str) -> "GnssSource":
        """The place in a text: DEVICE, DEVICE:BAUD, tcp://HOST:PORT, udp://:PORT or udp://HOST:PORT.

        Raises UsageError for what can never be opened: no host, port or speed, or a device that is something else.
        """
        network = _NETWORK.fullmatch(text)
        if network is not None:
            host = _host(network[2])
            port = int(network[3])
            if 0 < port < 1 << 16 and host is not None and (host or network[1] == "udp"):
                return cls(network[1], host, port)
        serial = _SERIAL_SOURCE.fullmatch(text)
        if serial and "//" not in text and sys.platform != "win32":
            import termios

            baud = int(serial[2] or USUAL_BAUD)
            if baud and hasattr(termios, f"B{baud}") and _may_be_device(serial[1]):
                return cls("serial", serial[1], baud)
        raise UsageError("usage.gnss-source", text=text)

    @contextmanager
    def open(self) -> Iterator[Read]:
        """Open it. Raises OSError."""
        if self.kind == "serial":
            with _serial(self.name, self.number) as read:
                yield read
        elif self.kind == "tcp":
            with closing(socket.create_connection((self.name, self.number), CONNECT_S)) as connection:
                yield _stream(connection)
        else:
            with closing(_listening(self.name, self.number)) as port:
                yield _datagrams(port, _addresses(self.name, self.number))


def _host(text: str) -> str | None:
    """A name of the domain name system or an address, as the resolver takes it; empty for none; None if it is none."""
    if text.startswith("["):
        address = _IPV6.fullmatch(text[1:-1])
        with suppress(AddressValueError):
            return text[1:-1] if address and IPv6Address(address[1]) else None
        return None
    if text in ("", "0.0.0.0"):  # noqa: S104 (of UDP: any sender)
        return ""
    try:
        name = text.encode("idna").decode("ascii") if not text.isascii() else text
    except UnicodeError:
        return None
    labels = name.removesuffix(".").split(".")
    if len(name) > _MAX_NAME or not all(_LABEL.fullmatch(label) for label in labels):
        return None
    if labels[-1].isdigit():  # of an address, or of nothing
        try:
            IPv4Address(name)
        except AddressValueError:
            return None
    return name


def _may_be_device(name: str) -> bool:
    """Whether a device has that name, or nothing has: it may be plugged in later."""
    try:
        return stat.S_ISCHR(Path(name).stat().st_mode)
    except FileNotFoundError:
        return True
    except (OSError, ValueError):
        return False


def _stream(connection: socket.socket) -> Read:
    """What a server sends."""
    connection.settimeout(WAIT_S)
    heard_s = time.monotonic()

    def read() -> GnssBytes:
        nonlocal heard_s
        try:
            data = connection.recv(_PIECE)
        except TimeoutError:
            if time.monotonic() - heard_s > CONNECTION_SILENT_S:
                raise
            return GnssBytes()
        if not data:
            raise ConnectionResetError(None, "the connection was closed")
        heard_s = time.monotonic()
        return GnssBytes(data)

    return read


def _addresses(host: str, port: int) -> frozenset[str]:
    """The addresses of a host; empty for any. Raises OSError if its name is unknown."""
    if not host:
        return frozenset()
    return frozenset(str(found[4][0]) for found in socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM))


def _listening(host: str, port: int) -> socket.socket:
    """A UDP port at all addresses of this machine, of the family of a sender. Raises OSError."""
    opened = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM)
    try:
        opened.bind(("", port))
    except OSError:
        opened.close()
        raise
    return opened


def _datagrams(port: socket.socket, of: frozenset[str]) -> Read:
    """What the stated senders send, or any sender if none is."""
    port.settimeout(WAIT_S)

    def read() -> GnssBytes:
        with suppress(TimeoutError):
            data, source = port.recvfrom(_PIECE)
            return GnssBytes(data, str(source[0]), bool(of) and source[0] not in of)
        return GnssBytes()

    return read


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
            if not stat.S_ISCHR(os.fstat(descriptor).st_mode):
                raise OSError(None, "it is no serial device")
            try:
                tty.setraw(descriptor)
                attributes = termios.tcgetattr(descriptor)
                attributes[2] |= termios.CLOCAL | termios.CREAD
                attributes[4] = attributes[5] = getattr(termios, f"B{baud}")
                termios.tcsetattr(descriptor, termios.TCSANOW, attributes)
            except termios.error as error:
                raise OSError(*error.args) from None

            def read() -> GnssBytes:
                if not select.select([descriptor], [], [], WAIT_S)[0]:
                    return GnssBytes()
                data = os.read(descriptor, _PIECE)
                if not data:
                    raise ConnectionResetError(None, "the device was removed")
                return GnssBytes(data)

            yield read
        finally:
            os.close(descriptor)
