"""The first line of a table in CSV, which says by its names what the table is."""

from __future__ import annotations

from typing import Final

from furrowmap.core.readers.source import Head

LONGEST: Final = 4096
"""Bytes of a header at most."""


def head_columns(head: Head) -> list[str] | None:
    """The names of a file's columns by its head; None where that is no text with a line below a header."""
    line, _, rest = head.data.partition(b"\n")
    if not rest or len(line) > LONGEST or b"\0" in head.data:
        return None
    return columns_of(line.decode("utf-8", "replace"))[0]


def columns_of(line: str) -> tuple[list[str], str]:
    """The names in a header, and what separates them: of comma, semicolon and tab the most frequent."""
    line = line.lstrip("\ufeff").strip()
    separator = max(",;\t", key=line.count)
    return [name.strip().strip('"').strip() for name in line.split(separator)], separator
