"""One run of a batch, as a worker does it."""

from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from time import monotonic, perf_counter, process_time, sleep
from typing import Final

import msgspec

from furrowmap.core.runtime.errors import FurrowmapError, RefusedError, as_furrowmap_error
from furrowmap.core.runtime.json_text import plain
from furrowmap.core.runtime.memory import peak_memory_bytes
from furrowmap.core.runtime.settings import using
from furrowmap.core.session.opened import OpenSession
from furrowmap.exporters.files.batch_state import Failure, SessionOutcome, Stamp
from furrowmap.exporters.files.file_records import file_records, files_in
from furrowmap.exporters.files.result_folder import REPORT
from furrowmap.exporters.vectors.batch_table import BATCH_FIGURES, outlines
from furrowmap.results import Result, open_result
from furrowmap.workflows.batch.jobs import Job, key_of, open_job
from furrowmap.workflows.batch.places import earlier_in_store, fetch_session, put_result, scratch, store_failure
from furrowmap.workflows.batch.sources import stamp
from furrowmap.workflows.run.run import run_opened

PATIENCE_S: Final = 3600.0
"""A run of another worker into the same folder, such as one whose scheduler is gone, is waited for so long."""
_LOOK_S: Final = 1.0


def run_job(job: Job) -> SessionOutcome:
    """Run a session into its folder, unless the result of the same inputs, settings and version is there.

    Errors are part of the outcome, because one session must not stop the others.
    """
    if job.url or job.results_url:
        return _run_with_store(job)
    wall_s, processor_s = perf_counter(), process_time()
    key, stamps = "", tuple[Stamp, ...]()
    try:
        with using(threads=job.process.threads, allowed=job.process.allowed, language=job.process.language):
            opened = open_job(job)
            key, stamps = key_of(job), input_stamps(opened)
            result, repeated = _result(job, opened)
            outcome = replace(_outcome(key, stamps, result, opened), repeated=repeated)
    except Exception as error:  # noqa: BLE001 whatever is wrong with one session is a row of the table
        outcome = SessionOutcome(key, stamps, Failure.from_error(as_furrowmap_error(error)))
    return replace(
        outcome,
        seconds=round(perf_counter() - wall_s, 3),
        processor_s=round(process_time() - processor_s, 3),
        peak_mb=round(peak_memory_bytes() / 1e6, 1),
    )


def _run_with_store(job: Job) -> SessionOutcome:
    """Run a session whose recordings or results are in a store, on copies."""
    target = f"{job.results_url}/{job.name}" if job.results_url else ""
    try:
        key = key_of(job)
        if target and job.url and (earlier := earlier_in_store(target, key, job.stamps)) is not None:
            return earlier
        with scratch() as folder:
            file = str(fetch_session(job.url, job.stamps, Path(folder))) if job.url else job.file
            results = str(Path(folder) / "results") if target else job.results
            local = replace(job, file=file, results=results, url="", results_url="")
            outcome = run_job(local)
            outcome = replace(outcome, key=key, inputs=job.stamps) if job.url else outcome
            if target and outcome.failure is None:
                _put(local.folder, target, outcome)
            return outcome
    except Exception as error:  # noqa: BLE001 whatever a store or its library raises is a row of the table
        ours = isinstance(error, FurrowmapError | MemoryError)
        ended_by = as_furrowmap_error(error) if ours else store_failure(job.url or target, error)
        return SessionOutcome("", job.stamps, Failure.from_error(ended_by))


def _put(folder: Path, target: str, outcome: SessionOutcome) -> None:
    """Copy a result into a store when no other host writes it."""
    until = monotonic() + PATIENCE_S
    while True:
        try:
            put_result(folder, target, outcome)
        except RefusedError as error:
            if error.code not in ("output-busy", "output-lost") or monotonic() > until:
                raise
            sleep(_LOOK_S)
        else:
            return


def input_stamps(opened: OpenSession) -> tuple[Stamp, ...]:
    """The files of a session as they are now, without their content."""
    files = [file for path in opened.inputs.all for file in (files_in(path) if path.is_dir() else [path])]
    return tuple(stamp(file) for file in files)


def _result(job: Job, opened: OpenSession) -> tuple[Result, bool]:
    """The result, and whether it was there."""
    until = monotonic() + PATIENCE_S
    while True:
        try:
            earlier = _earlier(job.folder, opened)
            if earlier is not None:
                return earlier, True
            return run_opened(opened, job.folder, overwrite=job.overwrite, resume=True), False
        except RefusedError as error:
            if error.code != "output-busy" or monotonic() > until:
                raise
            sleep(_LOOK_S)


def _earlier(folder: Path, opened: OpenSession) -> Result | None:
    """The result in a folder, if it is of the same inputs, settings and version."""
    if not (folder / REPORT).is_file():
        return None
    result = open_result(folder)
    report = result.report
    if report["furrowmap"] != version("furrowmap") or report["session"] != plain(msgspec.to_builtins(opened.session)):
        return None
    records = plain(file_records(opened.inputs.all, opened.file.resolve().parent))
    had, have = (sorted((file["name"], file["sha256"]) for file in files) for files in (report["inputs"], records))
    return result if had == have else None


def _outcome(key: str, stamps: tuple[Stamp, ...], result: Result, opened: OpenSession) -> SessionOutcome:
    report = result.report
    root = opened.file.resolve().parent
    digests = {(root / record["name"]).resolve(): record["sha256"] for record in report["inputs"]}
    inputs = tuple(replace(one, sha256=digests.get(Path(one.path).resolve(), "")) for one in stamps)
    figures = {name: report["figures"][name] for name in BATCH_FIGURES if name in report["figures"]}
    figures |= {"session": report["session"]["name"], "warnings": len(report["warnings"])}
    footprint, track = outlines(result.layers, opened.frame)
    return SessionOutcome(key, inputs, figures=figures, footprint=footprint, track=track)
