"""States of the implement from a CSV of the times at which they change."""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np

from furrowmap.core.readers.csv_header import columns_of, head_columns
from furrowmap.core.readers.last_line import cut_line_notice, is_whole
from furrowmap.core.readers.reader import FileReader, Inspection
from furrowmap.core.readers.source import Head, Source, cut_notice
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.clock import LAST_S, iso_utc
from furrowmap.core.values.tool_states import ToolState, ToolStates

LARGEST_BYTES: Final = 50_000_000
_STATES: Final = {state.label: state for state in ToolState}


class StatesCsv(FileReader):
    """A CSV with the times from which the implement is `down`, `up` or `unknown`.

    The state of the last row lasts to the end of the drive.

    Args:
        paths: the files of one recording, in the order of time.
        options: none is used.
    """

    format: ClassVar[str] = "states-csv"
    title: ClassVar[str] = "implement states in CSV"

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain with columns of times and states."""
        names = set(head_columns(head) or ())
        return 1.0 if "state" in names and {"time", "t_s"} & names else 0.0

    def states(self) -> ToolStates:
        """The states of all files; the end of the last interval is infinite unless its state is `unknown`.

        Raises:
            InputError: with the line, if a row is invalid or the times do not increase.
        """
        self.notices = []
        rows = [row for path in self.paths for row in _rows(path, self.notices)]
        for (t_s, *_), (later_s, *_, where) in pairwise(rows):
            if later_s <= t_s:
                raise InputError("rows-out-of-order", where=where, later_s=iso_utc(later_s), t_s=iso_utc(t_s))
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
        """Read the whole first file and report what it contains.

        Raises:
            InputError: as :meth:`states`.
        """
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


def _rows(path: Path, notices: list[Notice]) -> Iterator[tuple[float, ToolState, float, float, float, str]]:
    """(t_s, state, sigma_s, confidence, common_share, file and line) of each row."""
    with Source(path) as source:
        data, fault = source.read(LARGEST_BYTES + 1), source.fault
    if len(data) > LARGEST_BYTES:
        raise _bad(f"{path}: more than {LARGEST_BYTES:,} bytes")
    lines = data.decode("utf-8", "replace").splitlines()
    if fault:
        notices.append(cut_notice(path, fault))
    if data and not data.endswith((b"\n", b"\r")) and not _is_whole(data.splitlines(), fault):
        notices.append(cut_line_notice(path))
        lines.pop()
    names, separator = columns_of(lines[0] if lines else "")
    for number, line in enumerate(lines[1:], start=2):
        cells = line.replace('"', "").split(separator)
        if not any(cell.strip() for cell in cells):
            continue
        where = f"{path}, line {number}"
        row = dict(zip(names, (cell.strip() for cell in cells), strict=False))
        word = row.get("state", "").lower()
        if word not in _STATES:
            raise _bad(f"{where}: the state is {word[:40]!r}")
        sigma_s, confidence = _number(row, "sigma_s", where, math.nan), _number(row, "confidence", where, 1.0)
        common = _number(row, "common_share", where, 0.0)
        yield _time_s(row, where), _STATES[word], sigma_s, _share(confidence), _share(common), where


def _is_whole(lines: list[bytes], fault: str) -> bool:
    """Whether the last line is certainly complete; no state is the beginning of another."""
    names, separator = columns_of(lines[0].decode("utf-8", "replace"))
    cells = [cell.strip('" ').lower() for cell in lines[-1].decode("utf-8", "replace").split(separator)]
    word = len(cells) == len(names) and cells[-1] in _STATES
    return not fault and (word or is_whole(lines[-1], lines[1:-1]))


def _share(value: float) -> float:
    return min(max(value, 0.0), 1.0)


def _time_s(row: dict[str, str], where: str) -> float:
    if row.get("t_s"):
        t_s = _number(row, "t_s", where, math.nan)
        if not 0.0 <= t_s < LAST_S:
            raise _bad(f"{where}: the time is {row['t_s'][:40]!r}")
        return t_s
    text = row.get("time", "")
    try:
        when = dt.datetime.fromisoformat(text)
        return when.timestamp() if when.tzinfo is not None else when.replace(tzinfo=dt.UTC).timestamp()
    except (ValueError, OverflowError):
        raise _bad(f"{where}: the time is {text[:40]!r}") from None


def _number(row: dict[str, str], name: str, where: str, default: float) -> float:
    text = row.get(name, "")
    if not text:
        return default
    try:
        return float(text)
    except ValueError:
        raise _bad(f"{where}: {name} is {text[:40]!r}") from None


def _bad(what: str) -> InputError:
    return InputError("states-unreadable", what=what)
