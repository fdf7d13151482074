"""The products of a run: what takes its points and frames, and writes cloud, surfaces, layers and report."""

from __future__ import annotations

import math
import os
from concurrent.futures import Future
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from types import TracebackType
from typing import Any, Self

import msgspec
import tomli_w

from furrowmap.core.crops.parcel_points import ParcelPoints
from furrowmap.core.pipeline.run_result import RunResult
from furrowmap.core.runtime.background import beside
from furrowmap.core.runtime.errors import printable
from furrowmap.core.runtime.languages.choice import language_of_user, using_language
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.session.implements import together
from furrowmap.core.session.opened import OpenSession
from furrowmap.core.values.session import Session
from furrowmap.core.work.field_surfaces import REACH_M, FieldPoints
from furrowmap.core.work.saved import save_implement
from furrowmap.exporters.cloud.writer import CopcSummary
from furrowmap.exporters.exchange.stac import write_item
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
from furrowmap.exporters.vectors.field_layers import Layer, strip_layers
from furrowmap.exporters.vectors.geopackage import write_field
from furrowmap.exporters.vectors.parcel_table import parcel_layer
from furrowmap.exporters.vectors.states_table import write_states
from furrowmap.workflows.crops.parcels import WrittenParcels, parcel_settings, session_parcels, write_parcels
from furrowmap.workflows.run.cloud import RunCloud, RunSink
from furrowmap.workflows.run.colours import ColourFigures, RunColours
from furrowmap.workflows.run.features import RunFeatures, run_features


@dataclass(frozen=True)
class Made:
    """The result of a run, and what was made of its cloud; None where there is none."""

    found: RunResult
    inputs: list[FileRecord]
    cloud: CopcSummary | None = None
    rasters: RasterFigures | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    parcels: WrittenParcels | None = None
    colours: ColourFigures | None = None
    features: RunFeatures | None = None


class RunProducts:
    """Collects the points and frames of a run, and makes its cloud, surfaces and parcels of them: a context manager.

    Args:
        opened: the session.
        staging: folder of the products.
    """

    def __init__(self, opened: OpenSession, staging: Path) -> None:
        self._opened, self._staging, self._stack = opened, staging, ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self.frames = stack.enter_context(RunColours())
            self._cloud = stack.enter_context(RunCloud(self._staging / CLOUD, self.frames))
            self._land = stack.enter_context(FieldPoints(self._staging, reach_m=_reach_m(self._opened)))
            self._crops = stack.enter_context(session_parcels(self._opened, self._staging))
            self.points = RunSink(self._cloud, self._land, self.frames, self._crops)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, error, trace)

    def made(self, found: RunResult, inputs: list[FileRecord], progress: Progress) -> Made:
        """Write cloud and rasters, once all points were taken; neither without a scanner.

        Args:
            found: the result of the run.
            inputs: records of its files.
            progress: receives the stages.
        """
        if not found.session.recording.lidar:
            return Made(found, inputs)
        staging, colours, origin = self._staging, self.frames, run_origin(found, inputs)
        begin = perf_counter()
        colours.finish(progress)
        with beside(partial(write_rasters, staging, self._land, found, origin), progress) as rasters:
            with _parcels_beside(staging, self._crops, self._opened, origin, progress) as parcels:
                summary = self._cloud.finish(
                    progress, found.strips or found.work.passes, f"{found.frame.words}\n{origin.text}".strip()
                )
                written = perf_counter()
            measured = perf_counter()
        surfaced = perf_counter()
        colours.write_orthophoto(staging, origin, progress)
        # Seconds of the parcels beyond those of the cloud, and of the surfaces beyond those of both.
        seconds = {"cloud": written - begin, "surfaces": surfaced - measured}
        coloured = colours.figures()
        if coloured is not None:
            found = replace(found, notices=(*found.notices, *coloured.notices))
        made = Made(found, inputs, summary, rasters.result(), seconds, colours=coloured)
        if parcels is not None:
            noticed = replace(found, notices=(*found.notices, *parcels.result().notices))
            seconds |= {"parcels": measured - written}
            made = replace(made, found=noticed, seconds=seconds, parcels=parcels.result())
        return _with_features(made, staging / CLOUD, progress)


def write_products(
    made: Made, opened: OpenSession, folder: Path, staging: Path, start: float, progress: Progress
) -> None:
    """Write layers, page, session and report.

    Args:
        made: what is written already.
        opened: the session.
        folder: of the products in the end.
        staging: folder to write into.
        start: when the run began, by `perf_counter`.
        progress: receives the stage "writing layers".
    """
    origin = _path_from(opened.file, folder)
    found, summary = made.found, made.cloud
    progress("writing layers", 0.0)
    layers = perf_counter()
    provenance = run_origin(found, made.inputs)
    with using_language(language_of_user(found.session.report.language)):
        write_field(
            staging / FIELD,
            found.placement.poses,
            found.frame.wkt,
            found.work,
            found.frame.words,
            provenance,
            _more_layers(made),
            found.zone,
        )
    for number, work in enumerate(found.work.each, start=1):
        if work.states is not None:
            write_states(staging / of_tool(STATES, number), work.states)
        if work.seen is not None:
            save_implement(staging / of_tool(LEARNED, number), work.seen)
    crops = made.parcels.found if made.parcels is not None else ()
    features = made.features.account if made.features is not None else None
    counts = features["figures"] if features is not None else None
    write_page(staging / REPORT_PAGE, found, staging / CLOUD, summary, made.rasters, crops, counts)
    layers = perf_counter() - layers
    (staging / SESSION_FILE).write_text(session_text(found.session, origin), encoding="utf-8")
    seconds = {**made.seconds, "layers": layers, "whole": perf_counter() - start}
    timings = found.timings_s | {stage: round(value, 3) for stage, value in seconds.items()}
    content = run_report(found, origin, summary, made.rasters, made.inputs, timings, _names(staging))
    content["colours"] = made.colours.plain() if made.colours is not None else None
    if made.parcels is not None:
        content["parcels"] = made.parcels.account
    if features is not None:
        content["features"] = features
    write_item(staging / ITEM, write_report(staging / REPORT, content))


def _parcels_beside(
    staging: Path, crops: ParcelPoints | None, opened: OpenSession, origin: Origin, progress: Progress
) -> AbstractContextManager[Future[WrittenParcels] | None]:
    """Within it, parcels are measured and written in another thread; None where there are none."""
    if crops is None:
        return nullcontext()
    settings, crs = parcel_settings(opened), opened.frame.whole_crs
    return beside(partial(write_parcels, staging, crops, settings, crs, origin), progress)


def _with_features(made: Made, cloud: Path, progress: Progress) -> Made:
    """With the features of the finished cloud, where the session asks for them."""
    stated = made.found.session.features
    if stated is None or made.cloud is None or not made.cloud.points:
        return made
    begin = perf_counter()
    features = run_features(cloud, stated, progress)
    noticed = replace(made.found, notices=(*made.found.notices, *features.notices))
    seconds = {**made.seconds, "features": perf_counter() - begin}
    return replace(made, found=noticed, seconds=seconds, features=features)


def _more_layers(made: Made) -> list[Layer]:
    """The layers of strips, parcels and features."""
    crops = [parcel_layer(made.parcels.found)] if made.parcels is not None else []
    return [*_strips(made), *crops, *(made.features.layers if made.features is not None else [])]


def _strips(made: Made) -> list[Layer]:
    """The layers of a flight's strips."""
    grounds = made.rasters.strips if made.rasters is not None else ()
    return strip_layers(grounds, made.found.strip_differences)


def _reach_m(opened: OpenSession) -> float:
    """Range up to which returns make surfaces: all of an aircraft, which meet the ground steeply."""
    session = opened.session
    flies = (session.imu is not None or session.attitude is not None) and session.implement is None
    return math.inf if flies else REACH_M


def _names(staging: Path) -> list[str]:
    """Names of the products that exist, or are about to be written."""
    return [name for name in RUN_PRODUCTS if name in (REPORT, ITEM) or (staging / name).exists()]


def session_text(session: Session, session_file: str) -> str:
    """A session as a file: every key that has a value, the defaults too.

    Args:
        session: as it was read.
        session_file: path of the file it was read from, for a comment.
    """
    values = together(msgspec.to_builtins(session))
    tables = {key: _without_none(value) for key, value in values.items() if value is not None}
    head = (
        f"# The session as furrowmap {version('furrowmap')} read it from this file, relative to here:\n"
        f"#   {printable(session_file)}\n"
        "# Paths below are relative to that file: to run this one, put it into the same folder.\n\n"
    )
    return head + tomli_w.dumps(tables)


def _path_from(session_file: Path, folder: Path) -> str:
    """The session file as seen from the products' folder; its name alone where no relative path leads there."""
    try:
        return Path(os.path.relpath(session_file.resolve(), folder.resolve())).as_posix()
    except ValueError:  # on another drive of Windows
        return session_file.name


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, list):
        return [_without_none(item) for item in value]
    return value
