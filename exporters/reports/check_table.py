"""The surveyed points of a check as a CSV, a row a point."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any, Final

import numpy as np

from furrowmap.core.checking.check import Check
from furrowmap.core.checking.point_check import PointCheck
from furrowmap.exporters.files.atomic import atomic_output

COLUMNS: Final = (
    "name", "e_m", "n_m", "h_m", "error_e_m", "error_n_m", "error_h_m", "returns", "slope", "spread_m", "swaths",
    "why_not",
)  # fmt: skip


def point_rows(check: Check) -> list[dict[str, Any]]:
    """A row for each point; None for unknown values."""
    return [_row(point) for point in check.points]


def write_check_table(path: Path, check: Check) -> None:
    """Write the rows as a CSV; an older file is replaced.

    Raises:
        OSError: if it cannot be written.
    """
    with atomic_output(path) as unfinished, unfinished.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(point_rows(check))


def _row(point: PointCheck) -> dict[str, Any]:
    error = [_known(value, 4) for value in point.error_m.tolist()]
    values = (
        point.name, *(round(value, 4) for value in point.surveyed_m), *error, point.returns, _known(point.slope, 3),
        _known(point.swaths.spread_m, 4), len(point.swaths.height_m), point.why_not,
    )  # fmt: skip
    return dict(zip(COLUMNS, values, strict=True))


def _known(value: float, digits: int) -> float | None:
    return round(value, digits) if np.isfinite(value) else None
