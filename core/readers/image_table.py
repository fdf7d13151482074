"""Tables of images: CSV with the file and the time of each."""

from __future__ import annotations

import datetime as dt
from pathlib import Path
from typing import Final

import numpy as np

from furrowmap.core.readers.csv_header import columns_of
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.source import Source, cut_notice
from furrowmap.core.readers.time_scale import utc_of
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.file_names import leads_out
from furrowmap.core.runtime.foreign_content import binary_kind
from furrowmap.core.values.images import Images

FILES: Final = ("file", "image", "filename", "name")
TIMES: Final = {"time_unix_s": "unix", "time_gps_s": "gps", "time": "iso"}
"""Names of the columns; `time` is ISO 8601, UTC without a zone."""
LARGEST_BYTES: Final = 1 << 26


def read_image_table(path: Path, folder: Path, notices: list[Notice]) -> Images:
    """The images that a table names, those that exist.

    Args:
        path: of the table; names in it are relative to its folder.
        folder: that the images must lie in.
        notices: images that are missing, and rows that are incomplete, are added.

    Raises:
        InputError: if columns are missing, a field is no time, or an image lies outside the folder.
    """
    names, cells = _rows(path, notices)
    file = next((name for name in FILES if name in names), None)
    time = next((name for name in TIMES if name in names), None)
    if file is None or time is None:
        raise InputError("missing-column.read-image-table", path=path, names=", ".join(names)[:80])
    at = names.index(file), names.index(time)
    rows = [(line, row[at[0]], row[at[1]]) for line, row in cells if len(row) > max(at) and row[at[0]] and row[at[1]]]
    if len(rows) < len(cells):
        notices.append(Notice("rows-incomplete", source=path, whole=len(cells) - len(rows), rows=len(cells)))
    seconds = np.array([_seconds(text, time, f"{path}, line {line}") for line, _, text in rows], np.float64)
    times = utc_of(seconds, "unix" if TIMES[time] == "iso" else TIMES[time], str(path), ReadOptions())
    paths = [_inside(path, folder, name) for _, name, _ in rows]
    there = np.array([_is_file(image) for image in paths], bool)
    if not there.all():
        first = rows[int(np.argmin(there))][1]
        notices.append(Notice("images-missing", path=path, there=int((~there).sum()), rows=len(rows), first=first))
    return Images.sorted([image for image, is_there in zip(paths, there, strict=True) if is_there], times[there])


def _rows(path: Path, notices: list[Notice]) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """The names of the columns, and of each row the number of its line and its fields."""
    with Source(path) as source:
        data, fault = source.read(LARGEST_BYTES + 1), source.fault
    if len(data) > LARGEST_BYTES:
        raise InputError("not-a-table", path=path, largest_bytes=LARGEST_BYTES)
    if (kind := binary_kind(data)) is not None:
        raise InputError("not-a-table.rows", path=path, kind=kind)
    if fault:
        notices.append(cut_notice(path, fault))
    lines = data.decode("utf-8-sig", "replace").splitlines()
    names, separator = columns_of(lines[0] if lines else "")
    cells = [
        (number, [cell.strip().strip('"') for cell in line.split(separator)])
        for number, line in enumerate(lines[1:], start=2)
        if line.strip()
    ]
    return names, cells


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # the name is too long
        return False


def _inside(table: Path, folder: Path, name: str) -> Path:
    """The path of an image."""
    image = table.parent / name.replace("\\", "/")
    if "\0" in name or leads_out(image, folder):
        raise InputError("session-path-outside", table=table, name=name[:80])
    return image


def _seconds(text: str, column: str, where: str) -> float:
    try:
        if TIMES[column] != "iso":
            return _finite(text)
        stamp = dt.datetime.fromisoformat(text.replace("/", "-"))
        return (stamp if stamp.tzinfo else stamp.replace(tzinfo=dt.UTC)).timestamp()
    except (ValueError, OverflowError):
        raise InputError("not-a-time", where=where, column=column, text=text[:40]) from None


def _finite(text: str) -> float:
    """A number."""
    number = float(text)
    if not np.isfinite(number):
        raise ValueError(text)
    return number


def is_image_table(path: Path) -> bool:
    """Whether the first line of a CSV has the columns of a table of images."""
    with Source(path) as source:
        names, _ = columns_of(source.read(4096).decode("utf-8-sig", "replace").split("\n", 1)[0])
    return not set(FILES).isdisjoint(names) and not TIMES.keys().isdisjoint(names)
