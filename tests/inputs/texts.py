"""A table written in the ways of others: separators, decimal commas, code pages, compression."""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import lzma
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

Cells = Sequence[Sequence[str]]
"""The header and the rows of a table; numbers have points."""
MARK = codecs.BOM_UTF8


def lines(cells: Cells, separator: str = ",", end: str = "\n", *, decimal: str = ".") -> str:
    written = io.StringIO()
    table = csv.writer(written, delimiter=separator, lineterminator=end)
    table.writerows([[_number(cell, decimal) for cell in row] for row in cells])
    return written.getvalue()


def _number(cell: str, decimal: str) -> str:
    try:
        float(cell)
    except ValueError:
        return cell
    return cell.replace(".", decimal)


def with_column(cells: Cells, name: str, text: str) -> Cells:
    header, *rows = cells
    return [[*header, name], *([*row, text] for row in rows)]


def quoted(cells: Cells) -> str:
    return "".join(",".join(f'"{cell}"' for cell in row) + "\n" for row in cells)


def spaced(cells: Cells) -> str:
    return "".join(" , ".join(row) + " \n" for row in cells)


def blank_between(cells: Cells) -> str:
    return "\n".join(["", *lines(cells).splitlines()[:2], "", *lines(cells).splitlines()[2:], "", ""])


TITLES: Mapping[str, str] = {
    "time_unix_s": "Unix time [s]", "e_m": "Easting (m)", "n_m": "Northing (m)", "h_m": "Height (m)",
    "lon_deg": "Longitude [deg]", "lat_deg": "Latitude [deg]", "roll_deg": "Roll (deg)", "pitch_deg": "Pitch (°)",
    "heading_deg": "Heading (degrees)", "yaw_deg": "Yaw [deg]", "gyro_x_dps": "Gyro X (deg/s)",
    "gyro_y_dps": "GyroY [°/s]", "gyro_z_dps": "Angular Rate Z [deg/s]", "accel_x_mps2": "AccX (m/s^2)",
    "accel_y_mps2": "Acceleration Y [m/s²]", "accel_z_mps2": "acc_z_m_s2", "angle_deg": "Angle (deg)",
    "range_m": "Distance [m]", "file": "Filename", "state": "State", "t_s": "T (s)", "id": "ID",
}  # fmt: skip
"""Names of columns as other programs write them."""


def renamed(cells: Cells, name: Callable[[str], str]) -> Cells:
    header, *rows = cells
    return [[name(cell) for cell in header], *rows]


def units_below(cells: Cells) -> Cells:
    header, *rows = cells
    titles = [TITLES.get(name, name).replace("acc_z_m_s2", "acc_z (m/s2)") for name in header]
    split = [re.fullmatch(r"(.*?) ?[(\[](.*)[)\]]", title) for title in titles]
    names = [title if found is None else found[1] for title, found in zip(titles, split, strict=True)]
    return [names, ["" if found is None else found[2] for found in split], *rows]


WAYS: Mapping[str, Callable[[Cells], bytes]] = {
    "commas": lambda cells: lines(cells).encode(),
    "semicolons": lambda cells: lines(cells, ";").encode(),
    "tabs": lambda cells: lines(cells, "\t").encode(),
    "carriage returns": lambda cells: lines(cells, end="\r\n").encode(),
    "quotes around cells": lambda cells: quoted(cells).encode(),
    "spaces around cells": lambda cells: spaced(cells).encode(),
    "no newline at the end": lambda cells: lines(cells).rstrip("\n").encode(),
    "empty lines": lambda cells: blank_between(cells).encode(),
    "rows of separators alone": lambda cells: (lines(cells) + 2 * ("," * (len(cells[0]) - 1) + "\n")).encode(),
    "comments (#) before the header": lambda cells: b"# exported, by hand\n#\n" + lines(cells).encode(),
    "separator line": lambda cells: b"sep=;\r\n" + lines(cells, ";", "\r\n").encode(),
    "separator line of another separator": lambda cells: b'"sep=|"\n' + lines(cells, "|").encode(),
    "decimal commas between semicolons": lambda cells: lines(cells, ";", decimal=",").encode(),
    "decimal commas between tabs": lambda cells: lines(cells, "\t", decimal=",").encode(),
    "quoted decimal commas between commas": lambda cells: lines(cells, decimal=",").encode(),
    "separator line and decimal commas": lambda cells: b"sep=;\n" + lines(cells, ";", decimal=",").encode(),
    "UTF-8 with a byte order mark": lambda cells: MARK + lines(cells).encode(),
    "byte order mark and separator line": lambda cells: MARK + b"sep=;\n" + lines(cells, ";").encode(),
    "UTF-16, little-endian": lambda cells: codecs.BOM_UTF16_LE + lines(cells).encode("utf-16-le"),
    "UTF-16, big-endian": lambda cells: codecs.BOM_UTF16_BE + lines(cells).encode("utf-16-be"),
    "UTF-16 without a byte order mark": lambda cells: lines(cells).encode("utf-16-le"),
    "Japanese words in UTF-8": lambda cells: lines(with_column(cells, "備考", "圃場1")).encode(),
    "Japanese words in Shift-JIS": lambda cells: lines(with_column(cells, "備考", "圃場1")).encode("cp932"),
    "French words in Windows-1252": lambda cells: lines(with_column(cells, "témoin", "début")).encode("cp1252"),
    "names in capitals": lambda cells: lines(renamed(cells, str.upper)).encode(),
    "names with spaces and units in brackets": lambda cells: lines(
        renamed(cells, lambda name: TITLES.get(name, name))
    ).encode(),
    "a row of units below the names": lambda cells: lines(units_below(cells)).encode(),
    "gzip": lambda cells: gzip.compress(lines(cells).encode()),
    "Zstandard": lambda cells: zstd.compress(lines(cells).encode()),
    "xz": lambda cells: lzma.compress(lines(cells).encode()),
}


def written(path: Path, cells: Cells, way: str) -> Path:
    """A table in a file, written in one of the ways; a symbolic link to it under the way of that name."""
    if way == "symbolic link":
        target = path.with_name(f"linked-{path.name}")
        target.write_bytes(WAYS["commas"](cells))
        path.symlink_to(target.name)
    else:
        path.write_bytes(WAYS[way](cells))
    return path


PROPERTIES = (*WAYS, "symbolic link")
