"""Running a session: from the session file to the folder of its products."""

from __future__ import annotations

import json
import math
import os
import shutil
from concurrent.futures import Future
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path, PurePosixPath
from time import perf_counter
from typing import Any, Final

import msgspec
import tomli_w

from furrowmap.core import pipeline
from furrowmap.core.crops.parcel_points import ParcelPoints
from furrowmap.core.implement.saved import save_implement
from furrowmap.core.session.opened import OpenSession, open_session
from furrowmap.core.values.beside import beside
from furrowmap.core.values.errors import RefusedError, printable
from furrowmap.core.values.json_text import plain
from furrowmap.core.values.progress import Progress, silent
from furrowmap.core.values.scratch import release, scratch_in
from furrowmap.core.values.session import Session
from furrowmap.core.values.threads import using_threads
from furrowmap.core.work.field_surfaces import REACH_M, FieldPoints
from furrowmap.core.work.run_result import RunResult
from furrowmap.exporters.cloud.writer import CopcSummary
from furrowmap.exporters.exchange.stac import write_item
from furrowmap.exporters.files.file_records import FileRecord, file_records
from furrowmap.exporters.files.provenance import Origin
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
from furrowmap.exporters.files.staging import kept, recover, staged_folder
from furrowmap.exporters.rasters.field_rasters import RasterFigures, write_rasters
from furrowmap.exporters.reports.report_page import write_page
from furrowmap.exporters.reports.run_report import run_origin, run_report, write_report
from furrowmap.exporters.vectors.field_layers import Layer, strip_layers
from furrowmap.exporters.vectors.geopackage import write_field
from furrowmap.exporters.vectors.parcel_table import parcel_layer
from furrowmap.exporters.vectors.states_table import write_states
from furrowmap.results import Result, open_result
from furrowmap.workflows.kept_matching import KeptMatching
from furrowmap.workflows.parcels import WrittenParcels, parcel_settings, session_parcels, write_parcels
from furrowmap.workflows.run_cloud import RunCloud, RunSink
from furrowmap.workflows.run_colours import ColourFigures, RunColours

SPACE: Final = 2
"""Bytes of temporary files and products for each byte of a capture, at least: 10 bytes a point for surfaces and 5 for
the cloud, where half of the 384 firings in a packet of 1264 bytes return."""
_BAGS: Final = frozenset({".bag", ".mcap", ".db3"})


def run(
    session: str | Path,
    out: str | Path | None = None,
    *,
    overwrite: bool = False,
    resume: bool = False,
    progress: Progress = silent,
) -> Result:
    """Run a session and write its products into a folder.

    Products of the same recordings in the folder are replaced, whatever else the session names or sets: the same files
    of the scanner, byte for byte, or without a scanner the same positions.

    Args:
        session: the session file.
        out: the folder, made if it does not exist; by default SESSION_result beside the session file.
        overwrite: replace the products of other recordings, too.
        resume: use what a killed run into the same folder found by scan matching, if session and recordings are the
            same.
        progress: is called with each stage and its share, 0 to 1.

    Raises:
        FurrowmapError: if the session does not make a cloud, or the folder cannot be written to.
    """
    file = Path(session)
    folder = Path(out) if out is not None else file.resolve().parent / f"{file.stem}_result"
    opened = open_session(file)
    _refuse_original(folder, file)
    inputs = None if overwrite else _refuse_foreign(folder, opened, progress)
    _expect_space(folder, opened)
    with (
        staged_folder(folder, resume=resume) as staging,
        scratch_in(staging),
        using_threads(opened.session.run.threads, by_default=True),
    ):
        _write_products(opened, folder, staging, inputs, progress)
    return open_result(folder)


def _write_products(
    opened: OpenSession, folder: Path, staging: Path, inputs: list[FileRecord] | None, progress: Progress
) -> None:
    """Write all products into `staging`; `inputs` are the records of the session's files, where they are known."""
    start = perf_counter()
    origin = _path_from(opened.file, folder)
    made = _made(opened, staging, inputs, progress)
    found, summary = made.found, made.cloud
    release()
    progress("writing layers", 0.0)
    layers = perf_counter()
    provenance = run_origin(found, made.inputs)
    write_field(
        staging / FIELD,
        found.placement.poses,
        found.frame.wkt,
        found.work,
        found.frame.words,
        provenance,
        [*_strips(made), *([parcel_layer(made.parcels.found)] if made.parcels is not None else [])],
        found.zone,
    )
    if found.work.states is not None:
        write_states(staging / STATES, found.work.states)
    if found.work.seen is not None:
        save_implement(staging / LEARNED, found.work.seen)
    crops = made.parcels.found if made.parcels is not None else ()
    write_page(staging / PAGE, found, staging / CLOUD, summary, made.rasters, crops)
    layers = perf_counter() - layers
    (staging / SESSION).write_text(session_text(found.session, origin), encoding="utf-8")
    seconds = {**made.seconds, "layers": layers, "whole": perf_counter() - start}
    timings = found.timings_s | {stage: round(value, 3) for stage, value in seconds.items()}
    content = run_report(found, origin, summary, made.rasters, made.inputs, timings, _names(staging))
    content["colours"] = made.colours.plain() if made.colours is not None else None
    if made.parcels is not None:
        content["parcels"] = made.parcels.account
    write_item(staging / ITEM, write_report(staging / REPORT, content))


@dataclass(frozen=True)
class _Made:
    """The result of a run, and the figures of its cloud, rasters, parcels and colours; None where there are none."""

    found: RunResult
    inputs: list[FileRecord]
    cloud: CopcSummary | None = None
    rasters: RasterFigures | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    parcels: WrittenParcels | None = None
    colours: ColourFigures | None = None


def _made(opened: OpenSession, staging: Path, inputs: list[FileRecord] | None, progress: Progress) -> _Made:
    """Run a session and write its cloud and its rasters; neither without a scanner."""
    with (
        RunColours() as colours,
        RunCloud(staging / CLOUD, colours) as cloud,
        FieldPoints(staging, reach_m=_reach_m(opened)) as land,
        session_parcels(opened, staging) as crops,
    ):
        inputs = inputs or file_records(opened.inputs.all, opened.file.resolve().parent, progress)
        sink = RunSink(cloud, land, colours, crops)
        found = pipeline.run(opened, sink, progress, KeptMatching(kept(staging), opened, inputs), colours)
        if not found.session.recording.lidar:
            return _Made(found, inputs)
        origin = run_origin(found, inputs)
        begin = perf_counter()
        colours.finish(progress)
        with beside(partial(write_rasters, staging, land, found, origin), progress) as rasters:
            with _parcels_beside(staging, crops, opened, origin, progress) as parcels:
                summary = cloud.finish(
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
        made = _Made(found, inputs, summary, rasters.result(), seconds, colours=coloured)
        if parcels is None:
            return made
        noticed = replace(found, notices=(*found.notices, *parcels.result().notices))
        seconds |= {"parcels": measured - written}
        return replace(made, found=noticed, seconds=seconds, parcels=parcels.result())


def _parcels_beside(
    staging: Path, crops: ParcelPoints | None, opened: OpenSession, origin: Origin, progress: Progress
) -> AbstractContextManager[Future[WrittenParcels] | None]:
    """Within it, parcels are measured and written in another thread; None where there are none."""
    if crops is None:
        return nullcontext()
    settings, crs = parcel_settings(opened), opened.frame.whole_crs
    return beside(partial(write_parcels, staging, crops, settings, crs, origin), progress)


def _strips(made: _Made) -> list[Layer]:
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
    tables = {key: _without_none(value) for key, value in msgspec.to_builtins(session).items() if value is not None}
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
    return value


def _expect_space(folder: Path, opened: OpenSession) -> None:
    """Check, before hours of work, that the disk has room for what a capture becomes.

    Files that may hold other data than packets of a scanner, such as ROS bags, are not counted.

    Raises:
        RefusedError: if it has less than is needed at least.
    """
    captures = [path for path in opened.inputs.lidar if path.is_file() and _BAGS.isdisjoint(path.suffixes)]
    needed = SPACE * sum(path.stat().st_size for path in captures)
    there = next(place for place in (folder.absolute(), *folder.absolute().parents) if place.exists())
    free = shutil.disk_usage(there).free
    if needed > free:
        raise RefusedError(
            f"{folder} has {free / 1e9:.2f} GB of free space; the run needs at least {needed / 1e9:.2f} GB.",
            "It would end on a full disk after long work, so it did not start.",
            "Free some space, or choose a folder on another disk with -o.",
            code="disk-space",
        )


def _refuse_original(folder: Path, session_file: Path) -> None:
    """Refuse a folder in which a product would overwrite the user's session file.

    Raises:
        RefusedError: if it would.
    """
    if session_file.resolve() in {(folder / name).resolve() for name in RUN_PRODUCTS}:
        raise RefusedError(
            f"{folder} contains {session_file.name} itself.",
            "The run writes its own file of that name, which would replace yours.",
            "Choose another folder with -o.",
            code="output-is-input",
        )


def _refuse_foreign(folder: Path, opened: OpenSession, progress: Progress) -> list[FileRecord] | None:
    """Refuse a folder that holds the products of other recordings.

    Recordings often have the same names, so their content is compared.

    Returns:
        Records of the session's files, where there were products to compare with.

    Raises:
        RefusedError: if there are products of other recordings.
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
        same = _recordings(earlier["session"], earlier["inputs"]) == _recordings(
            msgspec.to_builtins(opened.session), plain(inputs)
        )
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        same = False
    if not same:
        raise RefusedError(
            f"{folder} holds {', '.join(there)} of another recording.",
            "Their report names other recordings, so they were not replaced.",
            "Choose another folder with -o, or replace them with --overwrite.",
            code="output-exists",
        )
    return inputs


def _recordings(session: Any, inputs: Any) -> tuple[Any, set[str]]:
    """The task and the hashes of the recordings in a session's tables and the records of its files, as in the report.

    Raises:
        LookupError, TypeError, AttributeError: if they are no such tables.
    """
    recording, stated = session["recording"], session["trajectory"]
    named = recording["lidar"] or (stated["files"] if stated is not None else recording["gnss"])
    names = {PurePosixPath(name).as_posix() for name in named}
    whole = [file for file in inputs if names & {file["name"], *map(str, PurePosixPath(file["name"]).parents)}]
    return recording["task"], {file["sha256"] for file in whole}
