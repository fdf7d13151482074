"""Times written as date and time of day in columns of CSV files, and clocks of a device that they tie to UTC."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.errors import InputError, Notice

FloatArray = NDArray[np.float64]

FEWEST_CHANGES: Final = 2
SCATTER_S: Final = 0.05
"""UTC that agrees with the device's clock within this is one of measurement, not of arrival."""


def with_unix_times(
    pieces: Iterator[bytes], header: tuple[Sequence[str], str], columns: Sequence[str], path: Path
) -> Iterator[bytes]:
    """Pieces of complete lines with the ISO 8601 times in some columns as seconds since 1970.

    Args:
        pieces: those after the first line.
        header: names of all columns, and what separates fields.
        columns: names of those with times; a time without a zone is UTC.
        path: of the file, for messages.

    Raises:
        InputError: with the line, if a field is no time.
    """
    names, separator = header
    places, mark, line = [names.index(name) for name in columns], separator.encode(), 2
    for piece in pieces:
        lines = piece.split(b"\n")
        for k, text in enumerate(lines):
            fields = text.rstrip(b"\r").split(mark)
            if len(fields) <= max(places):
                continue
            for place in places:
                fields[place] = _unix(fields[place], f"{path}, line {line + k}", names[place])
            lines[k] = mark.join(fields)
        yield b"\n".join(lines)
        line += len(lines) - 1


def _unix(field: bytes, where: str, column: str) -> bytes:
    text = field.decode("latin-1").strip().strip('"').strip()
    if not text:
        return b""
    try:
        stamp = dt.datetime.fromisoformat(text.replace("/", "-"))
        return b"%.6f" % (stamp if stamp.tzinfo else stamp.replace(tzinfo=dt.UTC)).timestamp()
    except (ValueError, OverflowError):
        raise InputError("not-a-time.unix", where=where, column=column, text=text[:40]) from None


def tied_to_utc(clock_s: FloatArray, utc_s: FloatArray, name: str, notices: list[Notice]) -> FloatArray:
    """UTC (n,) of a device's own clock (n,) by a column of UTC (n,) that changes now and then, such as once a second.

    UTC is that of the row in which it changes; the median over the changes counts. How far it is behind, because a
    receiver tells the time after the second began, stays unknown.

    Raises:
        InputError: if UTC never changes.
    """
    known = np.isfinite(utc_s)
    at = np.flatnonzero(known)
    changes = at[1:][np.diff(utc_s[at]) > 0]
    if len(changes) < FEWEST_CHANGES:
        raise InputError("not-a-time.tied-to-utc", name=name, changes=len(changes))
    offset = utc_s[changes] - clock_s[changes]
    middle = float(np.median(offset))
    scatter = float(np.median(np.abs(offset - middle)))
    notices.append(
        Notice("imu-clock-tied", name=name, changes=len(changes), is_scatter=scatter < SCATTER_S, scatter=scatter)
    )
    return clock_s + middle
