# SPDX-License-Identifier: GPL-2.0-or-later
"""A session file as lines, some of which the form edits; comments and all other lines are kept byte by byte.

The form changes values one at a time, in their own lines. What it cannot show, such as inline tables, stays as it is;
only where that is one of the values that the form has, it does not edit the file. Of several tables of one name, such
as `[[implement]]`, it edits one at a time. A Python before 3.11 has no `tomllib`: there it reads values in one line.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from typing import Any, NoReturn

try:
    import tomllib as _tomllib
except ImportError:
    TOML: Any = None
else:
    TOML = _tomllib

_TABLE_LINE = re.compile(r"(\[?)\[\s*([A-Za-z0-9_-]+)\s*\](\]?)\s*(#.*)?")
_OTHER_TABLE_LINE = re.compile(r"(\[?)\[([^\]#]*)\](\]?)\s*(#.*)?")
_KEY_NAME = r"""(?:[A-Za-z0-9_-]+|"[^"\n]*"|'[^'\n]*')"""
_ENTRY = re.compile(rf"({_KEY_NAME}(?:\s*\.\s*{_KEY_NAME})*)\s*=\s*(.*)")
_LITERAL = re.compile(r"'[^'\n]*'")
_LINE_OF_ERROR = re.compile(r"at line (\d+)")
UNREAD = object()
"""The value of a key whose value the form cannot show."""


class NotSimpleError(Exception):
    """The form cannot edit the line of this number, counted from 1."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


class SessionLines:
    """The text of a session file, read and changed value by value.

    Raises NotSimpleError at a line that is no TOML, and later where a value is asked for that the form cannot show.
    """

    def __init__(self, text: str) -> None:
        self._newline = "\r\n" if "\r\n" in text else "\n"
        self._before = text
        body = text.replace("\r\n", "\n")
        self._mark = "\ufeff" if body.startswith("\ufeff") else ""
        body = body.removeprefix("\ufeff")
        self._end = body[len(body.rstrip("\n")) :] or "\n"
        self._lines = body.rstrip("\n").split("\n")  # splitlines() splits at characters that TOML does not
        self._index()
        self._known = list(self._lines)
        if TOML is not None:
            try:
                TOML.loads(body)
            except TOML.TOMLDecodeError as error:
                found = _LINE_OF_ERROR.search(str(error))
                raise NotSimpleError(int(found[1]) if found else len(self._lines)) from None

    def get(self, table: str, key: str) -> Any:
        """The value of a key; None if there is none. Keys before the first table have the table ""."""
        self._refuse_foreign(table)
        place = self._places.get((table, key))
        if place is not None and place[2] is UNREAD:
            raise NotSimpleError(place[0] + 1)
        return None if place is None else place[2]

    def has(self, table: str) -> bool:
        """Whether there is such a table."""
        self._refuse_foreign(table)
        return table in self._ends

    def tables(self, name: str) -> list[str]:
        """The tables of a name in their order, as :meth:`get` takes them, such as `name` and `name[1]`."""
        self._refuse_foreign(name)
        return [table for table in self._ends if table == name or table.startswith(f"{name}[")]

    def add(self, name: str) -> str:
        """Add a table of a name, `[name]`, or `[[name]]` beside others; returns it as :meth:`get` takes it."""
        known = self.tables(name)
        if len(known) == 1:
            number = self._headers[name]
            self._lines[number] = re.sub(rf"^\s*\[\s*{name}\s*\]", f"[[{name}]]", self._lines[number])
        self._lines += ["", f"[[{name}]]" if known else f"[{name}]"]
        self._index()
        return self.tables(name)[-1]

    def set(self, table: str, key: str, value: Any) -> None:
        """Set the value of a key, in its lines or in a new one at the end of its table."""
        # JSON text, numbers and lists are valid TOML, except for one character.
        written = f"{key} = " + json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        known = self.get(table, key)
        place = self._places.get((table, key))
        if place is not None:
            if known == value:
                return
            first, behind, _, comment = place
            self._lines[first:behind] = [f"{written}   {comment}" if comment else written]
        elif table in self._ends:
            self._lines.insert(self._ends[table], written)
        else:
            self._lines += ["", f"[{table}]", written]
        self._index()

    def drop(self, table: str) -> None:
        """Remove a table, except the comments in it; of several of this name, the first."""
        self._refuse_foreign(table)
        keys = [key for name, key in self._places if name == table]
        gone = {number for key in keys for number in range(*self._places[table, key][:2])}
        gone.add(self._headers.get(table, -1))
        self._lines = [line for number, line in enumerate(self._lines) if number not in gone]
        self._index()

    def drop_key(self, table: str, key: str) -> None:
        """Remove a key, and its table if it has no other one."""
        self._refuse_foreign(table)
        place = self._places.get((table, key))
        if place is None:
            return
        if sum(name == table for name, _ in self._places) == 1:
            self.drop(table)
            return
        del self._lines[place[0] : place[1]]
        self._index()

    @property
    def text(self) -> str:
        """The content of the file; as it was read if no line was changed."""
        if self._lines == self._known:
            return self._before
        return self._mark + (("\n".join(self._lines)) + self._end).replace("\n", self._newline)

    def _refuse_foreign(self, table: str) -> None:
        """Raise NotSimpleError for a table that is written in another way than `[table]`."""
        if table in self._foreign:
            raise NotSimpleError(self._foreign[table] + 1)

    def _index(self) -> None:
        # of a key: its first line, the line behind it, value, comment
        self._places: dict[tuple[str, str], tuple[int, int, Any, str]] = {}
        self._ends = {"": 0}  # of a table: number of the line behind its last entry
        self._headers: dict[str, int] = {}  # of a table: its line; further ones of a name have a number in theirs
        self._foreign: dict[str, int] = {}  # of a table that is written in another way: a line of it
        table = ""
        number = 0
        while number < len(self._lines):
            stripped = self._lines[number].strip()
            behind = number + 1
            if stripped and not stripped.startswith("#"):
                name = self._new_table(stripped)
                entry = _ENTRY.fullmatch(stripped)
                if name is not None and name not in self._ends:
                    table = name
                    self._headers[table] = number
                elif entry is not None and name is None:
                    behind = self._index_entry(table, entry, number)
                elif name is None and _OTHER_TABLE_LINE.fullmatch(stripped):
                    table = f"\0{number}"  # its entries are kept, and not asked for
                    path = _key_path(stripped.lstrip("[").partition("]")[0])
                    if len(path) == 1:
                        self._foreign[path[0]] = number
                else:
                    raise NotSimpleError(number + 1)
                self._ends[table] = behind
            number = behind

    def _index_entry(self, table: str, entry: re.Match[str], number: int) -> int:
        """Keep the value of a key, which may take several lines; returns the number of the line behind it."""
        path = _key_path(entry[1])
        behind = number + 1
        text = entry[2]
        while (found := _read(text)) is None:
            if behind >= len(self._lines) or TOML is None:
                raise NotSimpleError(number + 1)
            text += "\n" + self._lines[behind]
            behind += 1
        value, comment = found
        if len(path) > 1 or entry[1] != path[0]:
            value = UNREAD
        if (table, path[0]) in self._places and len(path) == 1:
            raise NotSimpleError(number + 1)
        if table == "" and value is UNREAD:
            self._foreign.setdefault(path[0], number)
        self._places.setdefault((table, path[0]), (number, behind, value, comment))
        return behind

    def _new_table(self, stripped: str) -> str | None:
        """The name of the table that a line begins, None for another line."""
        header = _TABLE_LINE.fullmatch(stripped)
        if header is None or len(header[1]) != len(header[3]):
            return None
        name = header[2]
        count = sum(known == header[2] or known.startswith(f"{header[2]}[") for known in self._ends)
        return f"{name}[{count}]" if header[1] and count else name


def _key_path(key: str) -> Sequence[str]:
    """The parts of a key with dots or quotes."""
    if re.fullmatch(r"[A-Za-z0-9_-]+", key) or TOML is None:
        return [key]
    try:
        found: Any = TOML.loads(f"{key} = 1")
    except TOML.TOMLDecodeError:
        return [key]
    path = []
    while isinstance(found, dict):
        [(name, found)] = found.items()
        path.append(name)
    return path


def _read(text: str) -> tuple[Any, str] | None:
    """A value, or :data:`UNREAD`, and the comment after it; None if the value does not end in the text."""
    literal = _LITERAL.match(text)
    if literal is not None and not text.startswith("''"):
        value: Any = literal[0][1:-1]
        end = literal.end()
    else:
        try:
            # Not strict: a TOML string may contain a tab.
            value, end = json.JSONDecoder(parse_constant=_refuse, strict=False).raw_decode(text)
        except ValueError:
            return _read_by_tomllib(text)
    rest = text[end:].strip()
    if (rest and not rest.startswith("#")) or not _is_shown(value):
        return _read_by_tomllib(text)
    return value, rest


def _read_by_tomllib(text: str) -> tuple[Any, str] | None:
    if TOML is None:
        return None
    try:
        value = TOML.loads(f"v = {text}")["v"]
    except TOML.TOMLDecodeError:
        return None
    last = text.rfind("\n") + 1
    for number in (number for number, sign in enumerate(text) if sign == "#" and number >= last):
        try:
            if TOML.loads(f"v = {text[:number]}")["v"] == value:
                return (value if _is_shown(value) else UNREAD), text[number:].strip()
        except TOML.TOMLDecodeError:
            continue
    return (value if _is_shown(value) else UNREAD), ""


def _refuse(name: str) -> NoReturn:
    raise ValueError(name)


def _is_shown(value: Any) -> bool:
    if isinstance(value, list):
        return all(map(_is_shown, value))
    return isinstance(value, str | int) or (isinstance(value, float) and value - value == 0.0)
