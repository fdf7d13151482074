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
        return FurrowmapError(
            "Out of memory.",
            "The command stopped; no partial files were left.",
            "Close other programs, or process a part of the recording.",
            code="out-of-memory",
        )
    if isinstance(raised, OSError) and raised.strerror:
        return FurrowmapError(
            f"{raised.filename}: {raised.strerror}." if raised.filename else f"{raised.strerror}.",
            "A file could not be read or written; no partial files were left.",
            "Check that the folder exists, that you have permission to write there, and that the disk is not full.",
            code="system",
        )
    return FurrowmapError(
        f"{type(raised).__name__}: {raised}.",
        "This is a bug in furrowmap; no partial files were left.",
        "Run the command again with --debug, and report the output together with that of `furrowmap --version`.",
        code="fault",
    )
