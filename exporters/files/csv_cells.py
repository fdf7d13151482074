"""Texts in the cells of CSV files."""

from __future__ import annotations

import re
from typing import Final

from furrowmap.core.runtime.errors import printable

_FORMULA: Final = frozenset("=+-@＝＋－＠")
"""Spreadsheets evaluate a cell that begins with one of these (OWASP: CSV injection); the wide ones in East Asia."""
_PLAIN_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def cell(value: object) -> object:
    """A value for a cell that no program takes for a formula or a control sequence.

    A text is one line with escapes for control characters, and begins with an apostrophe where it would be evaluated;
    everything else, and a text that is a number, is as it was.
    """
    if not isinstance(value, str):
        return value
    text = printable(value)
    return f"'{text}" if text[:1] in _FORMULA and not _PLAIN_NUMBER.fullmatch(text) else text
