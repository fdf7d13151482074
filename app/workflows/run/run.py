"""Running a session: from the session file to the folder of its products."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path, PurePosixPath
from time import perf_counter
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Self

import msgspec

from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.images.frames import Frames
from furrowmap.core.pipeline import pipeline
from furrowmap.core.pointclouds.placed import PlacedScan
from furrowmap.core.runtime.errors import RefusedError
from furrowmap.core.runtime.json_text import plain
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.runtime.scratch import release, scratch_in
from furrowmap.core.runtime.threads import using_threads
from furrowmap.core.session.opened import OpenSession, open_session
from furrowmap.core.work.boundary import ground_to_map
from furrowmap.exporters.files.file_records import FileRecord, file_records
from furrowmap.exporters.files.result_folder import REPORT, RUN_PRODUCTS
from furrowmap.exporters.files.staging import kept, recover, staged_folder
from furrowmap.process import importing_beside
from furrowmap.workflows.run.kept_matching import KeptMatching

if TYPE_CHECKING:
    from furrowmap.results import Result
    from furrowmap.workflows.run.products import RunProducts

PRODUCTS: Final = "furrowmap.workflows.run.products"
"""The module that writes products, with the libraries that do: imported while the trajectory is computed."""
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
    within: str | Path | None = None,
    progress: Progress = silent,
) -> Result:
    """Run a session and write its products into a folder.

    Products of the same recordings in the folder are replaced, whatever else the session names or sets: the same files
    of the scanner, byte for byte, or without a scanner the same positions.

    Args:
        out: the folder, made if it does not exist; by default SESSION_result beside the session file.
        overwrite: replace the products of other recordings, too.
        resume: use what a killed run into the same folder found by scan matching, if session and recordings are the
            same.
        within: a file with polygons, or task data: cloud, surfaces and parcels hold what lies in them alone; instead of
            `[field] within`.
        progress: is called with each stage and its share, 0 to 1.

    Raises:
        FurrowmapError: if the session does not make a cloud, or the folder cannot be written to.
    """
    file = Path(session)
    folder = Path(out) if out is not None else file.resolve().parent / f"{file.stem}_result"
    opened = open_session(file)
    if within is not None:
        opened = opened.within(Path(within))
    return run_opened(opened, folder, overwrite=overwrite, resume=resume, progress=progress)


def run_opened(
    opened: OpenSession, folder: Path, *, overwrite: bool, resume: bool, progress: Progress = silent
) -> Result:
    """Run an open session; arguments and errors as :func:`run`."""
    start = perf_counter()
    if opened.inputs.within is not None:
        ground_to_map(opened.inputs.within, opened.frame)  # what is wrong with the polygons is told before the work
    _refuse_original(folder, opened.file)
    inputs = None if overwrite else _refuse_foreign(folder, opened, progress)
    _expect_space(folder, opened)
    with (
        staged_folder(folder, resume=resume) as staging,
        scratch_in(staging),
        using_threads(opened.session.run.threads, by_default=True),
        importing_beside(PRODUCTS) as module,
    ):
        inputs = inputs or file_records(opened.inputs.all, opened.file.resolve().parent, progress)
        with _LateProducts(lambda: module().RunProducts(opened, staging)) as products:
            if opened.session.parcels is not None:
                products.ready()  # what is wrong with the parcels is told before the work
            checkpoint = KeptMatching(kept(staging), opened, inputs)
            found = pipeline.run(opened, products, progress, checkpoint, products)
            made = products.ready().made(found, inputs, progress)
        release()
        module().write_products(made, opened, folder, staging, start, progress)
    from furrowmap.results import open_result

    return open_result(folder)


class _LateProducts:
    """Hands the points and frames of a run to its products, whose module is imported when the first come."""

    def __init__(self, make: Callable[[], RunProducts]) -> None:
        self._make, self._stack = make, ExitStack()
        self._made: RunProducts | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, error, trace)

    def ready(self) -> RunProducts:
        """The products; the first call makes them, and raises what is wrong with their settings."""
        if self._made is None:
            self._made = self._stack.enter_context(self._make())
        return self._made

    def begin(self, frame: MapFrame, origin_m: tuple[float, float, float]) -> None:
        """Pass the local origin on."""
        self.ready().points.begin(frame, origin_m)

    def add(self, placed: PlacedScan) -> None:
        """Pass the points of a scan on."""
        self.ready().points.add(placed)

    def take(self, frames: Frames, origin_m: tuple[float, float, float]) -> None:
        """Pass the frames of the camera on."""
        self.ready().frames.take(frames, origin_m)


def _expect_space(folder: Path, opened: OpenSession) -> None:
    """Check, before hours of work, that the disk has room for what a capture becomes.

    Files that may hold other data than packets of a scanner, such as ROS bags, are not counted.
    """
    captures = [path for path in opened.inputs.lidar if path.is_file() and _BAGS.isdisjoint(path.suffixes)]
    needed = SPACE * sum(path.stat().st_size for path in captures)
    there = next(place for place in (folder.absolute(), *folder.absolute().parents) if place.exists())
    free = shutil.disk_usage(there).free
    if needed > free:
        raise RefusedError("disk-space", folder=folder, free=free / 1e9, needed=needed / 1e9)


def _refuse_original(folder: Path, session_file: Path) -> None:
    """Refuse a folder in which a product would overwrite the user's session file."""
    if session_file.resolve() in {(folder / name).resolve() for name in RUN_PRODUCTS}:
        raise RefusedError("output-is-input.refuse-original", folder=folder, session_file=session_file.name)


def _refuse_foreign(folder: Path, opened: OpenSession, progress: Progress) -> list[FileRecord] | None:
    """Refuse a folder that holds the products of other recordings.

    Recordings often have the same names, so their content is compared.
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
        raise RefusedError("output-exists.refuse-foreign", folder=folder, there=", ".join(there))
    return inputs


def _recordings(session: Any, inputs: Any) -> tuple[Any, set[str]]:
    """The task and the hashes of the recordings, from the tables of a session and the records of its files."""
    recording, stated = session["recording"], session["trajectory"]
    named = recording["lidar"] or (stated["files"] if stated is not None else recording["gnss"])
    names = {PurePosixPath(name).as_posix() for name in named}
    whole = [file for file in inputs if names & {file["name"], *map(str, PurePosixPath(file["name"]).parents)}]
    return recording["task"], {file["sha256"] for file in whole}
