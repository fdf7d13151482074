"""Threads that are started again, whatever ended them."""

import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

FIRST_PAUSE_S: Final = 0.05
MAX_PAUSE_S: Final = 2.0
"""Before a thread is started again: twice as long each time, so that one that ends at once takes no processor."""
AT_WORK_S: Final = 10.0
"""After so long at work the pauses begin anew."""
_SLICE_S: Final = 0.05
_MAX_CAUSE: Final = 200


class StopFlag:
    """Set once, from any thread.

    It has no lock: that of `threading.Event` is taken in Python code, and stays taken for ever if an exception comes to
    the thread just there.
    """

    def __init__(self) -> None:
        self._set = False

    def set(self) -> None:
        """Ask for the end."""
        self._set = True

    def is_set(self) -> bool:
        """Whether the end was asked for."""
        return self._set

    def wait(self, seconds: float) -> bool:
        """Wait for so long, or until the end is asked for; whether it was."""
        ends_s = time.monotonic() + seconds
        while not self._set and (left_s := ends_s - time.monotonic()) > 0.0:
            time.sleep(min(left_s, _SLICE_S))
        return self._set


class SupervisedThread:
    """Does `work` in a thread until it returns. Where it raises anything, it is begun again after a pause.

    An exception may end the thread itself as well, where it comes to it between two attempts: `ensure`, which others
    call about once a second, then starts another.

    Args:
        name: of the part that it does, as the user is told.
        work: what the thread does; it keeps its state outside, so that it can begin again.
        told: is called by the thread with itself, each time that the work was ended by an exception.

    Attributes:
        ends: how many times the work was ended by an exception.
        cause: of the last end: the exception, and the line that raised it; empty before any.
        ended_s: when that was, by the monotonic clock.
        stopping: set by `stop`; the work looks at it.
    """

    def __init__(self, name: str, work: Callable[[], None], told: Callable[["SupervisedThread"], None]) -> None:
        self.name = name
        self.ends = 0
        self.cause = ""
        self.ended_s = 0.0
        self.stopping = StopFlag()
        self._work = work
        self._told = told
        self._is_done = False
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None

    @property
    def is_working(self) -> bool:
        """Whether the thread lives."""
        return self._thread is not None and self._thread.is_alive()

    @property
    def ident(self) -> int | None:
        """The identifier of the thread that works at the moment."""
        return self._thread.ident if self._thread is not None else None

    def ensure(self) -> None:
        """Start the thread, unless it works, has finished its work, or is to stop."""
        with self._lock:
            if self._is_done or self.stopping.is_set() or self.is_working:
                return
            thread = threading.Thread(target=self._live, name=self.name, daemon=True)
            try:
                thread.start()
            except RuntimeError as error:  # the system has no more threads
                self._note(error)
                return
            self._thread = thread

    def stop(self, timeout_s: float | None = None) -> None:
        """Ask the work to end, and wait for it, at most for so long."""
        self.stopping.set()
        if self._thread is not None:
            self._thread.join(timeout_s)

    def finish(self) -> None:
        """Wait until the work has returned, which was asked to end in another way; it is begun again until it does."""
        while not self._is_done and not self.stopping.is_set():
            self.ensure()
            if self._thread is not None:
                self._thread.join(_SLICE_S)

    def _live(self) -> None:
        try:
            self._attempt()
        except BaseException as error:  # noqa: BLE001 (whatever came between two attempts: the next thread goes on)
            with suppress(BaseException):
                self._note(error)

    def _attempt(self) -> None:
        pause_s = FIRST_PAUSE_S
        while not self._is_done:
            begun_s = time.monotonic()
            try:
                self._work()
                self._is_done = True
            except BaseException as error:  # noqa: BLE001 (nothing may end it for good)
                self._note(error)
                if time.monotonic() - begun_s > AT_WORK_S:
                    pause_s = FIRST_PAUSE_S
                if self.stopping.wait(pause_s):
                    return
                pause_s = min(2.0 * pause_s, MAX_PAUSE_S)

    def _note(self, error: BaseException) -> None:
        self.ended_s = time.monotonic()
        self.cause = cause_of(error)
        self.ends += 1
        self._told(self)


def cause_of(error: BaseException) -> str:
    """An exception in a line: its kind, its words, and where it was raised."""
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
    words = " ".join(str(error).split())[:_MAX_CAUSE]
    return f"{type(error).__name__}{': ' * bool(words)}{words}{place}"
