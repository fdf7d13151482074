"""GNSS logs judged by a reference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from furrowmap.core.evaluation.evaluation import Evaluation
from furrowmap.core.evaluation.receivers import evaluate_logs
from furrowmap.core.values.progress import Progress, silent
from furrowmap.exporters.reports.evaluation_page import write_evaluation

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class EvaluationSettings:
    """How a log is compared with a reference.

    Attributes:
        antenna_offset_m: forward, left, up from the antenna of the reference to that of the log, on one vehicle.
        fixed_reference_only: leave out epochs at which the reference is not fixed.
        max_gap_s: maximum interpolation gap of the reference; None for 1.5 of its intervals.
        date: UTC date (YYYY-MM-DD) of the first position, for logs without dates.
    """

    antenna_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    fixed_reference_only: bool = False
    max_gap_s: float | None = None
    date: str | None = None


def evaluate_log(
    test: str | Path,
    reference: str | Path,
    out: str | Path | None = None,
    settings: EvaluationSettings = EvaluationSettings(),
    *,
    overwrite: bool = False,
    progress: Progress = silent,
) -> Evaluation:
    """Compare the positions of a GNSS log with those of a reference at the same instants.

    Average, standard deviation and RMSE in 3D, 2D, X, Y and Z after Nakagawa et al., of all epochs and by kind of fix.

    Args:
        test: the log.
        reference: another log of the same drive, a trajectory, or "LAT,LON,HEIGHT" of an antenna at rest.
        out: folder for evaluation.json, evaluation.html and epochs.csv; nothing is written without it.
        settings: antenna offset, reference quality, interpolation, date.
        overwrite: replace an earlier evaluation in the folder.
        progress: is called with each stage.

    Raises:
        InputError: if a log cannot be read, has no positions, or shares no time with the other.
        RefusedError: if the folder holds an evaluation.
    """
    found = evaluate_logs(
        Path(test),
        str(reference),
        date=settings.date,
        antenna_offset_m=settings.antenna_offset_m,
        max_gap_s=settings.max_gap_s,
        fixed_reference_only=settings.fixed_reference_only,
        progress=progress,
    )
    if out is not None:
        write_evaluation(Path(out), found, overwrite=overwrite)
    return found


def evaluate_gnss(
    logs: Mapping[str, str | Path], reference: str | Path, settings: EvaluationSettings = EvaluationSettings()
) -> pd.DataFrame:
    """Compare several GNSS services, such as CLAS and MADOCA, with one reference.

    Args:
        logs: a log for each service, by a name for the table: ``{"CLAS": "clas.ubx", "MADOCA": "madoca.sbf"}``.
        reference: as in `evaluate_log`.
        settings: the same for all logs.

    Returns:
        One row a service, kind of fix ("all" for all epochs) and quantity (3D, 2D, X, Y, Z, along, across), with the
        columns `service`, `fix`, `quantity`, `epochs`, `average_m`, `standard_deviation_m`, `rmse_m`, `p95_m`,
        `greatest_m`.

    Raises:
        InputError: as `evaluate_log`.
    """
    import pandas as pd

    rows = [
        {
            "service": service,
            "fix": fix,
            "quantity": quantity,
            "epochs": row.n,
            "average_m": row.average_m,
            "standard_deviation_m": row.standard_deviation_m,
            "rmse_m": row.rmse_m,
            "p95_m": row.percentiles_m[3],
            "greatest_m": row.greatest_m,
        }
        for service, log in logs.items()
        for fix, table in evaluate_log(log, reference, settings=settings).tables.items()
        for quantity, row in table.items()
    ]
    return pd.DataFrame(rows)
