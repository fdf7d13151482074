"""Work that ends or shows its process, for tests of engines; it imports little, because each process imports it."""

from __future__ import annotations

import os
import signal
from pathlib import Path


def end_worker(item: tuple[str, int]) -> int:
    """End the process in the first so many calls, as a kill or the crash of a library does; then give the process."""
    folder, kills = item
    before = len(list(Path(folder).iterdir()))
    if before < kills:
        (Path(folder) / str(before)).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return os.getpid()


def variable(name: str) -> str | None:
    """A variable of the worker's environment."""
    return os.environ.get(name)
