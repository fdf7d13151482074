"""Under which names a page may be asked for: another name that leads here is that of a foreign page (DNS rebinding)."""

import re
import socket
import struct
import sys
from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from ipaddress import ip_address
from socket import gethostname
from typing import Final, Self

_HOST: Final = re.compile(r"(?:\[(?P<ipv6>[0-9a-fA-F:.]{2,45})\]|(?P<name>[^\[\]:/@\s]{1,253}))(?::[0-9]{1,5})?")


@dataclass(frozen=True)
class OwnHosts:
    """The names of this computer, in small letters; with `only_loopback` its addresses in the network are none."""

    names: frozenset[str]
    only_loopback: bool

    @classmethod
    def of(cls, served_at: str, stated: Sequence[str]) -> Self:
        """The names for a server at an address of this computer, and those that the user states."""
        try:
            only_loopback = ip_address(served_at).is_loopback
        except ValueError:
            only_loopback = served_at == "localhost"
        names = {"localhost", *(name.lower().removesuffix(".") for name in stated)}
        if not only_loopback:
            own = gethostname().lower()
            names |= {own, own.partition(".")[0], f"{own.partition('.')[0]}.local"}
        return cls(frozenset(names), only_loopback)

    def include(self, header: str) -> bool:
        """Whether a Host header names this computer: by an address, or by one of its names."""
        found = _HOST.fullmatch(header)
        if found is None:
            return False
        text = found["ipv6"] or found["name"].lower().removesuffix(".")
        try:
            address = ip_address(text)
        except ValueError:
            return text in self.names
        return address.is_loopback or not self.only_loopback


OUTSIDE: Final = "192.0.2.1"
"""An address of documentation (RFC 5737), to which nothing is sent: which of its own would a computer send from?"""
INTERFACE_ADDRESS: Final = 0x8915
"""SIOCGIFADDR of Linux."""


def own_addresses() -> list[str]:
    """The IPv4 addresses of this computer in its networks; the one that it would reach others from comes first."""
    found = list[str]()
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as port:
        if sys.platform == "linux":
            import fcntl

            for _, name in socket.if_nameindex():
                with suppress(OSError):  # it has none
                    answer = fcntl.ioctl(port.fileno(), INTERFACE_ADDRESS, struct.pack("256s", name.encode()[:15]))
                    found.append(socket.inet_ntoa(answer[20:24]))
        with suppress(OSError):
            port.connect((OUTSIDE, 9))
            found.insert(0, str(port.getsockname()[0]))
    with suppress(OSError):
        found += [str(one[4][0]) for one in socket.getaddrinfo(gethostname(), None, socket.AF_INET)]
    return [address for address in dict.fromkeys(found) if not ip_address(address).is_loopback]
