"""The number of threads, one setting for all stages, and work in threads."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from itertools import pairwise
from typing import Final, TypeVar

from furrowmap.core.runtime.errors import UsageError

Item = TypeVar("Item")
Found = TypeVar("Found")

VARIABLE: Final = "FURROWMAP_THREADS"
MOST_BY_DEFAULT: Final = 8
"""Default maximum: more threads gain little and take more memory, because each has its own surfaces."""

_asked: list[int] = []
"""Counts in force, the innermost last."""


def threads() -> int:
    """Number of threads that a stage may use at once.

    The count of the innermost `using_threads`; else that of the environment variable FURROWMAP_THREADS; else
    the processors that this process may use, 8 at most.

    Raises:
        UsageError: if the environment variable is not an integer of at least 1.
    """
    if _asked:
        return _asked[-1]
    stated = os.environ.get(VARIABLE)
    if not stated:
        return min(available_processors(), MOST_BY_DEFAULT)
    if not stated.isdecimal() or int(stated) < 1:
        raise UsageError("usage.threads", stated=stated)
    return int(stated)


def asked_threads() -> int | None:
    """The count of the innermost `using_threads`; None outside of all."""
    return _asked[-1] if _asked else None


@contextmanager
def using_threads(count: int | None, *, by_default: bool = False) -> Iterator[None]:
    """Within it, furrowmap uses at most `count` threads at once.

    The setting is the process's: threads started within see it as well.

    Args:
        count: at least 1; None changes nothing.
        by_default: a count that is in force already wins, so that an option of the command line wins over a session.
    """
    if count is None or (by_default and _asked):
        yield
        return
    _asked.append(count)
    try:
        yield
    finally:
        _asked.pop()


def available_processors() -> int:
    """Processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


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
