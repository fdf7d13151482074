"""The surveyed points of a check as a CSV, a row a point."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from furrowmap.core.checking.check import Check
from furrowmap.core.checking.paired_points import PAIR_COLUMNS as PAIR_COLUMNS
from furrowmap.core.checking.paired_points import PairedPoints
from furrowmap.core.checking.point_check import CHECK_COLUMNS
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.csv_cells import cell


def write_check_table(path: Path, check: Check) -> None:
    """Write the points of a check as a CSV, in place of an older file.

    Raises:
        OSError: if it cannot be written.
    """
    _write(path, CHECK_COLUMNS, [point.row() for point in check.points])


def write_pairs_table(path: Path, pairs: PairedPoints) -> None:
    """Write paired points as a CSV, in place of an older file.

    Raises:
        OSError: if it cannot be written.
    """
    _write(path, PAIR_COLUMNS, pairs.rows())


def _write(path: Path, columns: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows as a CSV."""
    with atomic_output(path) as unfinished, unfinished.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows({name: cell(value) for name, value in row.items()} for row in rows)
