"""The products of a run: what takes its points and frames, and writes cloud, surfaces, layers and report."""

import math
import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any, Final

import msgspec
import numpy as np
import tomli_w

from furrowmap.core.coverage.field_surfaces import MAX_REACH_M, FieldPoints
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.images.image_frames import Frames
from furrowmap.core.implement.saved import save_implement
from furrowmap.core.pipeline.causes import by_cause
from furrowmap.core.pipeline.run_result import RunResult
from furrowmap.core.pointclouds.placed_scans import PLACED_AHEAD, PlacedScan
from furrowmap.core.runtime.background import behind, beside
from furrowmap.core.runtime.errors import printable
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.session.opened import OpenSession
from furrowmap.core.session.session_file import together
from furrowmap.core.surfaces.local_ground import GroundSampler
from furrowmap.core.values.clock import utc_to_las_time
from furrowmap.core.values.session import Session
from furrowmap.core.values.time_span import Interval, interval_numbers
from furrowmap.exporters.cloud.copc_file import CopcFormat, las_wkt
from furrowmap.exporters.cloud.layers import ChunkColumns
from furrowmap.exporters.cloud.point_batches import PointBatch
from furrowmap.exporters.cloud.writer import CopcSummary, CopcWriter
from furrowmap.exporters.files.file_records import FileRecord
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import (
    CLOUD,
    FIELD,
    ITEM,
    LEARNED,
    REPORT,
    REPORT_PAGE,
    RUN_PRODUCTS,
    SESSION_FILE,
    STATES,
    of_tool,
)
from furrowmap.exporters.rasters.field_rasters import RasterFigures, write_rasters
from furrowmap.exporters.reports.report_page import write_page
from furrowmap.exporters.reports.run_report import run_origin, run_report, write_report
from furrowmap.exporters.vectors.field_layers import strip_layers, write_states
from furrowmap.exporters.vectors.geopackage import write_field
from furrowmap.workflows.run.tools import CloudMade, Painter, RunTool, ToolFindings, Vector

SCALE_M: Final = 0.001
"""Resolution of the cloud's coordinates."""
MAX_PASSES: Final = 65_535
"""What a LAS file has numbers for."""


@dataclass(frozen=True)
class Made:
    """The result of a run, and what was made of its cloud; None where there is none."""

    found: RunResult
    inputs: list[FileRecord]
    cloud: CopcSummary | None = None
    rasters: RasterFigures | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    of_tools: Sequence[ToolFindings] = ()


@contextmanager
def open_products(
    opened: OpenSession,
    staging: Path,
    frame: MapFrame,
    origin_m: Vector,
    frames: Frames | None,
    tools: Sequence[RunTool],
) -> "Iterator[RunProducts]":
    """What makes cloud and surfaces of the points of a run, in a folder, and what open tools make of them.

    The other arguments are those of a pipeline's sink.
    """
    session = opened.session
    flies = (session.imu is not None or session.attitude is not None) and session.implement is None
    with ExitStack() as stack:
        for tool in tools:
            tool.origin_m = origin_m
            tool.frames = frames
            tool.stack = stack
            tool.begin()
        painter = next((tool.painter for tool in tools if tool.painter is not None), None)
        several = len(session.lidars) > 1
        cloud = stack.enter_context(open_cloud(staging / CLOUD, frame, origin_m, painter, several_scanners=several))
        # All returns of an aircraft make surfaces: they meet the ground steeply.
        land = stack.enter_context(FieldPoints(staging, reach_m=math.inf if flies else MAX_REACH_M))
        land.begin(origin_m)
        yield RunProducts(staging, cloud, land, tools)


@dataclass(frozen=True)
class RunProducts:
    """Takes the points of a run, makes its cloud and surfaces of them, and gives them to tools."""

    staging: Path
    cloud: "RunCloud"
    land: FieldPoints
    tools: Sequence[RunTool]

    def add(self, placed: PlacedScan) -> None:
        """Take the points of some scans."""
        self.cloud.add(placed)
        self.land.add(placed)
        for tool in self.tools:
            tool.add(placed)

    def finish(self, found: RunResult, inputs: list[FileRecord], progress: Progress) -> Made:
        """Write cloud and rasters, once all points were taken; then the tools judge the result one after another."""
        origin = run_origin(found, inputs)
        begin = perf_counter()
        for tool in self.tools:
            tool.end_points(progress)
        with beside(partial(self._surfaces, found, origin), progress) as rasters:
            with ExitStack() as measuring:
                for tool in self.tools:
                    if tool.measures:
                        measuring.enter_context(beside(partial(tool.measure, origin), progress))
                text = f"{found.frame.words}\n{origin.text}".strip()
                summary = self.cloud.finish(progress, found.strips or found.work.passes, text)
                written = perf_counter()
            measured = perf_counter()
        # Seconds of the surfaces beyond those of the cloud and of what was measured beside it.
        seconds = {"cloud": written - begin, "surfaces": perf_counter() - measured}
        figures = rasters.result()
        notices = [*found.notices, *(figures.notices if figures is not None else ())]
        of_tools = []
        for tool in self.tools:
            findings = tool.finish(CloudMade(found, summary, progress))
            found = findings.judged(found)
            notices += findings.notices
            seconds |= findings.seconds
            of_tools.append(findings)
        return Made(replace(found, notices=by_cause(notices)), inputs, summary, figures, seconds, of_tools)

    def _surfaces(self, found: RunResult, origin: Origin, progress: Progress) -> RasterFigures | None:
        """Write the rasters, and what tools draw of the surfaces."""
        figures = write_rasters(self.staging, self.land, found, origin, progress)
        for tool in self.tools:
            tool.draw(origin, progress)
        return figures


def write_products(
    made: Made, opened: OpenSession, folder: Path, staging: Path, start: float, progress: Progress
) -> dict[str, Any]:
    """Write layers, page, session and report of a run for `folder`; it began at `start`, by `perf_counter`.

    Returns the content of `report.json`.
    """
    try:
        origin = Path(os.path.relpath(resolved(opened.file), resolved(folder))).as_posix()
    except ValueError:  # on another drive of Windows
        origin = opened.file.name
    found = made.found
    summary = made.cloud
    progress("writing layers", 0.0)
    begin = perf_counter()
    layers = strip_layers(made.rasters.strips if made.rasters is not None else (), found.strip_differences)
    page: dict[str, Any] = {}
    for findings in made.of_tools:
        layers += findings.layers
        page |= findings.page
    provenance = run_origin(found, made.inputs)
    write_field(
        staging / FIELD,
        found.placement.poses,
        found.frame.wkt,
        found.work,
        found.frame.words,
        provenance,
        layers,
        found.zone,
    )
    for number, work in enumerate(found.work.each, start=1):
        if work.states is not None:
            write_states(staging / of_tool(STATES, number), work.states)
        if work.seen is not None and found.work.scanner == 0:  # a later session looks for it in the first one's scans
            save_implement(staging / of_tool(LEARNED, number), work.seen)
    write_page(staging / REPORT_PAGE, found, staging / CLOUD, summary, made.rasters, page)
    written = perf_counter()
    (staging / SESSION_FILE).write_text(session_text(found.session, origin), encoding="utf-8")
    seconds = {**made.seconds, "layers": written - begin, "whole": perf_counter() - start}
    timings = found.timings_s | {stage: round(value, 3) for stage, value in seconds.items()}
    names = [name for name in RUN_PRODUCTS if name in (REPORT, ITEM) or (staging / name).exists()]
    content = run_report(found, origin, summary, made.rasters, made.inputs, timings, names)
    for findings in made.of_tools:
        content |= findings.account
    return write_report(staging / REPORT, content)


def session_text(session: Session, session_file: str) -> str:
    """A session as a file: every key that has a value, the defaults too."""
    values = together(msgspec.to_builtins(session))
    tables = {key: _without_none(value) for key, value in values.items() if value is not None}
    head = (
        f"# The session as furrowmap {version('furrowmap')} read it from this file, relative to here:\n"
        f"#   {printable(session_file)}\n"
        "# Paths below are relative to that file: to run this one, put it into the same folder.\n\n"
    )
    return head + tomli_w.dumps(tables)


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, list):
        return [_without_none(item) for item in value]
    return value


@contextmanager
def open_cloud(
    path: Path,
    frame: MapFrame,
    origin_m: tuple[float, float, float],
    painter: Painter | None,
    *,
    several_scanners: bool = False,
) -> "Iterator[RunCloud]":
    """The cloud in a file, coordinates against a local origin; with a painter its points have colours.

    Points of several scanners have the number of theirs. A thread packs the points and sorts those that exceed the
    memory into a file.
    """
    extra: tuple[tuple[str, str, str], ...] = (("scan", "uint32", "scan (revolution) number"),)
    if several_scanners:
        extra += (("scanner", "uint8", "scanner, 0 for the first"),)
    kind = CopcFormat(las_wkt(frame.whole_crs), origin_m, SCALE_M, extra, colour=painter is not None)
    with CopcWriter(path, kind, colours_later=kind.colour) as writer, ExitStack() as packing:
        yield RunCloud(writer, packing, painter, several_scanners=several_scanners)


class RunCloud:
    """The cloud of a run, which is open."""

    def __init__(
        self, writer: CopcWriter, packing: ExitStack, painter: Painter | None, *, several_scanners: bool = False
    ) -> None:
        self._writer = writer
        self._packing = packing
        self._painter = painter
        self._several = several_scanners
        self._append = packing.enter_context(behind(writer.append, PLACED_AHEAD))
        self._watch = GroundSampler()

    def add(self, placed: PlacedScan) -> None:
        """Take the points of some scans."""
        scan = placed.scan
        self._watch.add(placed.xyz_m, placed.kept)
        self._append(
            PointBatch(
                placed.xyz_m,
                scan.t_s,
                intensity=scan.intensity,
                return_number=scan.return_number,
                returns=scan.returns,
                classification=placed.classification,
                extra={"scan": placed.number} | ({"scanner": scan.scanner} if self._several else {}),
            )
        )

    def finish(self, progress: Progress, passes: Sequence[Interval], description: str) -> CopcSummary:
        """Sort, compress and write the points, each with its class, the number of its pass and its colour."""
        self._packing.close()
        ground = self._watch.ground()

        # The few passes are turned into the points' time, not the many points into the passes'.
        spans = [_Span(*(float(utc_to_las_time(t_s)) for t_s in (when.begin_s, when.end_s))) for when in passes]

        def mark(points: ChunkColumns) -> None:
            ground.classify(points.x, points.y, points.z, SCALE_M, points.classification)
            if spans:
                points.point_source_id[:] = np.minimum(interval_numbers(spans, points.gps_time), MAX_PASSES)
            if self._painter is not None:
                self._painter(points, SCALE_M)

        return self._writer.close(progress, mark, description)


@dataclass(frozen=True)
class _Span:
    """A pass in the points' time."""

    begin_s: float
    end_s: float
