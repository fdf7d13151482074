# SPDX-License-Identifier: GPL-2.0-or-later
"""A session file as lines, some of which the form edits; comments and all other lines are kept.

QGIS may have a Python without `tomllib`, which cannot write either. So the form reads the part of TOML that
`furrowmap init` writes: tables with one value per line. It does not edit files with anything else. Of several tables of
one name, such as `[[implement]]`, it edits one at a time.
"""

from __future__ import annotations

import json
import re
from typing import Any, NoReturn

_TABLE_LINE = re.compile(r"(\[?)\[([A-Za-z0-9_-]+)\](\]?)\s*(#.*)?")
_ENTRY = re.compile(r"([A-Za-z0-9_-]+)\s*=\s*(.*)")
_LITERAL = re.compile(r"'[^'\n]*'")


class NotSimpleError(Exception):
    """The form cannot edit the line of this number, counted from 1."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


class SessionLines:
    """The text of a session file, read and changed value by value.

    Raises NotSimpleError at a line that is not a comment, a `[table]`, a `[[table]]` or a `key = value`.
    """

    def __init__(self, text: str) -> None:
        self._lines = text.rstrip("\n").split("\n")  # splitlines() splits at characters that TOML does not
        self._index()

    def get(self, table: str, key: str) -> Any:
        """The value of a key; None if there is none. Keys before the first table have the table ""."""
        place = self._places.get((table, key))
        return None if place is None else place[1]

    def has(self, table: str) -> bool:
        """Whether there is such a table."""
        return table in self._ends

    def tables(self, name: str) -> list[str]:
        """The tables of a name in their order, as :meth:`get` takes them, such as `name` and `name[1]`."""
        return [table for table in self._ends if table == name or table.startswith(f"{name}[")]

    def add(self, name: str) -> str:
        """Add a table of a name, `[name]`, or `[[name]]` beside others; returns it as :meth:`get` takes it."""
        known = self.tables(name)
        if len(known) == 1:
            number = self._headers[name]
            self._lines[number] = re.sub(rf"^\s*\[{name}\]", f"[[{name}]]", self._lines[number])
        self._lines += ["", f"[[{name}]]" if known else f"[{name}]"]
        self._index()
        return self.tables(name)[-1]

    def set(self, table: str, key: str, value: Any) -> None:
        """Set the value of a key, in its line or in a new one at the end of its table."""
        # JSON text, numbers and lists are valid TOML, except for one character.
        written = f"{key} = " + json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        place = self._places.get((table, key))
        if place is not None:
            number, known, comment = place
            if known == value:
                return
            self._lines[number] = f"{written}   {comment}" if comment else written
        elif table in self._ends:
            self._lines.insert(self._ends[table], written)
        else:
            self._lines += ["", f"[{table}]", written]
        self._index()

    def drop(self, table: str) -> None:
        """Remove a table, except the comments in it; of several of this name, the first."""
        gone = {place[0] for (name, _), place in self._places.items() if name == table}
        gone.add(self._headers.get(table, -1))
        self._lines = [line for number, line in enumerate(self._lines) if number not in gone]
        self._index()

    @property
    def text(self) -> str:
        """The content of the file."""
        return "\n".join(self._lines) + "\n"

    def _index(self) -> None:
        self._places: dict[tuple[str, str], tuple[int, Any, str]] = {}  # of a key: its line, value, comment
        self._ends = {"": 0}  # of a table: number of the line behind its last entry
        self._headers: dict[str, int] = {}  # of a table: its line; further ones of a name have a number in theirs
        table = ""
        for number, line in enumerate(self._lines):
            stripped = line.strip()
            if not stripped or stripped.startswith("#"):
                continue
            name = self._new_table(line)
            entry = _ENTRY.fullmatch(stripped)
            if name is not None and name not in self._ends:
                table = name
                self._headers[table] = number
            elif entry is not None and (table, entry[1]) not in self._places:
                value, comment = _read(entry[2], number)
                self._places[table, entry[1]] = (number, value, comment)
            else:
                raise NotSimpleError(number + 1)
            self._ends[table] = number + 1

    def _new_table(self, line: str) -> str | None:
        """The name of the table that a line begins, None for another line."""
        header = _TABLE_LINE.fullmatch(line.strip())
        if header is None or len(header[1]) != len(header[3]):
            return None
        name = header[2]
        count = sum(known == header[2] or known.startswith(f"{header[2]}[") for known in self._ends)
        return f"{name}[{count}]" if header[1] and count else name


def _read(text: str, number: int) -> tuple[Any, str]:
    """A value that is the same in TOML and JSON (or a literal string), and the comment after it."""
    literal = _LITERAL.match(text)
    if literal is not None and not text.startswith("''"):
        value = literal[0][1:-1]
        end = literal.end()
    else:
        try:
            # Not strict: a TOML string may contain a tab.
            value, end = json.JSONDecoder(parse_constant=_refuse, strict=False).raw_decode(text)
        except ValueError:
            raise NotSimpleError(number + 1) from None
    rest = text[end:].strip()
    if (rest and not rest.startswith("#")) or not _is_toml(value):
        raise NotSimpleError(number + 1)
    return value, rest


def _refuse(name: str) -> NoReturn:
    raise ValueError(name)


def _is_toml(value: Any) -> bool:
    if isinstance(value, list):
        return all(map(_is_toml, value))
    return isinstance(value, (str, int, float))
