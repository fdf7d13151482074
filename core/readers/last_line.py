"""The last line of a text file that does not end with a newline: it may be cut inside its last number."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from furrowmap.core.runtime.errors import Notice

COMPARED: Final = 8
"""Lines that the last one is compared with."""
_FIELD: Final = re.compile(rb"[^,;\s]+")
_WHOLE_DIGITS: Final = re.compile(rb'^"?[-+]?\d*')


def is_whole(line: bytes, before: Sequence[bytes]) -> bool:
    """Whether a last line without a newline is certainly complete.

    It is if it has as many fields as each of the lines before, and its last field is a number with as many decimals as
    theirs: 81.02 may be cut to 81.0, 81 or 8, which have fewer.

    Args:
        line: the last line.
        before: lines before it, of which the last :data:`COMPARED` are used.
    """
    forms = {_form(other) for other in before[-COMPARED:]}
    count, decimals = _form(line)
    return forms == {(count, decimals)} and decimals.startswith(b".0")


def cut_line_notice(path: Path) -> Notice:
    """The notice of a last line that is dropped."""
    return Notice("last-line-cut", path=path)


def _form(line: bytes) -> tuple[int, bytes]:
    """Number of fields, and the last one without the digits before its point and with 0 for those behind."""
    fields = _FIELD.findall(line)
    if not fields:
        return 0, b""
    return len(fields), re.sub(rb"\d", b"0", _WHOLE_DIGITS.sub(b"", fields[-1]))
