"""Free memory of the computer and peak memory of this process, on Linux, macOS and Windows.

Content that is unpacked from foreign files is limited; a user may allow more.
"""

import ctypes
import os
import re
import shutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Final

from furrowmap.core.runtime.errors import RefusedError
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.settings import allows

FREE_BYTES: Final = 256 << 20
"""Content up to this size is unpacked from a file of any size."""
MAX_GROWTH: Final = 200
"""More bytes of content for each byte of a file are no recording: those of scanners and receivers have up to 20, a
table of a machine that stands still 100."""


def expect_growth(what: str | Path | Text, packed_bytes: int, unpacked_bytes: int) -> None:
    """Raises RefusedError for content that is implausibly large for its file, unless the user allows it."""
    if unpacked_bytes > FREE_BYTES + MAX_GROWTH * packed_bytes and not allows("large"):
        raise RefusedError(
            "too-large",
            what=what,
            packed=size_text(packed_bytes),
            unpacked=size_text(unpacked_bytes),
            growth=MAX_GROWTH,
        )


_WORKED_TIMES: Final = 4
"""Times the memory of a log's rows that its reader takes at most: joined, sorted and selected ones beside them."""


def expect_rows(what: str | Path | Text, packed_bytes: int, row_bytes: int) -> None:
    """Raises RefusedError for a log whose rows take implausibly much memory for its file.

    Args:
        packed_bytes: size of the file.
        row_bytes: memory of the rows that have been read from it.
    """
    worked_bytes = _WORKED_TIMES * row_bytes
    if worked_bytes > FREE_BYTES + MAX_GROWTH * packed_bytes and not allows("large"):
        needed = size_text(worked_bytes)
        raise RefusedError(
            "too-large.row-count", what=what, packed=size_text(packed_bytes), needed=needed, growth=MAX_GROWTH
        )


def expect_memory(what: str | Path | Text, needed_bytes: int) -> None:
    """Raises RefusedError for content that takes more than half of the free memory, unless the user allows it."""
    if needed_bytes > FREE_BYTES:
        free = free_memory_bytes()
        if needed_bytes > free // 2 and not allows("large"):
            raise RefusedError("too-large.memory", what=what, needed=size_text(needed_bytes), free=size_text(free))


def expect_disk(what: str | Path | Text, folder: Path, needed_bytes: int) -> None:
    """Raises RefusedError for content that takes more than half of a disk's free space, unless the user allows it."""
    if needed_bytes > FREE_BYTES:
        free = shutil.disk_usage(folder).free
        if needed_bytes > free // 2 and not allows("large"):
            raise RefusedError(
                "too-large.free-disk", what=what, needed=size_text(needed_bytes), folder=folder, free=size_text(free)
            )


def size_text(size: int) -> str:
    """Such as 1.23 GB."""
    power = min(4, max(0, len(str(abs(size))) - 1) // 3)
    return f"{size / 1000**power:.3g} {('bytes', 'kB', 'MB', 'GB', 'TB')[power]}"


_UNKNOWN_BYTES: Final = 4 << 30
"""Assumed to be free where the system does not report it."""


def free_memory_bytes() -> int:
    """Memory that this process may still take: what the system has free, or a lower limit of the process.

    4 GiB where the system does not report it.
    """
    free = _UNKNOWN_BYTES
    if sys.platform == "win32":
        with suppress(OSError, AttributeError):
            free = _windows_free()
    else:
        with suppress(ValueError, OSError, AttributeError):
            free = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        with suppress(OSError, StopIteration):
            lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
            free = int(next(line for line in lines if line.startswith("MemAvailable:")).split()[1]) << 10
        if sys.platform == "darwin":
            with suppress(OSError, ValueError, subprocess.SubprocessError):
                free = available_of_vm_stat(subprocess.run("/usr/bin/vm_stat", capture_output=True, check=True).stdout)
        with suppress(ImportError, OSError):
            import resource

            most = resource.getrlimit(resource.RLIMIT_AS)[0]
            if most != resource.RLIM_INFINITY:
                held = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
                free = min(free, max(0, most - held))
    return free


def peak_memory_bytes() -> float:
    """Peak memory of this process; nan where the system does not report it."""
    if sys.platform == "win32":
        with suppress(OSError, AttributeError):
            return float(_windows_peak())
    else:
        with suppress(ImportError, OSError):
            import resource

            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            return float(peak if sys.platform == "darwin" else peak << 10)
    return float("nan")


def available_of_vm_stat(text: bytes) -> int:
    """Bytes that programs may take without swapping, from what macOS's `vm_stat` prints.

    These are the free pages, those that were read ahead, and those not used lately. Raises ValueError for other text.
    """
    page = re.search(rb"page size of (\d+) bytes", text)
    pages = re.findall(rb"^Pages (?:free|inactive|speculative):\s+(\d+)\.", text, re.MULTILINE)
    if page is None or not pages:
        raise ValueError("not the output of vm_stat")
    return int(page[1]) * sum(map(int, pages))


class MemoryStatus(ctypes.Structure):
    """MEMORYSTATUSEX of the Windows API."""

    _fields_ = (
        *((name, ctypes.c_uint32) for name in ("length", "load_percent")),
        *((name, ctypes.c_uint64) for name in ("physical", "physical_free", "commit", "commit_free")),
        *((name, ctypes.c_uint64) for name in ("address_space", "address_space_free", "extended_free")),
    )


class MemoryCounters(ctypes.Structure):
    """PROCESS_MEMORY_COUNTERS of the Windows API."""

    _fields_ = (
        *((name, ctypes.c_uint32) for name in ("length", "faults")),
        *((name, ctypes.c_size_t) for name in ("peak_working_set", "working_set", "peak_paged", "paged")),
        *((name, ctypes.c_size_t) for name in ("peak_nonpaged", "nonpaged", "page_file", "peak_page_file")),
    )


if sys.platform == "win32":

    def _windows_free() -> int:
        status = MemoryStatus(length=ctypes.sizeof(MemoryStatus))
        if not ctypes.WinDLL("kernel32", use_last_error=True).GlobalMemoryStatusEx(ctypes.byref(status)):
            raise ctypes.WinError(ctypes.get_last_error())
        return min(int(status.physical_free), int(status.commit_free))

    def _windows_peak() -> int:
        kernel = ctypes.WinDLL("kernel32", use_last_error=True)
        kernel.GetCurrentProcess.restype = ctypes.c_void_p
        kernel.K32GetProcessMemoryInfo.argtypes = (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint32)
        counters = MemoryCounters()
        size = ctypes.sizeof(MemoryCounters)
        if not kernel.K32GetProcessMemoryInfo(kernel.GetCurrentProcess(), ctypes.byref(counters), size):
            raise ctypes.WinError(ctypes.get_last_error())
        return int(counters.peak_working_set)
