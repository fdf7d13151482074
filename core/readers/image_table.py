"""Tables of images: CSV with the file and the time of each."""

import math
from pathlib import Path
from typing import Final

import numpy as np

from furrowmap.core.readers.column_names import column_of, means, standard_names
from furrowmap.core.readers.csv_file import TIMES, names_a_position, read_small, text_rows, unix_time
from furrowmap.core.readers.csv_text import header_of
from furrowmap.core.readers.epochs import utc_of
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.source import Source
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.file_names import leads_out
from furrowmap.core.runtime.languages.texts import reason
from furrowmap.core.values.images import Images

FILES: Final = ("file", "image", "filename", "name")
_TIMES: Final = (*TIMES, "time")
"""Names of the columns; `time` is ISO 8601, UTC without a zone."""
MAX_TABLE_BYTES: Final = 1 << 26


def read_image_table(path: Path, folder: Path) -> tuple[Images, list[Notice]]:
    """The images in a folder that a table names, relative to its own, those that exist; others are noticed.

    InputError if columns are missing, a field is no time, or an image lies outside the folder.
    """
    try:
        data, notices = read_small(path, MAX_TABLE_BYTES)
    except ValueError as error:
        raise InputError("not-a-table", path=path, why=reason(error)) from None
    table = text_rows(data, path)
    notices += table.notices
    names = table.names
    cells = table.rows
    file = column_of(FILES, names, path)
    time = column_of(_TIMES, names, path)
    if file is None or time is None:
        raise InputError("missing-column.of-images", path=path, names=", ".join(names)[:80])
    kind = next(name for name in _TIMES if means(time, name))
    rows = [(line, row[file], row[time]) for line, row in cells if row.get(file) and row.get(time)]
    if len(rows) < len(cells):
        notices.append(Notice("rows-incomplete", source=path, whole=len(cells) - len(rows), rows=len(cells)))
    seconds = []
    paths = []
    for line, name, text in rows:
        try:
            seconds.append(float(text) if kind in TIMES else unix_time(text))
        except ValueError:
            seconds.append(math.nan)
        if not math.isfinite(seconds[-1]):
            raise InputError("not-a-time", where=f"{path}, line {line}", column=time, text=text[:40])
        paths.append(path.parent / name.replace("\\", "/"))
        if "\0" in name or leads_out(paths[-1], folder):
            raise InputError("session-path-outside", table=path, name=name[:80])
    times = utc_of(np.array(seconds, np.float64), TIMES.get(kind, "unix"), str(path), ReadOptions())
    there = np.array([_is_file(image) for image in paths], bool)
    if not there.all():
        first = rows[int(np.argmin(there))][1]
        notices.append(Notice("images-missing", path=path, there=int((~there).sum()), rows=len(rows), first=first))
    kept = [image for image, is_there in zip(paths, there, strict=True) if is_there]
    return Images.sorted(kept, times[there]), notices


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # the name is too long
        return False


def is_image_table(path: Path) -> bool:
    """Whether the first line of a CSV has the columns of a table of images."""
    with Source(path) as source:
        names = header_of(source.read(4096).split(b"\n")).names
    named = [name for name in names if any(means(name, file) for file in FILES)]
    if all(means(name, FILES[-1]) for name in named) and any(map(names_a_position, standard_names(names))):
        return False  # points have names and times as well
    return bool(named) and any(means(name, time) for name in names for time in _TIMES)
