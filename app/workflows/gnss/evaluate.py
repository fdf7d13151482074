"""GNSS logs judged by a reference."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from furrowmap.core.accuracy.evaluation import Evaluation
from furrowmap.core.accuracy.receiver_logs import evaluate_logs
from furrowmap.core.runtime.errors import MissingExtraError
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.exporters.reports.evaluation_figures import table_rows
from furrowmap.exporters.reports.evaluation_page import write_evaluation
from furrowmap.settings import EvaluationSettings

if TYPE_CHECKING:
    import pandas as pd


def evaluate_gnss(
    logs: Mapping[str, str | Path],
    reference: str | Path,
    out: str | Path | None = None,
    settings: EvaluationSettings | Mapping[str, EvaluationSettings] = EvaluationSettings(),
    *,
    overwrite: bool = False,
    progress: Progress = silent,
) -> dict[str, Evaluation]:
    """Compare the positions of GNSS services or receivers with those of one reference at the same instants.

    Average, standard deviation and RMSE in 3D, 2D, X, Y and Z after Nakagawa et al., of all epochs and by kind of fix.

    Args:
        logs: a log for each service, by a name for the tables: ``{"CLAS": "clas.ubx", "MADOCA": "madoca.sbf"}``.
        reference: another log of the same drive, a trajectory, or "LAT,LON,HEIGHT" of an antenna at rest.
        out: folder for evaluation.json, evaluation.html, evaluation.gpkg, services.csv and epochs.csv; nothing is
            written without it.

    Returns:
        The evaluation of each log, by its name.

    Raises:
        InputError: if a log cannot be read, has no positions, or shares no time with the reference.
        RefusedError: if the folder holds an evaluation.
        KeyError: if the settings of a log are missing.
    """
    found = {}
    for name, log in logs.items():
        own = settings if isinstance(settings, EvaluationSettings) else settings[name]
        found[name] = evaluate_logs(
            Path(log),
            str(reference),
            date=own.date,
            antenna_offset_m=own.antenna_offset_m,
            max_gap_s=own.max_gap_s,
            fixed_reference_only=own.fixed_reference_only,
            progress=progress,
        )
    if out is not None:
        write_evaluation(Path(out), found, overwrite=overwrite)
    return found


def evaluation_table(evaluations: Mapping[str, Evaluation]) -> pd.DataFrame:
    """The statistics of several services as one table.

    Args:
        evaluations: as :func:`evaluate_gnss` returns them.

    Returns:
        One row a service, kind of fix ("all" for all epochs) and quantity (3D, 2D, X, Y, Z, along, across), with the
        columns `service`, `fix`, `quantity`, `epochs`, `average_m`, `standard_deviation_m`, `rmse_m`, `p95_m`,
        `greatest_m`.

    Raises:
        InputError: if pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError:
        raise MissingExtraError("pandas", "notebooks", Text("Tables of layers and figures are made by it.")) from None
    return pd.DataFrame(list(table_rows(evaluations)))
