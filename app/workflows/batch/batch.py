"""A batch: all sessions below some folders, each run once, by one machine or many."""

from __future__ import annotations

import hashlib
import shutil
import statistics
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final

import msgspec

from furrowmap.core.runtime.errors import FurrowmapError, InputError, Notice
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.exporters.files.batch_state import (
    STATE,
    BatchState,
    Failure,
    SessionOutcome,
    Stamp,
    batch_state,
    same_files,
)
from furrowmap.exporters.files.lease import leased, refuse_leased
from furrowmap.exporters.files.result_folder import REPORT
from furrowmap.exporters.reports.batch_page import BATCH_PAGE, write_batch_page
from furrowmap.exporters.vectors.batch_table import LAYERS, TABLE, Row, write_layers, write_table
from furrowmap.settings import BatchSettings
from furrowmap.workflows.batch.engine import ATTEMPTS, Manner, Workforce
from furrowmap.workflows.batch.jobs import (
    Job,
    Prepared,
    Request,
    identity,
    key_of,
    open_job,
    own_version,
    prepare,
    result_or_failure,
)
from furrowmap.workflows.batch.places import Store, find_remote, is_url, scratch
from furrowmap.workflows.batch.sources import Source, find_sources, named, stamp
from furrowmap.workflows.batch.task import input_stamps, run_job
from furrowmap.workflows.session.machines import machine_file

START_S: Final = 2.0
BYTES_A_SECOND: Final = 5e6
"""Of a core and of recordings (docs/development/benchmarks.md: 0.85 million points for each second of processor time,
6.6 bytes of a capture for each), where no session of the batch has been run yet."""
_LOOKING: Final = "looking at recordings"
_RUNNING: Final = "running sessions"


@dataclass(frozen=True)
class Batch:
    """What a batch did, or would do.

    Attributes:
        results: path or URL of the folder of results.
        sessions: a row for each session that has ended, in the order of names; with `dry_run`, of earlier calls.
        run: names of those that ran, or would run.
        unchanged: names of those that were done before.
        failed: names of those without a result.
        estimate_s: expected wall time of the runs, with `dry_run`.
        notices: what a user should know.
    """

    results: str
    sessions: tuple[Row, ...] = ()
    run: tuple[str, ...] = ()
    unchanged: tuple[str, ...] = ()
    failed: tuple[str, ...] = ()
    estimate_s: float | None = None
    notices: tuple[Notice, ...] = ()


@dataclass(frozen=True)
class _Plan:
    """What is to be done.

    Attributes:
        jobs: all runs, by name.
        due: names of those to run.
        failures: of sources that give no run, by name.
        bytes_due: size of the inputs of those to run.
        notices: for the user.
    """

    jobs: dict[str, Job] = field(default_factory=dict)
    due: list[str] = field(default_factory=list)
    failures: dict[str, tuple[str, Failure]] = field(default_factory=dict)
    bytes_due: dict[str, int] = field(default_factory=dict)
    notices: list[Notice] = field(default_factory=list)


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
    """Run all sessions below some folders, each once, and write tables of them.

    A session runs if its inputs, its settings or furrowmap's version have changed since its result was made. One that
    fails does not stop the others.

    Args:
        folders: folders with session files, or recordings; or session files.
        results: folder of the results, one folder a session; created if it does not exist. Both may be URLs that fsspec
            opens, such as `s3://…`.
        settings: how it is done.
        dry_run: look at the sessions, run and write nothing.
        overwrite: replace products of other recordings in result folders.
        say: is called with what a user may want to know meanwhile, such as the address of the dashboard.
        progress: is called with each stage and its share.

    Raises:
        InputError: if a folder does not exist, or holds no session.
        RefusedError: if another batch is writing to `results`, or a package is missing.
        FurrowmapError: if the scheduler cannot be reached.
    """
    remote = [str(folder) for folder in folders if is_url(folder)]
    with ExitStack() as stack:
        target = Path(stack.enter_context(scratch())) if is_url(results) else Path(results)
        sources = find_sources([Path(folder) for folder in folders if not is_url(folder)], target)
        sources += [source for url in remote for source in find_remote(url)]
        url = str(results).rstrip("/") if is_url(results) else ""
        runs = _Batch(target, settings, overwrite=overwrite, progress=progress, say=say, url=url)
        return runs.call(sources, dry_run=dry_run)


@dataclass(frozen=True)
class _Batch:
    """The steps of a batch."""

    results: Path
    settings: BatchSettings
    overwrite: bool
    progress: Progress
    say: Callable[[str], None]
    url: str

    def call(self, sources: Sequence[Source], *, dry_run: bool) -> Batch:
        """Plan or do the batch, with the state of the folder of results."""
        store, path = Store(self.url), self.results / STATE
        if self.url and (content := store.read(STATE)) is not None:
            path.write_bytes(content)
        if dry_run:
            with batch_state(path if path.is_file() else None) as state:
                return self.planned(sources, state)
        self.results.mkdir(parents=True, exist_ok=True)
        with leased(self.results) as own, batch_state(path) as state:
            for ended in refuse_leased(self.results, own):  # of batches that were killed
                shutil.rmtree(ended, ignore_errors=True)
            try:
                return self.done(sources, state)
            finally:
                if self.url:
                    state.save_as(self.results / "copy")
                    store.write(STATE, (self.results / "copy").read_bytes())

    def planned(self, sources: Sequence[Source], state: BatchState) -> Batch:
        """What would be done."""
        outcomes = state.outcomes()
        force = Workforce(self.settings.workers, self.settings.scheduler, self.say)
        plan = self._plan(sources, state, outcomes, force, keep=False)
        rates = [
            outcome.processor_s / size
            for outcome in outcomes.values()
            if outcome.failure is None and not outcome.repeated and (size := _size(outcome.inputs)) > 0
        ]
        each = (statistics.median(rates), 0.0) if rates else (1.0 / BYTES_A_SECOND, START_S)
        estimate_s = sum(each[0] * plan.bytes_due.get(name, 0) + each[1] for name in plan.due) / force.cores
        return self._told(plan, outcomes, run=plan.due, estimate_s=estimate_s)

    def done(self, sources: Sequence[Source], state: BatchState) -> Batch:
        """What was done."""
        outcomes = state.outcomes()
        with Workforce(self.settings.workers, self.settings.scheduler, self.say) as force:
            plan = self._plan(sources, state, outcomes, force, keep=True)
            for name, outcome in self._run(plan, force):
                outcomes[name] = outcome
                state.keep(name, outcome)
        for name, (_, failure) in plan.failures.items():
            outcomes[name] = SessionOutcome("", failure=failure)
        told = self._told(plan, outcomes, run=plan.due)
        if (
            plan.due
            or plan.failures
            or not all((self.results / name).is_file() for name in (TABLE, LAYERS, BATCH_PAGE))
        ):
            write_table(self.results, told.sessions)
            write_layers(self.results, told.sessions)
            write_batch_page(self.results, told.sessions)
            for name in (TABLE, LAYERS, BATCH_PAGE) if self.url else ():
                Store(self.url).write(name, (self.results / name).read_bytes())
        return told

    def _plan(
        self,
        sources: Sequence[Source],
        state: BatchState,
        outcomes: dict[str, SessionOutcome],
        force: Workforce,
        *,
        keep: bool,
    ) -> _Plan:
        plan = _Plan()
        prepared = self._prepared(sources, state, force, plan, keep=keep)
        wanted, made = [], {}
        for source in sources:
            found = prepared.get(source.place)
            if found is None:
                continue
            for visit in found.visits or (None,):
                key = identity(source.place, visit)
                wanted.append((key, (*source.parts, visit.name) if visit is not None else source.parts))
                made[key] = (source, found, visit)
        names = named(wanted, state.sources())
        if keep:
            state.keep_names(names)
        manner = Manner.of_user(force.threads)
        for key, (source, found, visit) in made.items():
            if found.failure is not None:
                plan.failures[names[key]] = (source.place, found.failure)
                continue
            job = Job(
                name=names[key],
                file=source.place,
                text=found.text,
                results=str(self.results.resolve()),
                manner=manner,
                visit=visit,
                overwrite=self.overwrite or names[key] in outcomes,
                url=source.url,
                stamps=source.stamps if source.url else (),
                results_url=self.url,
            )
            plan.jobs[job.name] = job
        self._choose(plan, outcomes)
        return plan

    def _prepared(
        self, sources: Sequence[Source], state: BatchState, force: Workforce, plan: _Plan, *, keep: bool
    ) -> dict[str, Prepared]:
        """What each source holds, by its file."""
        machine = str(machine_file(self.settings.machine).resolve()) if self.settings.machine is not None else ""
        boundaries = str(Path(self.settings.boundaries).resolve()) if self.settings.boundaries is not None else ""
        without = [source for source in sources if source.made and not machine]
        if without:
            plan.notices.append(_no_session(without))
        taken = [source for source in sources if machine or not source.made]
        if not taken:
            raise _nothing(without)
        decisive = [stamp(Path(path)) for path in (machine, boundaries) if path]
        keys = {one.place: _prepared_key(one, decisive) for one in taken}
        found, asked = dict[str, Prepared](), list[tuple[str, Request]]()
        for source in taken:
            name = source.place
            if not source.made and not boundaries:
                found[name] = _as_it_is(source)
            elif (kept := state.prepared(name, keys[name])) is not None:
                found[name] = msgspec.json.decode(kept, type=Prepared)
            else:
                asked.append((name, _request(source, machine, boundaries)))
        looked = force.each(prepare, asked, _LOOKING, self.progress) if keep else _here(asked)
        for name, result in looked:
            found[name] = result if isinstance(result, Prepared) else Prepared(failure=_lost(name))
            if keep and found[name].failure is None:
                state.keep_prepared(name, keys[name], msgspec.json.encode(found[name]))
        return found

    def _choose(self, plan: _Plan, outcomes: dict[str, SessionOutcome]) -> None:
        """Choose the jobs whose settings or inputs have changed, or that failed for a reason that may have passed."""
        whole = Store(self.url).complete() if self.url else None
        for name, job in plan.jobs.items():
            looked = result_or_failure(partial(_key_and_stamps, job))
            if isinstance(looked, Failure):
                plan.failures[name] = (job.file, looked)
                continue
            before, (key, stamps) = outcomes.get(name), looked
            plan.bytes_due[name] = _size(stamps)
            same = before is not None and before.key == key and same_files(before.inputs, stamps)
            if before is None or not same or not _is_settled(before, job, whole):
                plan.due.append(name)

    def _run(self, plan: _Plan, force: Workforce) -> Iterator[tuple[str, SessionOutcome]]:
        longest_first = sorted(plan.due, key=lambda name: -plan.bytes_due[name])
        items = [(name, plan.jobs[name]) for name in longest_first]
        for name, found in force.each(run_job, items, _RUNNING, self.progress):
            yield name, found if isinstance(found, SessionOutcome) else SessionOutcome("", failure=_lost(name))

    def _told(
        self, plan: _Plan, outcomes: dict[str, SessionOutcome], *, run: Sequence[str], estimate_s: float | None = None
    ) -> Batch:
        of = {name: (job.file, job.visit.name if job.visit is not None else "") for name, job in plan.jobs.items()}
        of |= {name: (file, "") for name, (file, _) in plan.failures.items()}
        rows = tuple(Row(name, *of[name], outcomes[name]) for name in sorted(of) if name in outcomes)
        return Batch(
            self.url or str(self.results),
            rows,
            tuple(run),
            tuple(sorted(set(plan.jobs) - set(run) - set(plan.failures))),
            tuple(row.name for row in rows if row.outcome.failure is not None),
            estimate_s,
            tuple(plan.notices),
        )


def _request(source: Source, machine: str, boundaries: str) -> Request:
    stamps = source.stamps if source.url else ()
    return Request(source.place, source.made, machine, boundaries, source.url, stamps)


def _here(asked: Sequence[tuple[str, Request]]) -> Iterator[tuple[str, Prepared]]:
    """Look at sources in this process."""
    for name, request in asked:
        yield name, prepare(request)


def _as_it_is(source: Source) -> Prepared:
    text = result_or_failure(partial(_text_of, source))
    return Prepared(failure=text) if isinstance(text, Failure) else Prepared(text)


def _text_of(source: Source) -> str:
    if source.url:
        return (Store(source.url).read(source.file.name) or b"").decode()
    return source.file.read_text(encoding="utf-8")


def _key_and_stamps(job: Job) -> tuple[str, tuple[Stamp, ...]]:
    return key_of(job), job.stamps if job.url else input_stamps(open_job(job))


def _prepared_key(source: Source, decisive: Sequence[Stamp]) -> str:
    """A hash of what decides on what a source holds."""
    content = msgspec.json.encode([own_version(), source.stamps, decisive])
    return hashlib.sha256(content).hexdigest()


def _size(stamps: Sequence[Stamp]) -> int:
    return sum(one.bytes for one in stamps)


def _no_session(without: Sequence[Source]) -> Notice:
    shown = ", ".join(source.url or str(source.file.parent) for source in without[:3])
    return Notice("batch-no-session", without=len(without), shown=shown, is_without=len(without) > 3)


def _nothing(without: Sequence[Source]) -> InputError:
    return InputError("batch-nothing", without_count=len(without) if without else None)


def _is_settled(before: SessionOutcome, job: Job, whole: set[str] | None) -> bool:
    """Whether the same inputs would give the same: there is a result, or the inputs themselves are at fault."""
    if before.failure is None:
        return job.name in whole if whole is not None else (job.folder / REPORT).is_file()
    return before.failure.exit_status == InputError.exit_status


def _lost(name: str) -> Failure:
    return Failure.of(FurrowmapError("batch-worker-lost", name=name, attempts=ATTEMPTS))
