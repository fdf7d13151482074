"""One process at a time changes a farm map in a file."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from furrowmap.core.runtime.errors import RefusedError
from furrowmap.core.runtime.progress import Progress

_PATIENCE_S: Final = 60.0
_STEP_S: Final = 0.05


@contextmanager
def exclusive(path: Path, progress: Progress, patience_s: float = _PATIENCE_S) -> Iterator[None]:
    """Keep other processes of furrowmap from changing the file at `path`.

    The lock is a system lock on a hidden file beside it, so it ends with the process, however that ends.

    Args:
        path: of the file, which need not exist.
        progress: receives the stage "waiting for another process".

    Raises:
        RefusedError: if another process holds the lock for longer.
        OSError: if the folder cannot be written to.
    """
    lock = path.with_name(f".{path.name}.lock")
    deadline = time.monotonic() + patience_s
    while (descriptor := _try(lock)) is None:
        if time.monotonic() > deadline:
            raise RefusedError("base-busy.exclusive", path=path, patience_s=patience_s)
        progress("waiting for another process", 0.0)
        time.sleep(_STEP_S)
    try:
        yield
    finally:
        with suppress(OSError):  # Windows does not remove an open file; an empty one remains
            lock.unlink()
        os.close(descriptor)


def _try(lock: Path) -> int | None:
    """The descriptor of the file at `lock`, locked; None while another process has it."""
    descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
    with suppress(OSError):
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.samestat(os.fstat(descriptor), lock.stat()):
            return descriptor
    os.close(descriptor)  # another process's, or of a name that the process before has just removed
    return None
