"""Dask's workers for a batch: processes of this machine, or those of a running cluster.

Whoever may connect to a scheduler or to a worker of Dask may run any code there: what they exchange is pickled. Those
of this machine listen on its loopback only, speak TLS, and accept nothing without the certificate that is made for them
when they start. Dask keeps it in their memory, and for the moment of loading in a folder of this user alone.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, suppress
from secrets import token_hex
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Any, Final

from dask import config
from distributed import Client, LocalCluster, WorkerPlugin, wait
from distributed.scheduler import KilledWorker
from distributed.security import Security

from furrowmap.core.runtime.errors import FurrowmapError, UsageError
from furrowmap.process import prepare_process
from furrowmap.workflows.batch.engine import ATTEMPTS, TICK_S, TLS, Found, Item, WorkerDied

IN_HAND: Final = 4
"""Items for each worker that the scheduler has at a time: more would only take its memory."""
RECONNECT_S: Final = 60.0
"""A scheduler that is gone is waited for so long."""
_CONNECT_TIMEOUT_S: Final = 5.0
_TRIM: Final = ("MALLOC_TRIM_THRESHOLD_", "65536")
"""What Dask sets for its workers: freed memory goes back to the system at once, and comes again as pages to be filled
with zeros, four times as many in a run. No setting of the user that :func:`.prepare_process` had to respect."""
_QUIET: Final = {
    "distributed.worker.profile.enabled": False,
    "distributed.worker.memory.monitor-interval": "1s",
    "distributed.admin.tick.interval": "500ms",
    "distributed.admin.system-monitor.interval": "2s",
}
"""Dask's watching of tasks of some milliseconds: in a run of seconds it only takes the interpreter from it."""
_LOOPBACK: Final = "127.0.0.1"
_NO_PAGES: Final[dict[str, list[str]]] = {"distributed.scheduler.http.routes": [], "distributed.worker.http.routes": []}
"""Dask starts its HTTP servers in any case; without these routes they have no page."""


class WorkerSetup(WorkerPlugin):
    """Sets up each worker before it imports what a run needs."""

    name = "furrowmap"

    def setup(self, worker: object) -> None:  # noqa: ARG002 (distributed's signature)
        """Called once in each worker, also in those that come later."""
        if os.environ.get(_TRIM[0]) == _TRIM[1]:
            del os.environ[_TRIM[0]]
        prepare_process()


class DaskWorkers:
    """An engine of Dask's workers.

    A worker that is lost costs no item: the scheduler gives it to another one, three times. Where the scheduler is
    lost, the items without an answer are handed to the next one at the same address.
    """

    def __init__(self, connect: Callable[[], Client]) -> None:
        self._connect = connect
        self.client = self._connected()

    def close(self) -> None:
        """Disconnect; what still runs on workers is given up."""
        with suppress(Exception):
            self.client.close(timeout=_CONNECT_TIMEOUT_S)

    def each(
        self, work: Callable[[Item], Found], items: Sequence[tuple[str, Item]], tick: Callable[[], None]
    ) -> Iterator[tuple[str, Found | WorkerDied]]:
        """As :meth:`~.engine.Engine.each`, in the order in which they are done."""
        waiting = list(reversed(items))
        in_hand: dict[Any, tuple[str, Item]] = {}
        try:
            while waiting or in_hand:
                tick()
                try:
                    self._hand_out(work, waiting, in_hand)
                    with suppress(TimeoutError, CancelledError):  # what a lost scheduler had is cancelled
                        wait(list(in_hand), timeout=TICK_S, return_when="FIRST_COMPLETED")
                    done = [future for future in in_hand if future.status != "pending"]
                except Exception as error:  # a closed client raises KeyError and Dask's own
                    if self.client.status == "running":
                        raise _unusable(error) from error
                    done = []
                if self.client.status != "running":
                    waiting += reversed(list(in_hand.values()))
                    in_hand.clear()
                    self._reconnect(tick)
                    continue
                for future in done:
                    name, item = in_hand.pop(future)
                    try:
                        found = _result(future)
                    except (OSError, TimeoutError, CancelledError):
                        waiting.append((name, item))
                    else:
                        yield name, found
        finally:
            with suppress(Exception):
                self.client.cancel(list(in_hand), force=True)

    def _hand_out(
        self, work: Callable[[Item], Found], waiting: list[tuple[str, Item]], in_hand: dict[Any, tuple[str, Item]]
    ) -> None:
        room = IN_HAND * max(1, len(self.client.scheduler_info(n_workers=-1)["workers"]))
        while waiting and len(in_hand) < room:
            name, item = waiting[-1]
            future = self.client.submit(work, item, key=f"{name}-{token_hex(4)}", pure=False)
            in_hand[future] = waiting.pop()

    def _connected(self) -> Client:
        client = self._connect()
        client.register_plugin(WorkerSetup())
        return client

    def _reconnect(self, tick: Callable[[], None]) -> None:
        self.close()
        until = monotonic() + RECONNECT_S
        while True:
            tick()
            try:
                self.client = self._connected()
            except (OSError, TimeoutError, RuntimeError, CancelledError):
                if monotonic() > until:
                    raise FurrowmapError("batch-scheduler-lost", reconnect_s=RECONNECT_S) from None
            else:
                return


@contextmanager
def local_cluster(workers: int, say: Callable[[str], None]) -> Iterator[DaskWorkers]:
    """Workers that are processes of this machine, and end with it; its memory is divided among them."""
    with ExitStack() as stack:
        folder = stack.enter_context(TemporaryDirectory(prefix="furrowmap-dask-", ignore_cleanup_errors=True))
        stack.enter_context(config.set({**_QUIET, **_NO_PAGES, "temporary-directory": folder}))
        cluster = stack.enter_context(_worker_processes(workers, folder))
        say(f"{workers} workers")
        engine = DaskWorkers(lambda: Client(cluster, timeout=_CONNECT_TIMEOUT_S))
        stack.callback(engine.close)
        yield engine


def _worker_processes(workers: int, folder: str) -> LocalCluster:
    """A cluster of this machine; what its workers put on the disk goes to `folder`, not to one that users share."""
    security = Security.temporary()
    for left in reversed(range(ATTEMPTS)):
        try:
            return LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                memory_limit="auto",
                host=_LOOPBACK,
                security=security,
                dashboard_address=f"{_LOOPBACK}:0",
                scheduler_kwargs={"dashboard": False},
                local_directory=folder,
            )
        except RuntimeError as error:
            if not left:
                raise _not_started(error) from error
    raise AssertionError


@contextmanager
def cluster_of_scheduler(address: str, say: Callable[[str], None]) -> Iterator[DaskWorkers]:
    """The workers of a running scheduler; FurrowmapError if it cannot be reached.

    For tls:// addresses Dask takes the certificates that its own configuration states; UsageError if it states none.
    """
    if address.startswith(TLS) and config.get("distributed.comm.tls.client.cert") is None:
        raise UsageError("usage.scheduler-certificate", address=address)
    try:
        engine = DaskWorkers(lambda: Client(address, timeout=_CONNECT_TIMEOUT_S))
    except (OSError, TimeoutError, ValueError) as error:
        raise FurrowmapError("no-scheduler", address=address, error=error) from None
    try:
        say(f"{len(engine.client.nthreads())} workers")
        yield engine
    finally:
        engine.close()


def _result(future: Any) -> Any:
    if future.status in ("cancelled", "lost"):
        raise CancelledError
    if future.status == "finished":
        return future.result(RECONNECT_S)
    error = future.exception(RECONNECT_S)
    if isinstance(error, KilledWorker):
        return WorkerDied()
    raise _unusable(error)


def _not_started(error: BaseException) -> FurrowmapError:
    return FurrowmapError("batch-no-workers", error=error)


def _unusable(error: BaseException) -> FurrowmapError:
    return FurrowmapError("batch-cluster", name=type(error).__name__, error=error)
