"""The process that writes a file or folder, as other processes, containers and hosts can recognise it."""

from __future__ import annotations

import hashlib
import os
import platform
import re
import sys
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final, Self

_OWNER: Final = re.compile(r"(?P<machine>[0-9a-f]{8})-(?P<process>\d{1,10})-(?P<started>\d{1,20})")
PATTERN: Final = re.sub(r"\?P<\w+>", "", _OWNER.pattern)
"""Of :meth:`Owner.words`."""


@dataclass(frozen=True)
class Owner:
    """A process.

    Attributes:
        machine: 8 hexadecimal digits for the host, its start and its space of process numbers: a container has its own.
        started: when the process started, in ticks of the kernel; 0 where the system does not report it.
    """

    machine: str
    process: int
    started: int

    @classmethod
    def here(cls) -> Self:
        """This process."""
        return cls(machine(), os.getpid(), _started(os.getpid()))

    @classmethod
    def parse(cls, words: str) -> Self | None:
        """The owner that :meth:`words` describes; None for other text."""
        match = _OWNER.fullmatch(words)
        return None if match is None else cls(match["machine"], int(match["process"]), int(match["started"]))

    def words(self) -> str:
        """The owner as part of a file name."""
        return f"{self.machine}-{self.process}-{self.started}"

    def is_running(self) -> bool | None:
        """Whether the process runs; None where this cannot be seen from here.

        A process of another machine cannot be seen, nor can any on Windows, where signal 0 would end it. Where the
        system does not report when a process started, its number may be that of a later one.
        """
        if self.machine != machine() or sys.platform == "win32":
            return None
        try:
            os.kill(self.process, 0)
        except (ProcessLookupError, OverflowError):
            return False
        except OSError:  # of another user
            pass
        if not self.started:
            return None
        return self.started == _started(self.process)


@cache
def machine() -> str:
    """8 hexadecimal digits for this host, its start and this space of process numbers."""
    known = [platform.node()]
    if sys.platform == "linux":
        with suppress(OSError):
            boot, numbers = Path("/proc/sys/kernel/random/boot_id"), Path("/proc/self/ns/pid")
            known += [boot.read_text("ascii"), str(numbers.readlink())]
    return hashlib.sha256("\n".join(known).encode()).hexdigest()[:8]


def _started(process: int) -> int:
    """Start of a process in ticks since the system's own; 0 where it is not reported."""
    try:
        if str(Path("/proc/self").readlink()) != str(os.getpid()):  # a container that sees the processes of its host
            return 0
        status = Path(f"/proc/{process}/stat").read_bytes()
        return int(status.rpartition(b")")[2].split()[19])
    except (OSError, ValueError, IndexError):
        return 0
