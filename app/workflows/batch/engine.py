"""What works through the items of a batch: one process beside this one; :mod:`.dask` has workers of Dask."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, Final, Protocol, TypeVar

from furrowmap.core.runtime.worker_process import end_with_parent
from furrowmap.process import leave_out_unused, prepare_process

Item = TypeVar("Item")
Found = TypeVar("Found")

ATTEMPTS: Final = 3
"""Workers that an item may lose before it is given up."""
SESSIONS_A_PROCESS: Final = 200
"""Then a process makes room for a new one."""
TICK_S: Final = 0.2
TLS: Final = "tls://"
"""How the address of a scheduler begins that takes work from those with its certificate only."""


class WorkerDied:
    """In place of the result of an item that ended :data:`ATTEMPTS` workers."""


class Engine(Protocol):
    """Works through items in other processes."""

    def each(
        self, work: Callable[[Item], Found], items: Sequence[tuple[str, Item]], tick: Callable[[], None]
    ) -> Iterator[tuple[str, Found | WorkerDied]]:
        """The name of each item, and the result of `work` on it, in any order.

        `work` is a function of a module that raises nothing; `tick` is called often, and may raise an error to stop.
        """
        ...


class OneProcess:
    """An engine of one process at a time, which is replaced when it ends unexpectedly, and after many items."""

    def each(
        self, work: Callable[[Item], Found], items: Sequence[tuple[str, Item]], tick: Callable[[], None]
    ) -> Iterator[tuple[str, Found | WorkerDied]]:
        """As :meth:`Engine.each`, in the order of the items."""
        worker: _Worker | None = None
        try:
            for name, item in items:
                found: Any = WorkerDied()
                for _ in range(ATTEMPTS):
                    if worker is None or worker.done >= SESSIONS_A_PROCESS:
                        worker = _renewed(worker)
                    with suppress(EOFError, OSError):
                        found = worker.do(work, item, tick)
                        break
                    worker = _renewed(worker)
                yield name, found
        finally:
            if worker is not None:
                worker.end()


class _Worker:
    """A process that takes items through a pipe."""

    def __init__(self) -> None:
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()
        self.done = 0

    def do(self, work: Callable[[Any], Any], item: object, tick: Callable[[], None]) -> Any:
        """`work` on an item."""
        self._pipe.send((work, item))
        while not self._pipe.poll(TICK_S):
            tick()
        self.done += 1
        return self._pipe.recv()

    def end(self) -> None:
        """End the process."""
        self._process.terminate()
        self._process.join(5.0)
        self._process.kill()
        self._pipe.close()


def _renewed(worker: _Worker | None) -> _Worker:
    if worker is not None:
        worker.end()
    return _Worker()


def _serve(pipe: Connection) -> None:
    """Do what comes through the pipe until it is closed; end with the parent, whatever ends that."""
    prepare_process()
    leave_out_unused()
    end_with_parent()
    from furrowmap.warm_up import reporting_compilation  # it imports numba

    with suppress(EOFError, KeyboardInterrupt), reporting_compilation(lambda _: None, "run"):
        while True:
            work, item = pipe.recv()
            pipe.send(work(item))
