# SPDX-License-Identifier: GPL-2.0-or-later
"""A session file as lines, of which the form shows and changes some: comments and all other lines stay as they are.

QGIS on Windows and macOS may bring a Python without `tomllib`, and that could not write. So the form reads the simple
part of TOML that `furrowmap init` writes: tables with one value a line. Of anything else it keeps its hands off.
"""

import json
import re

_HEADER = re.compile(r"\[([A-Za-z0-9_-]+)\]\s*(#.*)?")
_ENTRY = re.compile(r"([A-Za-z0-9_-]+)\s*=\s*(.*)")
_LITERAL = re.compile(r"'[^'\n]*'")


class NotSimpleError(Exception):
    """A line that is more than the form understands.

    Attributes:
        number: of the line, from 1.
    """

    def __init__(self, number):
        super().__init__(number)
        self.number = number


class SessionLines:
    """The text of a session file, to read and change value by value.

    Args:
        text: of the file.

    Raises:
        NotSimpleError: at a line that is no comment, no `[table]` and no `key = value` on one line.
    """

    def __init__(self, text):
        self._lines = text.rstrip("\n").split("\n")  # splitlines() knows ends of lines that TOML does not
        self._index()

    def get(self, table, key):
        """The value of a key; None where it is not there. The tables' own keys have the table ""."""
        place = self._places.get((table, key))
        return None if place is None else place[1]

    def has(self, table):
        """Whether the table is there."""
        return table in self._ends

    def set(self, table, key, value):
        """Give a key its value: in its line, else in a new one at its table's end."""
        written = f"{key} = {_written(value)}"
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

    def drop(self, table):
        """Take a table away, without the comments in it."""
        gone = {place[0] for (name, _), place in self._places.items() if name == table}
        gone |= {number for number, line in enumerate(self._lines) if _table_of(line) == table}
        self._lines = [line for number, line in enumerate(self._lines) if number not in gone]
        self._index()

    @property
    def text(self):
        """Of the file."""
        return "\n".join(self._lines) + "\n"

    def _index(self):
        self._places = {}  # (table, key): number of the line, value, comment
        self._ends = {"": 0}  # table: number of the line behind its last entry
        table = ""
        for number, line in enumerate(self._lines):
            stripped = line.strip()
            if not stripped or stripped.startswith("#"):
                continue
            name = _table_of(line)
            entry = _ENTRY.fullmatch(stripped)
            if name is not None and name not in self._ends:
                table = name
            elif entry is not None and (table, entry[1]) not in self._places:
                value, comment = _read(entry[2], number)
                self._places[table, entry[1]] = (number, value, comment)
            else:
                raise NotSimpleError(number + 1)
            self._ends[table] = number + 1


def _table_of(line):
    header = _HEADER.fullmatch(line.strip())
    return None if header is None else header[1]


def _read(text, number):
    """A value that TOML and JSON write alike (or a literal string), and the comment behind it."""
    literal = _LITERAL.match(text)
    if literal is not None and not text.startswith("''"):
        value, end = literal[0][1:-1], literal.end()
    else:
        try:
            # Not strict: a tab may stand in a text of TOML as it is.
            value, end = json.JSONDecoder(parse_constant=_refuse, strict=False).raw_decode(text)
        except ValueError:
            raise NotSimpleError(number + 1) from None
    rest = text[end:].strip()
    if (rest and not rest.startswith("#")) or not _is_toml(value):
        raise NotSimpleError(number + 1)
    return value, rest


def _refuse(name):
    raise ValueError(name)


def _is_toml(value):
    if isinstance(value, list):
        return all(_is_toml(item) for item in value)
    return isinstance(value, (str, int, float))


def _written(value):
    """JSON's way of writing text, numbers and lists is TOML's too, but for one character."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
