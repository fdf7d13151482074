"""From clouds to one clean cloud, as COPC."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np
from pyproj import CRS

from furrowmap.core.pointclouds.cleaning import Cleaning, cleaned
from furrowmap.core.pointclouds.clouds import Clouds, box_in, no_points_error, open_clouds
from furrowmap.core.readers.las.gps_time import TimeKind
from furrowmap.core.readers.las.survey import Survey
from furrowmap.core.surfaces.cloth import require_cloth
from furrowmap.core.values.clock import las_time_to_utc
from furrowmap.core.values.crs_name import name_of
from furrowmap.core.values.errors import InputError, Notice, RefusedError, UsageError
from furrowmap.core.values.json_text import plain
from furrowmap.core.values.progress import Progress, silent
from furrowmap.core.values.record_spool import RecordArray
from furrowmap.exporters.cloud.file import CopcFormat, las_wkt
from furrowmap.exporters.cloud.points import RETURNS, PointBatch
from furrowmap.exporters.cloud.writer import CopcWriter
from furrowmap.exporters.files.atomic import refuse_existing
from furrowmap.exporters.files.file_records import file_records
from furrowmap.exporters.files.provenance import Origin

FINEST_M: Final = 1e-4
"""Steps of coordinates; in a 32-bit number they reach 214 km."""
USUAL_M: Final = 1e-3
NO_TIME: Final = float(las_time_to_utc(0.0))
"""UTC of what LAS counts as 0, which stands for no time."""


@dataclass(frozen=True)
class CleanSettings:
    """What is asked for.

    Attributes:
        cleaning: of the points.
        box_crs: of its box, if that is another one than the cloud's.
        crs: of files that state none.
        dst_crs: of the cloud; None for the files' own.
    """

    cleaning: Cleaning = field(default_factory=Cleaning)
    box_crs: CRS | None = None
    crs: CRS | None = None
    dst_crs: CRS | None = None


def write_clean_cloud(
    paths: Sequence[Path],
    target: Path,
    settings: CleanSettings,
    *,
    overwrite: bool = False,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Make one COPC file of clouds, whole or not at all.

    Args:
        paths: of LAS, LAZ or COPC files.
        target: the file.
        settings: what is asked for.
        overwrite: replace what is there.
        progress: is told of the stages.

    Returns:
        Inputs, CRS, parameters, figures and warnings, as they are told with --json.

    Raises:
        UsageError: if the target is no name of a COPC file.
        InputError: if a cloud cannot be read, their CRS do not fit, or no point is left.
        RefusedError: if there is a file already, or it is one of the clouds.
        OSError: if the file cannot be written.
    """
    _refuse_target(target, paths, overwrite=overwrite)
    if settings.cleaning.ground == "csf":
        require_cloth()
    clouds = open_clouds(paths, settings.crs, settings.dst_crs)
    box = box_in(clouds, settings.cleaning.box, settings.box_crs)
    cleaning = Cleaning(**{**vars(settings.cleaning), "box": box})
    inputs = [file_records([path], path.parent, progress)[0] for path in paths]
    surveys: list[Survey] = []
    told = _Told()
    target.parent.mkdir(parents=True, exist_ok=True)
    points = cleaned(clouds, cleaning, target.parent, surveys.append, progress)
    with closing(points):
        first = next((records for records in points if len(records)), None)
        if first is None:
            raise no_points_error(clouds, box)
        east, north, up = (np.floor(first["xyz_m"][0] / 1000.0) * 1000.0).tolist()
        coloured = any("red" in file.dimensions for file in clouds.files)
        kind = CopcFormat(
            las_wkt(clouds.crs), (east, north, up), _scale_m(clouds), colour=coloured, week_time=clouds.week_times
        )
        with CopcWriter(target, kind) as writer:
            for records in _rest(first, points):
                told.see(records)
                no_time = 0.0 if clouds.week_times else NO_TIME
                writer.append(_batch(records, (east, north, up), no_time, coloured=coloured))
            origin = Origin(
                "points of clouds, cleaned",
                inputs=[(record.name, record.sha256) for record in inputs],
                span_s=None if clouds.week_times else told.span_s,
                parameters={name: str(value) for name, value in _parameters(cleaning).items() if value is not None},
            )
            summary = writer.close(progress, description=origin.text)
    notices = [*clouds.notices, *(notice for survey in surveys for notice in survey.notices()), *told.notices(clouds)]
    return dict(
        plain(
            {
                "furrowmap": version("furrowmap"),
                "inputs": [
                    {"name": record.name, "format": file.format, "points": file.points, "sha256": record.sha256}
                    for record, file in zip(inputs, clouds.files, strict=True)
                ],
                "crs": name_of(clouds.crs),
                "parameters": _parameters(cleaning),
                "figures": {
                    "points_read": clouds.points,
                    "points": summary.points,
                    "points_by_class": {str(number): count for number, count in summary.points_by_class.items()},
                },
                "low_m": summary.low_m,
                "high_m": summary.high_m,
                "warnings": list(dict.fromkeys(notices)),
            }
        )
    )


@dataclass
class _Told:
    """What is to be said of the points that went by.

    Attributes:
        points: their number.
        timeless: those without a time that is UTC.
        unnumbered: those whose return number or number of returns was 0.
        span_s: earliest and latest time.
    """

    points: int = 0
    timeless: int = 0
    unnumbered: int = 0
    span_s: tuple[float, float] | None = None

    def see(self, records: RecordArray) -> None:
        self.points += len(records)
        timed = records["t_s"][np.isfinite(records["t_s"])]
        self.timeless += len(records) - len(timed)
        self.unnumbered += int(np.count_nonzero((records["return_number"] == 0) | (records["returns"] == 0)))
        if len(timed):
            first, last = self.span_s or (np.inf, -np.inf)
            self.span_s = min(first, float(timed.min())), max(last, float(timed.max()))

    def notices(self, clouds: Clouds) -> Iterator[Notice]:
        """What the file does not hold of what the clouds did."""
        if not clouds.week_times and any(file.clock.kind is TimeKind.WEEK for file in clouds.files):
            text = (
                f"{self.timeless:,} of {self.points:,} points have times that count from the beginning of a week that "
                "no file names, or none; their time is 0 in the cloud written."
            )
            yield Notice("times-of-week-lost", text)
        elif self.timeless:
            text = f"{self.timeless:,} of {self.points:,} points have no time; it is 0 in the cloud written."
            yield Notice("times-none", text)
        if self.unnumbered:
            text = f"{self.unnumbered:,} points had return number 0, or 0 returns; it is 1 in the cloud written."
            yield Notice("returns-zero", text)
        lost = {dimension.name for file in clouds.files for dimension in file.extra}
        lost |= {"nir" for file in clouds.files if "nir" in file.dimensions}
        if lost:
            yield Notice("dimensions-left-out", f"The cloud written is without {', '.join(sorted(lost))}.")


def _rest(first: RecordArray, others: Iterator[RecordArray]) -> Iterator[RecordArray]:
    yield first
    yield from (records for records in others if len(records))


def _batch(records: RecordArray, origin_m: tuple[float, float, float], no_time: float, *, coloured: bool) -> PointBatch:
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


def _scale_m(clouds: Clouds) -> float:
    """A millimetre, or finer where a file is."""
    if clouds.change is not None or clouds.unit_m != 1.0:
        return USUAL_M
    return max(FINEST_M, min([USUAL_M, *(step for file in clouds.files for step in file.header.scale)]))


def _parameters(cleaning: Cleaning) -> dict[str, Any]:
    return {
        "box": list(cleaning.box) if cleaning.box is not None else None,
        "without_classes": sorted(cleaning.without) or None,
        "every": cleaning.every,
        "outliers": cleaning.outliers,
        "drop_noise": cleaning.drop_noise,
        "ground": cleaning.ground,
        "voxel_m": cleaning.voxel_m,
    }


def _refuse_target(target: Path, paths: Sequence[Path], *, overwrite: bool) -> None:
    """Keep what is there.

    Raises:
        UsageError: if the target is no name of a COPC file.
        RefusedError: if it may not be replaced.
        InputError: if it is a folder.
    """
    if not target.name.lower().endswith(".laz"):
        raise UsageError(
            f"{target} is no name of a COPC file.",
            "Programs know COPC by .copc.laz, and other clouds are not written.",
            f"Name it {target.name.split('.')[0] or 'cloud'}.copc.laz.",
            code="usage",
        )
    if target.is_dir():
        raise InputError(
            f"{target} is a folder.", "The cloud is one file.", "Choose another name with -o.", code="output-is-folder"
        )
    if any(target.exists() and path.exists() and target.samefile(path) for path in paths):
        raise RefusedError(
            f"{target} is one of the clouds that are read.",
            "It would be replaced by what is left of it.",
            "Choose another name with -o.",
            code="output-is-input",
        )
    refuse_existing(target, overwrite=overwrite)
