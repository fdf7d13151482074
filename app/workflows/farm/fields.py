"""The ground worked in each field of ISO 11783-10 task data."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from furrowmap.core.coverage.task_work import task_works
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.exporters.files.atomic import refuse_existing
from furrowmap.exporters.vectors.task_fields import task_figures, write_fields


@dataclass(frozen=True)
class Fields:
    """The ground worked in the tasks of a set of task data, by the name of the map's CRS.

    `rows` are figures of each task by name, None where unknown; `pandas.DataFrame(rows)` is a table.
    """

    crs: str
    rows: list[dict[str, Any]]
    warnings: tuple[Notice, ...]


def fields(
    taskdata: str | Path,
    out: str | Path | None = None,
    *,
    crs: str | None = None,
    width_m: float | None = None,
    task: str | None = None,
    overwrite: bool = False,
    progress: Progress = silent,
) -> Fields:
    """Compute what a machine worked from its own log.

    Args:
        taskdata: an ISO 11783-10 folder, or a .zip of it.
        out: GeoPackage for passes, overlaps, misses and fields; nothing is written without it.
        crs: of the map, such as "EPSG:6677"; one that fits the place by default.
        width_m: working width; the widest that the logs show by default.
        task: id or name of the only task wanted.

    Raises:
        InputError: if the task data cannot be read, have no positions, or do not state a width.
        RefusedError: if the CRS does not fit the place, or the GeoPackage exists.
    """
    if out is not None:
        refuse_existing(Path(out), overwrite=overwrite)
    found = task_works(Path(taskdata), crs=crs, width_m=width_m, only=task, progress=progress)
    if out is not None:
        write_fields(Path(out), found)
    notices = dict.fromkeys([*found.notices, *(notice for work in found.works for notice in work.notices)])
    return Fields(found.frame.name, [task_figures(work) for work in found.works], tuple(notices))
