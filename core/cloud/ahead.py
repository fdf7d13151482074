"""Work of one iterator done ahead in a thread, while the caller works on what it has given already."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, TypeVar

Item = TypeVar("Item")

_POLL_S: Final = 0.1


@dataclass(frozen=True)
class _End:
    """Behind the last item: why there are no more."""

    error: BaseException | None = None


def ahead(items: Iterator[Item], depth: int) -> Iterator[Item]:
    """`items` in their order, up to `depth` of them made ahead in a thread of their own.

    It pays where making them releases the interpreter's lock, as decompression and kernels do. An exception of
    `items` is raised here; when the caller stops early, the thread ends with the item it is at.
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
        thread.join()
