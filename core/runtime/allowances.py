"""What a user allows of foreign files: content far larger than the file, and damage; and the limits that then rest."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final, Literal

from furrowmap.core.runtime.errors import RefusedError, UsageError

Allowance = Literal["large", "damaged"]

VARIABLE: Final = "FURROWMAP_ALLOW"
ALL: Final[tuple[Allowance, ...]] = ("large", "damaged")
FREE_BYTES: Final = 256 << 20
"""Content up to this size is unpacked from a file of any size."""
MOST_GROWTH: Final = 200
"""More bytes of content for each byte of a file are no recording: those of scanners and receivers have up to 20, a
table of a machine that stands still 100."""

_allowed: list[frozenset[Allowance]] = []
"""Those in force, the innermost last."""


def allows(what: Allowance) -> bool:
    """Whether the user allows large content ("large") or the undamaged parts of damaged files ("damaged").

    By the innermost `allowing`; else by the environment variable FURROWMAP_ALLOW, words separated by commas.

    Raises:
        UsageError: if the environment variable has another word.
    """
    stated = {word.strip() for word in os.environ.get(VARIABLE, "").split(",")} - {""}
    if not stated <= set(ALL):
        raise UsageError("usage.allows", environ=os.environ[VARIABLE], all=" or ".join(ALL))
    return what in stated or any(what in allowed for allowed in _allowed)


@contextmanager
def allowing(*what: Allowance) -> Iterator[None]:
    """Within it, what is named is allowed: "large" content of small files, "damaged" files without their damaged parts.

    The setting is the process's: threads started within see it as well.
    """
    _allowed.append(frozenset(what))
    try:
        yield
    finally:
        _allowed.pop()


def expect_growth(what: str | Path, packed_bytes: int, unpacked_bytes: int) -> None:
    """Refuse content that is implausibly large for its file.

    Args:
        what: the file, or the part of one.
        packed_bytes: its size.
        unpacked_bytes: size of its content as far as known.

    Raises:
        RefusedError: if it is, and the user does not allow it.
    """
    if unpacked_bytes > FREE_BYTES + MOST_GROWTH * packed_bytes and not allows("large"):
        raise RefusedError(
            "too-large", what=what, packed=_size(packed_bytes), unpacked=_size(unpacked_bytes), growth=MOST_GROWTH
        )


def expect_memory(what: str | Path, needed_bytes: int) -> None:
    """Refuse content that takes more than half of the free memory.

    Raises:
        RefusedError: if it does, and the user does not allow it.
    """
    if needed_bytes > FREE_BYTES:
        free = free_memory_bytes()
        if needed_bytes > free // 2 and not allows("large"):
            raise RefusedError("too-large.memory", what=what, needed=_size(needed_bytes), free=_size(free))


def expect_disk(what: str | Path, folder: Path, needed_bytes: int) -> None:
    """Refuse content that takes more than half of the free space of a disk.

    Raises:
        RefusedError: if it does, and the user does not allow it.
    """
    if needed_bytes > FREE_BYTES:
        free = shutil.disk_usage(folder).free
        if needed_bytes > free // 2 and not allows("large"):
            raise RefusedError("too-large.disk", what=what, needed=_size(needed_bytes), folder=folder, free=_size(free))


def free_memory_bytes() -> int:
    """Memory that this process may still take: what the system has free, or a lower limit of the process."""
    free = 4 << 30
    if sys.platform == "win32":
        return free
    with suppress(ValueError, OSError, AttributeError):
        free = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    with suppress(OSError, StopIteration):
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        free = int(next(line for line in lines if line.startswith("MemAvailable:")).split()[1]) << 10
    with suppress(ImportError, OSError):
        import resource

        most = resource.getrlimit(resource.RLIMIT_AS)[0]
        if most != resource.RLIM_INFINITY:
            held = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
            free = min(free, max(0, most - held))
    return free


def _size(size: int) -> str:
    """Such as 1.23 GB."""
    power = min(4, max(0, len(str(abs(size))) - 1) // 3)
    return f"{size / 1000**power:.3g} {('bytes', 'kB', 'MB', 'GB', 'TB')[power]}"
