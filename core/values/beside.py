"""Work in a background thread beside other work."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from typing import Final, TypeVar

from furrowmap.core.values.errors import Cancelled
from furrowmap.core.values.progress import Progress
from furrowmap.core.values.threads import threads

Found = TypeVar("Found")

_POLL_S: Final = 0.1


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
