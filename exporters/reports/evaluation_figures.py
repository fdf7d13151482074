"""The results of GNSS evaluations as figures and as tables."""

import math
from collections.abc import Iterator, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np

from furrowmap.core.accuracy.evaluation import DEFINITIONS, QUANTILES, ErrorStatistics, Evaluation
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.gnss import Fix
from furrowmap.exporters.files.csv_cells import write_csv

EPOCH_COLUMNS: Final = (
    "service", "time", "t_s", "x_m", "y_m", "z_m", "error_2d_m", "error_3d_m", "along_m", "across_m", "speed_mps",
    "fix", "reference_fix", "interpolated", "sigma_e_m", "sigma_n_m", "sigma_h_m", "age_s", "outlier",
)  # fmt: skip


def evaluation_figures(evaluations: Mapping[str, Evaluation]) -> dict[str, Any]:
    """All figures but those of the epochs, by service or receiver, against one reference; m with four decimals."""
    return {
        "furrowmap": version("furrowmap"),
        "definitions": DEFINITIONS,
        "services": [{"name": name, **_figures(found)} for name, found in evaluations.items()],
    }


def table_rows(evaluations: Mapping[str, Evaluation]) -> Iterator[dict[str, Any]]:
    """A row for each service, fix type ("all" for all epochs) and quantity."""
    for service, found in evaluations.items():
        for fix, table in found.tables.items():
            for quantity, row in table.items():
                yield {
                    "service": service,
                    "fix": fix,
                    "quantity": quantity,
                    "epochs": row.n,
                    "average_m": row.average_m,
                    "standard_deviation_m": row.standard_deviation_m,
                    "rmse_m": row.rmse_m,
                    "p95_m": row.percentiles_m[QUANTILES.index(0.95)],
                    "greatest_m": row.greatest_m,
                }


def write_table(path: Path, evaluations: Mapping[str, Evaluation]) -> None:
    """Write the rows of :func:`table_rows` as CSV; unknown values are empty."""
    rows = list(table_rows(evaluations))
    cells = ([_cell(value) if isinstance(value, float) else value for value in row.values()] for row in rows)
    write_csv(path, rows[0], cells)


def _figures(found: Evaluation) -> dict[str, Any]:
    matched = found.matched
    log = found.continuity
    return {
        "test": {"file": found.test, "service": found.service or None},
        "reference": {
            "file": found.reference,
            "service": found.reference_service or None,
            "share_by_fix": _rounded(found.reference_share_by_fix),
        },
        "antenna_offset_m": found.antenna_offset_m,
        "epochs": {
            "in_test": log.epochs,
            "compared": len(matched),
            "interpolated": int(matched.interpolated.sum()),
            "outside_reference": matched.outside,
            "in_gaps_of_reference": matched.in_gaps,
            "without_heading": matched.without_heading,
            "reference_not_fixed": found.left_out_by_reference_fix,
            "outliers": int(found.outlier.sum()),
            "outlier_share": round(float(found.outlier.mean()), 4),
        },
        "interpolation": {
            "longest_step_s": round(matched.max_gap_s, 3),
            "every_other_epoch_median_m": round(float(matched.interpolation_m[0]), 4),
            "every_other_epoch_p95_m": round(float(matched.interpolation_m[1]), 4),
        },
        "tables": {kind: {name: _statistics(row) for name, row in rows.items()} for kind, rows in found.tables.items()},
        "stated_sigmas": _rounded(found.within_sigmas) if found.within_sigmas else None,
        "test_ahead_s": (
            {"estimate": round(found.time_ahead_s[0], 4), "standard_error": round(found.time_ahead_s[1], 4)}
            if found.time_ahead_s
            else None
        ),
        "continuity": {
            "first": iso_utc(log.first_s),
            "last": iso_utc(log.last_s),
            "interval_s": round(log.interval_s, 3),
            "availability": round(log.availability, 4),
            "share_by_fix": _rounded(log.share_by_fix),
            "first_by_fix_s": _rounded(log.first_by_fix_s, 2),
            "gaps": log.gaps,
            "longest_gap_s": round(log.longest_gap_s, 3),
            "all_gaps_s": round(log.all_gaps_s, 3),
            "gap_list": [{"begin": iso_utc(gap.begin_s), "length_s": round(gap.length_s, 3)} for gap in log.gap_list],
            "age_of_corrections": _rounded(vars(log.age), 2) if log.age else None,
        },
        "warnings": found.notices,
    }


def write_epochs(path: Path, evaluations: Mapping[str, Evaluation]) -> None:
    """Write a row for each compared epoch of each service; unknown values are empty."""
    rows = ([service, *row] for service, found in evaluations.items() for row in _epochs(found))
    write_csv(path, EPOCH_COLUMNS, rows)


def _epochs(found: Evaluation) -> Iterator[list[Any]]:
    matched = found.matched
    error = found.matched.error_m
    lengths = np.column_stack([error, np.hypot(error[:, 0], error[:, 1]), np.sqrt(np.sum(error**2, axis=1)),
                               matched.along_m, matched.across_m, matched.speed_mps])  # fmt: skip
    labels = {int(fix): fix.label for fix in Fix}
    for k, t_s in enumerate(matched.t_s.tolist()):
        fixes = labels[int(found.fix[k])], labels[int(matched.reference_fix[k])], int(matched.interpolated[k])
        sigmas = map(_cell, [*found.sigma_m[k, :3].tolist(), float(found.age_s[k])])
        yield [iso_utc(t_s), repr(t_s), *map(_cell, lengths[k].tolist()), *fixes, *sigmas, int(found.outlier[k])]


def _cell(value: float) -> str:
    return f"{value:.4f}" if math.isfinite(value) else ""


def _rounded(values: dict[str, float], digits: int = 4) -> dict[str, float]:
    return {name: round(float(value), digits) for name, value in values.items()}


def _statistics(row: ErrorStatistics) -> dict[str, Any]:
    percentiles = {f"p{100 * q:.0f}_m": value for q, value in zip(QUANTILES, row.percentiles_m, strict=True)}
    metres = {
        "average_m": row.average_m,
        "standard_deviation_m": row.standard_deviation_m,
        "rmse_m": row.rmse_m,
        **percentiles,
        "greatest_m": row.greatest_m,
    }
    return {"n": row.n, **_rounded(metres)}
