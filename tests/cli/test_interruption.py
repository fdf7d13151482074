"""A signal at any moment ends the work and leaves no lock taken."""

from __future__ import annotations

import ctypes
import functools
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from queue import Queue
from types import FrameType
from typing import Any

import pytest
from llvmlite.binding.ffi import _LLVMLock
from numba.core.compiler_lock import _CompilerLock
from numba.core.event import end_event, start_event

from furrowmap.cli.interruption import Interruption, drop_interrupt

pytestmark = pytest.mark.skipif(os.name == "nt", reason="timers of POSIX")


class FrameOfAcquire:
    """A lock that keeps the frame in which it is taken."""

    frame: FrameType

    def __enter__(self) -> None:
        self.frame = sys._getframe(1)

    def __exit__(self, *_: object) -> None:
        pass

    acquire, release = __enter__, __exit__


@pytest.fixture
def alarms() -> Iterator[None]:
    before = signal.getsignal(signal.SIGALRM)
    yield
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    signal.signal(signal.SIGALRM, before)


def interrupted_after(seconds: float) -> None:
    signal.signal(signal.SIGALRM, Interruption())
    signal.setitimer(signal.ITIMER_REAL, seconds)


def is_free(lock: Any) -> bool:
    """Whether nobody has taken a lock; a reentrant one could be taken again by the same thread."""
    inner = getattr(lock, "_lock", lock)
    return not inner._is_owned() if hasattr(inner, "_is_owned") else bool(inner.acquire(blocking=False))


def lock_of_llvm() -> _LLVMLock:
    """With functions to call, as numba registers them."""
    lock = _LLVMLock()
    lock.register(functools.partial(start_event, "numba:llvm_lock"), functools.partial(end_event, "numba:llvm_lock"))
    return lock


@pytest.mark.usefixtures("alarms")
@pytest.mark.parametrize("make", [lambda: threading.Condition(threading.Lock()), lock_of_llvm, _CompilerLock])
def test_signal__leaves_no_lock_taken(make: Callable[[], Any]) -> None:
    """A handler that raises at once leaves every second one taken."""
    taken = 0
    for k in range(20):
        lock = make()
        with pytest.raises(KeyboardInterrupt):
            interrupted_after(5e-5 + 1e-5 * k)
            while True:
                with lock:
                    for _ in range(200):
                        pass
        taken += not is_free(lock)
    assert taken == 0


def test_signal__is_put_off_in_the_midst_of_an_import() -> None:
    """Another thread that imports would wait for ever where the lock of all imports is taken."""
    handler, names = Interruption(), dict[str, Any]()
    exec(compile("import sys\nframe = sys._getframe()", "<frozen importlib._bootstrap>", "exec"), names)
    handler(signal.SIGUSR1, names["frame"])
    assert handler.asked
    with pytest.raises(KeyboardInterrupt):
        handler(signal.SIGUSR1, sys._getframe())


@pytest.mark.usefixtures("alarms")
def test_signal__ends_what_waits_in_a_lock() -> None:
    begun_s = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        interrupted_after(0.02)
        Queue[None]().get(timeout=20.0)
    assert time.monotonic() - begun_s < 10.0


def test_signal__put_off_does_not_disturb_what_cleans_up() -> None:
    handler = Interruption()
    lock = FrameOfAcquire()
    with threading.Condition(lock):
        pass
    handler(signal.SIGUSR1, lock.frame)
    assert handler.asked
    with pytest.raises(KeyboardInterrupt):
        handler.check()
    handler(signal.SIGUSR1, None)
    with pytest.raises(KeyboardInterrupt):  # the user asks once more
        handler(signal.SIGUSR1, None)


@pytest.mark.parametrize(("lost", "shown"), [(KeyboardInterrupt, ""), (ValueError("a fault"), "ValueError: a fault")])
def test_drop_interrupt__shows_other_faults_of_callbacks_only(
    lost: BaseException, shown: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A kernel is loaded by a callback of ctypes, which prints what it cannot raise."""

    def load() -> None:
        raise lost

    monkeypatch.setattr(sys, "unraisablehook", drop_interrupt)
    ctypes.CFUNCTYPE(None)(load)()
    err = capsys.readouterr().err
    assert err.endswith(f"{shown}\n") if shown else not err
