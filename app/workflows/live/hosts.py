"""Under which names a page may be asked for: another name that leads here is that of a foreign page (DNS rebinding)."""

import re
from collections.abc import Sequence
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
