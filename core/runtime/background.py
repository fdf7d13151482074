"""Work in background threads: items computed ahead of the caller or written behind it, and work beside other work."""

from __future__ import annotations

import queue
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Final, TypeVar

from furrowmap.core.runtime.errors import Cancelled
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.runtime.threads import threads

Item = TypeVar("Item")

SCANS_AHEAD: Final = 32
"""Scans that are read while others are at work."""
_POLL_S: Final = 0.1


@dataclass(frozen=True)
class _End:
    """The end of the items, and why."""

    error: BaseException | None = None


def ahead(items: Iterator[Item], depth: int) -> Iterator[Item]:
    """`items` in their order, up to `depth` of them computed ahead in a background thread.

    It is useful if computing them releases the interpreter's lock, as decompression and kernels do. An exception of
    `items` is raised here; when the caller stops early, the thread ends after its current item.
    """
    ready: queue.Queue[Item | _End] = queue.Queue(depth)
    stopped = threading.Event()

    def put(item: Item | _End) -> None:
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
                    return
        except BaseException as error:  # noqa: BLE001 (raised again where the items are used)
            put(_End(error))
        else:
            put(_End())

    thread = threading.Thread(target=work, name="ahead", daemon=True)
    thread.start()
    try:
        while not isinstance(item := ready.get(), _End):
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
    waiting: queue.Queue[Item | _End] = queue.Queue(depth)
    failed: list[BaseException] = []

    def work() -> None:
        while not isinstance(item := waiting.get(), _End):
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
        waiting.put(_End())
        _wait_for(thread)
    if failed:
        raise failed[0]


def _wait_for(thread: threading.Thread) -> None:
    """Wait for its end, but not while the interpreter shuts down: threads do not run any more then.

    This happens when iterators that an interrupted caller left behind are closed.
    """
    if not sys.is_finalizing():
        thread.join()


Found = TypeVar("Found")


@contextmanager
def beside(work: Callable[[Progress], Found], progress: Progress) -> Iterator[Future[Found]]:
    """`work` in a background thread beside the body of the context; its result is there when the context has ended.

    With a single thread it is done after the body. What `work` reports of its progress is passed on, by the caller's
    thread, once the body has ended. If that or the body raises, `work` is stopped where it reports next.

    Args:
        work: takes a progress of its own.
        progress: receives its progress.
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
