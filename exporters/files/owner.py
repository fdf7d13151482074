"""The process that writes a file or folder, as other processes, containers and hosts can recognise it."""

import ctypes
import hashlib
import os
import platform
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
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

    `machine` is 8 hexadecimal digits for the host, its start and its space of process numbers, which a container has of
    its own; `started` is in ticks of the system, 0 where it does not report it, as on macOS.
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

        A process of another machine cannot be seen. Where the system does not report when a process started, its number
        may be that of a later one.
        """
        if self.machine != machine():
            return None
        if not _exists(self.process):
            return False
        if not self.started:
            return None
        return self.started == _started(self.process)


@cache
def machine() -> str:
    """8 hexadecimal digits for this host, its start and this space of process numbers."""
    known = [platform.node()]
    if sys.platform == "linux":
        with suppress(OSError):
            boot = Path("/proc/sys/kernel/random/boot_id")
            numbers = Path("/proc/self/ns/pid")
            known += [boot.read_text("ascii"), str(numbers.readlink())]
    return hashlib.sha256("\n".join(known).encode()).hexdigest()[:8]


if sys.platform == "win32":
    _KERNEL: Final = ctypes.WinDLL("kernel32", use_last_error=True)
    _KERNEL.OpenProcess.restype = ctypes.c_void_p
    _KERNEL.OpenProcess.argtypes = (ctypes.c_uint32, ctypes.c_int, ctypes.c_uint32)
    _KERNEL.WaitForSingleObject.argtypes = (ctypes.c_void_p, ctypes.c_uint32)
    _KERNEL.GetProcessTimes.argtypes = (ctypes.c_void_p,) * 5
    _KERNEL.CloseHandle.argtypes = (ctypes.c_void_p,)
    _QUERY_LIMITED_INFORMATION: Final = 0x1000
    _SYNCHRONIZE: Final = 0x100000
    _WAIT_OBJECT_0: Final = 0
    _ERROR_ACCESS_DENIED: Final = 5

    @contextmanager
    def _opened(process: int) -> Iterator[int | None]:
        """A handle of a process; None where there is no such process, or it is of another user."""
        handle = _KERNEL.OpenProcess(_QUERY_LIMITED_INFORMATION | _SYNCHRONIZE, 0, process)
        try:
            yield handle
        finally:
            if handle:
                _KERNEL.CloseHandle(handle)

    def _exists(process: int) -> bool:
        """Whether a process has not ended: signal 0 would end it on Windows."""
        if process >= 1 << 32:
            return False
        with _opened(process) as handle:
            if not handle:
                return ctypes.get_last_error() == _ERROR_ACCESS_DENIED
            return bool(_KERNEL.WaitForSingleObject(handle, 0) != _WAIT_OBJECT_0)

    def _started(process: int) -> int:
        """Start of a process in milliseconds since 1601; 0 where it is not reported."""
        times = (ctypes.c_uint64 * 4)()
        with _opened(process) as handle:
            if handle:
                places = (ctypes.byref(times, 8 * k) for k in range(4))
                _KERNEL.GetProcessTimes(handle, *places)
        return int(times[0]) // 10_000

else:

    def _exists(process: int) -> bool:
        """Whether there is a process of this number."""
        try:
            os.kill(process, 0)
        except (ProcessLookupError, OverflowError):
            return False
        except OSError:  # of another user
            pass
        return True

    def _started(process: int) -> int:
        """Start of a process in ticks since the system's own; 0 where it is not reported."""
        try:
            if str(Path("/proc/self").readlink()) != str(os.getpid()):  # a container that sees its host's processes
                return 0
            status = Path(f"/proc/{process}/stat").read_bytes()
            return int(status.rpartition(b")")[2].split()[19])
        except (OSError, ValueError, IndexError):
            return 0
