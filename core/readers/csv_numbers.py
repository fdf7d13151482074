"""Columns of numbers in CSV files, read in pieces."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.last_line import cut_line_notice, is_whole
from furrowmap.core.readers.source import Source, cut_notice
from furrowmap.core.runtime.errors import InputError, Notice

CHUNK_BYTES: Final = 1 << 23
LONGEST_TAIL: Final = 8192


def pieces(source: Source, notices: list[Notice]) -> Iterator[bytes]:
    """The first line, then pieces of complete lines; a last line that may be cut is dropped."""
    rest = tail = b""
    first = True
    while block := source.read(CHUNK_BYTES):
        rest += block
        if first and b"\n" in rest:
            line, _, rest = rest.partition(b"\n")
            first = False
            yield line
        end = rest.rfind(b"\n") + 1
        if end and not first:
            yield rest[:end]
            tail, rest = rest[max(0, end - LONGEST_TAIL) : end], rest[end:]
    if not rest.strip() or source.fault:
        return
    if is_whole(rest, tail.splitlines()):
        yield rest
    else:
        notices.append(cut_line_notice(source.path))


def complete_rows(
    source: Source,
    lines: Iterator[bytes],
    header: tuple[Sequence[str], str],
    columns: Sequence[str],
    notices: list[Notice],
    needed: int | None = None,
) -> NDArray[np.float64]:
    """Rows (n, k) of the numbers in some columns, without those in which a needed one is empty; notices tell of both.

    Args:
        source: the open file.
        lines: the pieces after its first line, see :func:`pieces`.
        header: names of all columns, and what separates fields.
        columns: names of those to read.
        notices: that rows are dropped, or the file is cut, is added.
        needed: so many of the columns, from the first on, are needed; None for all.

    Raises:
        InputError: with the line, if a field is not a number.
    """
    blocks, line = [np.empty((0, len(columns)))], 2
    for piece in lines:
        blocks.append(numbers(piece, *header, columns, source.path, line))
        line += piece.count(b"\n")
    if source.fault:
        notices.append(cut_notice(source.path, source.fault))
    rows = np.concatenate(blocks)
    whole = np.isfinite(rows[:, :needed]).all(axis=1)
    if not whole.all():
        notices.append(Notice("rows-incomplete", source=source.path, whole=int((~whole).sum()), rows=len(rows)))
    return rows[whole]


def numbers(
    piece: bytes, names: Sequence[str], separator: str, columns: Sequence[str], path: Path, line: int
) -> NDArray[np.float64]:
    """Rows (n, k) of the numbers in some columns; nan where a field is empty.

    Args:
        piece: complete lines.
        names: of all columns.
        separator: of the fields.
        columns: names of those to read.
        path: of the file, for messages.
        line: number of the first line.

    Raises:
        InputError: with the line, if a field is not a number.
    """
    import pandas as pd  # takes as long as importing all readers

    index = [names.index(name) for name in columns]
    try:
        frame = pd.read_csv(
            io.BytesIO(piece),
            sep=separator,
            header=None,
            names=list(range(len(names))),
            usecols=index,
            index_col=False,
            dtype=np.float64,
            skipinitialspace=True,
            encoding="latin-1",
        )
    except pd.errors.EmptyDataError:
        return np.empty((0, len(index)))
    except (ValueError, OverflowError, pd.errors.ParserError):
        raise _bad_field(piece, dict(zip(columns, index, strict=True)), separator, f"{path}", line) from None
    values: NDArray[np.float64] = frame[index].to_numpy()
    return values


def _bad_field(piece: bytes, wanted: dict[str, int], separator: str, path: str, line: int) -> InputError:
    """The error of lines that are not rows of numbers, with the first such field."""
    where, what = f"{path}, from line {line}", "the lines are not rows of numbers"
    for k, text in enumerate(piece.decode("latin-1").split("\n")):
        fields = [field.strip().strip('"') for field in text.split(separator)]
        bad = [(name, fields[i]) for name, i in wanted.items() if i < len(fields) and not _is_number(fields[i])]
        if bad:
            where, what = f"{path}, line {line + k}", f"column `{bad[0][0]}` holds {bad[0][1][:40]!r}"
            break
    return InputError("not-a-number", where=where, what=what)


def _is_number(field: str) -> bool:
    try:
        float(field or "nan")
    except ValueError:
        return field.lower() in ("na", "n/a", "null", "none")
    return True
