"""From a session to the folder of its products."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from types import TracebackType
from typing import Any, Final, Self

import msgspec
import numpy as np
import tomli_w

from furrowmap.core import pipeline
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.implement.saved import save_implement
from furrowmap.core.pointclouds.placed import PlacedScan
from furrowmap.core.session.opened import OpenSession, open_session
from furrowmap.core.surfaces.local_ground import GroundSampler
from furrowmap.core.values.clock import utc_to_las_time
from furrowmap.core.values.errors import RefusedError, printable
from furrowmap.core.values.json_text import plain
from furrowmap.core.values.progress import Progress, silent
from furrowmap.core.values.session import Session
from furrowmap.core.values.threads import using_threads
from furrowmap.core.work.field_surfaces import FieldPoints
from furrowmap.core.work.field_work import FieldWork
from furrowmap.core.work.run_result import RunResult
from furrowmap.core.work.sweep import pass_numbers
from furrowmap.exporters.cloud.chunk import Columns
from furrowmap.exporters.cloud.file import CopcFormat, las_wkt
from furrowmap.exporters.cloud.points import PointBatch
from furrowmap.exporters.cloud.writer import CopcSummary, CopcWriter
from furrowmap.exporters.exchange.stac import write_item
from furrowmap.exporters.files.file_records import FileRecord, file_records
from furrowmap.exporters.files.result_folder import (
    CLOUD,
    FIELD,
    ITEM,
    LEARNED,
    PAGE,
    REPORT,
    RUN_PRODUCTS,
    SESSION,
    STATES,
)
from furrowmap.exporters.files.staging import recover, staged_folder
from furrowmap.exporters.rasters.field_rasters import RasterFigures, write_rasters
from furrowmap.exporters.reports.report_page import write_page
from furrowmap.exporters.reports.run_report import run_origin, run_report, write_report
from furrowmap.exporters.vectors.geopackage import write_field
from furrowmap.exporters.vectors.states_table import write_states

SCALE_M: Final = 0.001
"""Resolution of the cloud's coordinates."""
MOST_PASSES: Final = 65_535
"""What a LAS file has numbers for."""


def write_products(
    session_file: Path, folder: Path, *, overwrite: bool = False, progress: Progress = silent
) -> dict[str, Any]:
    """Run a session and write its products into `folder`.

    Args:
        session_file: the session.
        folder: made if it is not there; products of the same session in it are replaced. That is a session of the
            same name with the same files, byte for byte: whoever tunes the mounting, the clock offset or the CRS and
            runs again replaces the earlier result.
        overwrite: replace products of another session, too.
        progress: is told of the stages.

    Returns:
        The content of `report.json`.

    Raises:
        FurrowmapError: if the session does not make a cloud, or the folder may not be written to.
    """
    start = perf_counter()
    opened = open_session(session_file)
    origin = _way_to(session_file, folder)
    _refuse_original(folder, session_file)
    inputs = None if overwrite else _refuse_foreign(folder, opened, progress)
    with staged_folder(folder) as staging, using_threads(opened.session.run.threads, by_default=True):
        made = _made(opened, staging, inputs, progress)
        found, summary = made.found, made.cloud
        told = run_origin(found, made.inputs)
        progress("writing layers", 0.0)
        laid_out = perf_counter()
        write_field(staging / FIELD, found.tally.poses, found.frame.wkt, found.work, found.frame.words, told)
        if found.work.states is not None:
            write_states(staging / STATES, found.work.states)
        if found.work.seen is not None:
            save_implement(staging / LEARNED, found.work.seen)
        write_page(staging / PAGE, found, staging / CLOUD, summary, made.rasters.swaths if made.rasters else None)
        laid_out = perf_counter() - laid_out
        (staging / SESSION).write_text(session_text(found.session, origin), encoding="utf-8")
        seconds = {**made.seconds, "layers": laid_out, "whole": perf_counter() - start}
        timings = found.timings_s | {stage: round(value, 3) for stage, value in seconds.items()}
        content = run_report(found, origin, summary, made.rasters, made.inputs, timings, _names(staging))
        report = write_report(staging / REPORT, content)
        write_item(staging / ITEM, report)
        return report


@dataclass(frozen=True)
class _Made:
    """What a run found out, and what is told of its cloud and its rasters; None where there are none."""

    found: RunResult
    inputs: list[FileRecord]
    cloud: CopcSummary | None = None
    rasters: RasterFigures | None = None
    seconds: dict[str, float] = field(default_factory=dict)


def _made(opened: OpenSession, staging: Path, inputs: list[FileRecord] | None, progress: Progress) -> _Made:
    """Run a session and write its cloud and its rasters; neither without a scanner."""
    with _Cloud(staging / CLOUD) as cloud, FieldPoints(staging) as land:
        found = pipeline.run(opened, _Both(cloud, land), progress)
        inputs = inputs or file_records(found.inputs, opened.file.resolve().parent, progress)
        if not found.session.recording.lidar:
            return _Made(found, inputs)
        origin = run_origin(found, inputs)
        begin = perf_counter()
        summary = cloud.finish(progress, found.work, f"{found.frame.words}\n{origin.text}".strip())
        written = perf_counter()
        rasters = write_rasters(staging, land, found, origin, progress)
        seconds = {"cloud": written - begin, "surfaces": perf_counter() - written}
        return _Made(found, inputs, summary, rasters, seconds)


def _names(staging: Path) -> list[str]:
    """The products that there are, or are about to be written beside them."""
    return [name for name in RUN_PRODUCTS if name in (REPORT, ITEM) or (staging / name).exists()]


class _Both:
    """The sink of a run whose points go into its cloud and its surfaces."""

    def __init__(self, cloud: _Cloud, land: FieldPoints) -> None:
        self._cloud, self._land = cloud, land

    def begin(self, frame: MapFrame, origin_m: tuple[float, float, float]) -> None:
        """Tell both the local origin."""
        self._cloud.begin(frame, origin_m)
        self._land.begin(origin_m)

    def add(self, placed: PlacedScan) -> None:
        """Give both the points of a scan."""
        self._cloud.add(placed)
        self._land.add(placed)


class _Cloud:
    """Writes the cloud of a run."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._writer: CopcWriter | None = None
        self._watch = GroundSampler()

    def __enter__(self) -> Self:
        return self

    def begin(self, frame: MapFrame, origin_m: tuple[float, float, float]) -> None:
        """Open the file, now that its CRS and local origin are known."""
        extra = (("scan", "uint32", "scan (revolution) number"),)
        kind = CopcFormat(las_wkt(frame.whole_crs), origin_m, SCALE_M, extra)
        self._writer = CopcWriter(self._path, kind).__enter__()

    def add(self, placed: PlacedScan) -> None:
        """Take the points of one scan."""
        assert self._writer is not None
        scan = placed.scan
        self._watch.add(placed.xyz_m, placed.kept)
        self._writer.append(
            PointBatch(
                placed.xyz_m,
                scan.t_s,
                intensity=scan.intensity,
                return_number=scan.return_number,
                returns=scan.returns,
                classification=placed.classification,
                extra={"scan": scan.number},
            )
        )

    def finish(self, progress: Progress, work: FieldWork, description: str) -> CopcSummary:
        """Sort, compress and write the points, each with its class and the pass in which it was measured."""
        assert self._writer is not None
        ground = self._watch.ground()

        # The few passes are turned into the points' time, not the many points into the passes'.
        passes = [replace(when, begin_s=_las(when.begin_s), end_s=_las(when.end_s)) for when in work.passes]

        def mark(points: Columns) -> None:
            ground.classify(points.x, points.y, points.z, SCALE_M, points.classification)
            if passes:
                points.point_source_id[:] = np.minimum(pass_numbers(passes, points.gps_time), MOST_PASSES)

        return self._writer.close(progress, mark, description)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._writer is not None:
            self._writer.__exit__(kind, error, trace)


def _las(t_s: float) -> float:
    return float(utc_to_las_time(t_s))


def session_text(session: Session, session_file: str) -> str:
    """A session as a file: every key that has a value, the defaults too.

    Args:
        session: as it was understood.
        session_file: the way to the file that it was read from, told in a comment.
    """
    tables = {key: _without_none(value) for key, value in msgspec.to_builtins(session).items() if value is not None}
    head = (
        f"# As furrowmap {version('furrowmap')} understood the session in this file, seen from here:\n"
        f"#   {printable(session_file)}\n"
        "# Paths below are relative to that file: to run this one, put it into the same folder.\n\n"
    )
    return head + tomli_w.dumps(tables)


def _way_to(session_file: Path, folder: Path) -> str:
    """The session file as seen from the products' folder; its name alone where no relative path leads there."""
    try:
        return Path(os.path.relpath(session_file.resolve(), folder.resolve())).as_posix()
    except ValueError:  # on another drive of Windows
        return session_file.name


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return value


def _refuse_original(folder: Path, session_file: Path) -> None:
    """Keep the user's own session file, with its comments, from becoming a product.

    Raises:
        RefusedError: if it has a product's place.
    """
    if session_file.resolve() in {(folder / name).resolve() for name in RUN_PRODUCTS}:
        raise RefusedError(
            f"{folder} is where {session_file.name} itself lies.",
            "The run writes the session as it was understood under that name, so yours would be lost.",
            "Choose another folder with -o.",
            code="output-is-input",
        )


def _refuse_foreign(folder: Path, opened: OpenSession, progress: Progress) -> list[FileRecord] | None:
    """Keep the products of another session where they are.

    Recorders give their files the same names every time, so the files' content decides.

    Returns:
        The records of the session's files, if there was something to compare them with.

    Raises:
        RefusedError: if there are products of another session.
    """
    if not folder.is_dir():
        return None
    recover(folder)
    there = [name for name in RUN_PRODUCTS if (folder / name).exists()]
    if not there:
        return None
    inputs = file_records(opened.inputs.all, opened.file.resolve().parent, progress)
    try:
        earlier = json.loads((folder / REPORT).read_text(encoding="utf-8"))
        same = (earlier["session"]["name"], earlier["inputs"]) == (opened.session.name, plain(inputs))
    except (OSError, ValueError, KeyError, TypeError):
        same = False
    if not same:
        raise RefusedError(
            f"{folder} holds {', '.join(there)} of another session.",
            "They would be lost, so nothing was done: their report names another session or other recordings.",
            "Choose another folder with -o, or replace them with --overwrite.",
            code="output-exists",
        )
    return inputs
