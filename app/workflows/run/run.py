"""Running a session: from an open session to the folder of its products; :mod:`.session_run` chains tools to it."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from functools import cache
from importlib.metadata import version
from pathlib import Path, PurePosixPath
from time import perf_counter
from typing import TYPE_CHECKING, Any, Final

import msgspec
import numpy as np

from furrowmap.core.coverage.field_boundary import ground_to_map
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.images.image_frames import Frames
from furrowmap.core.pipeline.run import run as run_session
from furrowmap.core.pointclouds.placed_scans import PlacedScan
from furrowmap.core.runtime.arrays import release
from furrowmap.core.runtime.errors import RefusedError
from furrowmap.core.runtime.file_names import read_own, resolved
from furrowmap.core.runtime.imports import importing
from furrowmap.core.runtime.json_text import json_text, plain
from furrowmap.core.runtime.packed import packed, unpacked
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.runtime.settings import language_of_user, threads, using, using_threads
from furrowmap.core.session.opened import OpenSession
from furrowmap.exporters.files.atomic import atomic_output, refuse_open
from furrowmap.exporters.files.file_records import FileRecord, file_records
from furrowmap.exporters.files.plain_files import refuse_unlike_products
from furrowmap.exporters.files.result_folder import REPORT, RUN_FILES, RUN_PRODUCTS
from furrowmap.exporters.files.staging import kept, recover, staged_folder
from furrowmap.workflows.run.tools import RunTool

if TYPE_CHECKING:
    from furrowmap.core.matching.session_match import MatchedSession
    from furrowmap.workflows.run.products import RunProducts

SPACE: Final = 2
"""Bytes of temporary files and products for each byte of a capture, at least: 10 bytes a point for surfaces and 5 for
the cloud, where half of the 384 firings in a packet of 1264 bytes return."""
_BAGS: Final = frozenset({".bag", ".mcap", ".db3"})


def run_to_folder(
    opened: OpenSession,
    folder: Path,
    tools: Sequence[RunTool] = (),
    *,
    overwrite: bool,
    resume: bool,
    progress: Progress = silent,
) -> None:
    """Run an open session, and write its products and those of tools into a folder.

    Args:
        overwrite: replace the products of other recordings.
        resume: use what a killed run into the same folder kept of scan matching.

    Raises:
        FurrowmapError: if the session does not make a cloud, or the folder cannot be written to.
    """
    start = perf_counter()
    if opened.inputs.within is not None:
        ground_to_map(opened.inputs.within, opened.frame)  # an error of the polygons is raised before the work
    for tool in tools:
        tool.check_inputs()  # likewise
    if resolved(opened.file) in {resolved(folder / name) for name in RUN_PRODUCTS}:
        raise RefusedError("output-is-input.refuse-original", folder=folder, session_file=opened.file.name)
    inputs = None if overwrite else _refuse_foreign(folder, opened, progress)
    refuse_unlike_products(folder, RUN_FILES)
    refuse_open(folder / name for name in RUN_PRODUCTS)
    captures = [path for path in opened.inputs.lidar if path.is_file() and _BAGS.isdisjoint(path.suffixes)]
    needed = SPACE * sum(path.stat().st_size for path in captures)
    there = next(place for place in (folder.absolute(), *folder.absolute().parents) if place.exists())
    free = shutil.disk_usage(there).free
    if needed > free:
        raise RefusedError("disk-space", folder=folder, free=free / 1e9, needed=needed / 1e9)
    with (
        staged_folder(folder, resume=resume) as staging,
        using(scratch_folder=staging, language=language_of_user(opened.session.report.language)),
        using_threads(opened.session.run.threads, by_default=True),
        ThreadPoolExecutor(1, "importing") as pool,
    ):
        early = threads() > 1
        begin = cache(lambda: pool.submit(_import_products, tools) if early else None)

        def report(stage: str, share: float) -> None:
            begin()  # once packets are read: beside kernels, which leave the interpreter to these imports
            progress(stage, share)

        inputs = inputs or file_records(opened.inputs.all, resolved(opened.file).parent, progress)
        with ExitStack() as stack:
            products: list[RunProducts] = []
            for tool in tools:
                tool.folder = staging
                tool.stack = stack
                tool.open()

            def open_sink(
                frame: MapFrame, origin_m: tuple[float, float, float], frames: Frames | None
            ) -> Callable[[PlacedScan], None]:
                _import_products(tools)
                from furrowmap.workflows.run.products import open_products

                products.append(stack.enter_context(open_products(opened, staging, frame, origin_m, frames, tools)))
                return products[0].add

            checkpoint = KeptMatching(kept(staging), opened, inputs)
            corrector = next((tool for tool in tools if tool.corrects), None)
            found = run_session(opened, open_sink, report, checkpoint, corrector)
            from furrowmap.workflows.run.products import Made, write_products

            made = products[0].finish(found, inputs, progress) if products else Made(found, inputs)
        release()
        report_content = write_products(made, opened, folder, staging, start, progress)
        for tool in tools:
            tool.describe(report_content)


def _import_products(tools: Sequence[RunTool]) -> None:
    """Import what writes products, and what tools need late."""
    _import_writers()
    for tool in tools:
        tool.preload()


@cache
def _import_writers() -> None:
    """Import what writes products with its libraries; once, as objects of an earlier run must not be frozen."""
    with importing():
        import furrowmap.workflows.run.products  # noqa: F401
        from furrowmap.exporters.reports.html_pages import compile_templates

        pages = ("report", "base", "parts", "passes", "images", "flight", "parcels", "control")
        compile_templates(*(f"{name}.html" for name in pages))  # half a second of the last step, which has one thread


class KeptMatching:
    """A checkpoint in a file, valid for one version of furrowmap, one session and one set of recordings."""

    def __init__(self, path: Path, opened: OpenSession, inputs: Sequence[FileRecord]) -> None:
        known = {"furrowmap": version("furrowmap"), "session": msgspec.to_builtins(opened.session), "inputs": inputs}
        self._path = path
        self._key = hashlib.sha256(json_text(known).encode()).digest()

    def load(self) -> MatchedSession | None:
        """What an earlier run kept; None for nothing, or that of another session."""
        if not self._path.is_file():
            return None
        from furrowmap.core.matching.session_match import MatchedSession

        try:
            data = np.memmap(self._path, np.uint8, "r").data
            if data[: len(self._key)] != self._key:
                return None
            return unpacked(data[len(self._key) :], MatchedSession)
        except (ValueError, TypeError, MemoryError):  # damaged
            return None

    def save(self, found: MatchedSession) -> None:
        """Keep what matching found."""
        with atomic_output(self._path) as unfinished, unfinished.open("wb") as file:
            file.write(self._key)
            file.writelines(packed(found))


def _refuse_foreign(folder: Path, opened: OpenSession, progress: Progress) -> list[FileRecord] | None:
    """Refuse a folder that holds the products of other recordings, by content as they often have the same names."""
    if not folder.is_dir():
        return None
    recover(folder)
    there = [name for name in RUN_PRODUCTS if (folder / name).exists()]
    if not there:
        return None
    inputs = file_records(opened.inputs.all, resolved(opened.file).parent, progress)
    try:
        earlier = json.loads(read_own(folder, REPORT))
        same = _recordings(earlier["session"], earlier["inputs"]) == _recordings(
            msgspec.to_builtins(opened.session), plain(inputs)
        )
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        same = False
    if not same:
        raise RefusedError("output-exists.other-recording", folder=folder, there=", ".join(there))
    return inputs


def _recordings(session: Any, inputs: Any) -> tuple[Any, set[str]]:
    """The task and the hashes of the recordings, from the tables of a session and the records of its files."""
    recording = session["recording"]
    stated = session["trajectory"]
    named = recording["lidar"] or (stated["files"] if stated is not None else recording["gnss"])
    names = {PurePosixPath(name).as_posix() for name in named}
    whole = [file for file in inputs if names & {file["name"], *map(str, PurePosixPath(file["name"]).parents)}]
    return recording["task"], {file["sha256"] for file in whole}
