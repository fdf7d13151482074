"""Where compiled kernels are kept between runs, and how a user hears of their being made."""

from __future__ import annotations

import ctypes
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

VARIABLE: Final = "NUMBA_CACHE_DIR"
_M_TRIM_THRESHOLD: Final = -1
_M_MMAP_THRESHOLD: Final = -3
_M_ARENA_MAX: Final = -8
"""Parameters of mallopt(3)."""
COMPILING: Final = "Compiling kernels for this machine, once (one to two minutes)."


def keep_kernels() -> None:
    """Give numba a folder of this user and version for its compiled kernels; to be called before numba is imported.

    A folder already set is respected. Where the user may write nowhere, a temporary folder serves this one run, because
    numba refuses to load kernels that it cannot keep.
    """
    if VARIABLE in os.environ:
        return
    folder = _caches() / "furrowmap" / f"kernels-{version('furrowmap')}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError:
        folder = Path(tempfile.mkdtemp(prefix="furrowmap-kernels-"))
    os.environ[VARIABLE] = str(folder)


def keep_blas_single() -> None:
    """Let the linear algebra of numpy and scipy work in one thread each; to be called before they are imported.

    Our own threads share the cores already, and those of BLAS only wait: matching 64 million points took 30 s of
    processor time with them and 18 s without. A number that the user has set is respected.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def keep_freed_memory() -> None:
    """Let the C library keep the memory of freed arrays of up to 32 MB for the next ones, where it is glibc.

    Else every scan's arrays are new pages, which the system fills with zeros first: a fifth of the time that it spends
    on a run. Two heaps do for all threads: with one for each, 77 million points took 180 MB more. What the user has set
    in glibc's own variables is respected.
    """
    if not sys.platform.startswith("linux") or any(name.startswith("MALLOC_") for name in os.environ):
        return
    with suppress(OSError, AttributeError):
        mallopt = ctypes.CDLL("libc.so.6").mallopt
        mallopt(_M_MMAP_THRESHOLD, 32 << 20)
        mallopt(_M_TRIM_THRESHOLD, 256 << 20)
        mallopt(_M_ARENA_MAX, 2)


@contextmanager
def compilation_told(say: Callable[[str], None]) -> Iterator[None]:
    """Within it, `say` is told once if a kernel has to be compiled that was not found among those kept.

    Entering imports numba.
    """
    from numba.core import event

    class FirstCompilation(event.Listener):  # type: ignore[misc]  # numba has no types
        told = False

        def on_start(self, _event: Any) -> None:
            if not self.told:
                self.told = True
                say(COMPILING)

        def on_end(self, _event: Any) -> None:
            """Only a start is told."""

    listener = FirstCompilation()
    event.register("numba:compile", listener)
    try:
        yield
    finally:
        event.unregister("numba:compile", listener)


def _caches() -> Path:
    """The folder for what this user's programs can make again."""
    if stated := os.environ.get("XDG_CACHE_HOME"):
        return Path(stated)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    return Path.home() / ("Library/Caches" if sys.platform == "darwin" else ".cache")
