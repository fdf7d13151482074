"""The header line of CSV files."""

from __future__ import annotations

import re
from typing import Final

from furrowmap.core.readers.source import Head

LONGEST: Final = 4096
"""Maximum length of a header in bytes."""
_POSITION: Final = re.compile(
    r"^(e|n|h|x|y|z|east|north|easting|northing)(_m)?$|lon|lat(_|$|itude)|east|north|alt|height"
)


def head_columns(head: Head) -> list[str] | None:
    """The column names of a file; None if it is not text with a line below a header."""
    line, _, rest = head.data.partition(b"\n")
    if not rest or len(line) > LONGEST or b"\0" in head.data:
        return None
    return columns_of(line.decode("utf-8", "replace"))[0]


def columns_of(line: str) -> tuple[list[str], str]:
    """The names in a header, and their separator: comma, semicolon or tab, whichever is most frequent."""
    line = line.lstrip("\ufeff").strip()
    separator = max(",;\t", key=line.count)
    return [name.strip().strip('"').strip() for name in line.split(separator)], separator


def names_a_position(name: str) -> bool:
    """Whether a column's name is that of a coordinate."""
    return _POSITION.search(name.lower()) is not None
