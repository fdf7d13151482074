"""Any exception as an error with three lines."""

from __future__ import annotations

from furrowmap.core.values.errors import Cancelled, FurrowmapError


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
