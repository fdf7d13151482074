"""Cleaning clouds: from LAS, LAZ or COPC files to one COPC file."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np

from furrowmap.core.pointclouds.cleaning import clean_points
from furrowmap.core.pointclouds.cleaning_steps import Cleaning
from furrowmap.core.pointclouds.joined_clouds import Clouds, no_points_error
from furrowmap.core.readers.las.cloud import Box, Survey
from furrowmap.core.readers.las.point_records import TimeKind
from furrowmap.core.runtime.errors import InputError, Notice, RefusedError, UsageError
from furrowmap.core.runtime.json_text import plain
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.runtime.record_spool import RecordArray
from furrowmap.core.surfaces.ground_filter import require_cloth
from furrowmap.core.values.clock import las_time_to_utc
from furrowmap.core.values.crs import name_of
from furrowmap.exporters.cloud.copc_file import CopcFormat, las_wkt
from furrowmap.exporters.cloud.point_batches import RETURNS, PointBatch
from furrowmap.exporters.cloud.writer import CopcSummary, CopcWriter
from furrowmap.exporters.files.atomic import make_folder, refuse_existing
from furrowmap.exporters.files.file_records import FileRecord
from furrowmap.exporters.files.provenance import Origin
from furrowmap.settings import CleanSettings
from furrowmap.workflows.clouds.inputs import area_records, box_to_use, input_records, input_rows, open_inputs

MIN_SCALE_M: Final = 1e-4
"""Steps of coordinates; in a 32-bit number they reach 214 km."""
USUAL_SCALE_M: Final = 1e-3
NO_TIME: Final = float(las_time_to_utc(0.0))
"""UTC of what LAS counts as 0, which stands for no time."""


def clean(
    clouds: Sequence[str | Path],
    out: str | Path,
    settings: CleanSettings = CleanSettings(),
    *,
    overwrite: bool = False,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Merge, clean, classify and thin clouds into one COPC file.

    Args:
        clouds: LAS, LAZ or COPC files.
        out: the file to write, whole or not at all.

    Returns:
        Inputs, CRS, parameters, figures and warnings: the answer of `furrowmap cloud --json`.

    Raises:
        UsageError: if `out` does not end in .laz.
        InputError: if a cloud cannot be read, the CRS do not fit together, or no point is left.
        RefusedError: if the file exists, or is one of the clouds.
    """
    paths = [Path(path) for path in clouds]
    target = Path(out)
    refuse_target(target, paths, overwrite=overwrite)
    if settings.cleaning.ground == "csf":
        require_cloth()
    opened = open_inputs(clouds, settings)
    box, far = box_to_use(opened, settings.cleaning.box, settings.box_crs, progress)
    cleaning = replace(settings.cleaning, box=box)
    inputs = input_records(opened, progress)
    make_folder(target.parent)
    parameters = _parameters(cleaning, opened)
    surveys = list[Survey]()
    with closing(clean_points(opened, cleaning, target.parent, surveys.append, progress)) as points:
        origin = ("points of clouds, cleaned", [*inputs, *area_records(opened)], parameters)
        summary, lost = write_records(opened, points, target, box, origin, progress)
    notices = [notice for survey in surveys for notice in survey.notices()]
    account = {
        "furrowmap": version("furrowmap"),
        "inputs": input_rows(opened, inputs),
        "crs": name_of(opened.crs),
        "parameters": parameters,
        "figures": {
            "points_read": opened.points,
            "points": summary.points,
            "points_by_class": {str(number): count for number, count in summary.points_by_class.items()},
        },
        "low_m": summary.low_m,
        "high_m": summary.high_m,
        "warnings": list(dict.fromkeys([*opened.notices, *notices, *lost, *far])),
    }
    return dict(plain(account))


def write_records(
    clouds: Clouds,
    points: Iterator[RecordArray],
    target: Path,
    box: Box | None,
    origin: tuple[str, Sequence[FileRecord], Mapping[str, Any]],
    progress: Progress,
) -> tuple[CopcSummary, list[Notice]]:
    """Write points of clouds, in batches, into a COPC file; a summary, and warnings about attributes it does not keep.

    `origin`: what the points are, the files they are from, and the parameters, for the file's description.
    """
    lost = _LostAttributes()
    first = next((records for records in points if len(records)), None)
    if first is None:
        raise no_points_error(clouds, box)
    east, north, up = (np.floor(first["xyz_m"][0] / 1000.0) * 1000.0).tolist()
    coloured = any("red" in file.dimensions for file in clouds.files)
    no_time = 0.0 if clouds.week_times else NO_TIME
    kind = CopcFormat(
        las_wkt(clouds.crs), (east, north, up), scale_of(clouds), colour=coloured, week_time=clouds.week_times
    )
    with CopcWriter(target, kind) as writer:
        for records in chain([first], (more for more in points if len(more))):
            lost.add(records)
            writer.append(batch_of(records, (east, north, up), no_time, coloured=coloured))
        what, inputs, parameters = origin
        digests = [(record.name, record.sha256) for record in inputs]
        span_s = None if clouds.week_times else lost.span_s
        described = Origin(what, inputs=digests, span_s=span_s, parameters=parameters)
        summary = writer.close(progress, description=described.text)
    return summary, list(lost.notices(clouds))


@dataclass
class _LostAttributes:
    """Counts of what points lose in the file."""

    points: int = 0
    timeless: int = 0
    unnumbered: int = 0
    span_s: tuple[float, float] | None = None

    def add(self, records: RecordArray) -> None:
        self.points += len(records)
        timed = records["t_s"][np.isfinite(records["t_s"])]
        self.timeless += len(records) - len(timed)
        self.unnumbered += int(np.count_nonzero((records["return_number"] == 0) | (records["returns"] == 0)))
        if len(timed):
            first, last = self.span_s or (np.inf, -np.inf)
            self.span_s = min(first, float(timed.min())), max(last, float(timed.max()))

    def notices(self, clouds: Clouds) -> Iterator[Notice]:
        """Warnings about attributes of the clouds that the file does not keep."""
        if not clouds.week_times and any(file.clock is TimeKind.WEEK for file in clouds.files):
            yield Notice("times-of-week-lost", timeless=self.timeless, points=self.points)
        elif self.timeless:
            yield Notice("times-none", timeless=self.timeless, points=self.points)
        if self.unnumbered:
            yield Notice("returns-zero", unnumbered=self.unnumbered)
        lost = {dimension.name for file in clouds.files for dimension in file.extra}
        lost |= {"nir" for file in clouds.files if "nir" in file.dimensions}
        if lost:
            yield Notice("dimensions-left-out", lost=", ".join(sorted(lost)))


def batch_of(
    records: RecordArray, origin_m: tuple[float, float, float], no_time: float, *, coloured: bool
) -> PointBatch:
    """Points as a writer takes them; `no_time` where they have none."""
    return PointBatch(
        xyz_m=records["xyz_m"] - np.array(origin_m),
        t_s=np.nan_to_num(records["t_s"], nan=no_time),
        intensity=records["intensity"],
        return_number=np.clip(records["return_number"], 1, RETURNS),
        returns=np.clip(records["returns"], 1, RETURNS),
        classification=records["classification"],
        point_source_id=records["point_source_id"],
        rgb=records["rgb"] if coloured else None,
    )


def scale_of(clouds: Clouds) -> float:
    """A millimetre, or finer where a file is."""
    if not clouds.as_recorded:
        return USUAL_SCALE_M
    return max(MIN_SCALE_M, min([USUAL_SCALE_M, *(step for file in clouds.files for step in file.header.scale)]))


def _parameters(cleaning: Cleaning, clouds: Clouds) -> dict[str, Any]:
    return {
        "box": list(cleaning.box) if cleaning.box is not None else None,
        "within": clouds.area.path.name if clouds.area is not None else None,
        "without_classes": sorted(cleaning.without) or None,
        "every": cleaning.every,
        "outliers": cleaning.outliers,
        "drop_noise": cleaning.drop_noise,
        "ground": cleaning.ground,
        "voxel_m": cleaning.voxel_m,
    }


def refuse_target(target: Path, paths: Sequence[Path], *, overwrite: bool) -> None:
    """Refuse a target that is no .laz file, is a folder or one of the clouds, or may not be replaced."""
    if not target.name.lower().endswith(".laz"):
        example = f"{target.name.split('.')[0] or 'cloud'}.copc.laz"
        raise UsageError("usage.suffix", path=target, suffixes=(".copc.laz",), example=example)
    if target.is_dir():
        raise InputError("output-is-folder", target=target)
    if any(target.exists() and path.exists() and target.samefile(path) for path in paths):
        raise RefusedError("output-is-input", target=target)
    refuse_existing(target, overwrite=overwrite)
