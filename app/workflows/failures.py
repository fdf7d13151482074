"""Any exception as an error with three lines."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from furrowmap.core.runtime.errors import Cancelled, FurrowmapError
from furrowmap.exporters.files.batch_state import Failure

Found = TypeVar("Found")


def tried(work: Callable[[], Found]) -> Found | Failure:
    """What `work` gives, or the error that ended it: one session of a batch must not stop the others."""
    try:
        return work()
    except Exception as error:  # noqa: BLE001 whatever is wrong with one session is told in the table
        return Failure.of(in_three_lines(error))


def in_three_lines(raised: BaseException) -> FurrowmapError:
    """Any exception as an error with a remedy."""
    if isinstance(raised, FurrowmapError):
        return raised
    if isinstance(raised, KeyboardInterrupt):
        return Cancelled()
    if isinstance(raised, MemoryError):
        return FurrowmapError("out-of-memory")
    if isinstance(raised, OSError) and raised.strerror:
        return FurrowmapError(
            "system",
            filename=raised.filename or None,
            strerror=raised.strerror if raised.filename else None,
            raised_strerror=raised.strerror if not (raised.filename) else None,
        )
    return FurrowmapError("fault", name=type(raised).__name__, raised=raised)
