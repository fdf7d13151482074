"""A batch: all sessions below some folders, each run once, by one machine or many."""

import hashlib
import shutil
import statistics
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from time import monotonic, perf_counter, process_time, sleep
from typing import Any, Final

import msgspec

from furrowmap.core.readers.boundary_file import BOUNDARIES_UNREADABLE, notices_of_fields, read_fields
from furrowmap.core.runtime.errors import FurrowmapError, InputError, Notice, RefusedError
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.json_text import from_kept_json, kept_json, plain
from furrowmap.core.runtime.memory import peak_memory_bytes
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.runtime.urls import without_passwords
from furrowmap.core.runtime.write_errors import as_furrowmap_error
from furrowmap.core.session.opened import OpenSession
from furrowmap.core.session.session_file import read_session_text, session_text
from furrowmap.exporters.files.atomic import made_folder
from furrowmap.exporters.files.batch_state import (
    STATE,
    BatchState,
    Failure,
    SessionOutcome,
    Stamp,
    batch_state,
    same_files,
)
from furrowmap.exporters.files.file_records import file_records, files_in
from furrowmap.exporters.files.lease import hold_lease, refuse_leased
from furrowmap.exporters.files.result_folder import REPORT
from furrowmap.exporters.reports.html_pages import write_html
from furrowmap.exporters.reports.season_pages import BATCH_PAGE, batch_page
from furrowmap.exporters.vectors.batch_table import (
    BATCH_FIGURES,
    BATCH_LAYERS,
    BATCH_TABLE,
    Row,
    outlines,
    write_layers,
    write_table,
)
from furrowmap.results import Result, open_result
from furrowmap.settings import BatchSettings
from furrowmap.workflows.batch.batch_sources import BatchSource, assign_names, find_sources, stamp
from furrowmap.workflows.batch.engine import ATTEMPTS
from furrowmap.workflows.batch.jobs import Job, PreparedSource, identity, key_of, open_job, own_version, prepare
from furrowmap.workflows.batch.object_stores import (
    Store,
    earlier_in_store,
    expect_store,
    fetch_session,
    find_remote,
    is_url,
    put_result,
    scratch,
    store_failure,
)
from furrowmap.workflows.batch.workforce import Workforce, unprotected
from furrowmap.workflows.run.session_run import run_opened
from furrowmap.workflows.session.known_machines import machine_file

PATIENCE_S: Final = 3600.0
"""A run of another worker into the same folder, such as one whose scheduler is gone, is waited for so long."""
_LOOK_S: Final = 1.0


def run_job(job: Job) -> SessionOutcome:
    """Run a session into its folder, unless the result of the same inputs, settings and version is there.

    Errors are part of the outcome, because one session must not stop the others.
    """
    if job.url or job.results_url:
        return _run_with_store(job)
    wall_s = perf_counter()
    processor_s = process_time()
    key = ""
    stamps = tuple[Stamp, ...]()
    try:
        opened = open_job(job)
        key = key_of(job)
        stamps = input_stamps(opened)
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
    records = plain(file_records(opened.inputs.all, resolved(opened.file).parent))
    had, have = (sorted((file["name"], file["sha256"]) for file in files) for files in (report["inputs"], records))
    return result if had == have else None


def _outcome(key: str, stamps: tuple[Stamp, ...], result: Result, opened: OpenSession) -> SessionOutcome:
    report = result.report
    root = resolved(opened.file).parent
    digests = {resolved(root / record["name"]): record["sha256"] for record in report["inputs"]}
    inputs = tuple(replace(one, sha256=digests.get(resolved(Path(one.path)), "")) for one in stamps)
    figures = {name: report["figures"][name] for name in BATCH_FIGURES if name in report["figures"]}
    figures |= {"session": report["session"]["name"], "warnings": len(report["warnings"])}
    figures |= {"damaged": [one for one in report["warnings"] if one.get("damaged") and one["follows"] is None]}
    footprint, track = outlines(result.layers, opened.frame)
    return SessionOutcome(key, inputs, figures=figures, footprint=footprint, track=track)


START_S: Final = 2.0
BYTES_A_SECOND: Final = 5e6
"""Of a core and of recordings (docs/decisions/benchmarks.md: 0.85 million points for each second of processor time,
6.6 bytes of a capture for each), where no session of the batch has been run yet."""


@dataclass(frozen=True)
class Batch:
    """What a batch did, or would do.

    Attributes:
        results: path or URL of the folder of results.
        sessions: a row for each session that has ended, in the order of names; with `dry_run`, of earlier calls and of
            those that cannot run.
        run: names of those that ran, or would run.
        unchanged: names of those that were done before.
        failed: names of those without a result.
        estimate_s: expected wall time of the runs, with `dry_run`.
    """

    results: str
    sessions: tuple[Row, ...] = ()
    run: tuple[str, ...] = ()
    unchanged: tuple[str, ...] = ()
    failed: tuple[str, ...] = ()
    estimate_s: float | None = None
    notices: tuple[Notice, ...] = ()

    @property
    def damaged(self) -> dict[str, list[dict[str, Any]]]:
        """Warnings, in all languages, of damaged inputs: by the names of the sessions that have any."""
        return {row.name: row.damaged for row in self.sessions if row.damaged}


@dataclass(frozen=True)
class _Plan:
    """The runs by name, those that are due with the size of their inputs, and the sources that give none."""

    jobs: dict[str, Job] = field(default_factory=dict)
    due: list[str] = field(default_factory=list)
    failures: dict[str, tuple[str, Failure]] = field(default_factory=dict)
    bytes_due: dict[str, int] = field(default_factory=dict)
    notices: tuple[Notice, ...] = ()


def batch(
    folders: Sequence[str | Path],
    results: str | Path,
    settings: BatchSettings = BatchSettings(),
    *,
    dry_run: bool = False,
    overwrite: bool = False,
    say: Callable[[str], None] = lambda _: None,
    progress: Progress = silent,
) -> Batch:
    """Run all sessions in some folders and their subfolders, each once, and write tables of them.

    A session runs if its inputs, its settings or furrowmap's version have changed since its result was made. One that
    fails does not stop the others.

    Args:
        folders: folders with session files, or recordings; or session files.
        results: folder of the results, one folder a session; created if it does not exist. Both may be URLs that fsspec
            opens, such as `s3://…`.
        dry_run: look at the sessions, run and write nothing.
        say: is called with what a user may want to know meanwhile, such as the number of workers.

    Raises:
        InputError: if a folder does not exist, or holds no session.
        RefusedError: if another batch is writing to `results`, or a package is missing.
        FurrowmapError: if the scheduler cannot be reached.
    """
    remote = [str(folder) for folder in folders if is_url(folder)]
    for place in (*remote, *([str(results)] if is_url(results) else ())):
        expect_store(place)
    with ExitStack() as stack:
        target = Path(stack.enter_context(scratch())) if is_url(results) else Path(results)
        sources = find_sources([Path(folder) for folder in folders if not is_url(folder)], target)
        sources += [source for url in remote for source in find_remote(url)]
        url = str(results).rstrip("/") if is_url(results) else ""
        runs = _Batch(target, settings, overwrite, progress, say, url)
        path = target / STATE
        if url and (content := Store(url).read(STATE)) is not None:
            path.write_bytes(content)
        if dry_run:
            return runs.estimate(sources, stack.enter_context(batch_state(path if path.is_file() else None)))
        stack.enter_context(made_folder(target))
        own = stack.enter_context(hold_lease(target))
        state = stack.enter_context(batch_state(path))
        for ended in refuse_leased(target, own):  # of batches that were killed
            shutil.rmtree(ended, ignore_errors=True)
        try:
            return runs.run(sources, state)
        finally:
            if url:
                state.save_as(target / "copy")
                Store(url).write(STATE, (target / "copy").read_bytes())


@dataclass(frozen=True)
class _Batch:
    """The steps of a batch."""

    results: Path
    settings: BatchSettings
    overwrite: bool
    progress: Progress
    say: Callable[[str], None]
    url: str

    def estimate(self, sources: Sequence[BatchSource], state: BatchState) -> Batch:
        """What would be done, and how long it would take."""
        outcomes = state.outcomes()
        force = Workforce(self.settings.workers, self.settings.scheduler, self.say)
        plan = self._plan(sources, state, outcomes, force, dry_run=True)
        rates = [
            outcome.processor_s / size
            for outcome in outcomes.values()
            if outcome.failure is None and not outcome.repeated and (size := _size(outcome.inputs)) > 0
        ]
        outcomes |= {name: SessionOutcome("", failure=failure) for name, (_, failure) in plan.failures.items()}
        each = (statistics.median(rates), 0.0) if rates else (1.0 / BYTES_A_SECOND, START_S)
        estimate_s = sum(each[0] * plan.bytes_due.get(name, 0) + each[1] for name in plan.due) / force.cores
        return self._summary(plan, outcomes, estimate_s)

    def run(self, sources: Sequence[BatchSource], state: BatchState) -> Batch:
        """Run what is due, the longest first, and write the tables."""
        outcomes = state.outcomes()
        with Workforce(self.settings.workers, self.settings.scheduler, self.say) as force:
            plan = self._plan(sources, state, outcomes, force, dry_run=False)
            items = [(name, plan.jobs[name]) for name in sorted(plan.due, key=lambda name: -plan.bytes_due[name])]
            if items and self.settings.scheduler is None and force.workers > 1:
                from furrowmap.warm_up import MOST_KERNELS, warm_up  # it imports numba

                warm_up([MOST_KERNELS], self.progress)  # once: each worker would compile them all
            for name, found in force.each(run_job, items, "running sessions", self.progress):
                outcomes[name] = found if isinstance(found, SessionOutcome) else SessionOutcome("", failure=_lost(name))
                state.keep(name, outcomes[name])
        for name, (_, failure) in plan.failures.items():
            outcomes[name] = SessionOutcome("", failure=failure)
        summary = self._summary(plan, outcomes)
        tables = (BATCH_TABLE, BATCH_LAYERS, BATCH_PAGE)
        if plan.due or plan.failures or not all((self.results / name).is_file() for name in tables):
            write_table(self.results, summary.sessions)
            write_layers(self.results, summary.sessions)
            write_html(self.results / BATCH_PAGE, batch_page(summary.sessions))
            for name in tables if self.url else ():
                Store(self.url).write(name, (self.results / name).read_bytes())
        return summary

    def _plan(
        self,
        sources: Sequence[BatchSource],
        state: BatchState,
        outcomes: dict[str, SessionOutcome],
        force: Workforce,
        *,
        dry_run: bool,
    ) -> _Plan:
        prepared, about_inputs = self._prepare(sources, state, force, dry_run=dry_run)
        plan = _Plan(notices=(*unprotected(self.settings.scheduler), *about_inputs))
        wanted = []
        made = {}
        for source in sources:
            found = prepared.get(source.place)
            if found is None:
                continue
            for visit in found.visits or (None,):
                key = identity(source.place, visit)
                wanted.append((key, (*source.parts, visit.name) if visit is not None else source.parts))
                made[key] = (source, found, visit)
        names = assign_names(wanted, state.sources())
        if not dry_run:
            state.keep_names(names)
        for key, (source, found, visit) in made.items():
            if found.failure is not None:
                plan.failures[names[key]] = (source.place, found.failure)
                continue
            job = Job(
                name=names[key],
                file=source.place,
                text=found.text,
                results=str(resolved(self.results)),
                visit=visit,
                overwrite=self.overwrite or names[key] in outcomes,
                url=source.url,
                stamps=source.stamps if source.url else (),
                results_url=self.url,
            )
            plan.jobs[job.name] = job
        self._choose(plan, outcomes)
        return plan

    def _prepare(
        self, sources: Sequence[BatchSource], state: BatchState, force: Workforce, *, dry_run: bool
    ) -> tuple[dict[str, PreparedSource], list[Notice]]:
        """The session and the visits of each source, by its file."""
        notices: list[Notice] = []
        machine = str(resolved(machine_file(self.settings.machine))) if self.settings.machine is not None else ""
        boundaries = str(resolved(Path(self.settings.boundaries))) if self.settings.boundaries is not None else ""
        without = [source for source in sources if source.made and not machine]
        if without:
            shown = ", ".join(source.url or str(source.file.parent) for source in without[:3])
            notices.append(Notice("batch-no-session", without=len(without), shown=shown, is_without=len(without) > 3))
        if boundaries and not Path(boundaries).exists():
            read_fields(Path(boundaries), error_code=BOUNDARIES_UNREADABLE)  # which says so
        if boundaries:
            notices += notices_of_fields(Path(boundaries))
        usable = [source for source in sources if machine or not source.made]
        if not usable:
            raise InputError("batch-nothing", without_count=len(without) if without else None)
        decisive = [stamp(file) for path in (machine, boundaries) if path for file in _files_of(Path(path))]
        found = dict[str, PreparedSource]()
        due = list[tuple[str, BatchSource]]()
        keys = dict[str, str]()
        for source in usable:
            content = kept_json([own_version(), source.stamps, decisive])
            key = keys[source.place] = hashlib.sha256(content).hexdigest()
            if not source.made and not boundaries:
                found[source.place] = _read_session(source)
            elif (kept := state.prepared(source.place, key)) is not None:
                found[source.place] = from_kept_json(kept, PreparedSource)
            else:
                due.append((source.place, source))
        work = partial(prepare, machine=machine, boundaries=boundaries)
        for name, result in (
            ((name, work(source)) for name, source in due)
            if dry_run
            else force.each(work, due, "looking at recordings", self.progress)
        ):
            found[name] = result if isinstance(result, PreparedSource) else PreparedSource(failure=_lost(name))
            if not dry_run and found[name].failure is None:
                state.keep_prepared(name, keys[name], kept_json(found[name]))
        return found, notices

    def _choose(self, plan: _Plan, outcomes: dict[str, SessionOutcome]) -> None:
        """Choose the jobs whose settings or inputs have changed, or that failed for a reason that may have passed."""
        whole = Store(self.url).complete() if self.url else None
        for name, job in plan.jobs.items():
            try:
                key = key_of(job)
                stamps = job.stamps if job.url else input_stamps(open_job(job))
            except Exception as error:  # noqa: BLE001 whatever is wrong with one session is a row of the table
                plan.failures[name] = (job.file, Failure.from_error(as_furrowmap_error(error)))
                continue
            plan.bytes_due[name] = _size(stamps)
            before = outcomes.get(name)
            if before is None or before.key != key or not same_files(before.inputs, stamps):
                plan.due.append(name)
            elif before.failure is not None:
                if before.failure.exit_status != InputError.exit_status:  # not the fault of the inputs themselves
                    plan.due.append(name)
            elif name not in whole if whole is not None else not (job.folder / REPORT).is_file():
                plan.due.append(name)

    def _summary(self, plan: _Plan, outcomes: dict[str, SessionOutcome], estimate_s: float | None = None) -> Batch:
        of = {name: (job.file, job.visit.name if job.visit is not None else "") for name, job in plan.jobs.items()}
        of |= {name: (file, "") for name, (file, _) in plan.failures.items()}
        rows = tuple(Row(name, *of[name], outcomes[name]) for name in sorted(of) if name in outcomes)
        return Batch(
            without_passwords(self.url) or str(self.results),
            rows,
            tuple(plan.due),
            tuple(sorted(set(plan.jobs) - set(plan.due) - set(plan.failures))),
            tuple(row.name for row in rows if row.outcome.failure is not None),
            estimate_s,
            plan.notices,
        )


def _read_session(source: BatchSource) -> PreparedSource:
    try:
        if source.url:
            return PreparedSource(
                session_text(Store(source.url).read(source.file.name) or b"", without_passwords(source.url))
            )
        return PreparedSource(read_session_text(source.file))
    except Exception as error:  # noqa: BLE001 whatever is wrong with one session is a row of the table
        return PreparedSource(failure=Failure.from_error(as_furrowmap_error(error)))


def _size(stamps: Sequence[Stamp]) -> int:
    return sum(one.bytes for one in stamps)


def _lost(name: str) -> Failure:
    return Failure.from_error(FurrowmapError("worker-lost", name=name, attempts=ATTEMPTS, is_session=True))


def _files_of(path: Path) -> list[Path]:
    """A file, or the files of a field folder or of task data."""
    inside = sorted(file for pattern in ("*", "*/*") for file in path.glob(pattern) if file.is_file())
    return inside if path.is_dir() else [path]
