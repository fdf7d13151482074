"""`furrowmap fields`: the worked ground of each field in ISO 11783-10 task data."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import click

import furrowmap
from furrowmap.cli.command_options import FILE, command, option, output, overwrite
from furrowmap.cli.console import Console
from furrowmap.cli.result_tables import aligned
from furrowmap.core.runtime.errors import printable

_FIELD_COLUMNS: Final = (
    ("task", "task", ""),
    ("field", "field", ""),
    ("passes", "passes", ""),
    ("worked_area_m2", "worked ha", "ha"),
    ("overlap_area_m2", "overlap ha", "ha"),
    ("missed_area_m2", "missed ha", "ha"),
    ("logged_swept_area_m2", "length × width ha", "ha"),
    ("counted_area_m2", "counter ha", "ha"),
    ("boundary_area_m2", "field ha", "ha"),
)


@command(
    "Compute the worked ground of each field in task data (ISOXML).",
    "furrowmap fields TASKDATA -o fields.gpkg",
    "furrowmap fields harvest.zip --width 9 --json",
)
@click.argument("taskdata", type=FILE)
@output("FILE", "Write passes, overlaps and misses to this GeoPackage.", "Worked ground")
@option("--width", "M", "Working width in metres [default: the largest in the logs].", "width_m", label="Working width")
@option("--task", "ID", "Process only the task with this identifier or name.")
@option(
    "--crs", "CRS", "Projected CRS, such as EPSG:6677 [default: chosen from the location].", label="CRS of the output"
)
@overwrite("Replace an existing FILE.")
def fields(console: Console, taskdata: Path, output: Path | None, **options: Any) -> None:
    """Compute the worked ground from a machine's own log. TASKDATA is an ISO 11783-10 folder or a ZIP archive of it.

    No scanner is needed: the time logs hold position, working state and width. Compare the machine's area counter with
    "length × width": neither subtracts overlap.
    """
    with console.work() as progress:
        found = furrowmap.fields(taskdata, output, **options, progress=progress)
    console.warn_all(found.warnings)
    answer = {"crs": found.crs, "output": output, "fields": found.rows, "warnings": found.warnings}
    console.answer(answer, _table(found.rows))


def _table(rows: Sequence[dict[str, Any]]) -> str:
    lines = [[name for _, name, _ in _FIELD_COLUMNS]]
    return aligned(lines + [[_cell(row[key], unit) for key, _, unit in _FIELD_COLUMNS] for row in rows], left=2)


def _cell(value: Any, unit: str) -> str:
    if value is None:
        return "unknown"
    return f"{value / 10_000:.3f}" if unit == "ha" else printable(str(value))
