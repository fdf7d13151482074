"""The products of a run: what takes its points and frames, and writes cloud, surfaces, layers and report."""

import math
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any, Final

import msgspec
import numpy as np
import tomli_w

from furrowmap.core.accuracy.check import CHECK_POINTS_OFF, HeldHeights
from furrowmap.core.accuracy.point_check import surface_at_points
from furrowmap.core.coverage.field_surfaces import MAX_REACH_M, FieldPoints
from furrowmap.core.crops.parcel_points import ParcelPoints
from furrowmap.core.crops.placement import ParcelShift
from furrowmap.core.features.cloud_features import FoundFeatures, classify_features, measure_density
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.images.frames import Frames
from furrowmap.core.implement.saved import save_implement
from furrowmap.core.pipeline.causes import by_cause
from furrowmap.core.pipeline.run_result import RunResult
from furrowmap.core.pointclouds.cleaning_steps import Cleaning
from furrowmap.core.pointclouds.clouds import open_clouds
from furrowmap.core.pointclouds.placed import PLACED_AHEAD, PlacedScan
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.background import behind, beside
from furrowmap.core.runtime.errors import Notice, printable
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.session.file import together
from furrowmap.core.session.opened import OpenSession
from furrowmap.core.surfaces.local_ground import GroundSampler
from furrowmap.core.values.clock import utc_to_las_time
from furrowmap.core.values.session import FeatureSearch, Session
from furrowmap.core.values.time_span import Interval, interval_numbers
from furrowmap.exporters.cloud.file import CopcFormat, las_wkt
from furrowmap.exporters.cloud.layers import ChunkColumns
from furrowmap.exporters.cloud.points import PointBatch
from furrowmap.exporters.cloud.writer import CopcSummary, CopcWriter
from furrowmap.exporters.exchange.stac import write_item
from furrowmap.exporters.files.file_records import FileRecord
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import (
    CLOUD,
    DSM,
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
from furrowmap.exporters.vectors.crop_layers import parcel_layer
from furrowmap.exporters.vectors.field_layers import Layer, strip_layers, write_states
from furrowmap.exporters.vectors.geopackage import write_field
from furrowmap.workflows.clouds.features import found_layers, sparse_notices
from furrowmap.workflows.clouds.inputs import box_to_use
from furrowmap.workflows.crops.parcels import WrittenParcels, held_against_surface, parcel_settings, write_parcels
from furrowmap.workflows.run.colours import RunColours

SCALE_M: Final = 0.001
"""Resolution of the cloud's coordinates."""
MAX_PASSES: Final = 65_535
"""What a LAS file has numbers for."""


@dataclass(frozen=True)
class RunFeatures:
    """Features found in the cloud of a run."""

    layers: list[Layer]
    account: dict[str, Any]
    notices: tuple[Notice, ...]


@dataclass(frozen=True)
class Made:
    """The result of a run, and what was made of its cloud; None where there is none."""

    found: RunResult
    inputs: list[FileRecord]
    cloud: CopcSummary | None = None
    rasters: RasterFigures | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    parcels: WrittenParcels | None = None
    colours: dict[str, Any] | None = None
    features: RunFeatures | None = None
    checked: HeldHeights | None = None


@contextmanager
def open_products(
    opened: OpenSession,
    staging: Path,
    frame: MapFrame,
    origin_m: tuple[float, float, float],
    frames: Frames | None,
    parcels: ParcelPoints | None,
) -> "Iterator[RunProducts]":
    """What makes cloud, surfaces and parcels of the points of a run, in a folder; arguments as of a pipeline's sink."""
    session = opened.session
    flies = (session.imu is not None or session.attitude is not None) and session.implement is None
    with ExitStack() as stack:
        colours = stack.enter_context(RunColours(frames, origin_m)) if frames is not None else None
        several = len(session.lidars) > 1
        cloud = stack.enter_context(open_cloud(staging / CLOUD, frame, origin_m, colours, several_scanners=several))
        # All returns of an aircraft make surfaces: they meet the ground steeply.
        land = stack.enter_context(FieldPoints(staging, reach_m=math.inf if flies else MAX_REACH_M))
        land.begin(origin_m)
        yield RunProducts(opened, staging, origin_m, cloud, land, colours, parcels)


@dataclass(frozen=True)
class RunProducts:
    """Takes the points of a run, and makes its cloud, surfaces and parcels of them."""

    opened: OpenSession
    staging: Path
    origin_m: tuple[float, float, float]
    cloud: "RunCloud"
    land: FieldPoints
    colours: RunColours | None
    parcels: ParcelPoints | None

    def add(self, placed: PlacedScan) -> None:
        """Take the points of some scans."""
        self.cloud.add(placed)
        self.land.add(placed)
        if self.colours is not None:
            self.colours.add(placed)
        if self.parcels is not None:
            self.parcels.add(placed.xyz_m[placed.kept] + self.origin_m)

    def finish(self, found: RunResult, inputs: list[FileRecord], progress: Progress) -> Made:
        """Write cloud and rasters, once all points were taken."""
        staging = self.staging
        origin = run_origin(found, inputs)
        opened = self.opened
        begin = perf_counter()
        if self.colours is not None:
            self.colours.finish(progress)
        measuring: AbstractContextManager[Future[WrittenParcels] | None] = nullcontext()
        if self.parcels is not None:
            settings = parcel_settings(opened)
            crs = opened.frame.whole_crs
            measuring = beside(partial(write_parcels, staging, self.parcels, settings, crs, origin), progress)
        with beside(partial(self._surfaces, found, origin), progress) as rasters:
            with measuring as parcels:
                text = f"{found.frame.words}\n{origin.text}".strip()
                summary = self.cloud.finish(progress, found.strips or found.work.passes, text)
                written = perf_counter()
            measured = perf_counter()
        # Seconds of the parcels beyond those of the cloud, and of the surfaces beyond those of both.
        seconds = {"cloud": written - begin, "surfaces": perf_counter() - measured}
        figures = rasters.result()
        notices = [*found.notices, *(figures.notices if figures is not None else ())]
        coloured = measured_parcels = checked = features = None
        if self.colours is not None:
            coloured, uncoloured = self.colours.figures()
            notices += uncoloured
        if parcels is not None:
            seconds["parcels"] = measured - written
            east_m, north_m = np.sqrt(np.mean(found.placement.poses.sigma[:, :2] ** 2, axis=0)).tolist()
            measured_parcels = held_against_surface(parcels.result(), staging, (east_m, north_m))
            notices += measured_parcels.notices
            found = _with_shift(found, measured_parcels.shift)
        if (points := opened.inputs.check_points) is not None and (staging / DSM).is_file():
            sigma = found.placement.poses.sigma.copy()
            at_points = surface_at_points(staging / DSM, points)
            checked = HeldHeights.of(at_points, float(np.sqrt(np.mean(sigma[:, 2] ** 2))))
            if (notice := checked.notice(points.name)) is not None:
                notices.append(notice)
                if notice.code == CHECK_POINTS_OFF:
                    sigma[:, 2] = np.hypot(sigma[:, 2], checked.off_m)
                    found = _with_sigma(found, sigma)
        if (stated := found.session.features) is not None and summary.points:
            begin = perf_counter()
            features = run_features(staging / CLOUD, stated, progress)
            seconds["features"] = perf_counter() - begin
            notices += features.notices
        found = replace(found, notices=by_cause(notices))
        return Made(found, inputs, summary, figures, seconds, measured_parcels, coloured, features, checked)

    def _surfaces(self, found: RunResult, origin: Origin, progress: Progress) -> RasterFigures | None:
        """Write the rasters, and the orthophoto of the surface among them."""
        figures = write_rasters(self.staging, self.land, found, origin, progress)
        if self.colours is not None:
            self.colours.write_orthophoto(self.staging, origin, progress)
        return figures


def _with_shift(found: RunResult, shift: ParcelShift | None) -> RunResult:
    """The result with larger standard deviations of the positions where parcels may be right, and the positions off."""
    if shift is None or not shift.of_positions:
        return found
    sigma = found.placement.poses.sigma.copy()
    sigma[:, :2] = np.hypot(sigma[:, :2], (shift.east_m, shift.north_m))
    return _with_sigma(found, sigma)


def _with_sigma(found: RunResult, sigma: FloatArray) -> RunResult:
    """The result with other standard deviations (n, 6) of its poses."""
    poses = replace(found.placement.poses, sigma=sigma)
    return replace(found, placement=replace(found.placement, poses=poses))


def write_products(
    made: Made, opened: OpenSession, folder: Path, staging: Path, start: float, progress: Progress
) -> None:
    """Write layers, page, session and report of a run for `folder`; it began at `start`, by `perf_counter`."""
    try:
        origin = Path(os.path.relpath(resolved(opened.file), resolved(folder))).as_posix()
    except ValueError:  # on another drive of Windows
        origin = opened.file.name
    found = made.found
    summary = made.cloud
    progress("writing layers", 0.0)
    begin = perf_counter()
    layers = strip_layers(made.rasters.strips if made.rasters is not None else (), found.strip_differences)
    layers += [parcel_layer(made.parcels.found)] if made.parcels is not None else []
    layers += made.features.layers if made.features is not None else []
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
    crops, response = (made.parcels.found, made.parcels.response) if made.parcels is not None else ((), None)
    features = made.features.account if made.features is not None else None
    counts = features["figures"] if features is not None else None
    write_page(staging / REPORT_PAGE, found, staging / CLOUD, summary, made.rasters, crops, response, counts)
    written = perf_counter()
    (staging / SESSION_FILE).write_text(session_text(found.session, origin), encoding="utf-8")
    seconds = {**made.seconds, "layers": written - begin, "whole": perf_counter() - start}
    timings = found.timings_s | {stage: round(value, 3) for stage, value in seconds.items()}
    names = [name for name in RUN_PRODUCTS if name in (REPORT, ITEM) or (staging / name).exists()]
    content = run_report(found, origin, summary, made.rasters, made.inputs, timings, names)
    content["colours"] = made.colours
    if made.parcels is not None:
        content["parcels"] = made.parcels.account
    if features is not None:
        content["features"] = features
    if made.checked is not None:
        content["check_points"] = made.checked.plain()
    write_item(staging / ITEM, write_report(staging / REPORT, content))


def run_features(cloud: Path, stated: FeatureSearch, progress: Progress) -> RunFeatures:
    """Find the features of a run's finished cloud, with its ground and, from images, its colours."""
    clouds = open_clouds([cloud], None, None)
    box, far = box_to_use(clouds, None, None, progress)
    fitting_m, classified = measure_density(clouds, box, progress)
    ground = stated.ground or ("class" if classified else "smrf")
    cell_m = stated.voxel_m or fitting_m
    found = FoundFeatures()
    cleaning = Cleaning(box, ground="none" if ground == "class" else ground)
    with closing(classify_features(clouds, cleaning, cell_m, cloud.parent, found, progress=progress)) as points:
        for _ in points:
            pass
    layers, figures = found_layers(found)
    account = {"parameters": {"ground": ground, "voxel_m": cell_m}, "figures": figures}
    return RunFeatures(layers, account, (*far, *sparse_notices(fitting_m)))


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
    colours: RunColours | None,
    *,
    several_scanners: bool = False,
) -> "Iterator[RunCloud]":
    """The cloud in a file, coordinates against a local origin; with `colours` its points get theirs.

    Points of several scanners have the number of theirs. A thread packs the points and sorts those that exceed the
    memory into a file.
    """
    extra: tuple[tuple[str, str, str], ...] = (("scan", "uint32", "scan (revolution) number"),)
    if several_scanners:
        extra += (("scanner", "uint8", "scanner, 0 for the first"),)
    kind = CopcFormat(las_wkt(frame.whole_crs), origin_m, SCALE_M, extra, colour=colours is not None)
    with CopcWriter(path, kind, colours_later=kind.colour) as writer, ExitStack() as packing:
        yield RunCloud(writer, packing, colours, several_scanners=several_scanners)


class RunCloud:
    """The cloud of a run, which is open."""

    def __init__(
        self, writer: CopcWriter, packing: ExitStack, colours: RunColours | None, *, several_scanners: bool = False
    ) -> None:
        self._writer = writer
        self._packing = packing
        self._colours = colours
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
            if self._colours is not None:
                self._colours.paint(points, SCALE_M)

        return self._writer.close(progress, mark, description)


@dataclass(frozen=True)
class _Span:
    """A pass in the points' time."""

    begin_s: float
    end_s: float
