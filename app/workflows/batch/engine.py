"""Where the runs of a batch take place: a process beside this one, or Dask's workers (:mod:`.dask`)."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from types import TracebackType
from typing import Any, Final, Protocol, Self, TypeVar

from furrowmap.core.runtime.allowances import ALL, allowing, allows, free_memory_bytes
from furrowmap.core.runtime.errors import RefusedError
from furrowmap.core.runtime.languages.choice import language_of_user, using_language
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.runtime.threads import asked_threads, available_processors, using_threads
from furrowmap.process import prepare_process

Item = TypeVar("Item")
Found = TypeVar("Found")

ATTEMPTS: Final = 3
"""Workers that an item may lose before it is given up."""
BYTES_A_WORKER: Final = 3 << 30
"""Free memory for each worker: a run of 77 million points takes 1.3 GB (docs/development/benchmarks.md)."""
SESSIONS_A_PROCESS: Final = 200
"""Then a process makes room for a new one."""
_TICK_S: Final = 0.2


@dataclass(frozen=True)
class Manner:
    """What the user has chosen for all work, as another process needs it.

    Attributes:
        threads: of the work; None for the default.
        allowed: what is allowed (`core/runtime/allowances.py`).
        language: of messages; empty for the default.
    """

    threads: int | None
    allowed: tuple[str, ...]
    language: str

    @classmethod
    def of_user(cls, threads: int | None) -> Self:
        """As chosen in this process."""
        return cls(threads, tuple(what for what in ALL if allows(what)), language_of_user())

    @contextmanager
    def applied(self) -> Iterator[None]:
        """Within it, this process works in that manner."""
        with ExitStack() as stack:
            stack.enter_context(using_threads(self.threads))
            stack.enter_context(allowing(*(what for what in ALL if what in self.allowed)))
            if self.language:
                stack.enter_context(using_language(self.language))
            yield


class Lost:
    """Stands for what an item would have given, had it not ended :data:`ATTEMPTS` workers."""


class Engine(Protocol):
    """Works through items in other processes."""

    def each(
        self, work: Callable[[Item], Found], items: Sequence[tuple[str, Item]], tick: Callable[[], None]
    ) -> Iterator[tuple[str, Found | Lost]]:
        """`work` on each item, in any order.

        Args:
            work: a function of a module; it raises nothing.
            tick: is called often; it may raise an error to stop the work.

        Yields:
            The name of an item, and what came of it.
        """
        ...


class Workforce:
    """The engine of a batch, started when there is work for it, and what each run may use.

    Without a scheduler, workers are processes of this machine: as many as are asked for, else one for each core as far
    as the memory suffices. Several need Dask; a single one does not.

    Args:
        workers: number asked for; None for the default.
        scheduler: address of a running Dask scheduler; None for none.
        say: is called with the address of the dashboard.

    Raises:
        RefusedError: if Dask is needed and not installed.
    """

    def __init__(self, workers: int | None, scheduler: str | None, say: Callable[[str], None]) -> None:
        has_dask = find_spec("distributed") is not None
        if not has_dask and (scheduler is not None or (workers or 1) > 1):
            raise _no_dask()
        self.workers = workers or (workers_here() if has_dask else 1)
        self._scheduler, self._say = scheduler, say
        self._stack = ExitStack()
        self._engine: Engine | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, error, trace)

    @property
    def threads(self) -> int | None:
        """Threads of each run: as asked for, else an even share of the cores; None for the default of a cluster."""
        asked = asked_threads()
        if asked is not None or self._scheduler is not None:
            return asked
        return max(1, available_processors() // self.workers)

    @property
    def cores(self) -> int:
        """Cores that work at a time, as far as is known before."""
        return self.workers if self._scheduler is not None else self.workers * (self.threads or 1)

    def each(
        self, work: Callable[[Item], Found], items: Sequence[tuple[str, Item]], stage: str, progress: Progress
    ) -> Iterator[tuple[str, Found | Lost]]:
        """As :meth:`Engine.each`, with the share that is done as the progress of a stage."""
        if not items:
            return
        if self._engine is None:
            self._engine = self._started()
        done = 0

        def tick() -> None:
            progress(stage, done / len(items))

        for name, found in self._engine.each(work, items, tick):
            done += 1
            tick()
            yield name, found

    def _started(self) -> Engine:
        if self._scheduler is None and self.workers == 1:
            return OneProcess()
        from furrowmap.workflows.batch.dask import cluster_of_scheduler, local_cluster

        if self._scheduler is not None:
            return self._stack.enter_context(cluster_of_scheduler(self._scheduler, self._say))
        return self._stack.enter_context(local_cluster(self.workers, self._say))


def workers_here() -> int:
    """Workers that this machine has cores and memory for."""
    return max(1, min(available_processors(), free_memory_bytes() // BYTES_A_WORKER))


def _no_dask() -> RefusedError:
    return RefusedError("no-dask")


class OneProcess:
    """An engine of one process at a time, which is replaced when it ends unexpectedly, and after many items."""

    def each(
        self, work: Callable[[Item], Found], items: Sequence[tuple[str, Item]], tick: Callable[[], None]
    ) -> Iterator[tuple[str, Found | Lost]]:
        """As :meth:`Engine.each`, in the order of the items."""
        worker: _Worker | None = None
        try:
            for name, item in items:
                found: Any = Lost()
                for _ in range(ATTEMPTS):
                    worker = worker if worker is not None and worker.is_fresh else _renewed(worker)
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
        self._done = 0

    @property
    def is_fresh(self) -> bool:
        """Whether it may take another item."""
        return self._done < SESSIONS_A_PROCESS

    def do(self, work: Callable[[Any], Any], item: object, tick: Callable[[], None]) -> Any:
        """`work` on an item."""
        self._pipe.send((work, item))
        while not self._pipe.poll(_TICK_S):
            tick()
        self._done += 1
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
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, KeyboardInterrupt):
        while True:
            work, item = pipe.recv()
            pipe.send(work(item))


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
