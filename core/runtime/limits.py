"""Limits of content that is unpacked from foreign files; a user may allow more."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Final

from furrowmap.core.runtime.errors import RefusedError
from furrowmap.core.runtime.memory import free_memory_bytes
from furrowmap.core.runtime.settings import allows

FREE_BYTES: Final = 256 << 20
"""Content up to this size is unpacked from a file of any size."""
MAX_GROWTH: Final = 200
"""More bytes of content for each byte of a file are no recording: those of scanners and receivers have up to 20, a
table of a machine that stands still 100."""


def expect_growth(what: str | Path, packed_bytes: int, unpacked_bytes: int) -> None:
    """Raises RefusedError for content that is implausibly large for its file, unless the user allows it."""
    if unpacked_bytes > FREE_BYTES + MAX_GROWTH * packed_bytes and not allows("large"):
        raise RefusedError(
            "too-large", what=what, packed=_size(packed_bytes), unpacked=_size(unpacked_bytes), growth=MAX_GROWTH
        )


def expect_memory(what: str | Path, needed_bytes: int) -> None:
    """Raises RefusedError for content that takes more than half of the free memory, unless the user allows it."""
    if needed_bytes > FREE_BYTES:
        free = free_memory_bytes()
        if needed_bytes > free // 2 and not allows("large"):
            raise RefusedError("too-large.memory", what=what, needed=_size(needed_bytes), free=_size(free))


def expect_disk(what: str | Path, folder: Path, needed_bytes: int) -> None:
    """Raises RefusedError for content that takes more than half of a disk's free space, unless the user allows it."""
    if needed_bytes > FREE_BYTES:
        free = shutil.disk_usage(folder).free
        if needed_bytes > free // 2 and not allows("large"):
            raise RefusedError("too-large.disk", what=what, needed=_size(needed_bytes), folder=folder, free=_size(free))


def _size(size: int) -> str:
    """Such as 1.23 GB."""
    power = min(4, max(0, len(str(abs(size))) - 1) // 3)
    return f"{size / 1000**power:.3g} {('bytes', 'kB', 'MB', 'GB', 'TB')[power]}"
