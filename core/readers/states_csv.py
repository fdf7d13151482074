"""States of the implement from a CSV of the times at which they change."""

import math
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np

from furrowmap.core.readers.column_names import expected_once
from furrowmap.core.readers.csv_file import head_columns, is_whole, read_small, text_rows, unix_time
from furrowmap.core.readers.csv_text import header_of, row_cells
from furrowmap.core.readers.reader import FileReader, Inspection
from furrowmap.core.readers.source import Head
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text, Words
from furrowmap.core.values.clock import LAST_S, iso_utc
from furrowmap.core.values.tool_states import ToolState, ToolStates

MAX_STATES_BYTES: Final = 50_000_000
_STATE_COLUMNS: Final = ("t_s", "time", "state", "sigma_s", "confidence", "common_share")
_STATE_WORDS: Final = {state.label: state for state in ToolState}


class StatesCsv(FileReader):
    """A CSV with the times from which the implement is `down`, `up` or `unknown`.

    The state of the last row lasts to the end of the drive.
    """

    format: ClassVar[str] = "states-csv"
    title: ClassVar[Text] = Text("implement states in CSV")

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain with columns of times and states."""
        names = set(head_columns(head))
        return 1.0 if "state" in names and {"time", "t_s"} & names else 0.0

    def states(self) -> ToolStates:
        """The states of all files; the end of the last interval is infinite unless its state is `unknown`.

        InputError, with the line, if a row is invalid or the times do not increase.
        """
        self.notices = []
        rows: list[_Row] = []
        for path in self.paths:
            of_file, doubts = _rows(path)
            rows += of_file
            self.notices += doubts
        for (t_s, *_), (later_s, *_, where) in pairwise(rows):
            if later_s <= t_s:
                raise InputError("rows-out-of-order", where=where, time=iso_utc(later_s), time_before=iso_utc(t_s))
        begin_s = np.array([row[0] for row in rows], np.float64)
        state = np.array([row[1] for row in rows], np.int8)
        sigma_s = np.array([row[2] for row in rows], np.float64)
        known = state != ToolState.UNKNOWN
        return ToolStates(
            begin_s=begin_s[known],
            end_s=np.append(begin_s[1:], np.inf)[known],
            state=state[known],
            confidence=np.array([row[3] for row in rows], np.float64)[known],
            begin_sigma_s=sigma_s[known],
            end_sigma_s=np.append(sigma_s[1:], np.nan)[known],
            common_share=max((row[4] for row in rows), default=0.0),
        )

    def inspect(self) -> Inspection:
        """Read the whole first file and report what it contains."""
        reader = StatesCsv(self.paths[:1], self.options)
        states = reader.states()
        length_s = np.where(np.isfinite(states.end_s), states.end_s, states.begin_s) - states.begin_s
        facts: dict[str, Any] = {
            "intervals": len(states),
            **{
                f"{state.label}_s": round(float(length_s[states.state == state].sum()), 1)
                for state in (ToolState.DOWN, ToolState.UP)
            },
        }
        if len(states):
            facts |= {"first": iso_utc(float(states.begin_s[0])), "last": iso_utc(float(states.begin_s[-1]))}
        return Inspection(self.paths[0], self.format, self.title, facts, notices=tuple(reader.notices))


_Row = tuple[float, ToolState, float, float, float, Words]
"""(t_s, state, sigma_s, confidence, common_share, file and line)."""


def _rows(path: Path) -> tuple[list[_Row], list[Notice]]:
    try:
        data, notices = read_small(path, MAX_STATES_BYTES)
    except ValueError as error:
        raise _bad(f"{path}: {error}") from None
    if data and not data.endswith((b"\n", b"\r")):
        *lines, last = data.splitlines()
        # No state is the beginning of another, so a row that ends with one is complete.
        header = header_of(lines or [last])
        cells = [cell.lower() for cell in row_cells(last.decode("utf-8", "replace"), header.separator)]
        complete = len(cells) == len(header.names) and cells[-1] in _STATE_WORDS
        if notices or not (complete or is_whole(last, lines[header.lines :], header.separator)):
            notices.append(Notice("last-line-cut", path=path))
            data = b"\n".join(lines)
    table = text_rows(data, path)
    standard = expected_once(table.names, _STATE_COLUMNS, path)
    rows: list[_Row] = []
    for number, fields in table.rows:
        row = {standard[name]: text for name, text in fields.items()}
        if not any(row.values()):
            continue
        where = Text("{path}, line {line}", path=path, line=number)
        word = row.get("state", "").lower()
        if word not in _STATE_WORDS:
            raise _bad(Text("{where}: the state is {text!r}", where=where, text=word[:40]))
        sigma_s = _number(row, "sigma_s", where, math.nan)
        confidence, common = (
            min(max(_number(row, name, where, default), 0.0), 1.0)
            for name, default in (("confidence", 1.0), ("common_share", 0.0))
        )
        rows.append((_time_s(row, where), _STATE_WORDS[word], sigma_s, confidence, common, where))
    return rows, [*notices, *table.notices]


def _time_s(row: dict[str, str], where: Words) -> float:
    if row.get("t_s"):
        t_s = _number(row, "t_s", where, math.nan)
        if not 0.0 <= t_s < LAST_S:
            raise _bad(Text("{where}: the time is {text!r}", where=where, text=row["t_s"][:40]))
        return t_s
    text = row.get("time", "")
    try:
        return unix_time(text)
    except ValueError:
        raise _bad(Text("{where}: the time is {text!r}", where=where, text=text[:40])) from None


def _number(row: dict[str, str], name: str, where: Words, default: float) -> float:
    text = row.get(name, "")
    if not text:
        return default
    try:
        return float(text)
    except ValueError:
        raise _bad(f"{where}: {name} is {text[:40]!r}") from None


def _bad(what: Words) -> InputError:
    return InputError("states-unreadable", what=what)
