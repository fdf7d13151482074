"""The surveyed points of a check as a CSV, a row a point."""

from __future__ import annotations

import csv
from pathlib import Path

from furrowmap.core.checking.check import Check
from furrowmap.core.checking.point_check import COLUMNS
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.csv_cells import cell


def write_check_table(path: Path, check: Check) -> None:
    """Write the rows as a CSV, in place of an older file.

    Raises:
        OSError: if it cannot be written.
    """
    with atomic_output(path) as unfinished, unfinished.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows({name: cell(value) for name, value in point.row().items()} for point in check.points)
