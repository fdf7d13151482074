"""Handling of SIGINT (Ctrl-C), SIGTERM, and SIGBREAK of Windows."""

import _thread
import signal
import sys
import threading
import time
from pathlib import Path
from types import FrameType
from typing import Final

AGAIN_S: Final = 0.01
_BLOCKING: Final = {"wait", "join", "_wait_for_tstate_lock"}
"""Functions of `threading` in which a thread waits; they leave their locks in order when an exception ends them."""
_TAKING: Final = {"__enter__", "__exit__", "acquire", "release"}
"""Methods of locks, by whatever module: llvmlite and numba have their own."""
_IMPORTING: Final = "<frozen importlib"
"""Code that takes the lock of a module, or that of all imports, and runs the code of the module elsewhere."""
_CALLERS: Final = 4
_LOCKS: Final = (str(Path("llvmlite", "binding", "ffi.py")), str(Path("numba", "core", "compiler_lock.py")))
"""Modules whose locks call other functions while they are taken, up to _CALLERS levels deep."""


class Interruption:
    """Signal handler that raises KeyboardInterrupt, so that callers can clean up.

    Where the main thread is just taking or giving back a lock, it raises a moment later. The lock
    would stay taken for ever (Python's documentation of `signal`: "Note on Signal Handlers and Exceptions"), and
    threads that need it would keep the process from ending.

    Attributes:
        asked: whether a signal came. Compiled code and libraries convert the exception, or lose it in a callback.
    """

    def __init__(self) -> None:
        self.asked = False
        self._raised = False
        self._put_off = 0

    def __call__(self, number: int = signal.SIGINT, frame: FrameType | None = None) -> None:
        """Handle the signal."""
        self.asked = True
        again = self._put_off > 0
        self._put_off -= again
        if again and self._raised:  # by check() in the meantime: what cleans up is left in peace
            return
        if frame is not None and _is_at_a_lock(frame):
            self._put_off += 1
            _thread.start_new_thread(_repeat, (number,))
            return
        self._raised = True
        raise KeyboardInterrupt

    def check(self) -> None:
        """Raise the exception again if it was lost."""
        if self.asked:
            self._raised = True
            raise KeyboardInterrupt


def drop_interrupt(lost: "sys.UnraisableHookArgs") -> None:
    """Hook for exceptions lost in callbacks: `Interruption.check` raises KeyboardInterrupt again, others are shown."""
    if not issubclass(lost.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(lost)


def _is_at_a_lock(frame: FrameType) -> bool:
    code = frame.f_code
    if code.co_filename == threading.__file__:
        return code.co_name not in _BLOCKING
    if code.co_filename.startswith(_IMPORTING):
        return True
    return code.co_name in _TAKING or _is_called_by_a_lock(frame)


def _is_called_by_a_lock(frame: FrameType) -> bool:
    caller = frame.f_back
    for _ in range(_CALLERS):
        if caller is None:
            return False
        code = caller.f_code
        if code.co_name in _TAKING and code.co_filename.endswith(_LOCKS):
            return True
        caller = caller.f_back
    return False


def _repeat(number: int) -> None:
    time.sleep(AGAIN_S)
    _thread.interrupt_main(signal.Signals(number))


INTERRUPTION: Final = Interruption()
"""The handler of this process."""
