"""The workers of a batch or a season, and the settings that they take over from this process."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from importlib.util import find_spec
from typing import Any, Final, Self

from furrowmap.core.runtime.errors import MissingExtraError, Notice
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.memory import free_memory_bytes
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.runtime.settings import (
    ALLOWANCES,
    Settings,
    allows,
    available_processors,
    language_of_user,
    settings,
    using,
)
from furrowmap.workflows.batch.engine import TLS, Engine, Found, Item, OneProcess, WorkerDied

BYTES_A_WORKER: Final = 3 << 30
"""Free memory for each worker: a run of 77 million points takes 1.3 GB (docs/decisions/benchmarks.md)."""


def unprotected(scheduler: str | None) -> tuple[Notice, ...]:
    """A warning if anybody who reaches the scheduler may run code on its workers, and in this process."""
    if scheduler is None or scheduler.startswith(TLS):
        return ()
    return (Notice("scheduler-unprotected", address=scheduler),)


class Workforce:
    """The engine of a batch, started when there is work for it, and what each run may use.

    Without a scheduler, workers are processes of this machine: as many as are asked for, else one for each core as far
    as the memory suffices. Several need Dask; a single one does not.
    """

    def __init__(self, workers: int | None, scheduler: str | None, say: Callable[[str], None]) -> None:
        has_dask = find_spec("distributed") is not None
        may_start = has_dask and find_spec("cryptography") is not None  # it makes the certificate of own workers
        if (scheduler is not None and not has_dask) or ((workers or 1) > 1 and not may_start):
            raise MissingExtraError(
                Text("{packages:or}", packages=("dask", "distributed", "cryptography")),
                "cluster",
                Text("Several workers, or those of other machines, need it."),
                otherwise=Text("use one worker"),
            )
        fitting = max(1, min(available_processors(), free_memory_bytes() // BYTES_A_WORKER)) if may_start else 1
        self.workers = workers or fitting
        self._scheduler = scheduler
        self._say = say
        self._stack = ExitStack()
        self._engine: Engine | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: Any) -> None:
        self._stack.__exit__(*error)

    @property
    def threads(self) -> int | None:
        """Threads of each run: as asked for, else an even share of the cores; None for the default of a cluster."""
        asked = settings().threads
        if asked is not None or self._scheduler is not None:
            return asked
        return max(1, available_processors() // self.workers)

    @property
    def cores(self) -> int:
        """Cores that work at a time, as far as is known before."""
        return self.workers if self._scheduler is not None else self.workers * (self.threads or 1)

    def each(
        self, work: Callable[[Item], Found], items: Sequence[tuple[str, Item]], stage: str, progress: Progress
    ) -> Iterator[tuple[str, Found | WorkerDied]]:
        """As :meth:`Engine.each`, with the settings of this process, and the share that is done as progress."""
        if not items:
            return
        if self._engine is None:
            if self._scheduler is None and self.workers == 1:
                self._engine = OneProcess()
            else:
                from furrowmap.workflows.batch.dask import cluster_of_scheduler, local_cluster

                if self._scheduler is not None:
                    cluster = cluster_of_scheduler(self._scheduler, self._say)
                else:
                    cluster = local_cluster(self.workers, self._say)
                self._engine = self._stack.enter_context(cluster)
        done = 0

        def tick() -> None:
            progress(stage, done / len(items))

        allowed = frozenset(what for what in ALLOWANCES if allows(what))
        with_settings = partial(_do, work, Settings(self.threads, allowed, language_of_user()))
        for name, found in self._engine.each(with_settings, items, tick):
            done += 1
            tick()
            yield name, found


def _do(work: Callable[[Item], Found], process: Settings, item: Item) -> Found:
    """`work` on an item, in a worker, with the settings of the process that handed it out."""
    with using(threads=process.threads, allowed=process.allowed, language=process.language):
        return work(item)
