"""Work in threads: items computed ahead of the caller or written behind it, beside other work, or in shares."""

import os
import queue
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, TypeVar

from furrowmap.core.runtime.errors import Cancelled
from furrowmap.core.runtime.iteration import close
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.runtime.settings import threads

Item = TypeVar("Item")
Found = TypeVar("Found")

SCANS_AHEAD: Final = 32
"""Scans that are read while others are at work."""
GIVEN_WAY: Final = 5
"""By how much the priority of a thread is lowered: to a third of the processor time where it competes."""
_POLL_S: Final = 0.1


@dataclass(frozen=True)
class _Finished:
    """The end of the items, and why."""

    error: BaseException | None = None


def ahead(items: Iterator[Item], depth: int) -> Iterator[Item]:
    """`items` in their order, up to `depth` of them computed ahead in a background thread.

    It is useful if computing them releases the interpreter's lock, as decompression and kernels do. An exception of
    `items` is raised here; when the caller stops early, `items` are closed after the current one.
    """
    ready: queue.Queue[Item | _Finished] = queue.Queue(depth)
    stopped = threading.Event()

    def put(item: Item | _Finished) -> None:
        while not stopped.is_set():
            try:
                ready.put(item, timeout=_POLL_S)
            except queue.Full:
                continue
            return

    def work() -> None:
        try:
            for item in items:
                put(item)
                if stopped.is_set():
                    close(items)
                    return
        except BaseException as error:  # noqa: BLE001 (raised again where the items are used)
            put(_Finished(error))
        else:
            put(_Finished())

    thread = threading.Thread(target=work, name="ahead", daemon=True)
    thread.start()
    try:
        while not isinstance(item := ready.get(), _Finished):
            yield item
        if item.error is not None:
            raise item.error
    finally:
        stopped.set()
        _wait_for(thread)


@contextmanager
def behind(sink: Callable[[Item], None], depth: int) -> Iterator[Callable[[Item], None]]:
    """A function that queues up to `depth` items and passes them to `sink` in their order, in a background thread.

    At the end of the context all items have been passed on. An exception of `sink` is raised at the next item, or at
    the end. If the context ends with another exception, queued items are dropped.
    """
    waiting: queue.Queue[Item | _Finished] = queue.Queue(depth)
    failed: list[BaseException] = []

    def work() -> None:
        while not isinstance(item := waiting.get(), _Finished):
            if failed:
                continue
            try:
                sink(item)
            except BaseException as error:  # noqa: BLE001 (raised again where the items come from)
                failed.append(error)

    def put(item: Item) -> None:
        if failed:
            raise failed[0]
        waiting.put(item)

    thread = threading.Thread(target=work, name="behind", daemon=True)
    thread.start()
    try:
        yield put
    except BaseException as error:
        failed.append(error)
        raise
    finally:
        waiting.put(_Finished())
        _wait_for(thread)
    if failed:
        raise failed[0]


def _wait_for(thread: threading.Thread) -> None:
    """Wait for its end, but not while the interpreter shuts down: threads do not run any more then."""
    if not sys.is_finalizing():
        thread.join()


@contextmanager
def beside(work: Callable[[Progress], Found], progress: Progress) -> Iterator[Future[Found]]:
    """`work` in a background thread beside the body of the context; its result is there when the context has ended.

    With a single thread it is done after the body. What `work` reports of its progress is passed on, by the caller's
    thread, once the body has ended. If that or the body raises, `work` is stopped where it reports next.
    """
    last: list[tuple[str, float]] = []
    stopped = threading.Event()

    def report(stage: str, share: float) -> None:
        if stopped.is_set():
            raise Cancelled
        last[:] = [(stage, share)]

    if threads() < 2:
        found: Future[Found] = Future()
        yield found
        found.set_result(work(progress))
        return
    with ThreadPoolExecutor(1, "beside") as pool:
        found = pool.submit(work, report)
        try:
            yield found
            while not found.done():
                with suppress(TimeoutError):
                    found.exception(_POLL_S)
                if last:
                    progress(*last[0])
        finally:
            stopped.set()
    found.result()
    if last:  # also of work that was done before the body
        progress(*last[0])


def give_way() -> None:
    """Let other threads of this process, which have less to share among cores, go before this one (on Linux alone)."""
    if sys.platform == "linux":
        with suppress(OSError):
            os.nice(GIVEN_WAY)


def in_threads(work: Callable[[Sequence[Item]], Found], items: Sequence[Item]) -> list[Found]:
    """`work` on even shares of the items, in their order, each in a thread of its own.

    Threads gain where `work` is a kernel or a library that releases the interpreter's lock.
    """
    count = threads()
    cuts = [len(items) * k // count for k in range(count + 1)]
    shares = [items[a:b] for a, b in pairwise(cuts) if b > a]
    if len(shares) < 2:
        return [work(share) for share in shares]
    with ThreadPoolExecutor(len(shares)) as pool:
        return list(pool.map(work, shares))


def in_turn(
    pool: ThreadPoolExecutor, work: Callable[[Item], Found], items: Iterable[Item], ahead: int
) -> Iterator[Found]:
    """`work` on each item in the threads of a pool; the results in the order of the items.

    At most `ahead` items are in work or wait for the caller, beside the one that it has.
    """
    begun = deque[Future[Found]]()
    for item in items:
        if len(begun) == ahead:
            done = begun.popleft().result()
            begun.append(pool.submit(work, item))
            yield done
        else:
            begun.append(pool.submit(work, item))
    while begun:
        yield begun.popleft().result()
