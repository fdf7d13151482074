"""ISO 11783-10 task data as a recording: positions and working states of the machine.

The tasks of a set become drives: logs joined, times in UTC, working states, widths and area counters.
"""

import datetime as dt
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar, Final, Self

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.geodesy.longitudes import unwrapped_deg
from furrowmap.core.readers.epochs import timing_facts, utc_facts
from furrowmap.core.readers.facts import position_facts
from furrowmap.core.readers.implausible_positions import drop_implausible_positions
from furrowmap.core.readers.isoxml.content import (
    MAIN,
    Partfield,
    Task,
    TaskData,
    TaskFiles,
    is_task_data,
    named_again,
    open_task_sets,
    read_content,
)
from furrowmap.core.readers.isoxml.devices import PARALLEL, DeviceElement, ancestors
from furrowmap.core.readers.isoxml.implement_placement import ImplementLinks, implement_links
from furrowmap.core.readers.isoxml.task_sections import (
    CONDENSED_STATES,
    SECTIONS_EACH,
    WORK_STATE,
    LoggedSections,
    StatedValues,
    read_sections,
)
from furrowmap.core.readers.isoxml.time_log import TimeLog, read_time_log
from furrowmap.core.readers.reader import FileReader, Inspection
from furrowmap.core.readers.source import Head
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.gnss import Fix, GnssTrack, assumed_sigma_m
from furrowmap.core.values.scan import Clock, ClockReading
from furrowmap.core.values.session import MAX_IMPLEMENT_WIDTH_M
from furrowmap.core.values.tool_states import SectionStates, ToolState, ToolStates

ACTUAL_WIDTH: Final = 67
"""Actual working width, mm; the numbers are those of ISO 11783-11's data dictionary."""
TOTAL_AREA: Final = 116
"""m²"""
EFFECTIVE_DISTANCE: Final = 117
"""mm, as 118, the ineffective one."""
EFFECTIVE_TIME: Final = 119
"""s, as 120, the ineffective one."""


@dataclass(frozen=True)
class _LoggedWork:
    """States (n,), width (n,; nan where not logged), and increase of the area counter (nan without) in a time log."""

    state: NDArray[np.int8]
    width_m: FloatArray
    counted_m2: float
    notices: tuple[Notice, ...]


def _logged_work(log: TimeLog, elements: Mapping[str, DeviceElement]) -> _LoggedWork:
    states, contradicted = _states(log, elements)
    state = np.full(len(log), ToolState.UNKNOWN, np.int8)
    if states:
        table = np.stack(list(states.values()))
        state[(table == ToolState.UP).any(axis=0)] = ToolState.UP
        state[(table == ToolState.DOWN).any(axis=0)] = ToolState.DOWN
    width, implausible = _width(log, elements, states, state == ToolState.DOWN)
    state[(state == ToolState.DOWN) & (width == 0.0)] = ToolState.UP
    gains = {
        element: np.nanmax(values) - np.nanmin(values)
        for element, values in log.values_of(TOTAL_AREA)
        if np.isfinite(values).any()
    }
    topmost = [gain for element, gain in gains.items() if not set(ancestors(element, elements)) & gains.keys()]
    return _LoggedWork(state, width, float(max(topmost, default=np.nan)), (*contradicted, *implausible))


def _states(log: TimeLog, elements: Mapping[str, DeviceElement]) -> tuple[dict[str, NDArray[np.int8]], list[Notice]]:
    """The state (n,) of each of the smallest device elements that have one."""
    notices = []
    own = {
        element: np.select([raw == 0, raw == 1], [ToolState.UP, ToolState.DOWN], ToolState.UNKNOWN).astype(np.int8)
        for element, raw in log.values_of(WORK_STATE)
    }
    sections = _section_states(log)
    for element, any_on in sections.items():
        if not (any_on == ToolState.DOWN).any() and (own.get(element, any_on) == ToolState.DOWN).any():
            notices.append(Notice("sections-contradicted", log=log.name, element=element))
        elif element in own:
            own[element] = np.where(any_on == ToolState.UP, ToolState.UP, own[element]).astype(np.int8)
        else:
            own[element] = any_on
    above = {parent for element in own for parent in ancestors(element, elements)}
    return {element: state for element, state in own.items() if element not in above}, notices


def _section_states(log: TimeLog) -> dict[str, NDArray[np.int8]]:
    """For each element with condensed states, whether any of its sections works (n,)."""
    found: dict[str, NDArray[np.int8]] = {}
    for ddi in CONDENSED_STATES:
        for element, bits in log.values_of(ddi):
            known = np.isfinite(bits)
            pairs = np.where(known, bits, 0).astype(np.int64)[:, None] >> (2 * np.arange(SECTIONS_EACH)) & 3
            state = np.where((pairs == 1).any(axis=1), ToolState.DOWN, ToolState.UP)
            state = np.where(known, state, ToolState.UNKNOWN).astype(np.int8)
            found[element] = np.maximum(found[element], state) if element in found else state
    return found


def _width(
    log: TimeLog,
    elements: Mapping[str, DeviceElement],
    states: Mapping[str, NDArray[np.int8]],
    at_work: NDArray[np.bool_],
) -> tuple[FloatArray, list[Notice]]:
    """The working width (n,): the sum of the sections at work, or the width of the widest function."""
    notices = []
    widths = {element: raw / 1000.0 for element, raw in log.values_of(ACTUAL_WIDTH)}
    wrong = sum(int(np.sum((values < 0.0) | (values > MAX_IMPLEMENT_WIDTH_M))) for values in widths.values())
    if wrong:
        notices.append(Notice("width-implausible", log=log.name, wrong=wrong, widest_m=MAX_IMPLEMENT_WIDTH_M))
    widths = {
        element: np.where((values >= 0.0) & (values <= MAX_IMPLEMENT_WIDTH_M), values, np.nan)
        for element, values in widths.items()
    }
    topmost = [element for element in widths if not set(ancestors(element, elements)) & widths.keys()]
    sections = [e for e in topmost if e in elements and elements[e].kind in PARALLEL]
    width = np.full(len(log), np.nan)
    parallel = np.zeros(len(log))
    for element in topmost:
        if element in sections:
            working = states[element] == ToolState.DOWN if element in states else at_work
            parallel += np.where(working & np.isfinite(widths[element]), widths[element], 0.0)
        else:
            width = np.fmax(width, widths[element])
    return np.fmax(width, parallel) if sections else width, notices


MAX_HOLD_S: Final = 15.0
"""Longest time that a state is assumed to last without another record."""
QUARTER_S: Final = 900.0
MAX_ZONE_S: Final = 15 * 3600.0
"""Largest offset of a time zone; a GPS time that differs more from the terminal's clock is invalid."""
STEADY_S: Final = 2.0
NMEA2000_FIXES: Final = {
    1: Fix.SINGLE, 2: Fix.DGPS, 3: Fix.PPS, 4: Fix.FIXED, 5: Fix.FLOAT, 6: Fix.ESTIMATED, 7: Fix.MANUAL,
    8: Fix.SIMULATED,
}  # fmt: skip
"""Fix of the codes of NMEA 2000."""


@dataclass(frozen=True)
class LoggedTask:
    """A task and the n records with a position in its time logs, in the order of time.

    Attributes:
        state: (n,) int8, values of :class:`ToolState`.
        width_m: (n,) working width; nan where unknown.
        states: states of all records, also those without a position, with those of the sections if it has some.
        counted_m2: increase of the machine's area counter, summed over all logs; nan if it has none.
        local_minus_utc_s: what was subtracted from the terminal's clock; nan if it is unknown and 0 was used.
        placement_notices: on how its sections lie to the positions.
    """

    id: str
    name: str
    field: Partfield | None
    track: GnssTrack
    state: NDArray[np.int8]
    width_m: FloatArray
    states: ToolStates
    counted_m2: float
    local_minus_utc_s: float
    logs: tuple[str, ...]
    notices: tuple[Notice, ...]
    placement_notices: tuple[Notice, ...] = ()

    @property
    def sections(self) -> SectionStates | None:
        """The states of its sections; None where it has none, or not the place of each."""
        return self.states.sections[0] if self.states.sections else None


def read_tasks(path: Path, only: str | None = None) -> tuple[TaskData, list[LoggedTask]]:
    """The content of all sets of task data in a folder or archive, and their tasks that have a time log.

    Where there are several sets, ids of fields and tasks begin with the set's folder, and a set that cannot be read is
    only a notice. Version and maker are those of the first. `only` is the id or name of the tasks that are wanted.
    InputError if no set can be read, or none has such a task. A time log that cannot be read is only a notice.
    """
    sets, notices = _read_sets(path)
    wanted = [[task for task in one.tasks if only is None or only in (task.id, task.name)] for _, one in sets]
    every = tuple(task for _, content in sets for task in content.tasks)
    if only is not None and not any(wanted):
        known = ", ".join(f"{task.id} ({task.name})" for task in every) or "none"
        raise InputError("no-such-task", files=path, only=only, known=known)
    tasks = []
    seen: dict[bytes, tuple[str, str]] = {}
    for (files, content), chosen in zip(sets, wanted, strict=True):
        read: Counter[str] = Counter()
        tasks += [_read_task(files, content, task, read, seen) for task in chosen if task.logs]
        notices += named_again(read)
    partfields = {files.id_of(key): field for files, content in sets for key, field in content.partfields.items()}
    first = sets[0][1]
    return replace(first, partfields=partfields, tasks=every, notices=tuple(dict.fromkeys(notices))), tasks


def _read_sets(path: Path) -> tuple[list[tuple[TaskFiles, TaskData]], list[Notice]]:
    """The sets that can be read, and notices on all."""
    found = []
    notices: list[Notice] = []
    sets = open_task_sets(path)
    for files in sets:
        try:
            content = read_content(files)
        except InputError as error:
            if len(sets) == 1:
                raise
            notices.append(Notice("task-data-left-out", name=files.named(MAIN), lines=error.lines[0]))
            continue
        found.append((files, content))
        notices += content.notices
    if not found:
        raise InputError("task-data-missing.none-readable", path=path, sets=len(sets))
    return found, notices


def _read_task(
    files: TaskFiles, content: TaskData, task: Task, read: Counter[str], seen: dict[bytes, tuple[str, str]]
) -> LoggedTask:
    """A task by the logs of :func:`_read_logs`."""
    logs, notices = _read_logs(files, task, read, seen)
    local_s, of_clock = _local_minus_utc_s(files.named(task.id), logs, task)
    work = [_logged_work(log, content.elements) for log in logs]
    counted = [one.counted_m2 for one in work if np.isfinite(one.counted_m2)]
    stated = StatedValues(logs, content.elements)
    sections, of_sections = read_sections(logs, content.elements, stated)
    notices += [*of_clock, *(notice for one in work for notice in one.notices), *of_sections]
    placement = ImplementLinks(links=(), is_drawn=False, notices=())
    if sections is not None:
        placement = implement_links(sections.device, content.elements, task.connections, stated)
        work = [_work_of_sections(one, table, sections) for one, table in zip(work, sections.states, strict=True)]
    all_states = np.concatenate([np.zeros(0, np.int8), *(one.state for one in work)])
    all_widths = np.concatenate([np.zeros(0), *(one.width_m for one in work)])
    joined = _join_logs(files.named(task.id), logs, local_s)
    notices += joined.notices
    states = _intervals(joined.t_s, all_states[joined.record])
    if sections is not None:
        table = np.concatenate(sections.states)[joined.record]
        states = replace(states, sections=_section_intervals(joined.t_s, table, sections, placement))
    if not len(joined.track):
        notices.append(Notice("no-positions.of-task", id=files.named(task.id)))
    return LoggedTask(
        id=files.id_of(task.id),
        name=task.name,
        field=content.partfields.get(task.partfield),
        track=joined.track,
        state=all_states[joined.used],
        width_m=all_widths[joined.used],
        states=states,
        counted_m2=float(sum(counted)) if counted else float("nan"),
        local_minus_utc_s=local_s,
        logs=task.logs,
        notices=tuple(notices),
        placement_notices=placement.notices,
    )


def _read_logs(
    files: TaskFiles, task: Task, read: Counter[str], seen: dict[bytes, tuple[str, str]]
) -> tuple[list[TimeLog], list[Notice]]:
    """The task's logs with records, without those that were `read` for it or another task before, by their begin.

    `seen` are the digests of logs with their set and name: a later set often has the logs of an earlier one.
    """
    notices: list[Notice] = []
    logs = []
    for name in task.logs:
        read[name.upper()] += 1
        if read[name.upper()] > 1:
            continue
        try:
            records = files.read(f"{name}.BIN")
            first_set, first = seen.setdefault(sha256(records).digest(), (files.inside, files.id_of(name)))
            if first_set != files.inside and records:
                notices.append(Notice("time-log-copy", name=files.named(name), first=first))
                continue
            log = read_time_log(files.read(f"{name}.XML"), records, files.named(name))
        except InputError as error:
            notices.append(Notice("time-log-lost", lines=error.lines[0], id=task.id))
            continue
        notices += log.notices
        if len(log):
            logs.append(log)
        else:
            notices.append(Notice("time-log-empty", name=files.named(name)))
    logs.sort(key=lambda log: log.clock_s[0])
    return logs, notices


def _work_of_sections(work: _LoggedWork, table: NDArray[np.int8], sections: LoggedSections) -> _LoggedWork:
    """The state (n,) of the whole implement by that of its sections (n, k), and how much of its width works (n,)."""
    working = table == ToolState.DOWN
    state = np.where((table == ToolState.UP).all(axis=1), ToolState.UP, ToolState.UNKNOWN)
    state = np.where(working.any(axis=1), ToolState.DOWN, state).astype(np.int8)
    return replace(work, state=state, width_m=working @ np.array([section.width_m for section in sections.sections]))


@dataclass(frozen=True)
class _JoinedLogs:
    """The positions of the logs, their record among those of all logs, and each record that counts with its UTC."""

    track: GnssTrack
    used: NDArray[np.intp]
    record: NDArray[np.intp]
    t_s: FloatArray
    notices: tuple[Notice, ...]


def _join_logs(name: str, logs: Sequence[TimeLog], local_s: float) -> _JoinedLogs:
    """Of records of equal times the last counts."""

    def column(name: str) -> FloatArray:
        return np.concatenate([np.zeros(0), *(getattr(log, name) for log in logs)])

    notices = []
    clock_s = column("clock_s")
    forward = np.flatnonzero(clock_s >= np.maximum.accumulate(clock_s))
    if len(forward) < len(clock_s):
        notices.append(Notice("time-backwards", name=name, records=len(clock_s) - len(forward)))
    last = forward[np.diff(clock_s[forward], append=np.inf) > 0]
    t_s = clock_s - (local_s if np.isfinite(local_s) else 0.0)
    lat = column("lat_deg")
    placed = last[np.isfinite(lat[last])]
    missing = len(last) - len(placed)
    if missing and len(placed):
        notices.append(Notice("positions-missing", name=name, missing=missing, last=len(last)))
    status = column("status")[placed].astype(np.int64)
    if len(placed) and (status < 0).any():
        notices.append(Notice("quality-unknown", name=name, status=int((status < 0).sum())))
    track = GnssTrack.build(
        t_s[placed],
        source=name,
        lon_deg=column("lon_deg")[placed],
        lat_deg=lat[placed],
        height_m=column("up_m")[placed],
        fix=np.array([NMEA2000_FIXES.get(code, Fix.SINGLE) for code in status.tolist()], np.int8),
        satellites=column("satellites")[placed],
        hdop=column("hdop")[placed],
    )
    try:
        track, here, dropped = drop_implausible_positions(track)
    except InputError as error:
        track, here, dropped = track[:0], np.zeros(len(track), bool), [Notice.from_error(error)]
    return _JoinedLogs(track, placed[here], last, t_s[last], (*notices, *dropped))


@dataclass(frozen=True)
class _Intervals:
    """Runs of records without a change: (m,) the first record of each, begin, end, and the sigmas of these."""

    first: NDArray[np.intp]
    begin_s: FloatArray
    end_s: FloatArray
    begin_sigma_s: FloatArray
    end_sigma_s: FloatArray

    @classmethod
    def between(cls, t_s: FloatArray, is_changed: NDArray[np.bool_]) -> Self:
        """Those of records at times (n,) that change before the next or not (n − 1,).

        A record counts until the next, but not beyond MAX_HOLD_S; a change is uniformly distributed between the two.
        """
        step = np.diff(t_s)
        near = step <= MAX_HOLD_S
        begins = np.ones(len(t_s), bool)
        begins[1:] = is_changed | ~near
        first = np.flatnonzero(begins)
        last = np.append(first[1:] - 1, len(t_s) - 1) if len(first) else first
        ends = [t_s[k + 1] if k + 1 < len(t_s) and near[k] else t_s[k] for k in last.tolist()]
        linked = np.append(False, near)
        slip = np.append(0.0, step) / np.sqrt(3.0)
        begin_sigma = [slip[k] if linked[k] else (0.0 if k == 0 else np.nan) for k in first.tolist()]
        end_sigma = [
            slip[k + 1] if k + 1 < len(t_s) and near[k] else (0.0 if k + 1 == len(t_s) else np.nan) for k in last
        ]
        return cls(
            first,
            t_s[first],
            np.array(ends, np.float64),
            np.array(begin_sigma, np.float64),
            np.array(end_sigma, np.float64),
        )


def _intervals(t_s: FloatArray, state: NDArray[np.int8]) -> ToolStates:
    """The states of records (n,) as intervals of time."""
    found = _Intervals.between(t_s, state[1:] != state[:-1])
    known = (state[found.first] != ToolState.UNKNOWN) & (found.end_s > found.begin_s)
    return ToolStates(
        begin_s=found.begin_s[known],
        end_s=found.end_s[known],
        state=state[found.first][known],
        confidence=np.ones(int(known.sum())),
        begin_sigma_s=found.begin_sigma_s[known],
        end_sigma_s=found.end_sigma_s[known],
    )


def _section_intervals(
    t_s: FloatArray, table: NDArray[np.int8], logged: LoggedSections, placement: ImplementLinks
) -> tuple[SectionStates, ...]:
    """The states (n, k) of sections in records as intervals of time; none without a record that lasts."""
    found = _Intervals.between(t_s, (table[1:] != table[:-1]).any(axis=1))
    lasting = found.end_s > found.begin_s
    if not lasting.any():
        return ()
    states = SectionStates(
        sections=logged.sections,
        links=placement.links,
        begin_s=found.begin_s[lasting],
        end_s=found.end_s[lasting],
        state=table[found.first][lasting],
        begin_sigma_s=found.begin_sigma_s[lasting],
        end_sigma_s=found.end_sigma_s[lasting],
        is_drawn=placement.is_drawn,
    )
    return (states,)


def _local_minus_utc_s(name: str, logs: Sequence[TimeLog], task: Task) -> tuple[float, list[Notice]]:
    """Terminal's clock minus UTC, from the records' GPS times, or from the time zone of the task's times; else nan."""
    ahead = np.concatenate([log.clock_s - log.gps_s for log in logs]) if logs else np.zeros(0)
    ahead = ahead[np.isfinite(ahead)]
    notices = []
    if len(ahead):
        middle = float(np.median(ahead))
        steady = float(np.median(np.abs(ahead - middle))) < STEADY_S
        if steady and abs(middle) < MAX_ZONE_S:
            if abs(middle) > STEADY_S:
                notices.append(Notice("clock-by-gps", name=name, ahead_s=middle))
            return middle, notices
        notices.append(Notice("gps-time-unused", name=name, differ_s=abs(middle)))
    local_s = _zone_s(logs, task)
    if local_s is not None:
        return local_s, notices
    if logs:
        notices.append(Notice("local-time", name=name))
    return float("nan"), notices


def _zone_s(logs: Sequence[TimeLog], task: Task) -> float | None:
    """Terminal's clock minus UTC, in quarters of an hour, from the time zones of the task's times; None without."""
    zoned = []
    for begin in task.begins:
        with suppress(ValueError):
            zoned.append(dt.datetime.fromisoformat(begin))
    zoned = [when for when in zoned if when.tzinfo is not None]
    for when in zoned:
        zone_s = (when.utcoffset() or dt.timedelta()).total_seconds()
        face_s = when.timestamp() + zone_s
        if any(log.clock_s[0] - QUARTER_S < face_s < log.clock_s[-1] + QUARTER_S for log in logs):
            return zone_s
    if not zoned or not logs:
        return None

    def from_quarter(seconds: float) -> float:
        return abs(seconds - QUARTER_S * round(seconds / QUARTER_S))

    off = [min((log.clock_s[0] - when.timestamp() for when in zoned), key=from_quarter) for log in logs]
    local_s = QUARTER_S * round(float(np.median(off)) / QUARTER_S)
    return local_s if abs(local_s) < MAX_ZONE_S else None


def whole_width_m(tasks: Sequence[LoggedTask]) -> float:
    """Width of the machine: the largest working width in any of the tasks, or logged; nan if there is none."""
    for chosen in ([task.width_m[task.state == ToolState.DOWN] for task in tasks], [task.width_m for task in tasks]):
        width = np.concatenate([np.zeros(0), *chosen])
        if (width > 0.0).any():
            return float(np.nanmax(width))
    return float("nan")


LATE_S: Final = 0.1
"""Half of the interval of receivers with 5 Hz, which terminals have."""
METRES_A_DEGREE: Final = 111_200.0
MOVING_MPS: Final = 1.0
MAX_CHORD_S: Final = 6.0
"""Duration of two steps beyond which a vehicle may have turned between them."""
MEDIAN_OF_NORMAL: Final = 0.6745
"""Median of the absolute value of a normal deviate, in its standard deviation."""


class TaskDataLog(FileReader):
    """The tasks of ISO 11783-10 task data: a TASKDATA folder, its TASKDATA.XML, or a zip archive of it."""

    format: ClassVar[str] = "isoxml"
    title: ClassVar[Text] = Text("ISO 11783-10 task data (folder or .zip)")

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain with a main file; possible for archives without one, which the reader then reports."""
        zipped = head.suffix == ".zip" or head.data.startswith(b"PK\x03\x04")
        if not (head.path.is_dir() or zipped or head.path.name.upper() == MAIN):
            return 0.0
        if is_task_data(head.path):
            return 1.0
        return 0.3 if zipped or (head.path.is_dir() and any(head.path.glob("[Tt][Ll][Gg]*"))) else 0.0

    def track(self) -> GnssTrack:
        """The positions of the task, or of all tasks in the order of time.

        Their standard deviations are those of their quality and what the vehicle goes in the error of their times.
        InputError if there are none, or two tasks overlap in time.
        """
        tasks = self._tasks()
        columns: dict[str, Any] = {
            name: np.concatenate([getattr(t.track, name) for t in tasks]) for name in GnssTrack.columns()
        }
        off = [_time_sigmas(task.track) for task in tasks]
        sigma_m = np.hypot(assumed_sigma_m(columns["fix"]), np.concatenate([sigma_m for sigma_m, _ in off]))
        columns |= {"sigma_e_m": sigma_m, "sigma_n_m": sigma_m.copy()}
        source = ", ".join(str(path) for path in self.paths)
        worst_s = max(time_s for _, time_s in off)
        self.notices.append(
            Notice("positions-of-terminal", source=source, time_s=worst_s, sigma_m=float(np.median(sigma_m)))
        )
        return GnssTrack.build(source=source, **columns)

    def states(self) -> ToolStates:
        """Whether the machine worked, over time; errors as of :meth:`track`."""
        parts = [task.states for task in self._tasks()]
        names = ("begin_s", "end_s", "state", "confidence", "begin_sigma_s", "end_sigma_s")
        columns: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        return ToolStates(**columns, sections=tuple(one for part in parts for one in part.sections))

    def inspect(self) -> Inspection:
        """Read the whole first set and report what it contains."""
        content, tasks = read_tasks(self.paths[0], self.options.task)
        facts: dict[str, Any] = {
            "version": content.version,
            "maker": content.maker,
            "fields": {field.id: field.name for field in content.partfields.values()},
            "tasks": {task.id: _task_facts(task) for task in tasks},
        }
        placed = [task for task in tasks if len(task.track)]
        width_m = whole_width_m(placed)
        facts["width_m"] = round(width_m, 3) if np.isfinite(width_m) else None
        clocks = []
        for task in placed:
            known = np.isfinite(task.local_minus_utc_s)
            utc = f" minus {task.local_minus_utc_s:g} s" if known else ", assumed to be UTC"
            clocks.append(ClockReading(Clock.GNSS, *_span(task), f"of task {task.id}, terminal's clock{utc}"))
        if len(placed) == 1:
            track = placed[0].track
            facts |= utc_facts(track.t_s) | timing_facts(track.t_s) | position_facts(track)
        return Inspection(self.paths[0], self.format, self.title, facts, tuple(clocks), _notices(content, tasks))

    def _tasks(self) -> list[LoggedTask]:
        """The requested tasks with positions, in the order of time."""
        found = []
        self.notices = []
        for path in self.paths:
            content, tasks = read_tasks(path, self.options.task)
            self.notices += _notices(content, tasks)
            found += [task for task in tasks if len(task.track)]
        if not found:
            raise InputError("no-positions.of-time-logs", paths=self.paths[0])
        found.sort(key=_span)
        for one, other in pairwise(found):
            if _span(other)[0] <= _span(one)[1]:
                raise InputError(
                    "tasks-overlap", paths=self.paths[0], id=one.id, other_id=other.id, other=iso_utc(_span(other)[0])
                )
        return found


def _time_sigmas(track: GnssTrack) -> tuple[FloatArray, float]:
    """How far (n,) the vehicle goes in the error of the times of a time log, and that error in seconds.

    A terminal's stamp says when a record was written: it is late by :data:`LATE_S` at least, and it varies by what
    positions are ahead of or behind the middle of their neighbours along the way.
    """
    if len(track) < 3:
        return np.zeros(len(track)), LATE_S
    metres = METRES_A_DEGREE * np.array([np.cos(np.radians(np.median(track.lat_deg))), 1.0])
    en_m = np.column_stack([unwrapped_deg(track.lon_deg), track.lat_deg]) * metres
    step_s = np.diff(track.t_s)
    chord_m = en_m[2:] - en_m[:-2]
    chord_s = step_s[1:] + step_s[:-1]
    speed = np.linalg.norm(chord_m, axis=1) / chord_s
    ahead_m = en_m[1:-1] - en_m[:-2] - chord_m * (step_s[:-1] / chord_s)[:, None]
    moving = (speed > MOVING_MPS) & (chord_s < MAX_CHORD_S)
    along_s = np.einsum("ni,ni->n", ahead_m, chord_m)[moving] / (speed[moving] ** 2 * chord_s[moving])
    # The difference of a stamp to the mean of two others has one and a half times its variance.
    varies_s = float(np.median(np.abs(along_s))) / MEDIAN_OF_NORMAL / np.sqrt(1.5) if len(along_s) else 0.0
    time_s = float(np.hypot(LATE_S, varies_s))
    return np.pad(speed, 1, mode="edge") * time_s, time_s


def _span(task: LoggedTask) -> tuple[float, float]:
    return float(task.track.t_s[0]), float(task.track.t_s[-1])


def _task_facts(task: LoggedTask) -> dict[str, Any]:
    length_s = task.states.end_s - task.states.begin_s
    return {
        "name": task.name,
        "field": task.field.name if task.field is not None else None,
        "time_logs": list(task.logs),
        "positions": len(task.track),
        **(utc_facts(task.track.t_s) if len(task.track) else {}),
        "working_s": round(float(length_s[task.states.state == ToolState.DOWN].sum()), 1),
        "sections": _section_facts(task.sections) if task.sections is not None else None,
        "counted_area_m2": round(task.counted_m2, 1) if np.isfinite(task.counted_m2) else None,
    }


def _section_facts(states: SectionStates) -> list[dict[str, Any]]:
    """The sections from left to right: place of the middle, width, and for how long each worked."""
    return [
        {
            "name": section.name,
            "left_m": round(section.y_m, 3),
            "ahead_m": round(section.x_m, 3),
            "width_m": round(section.width_m, 3),
            "working_s": round(working_s, 1),
        }
        for section, working_s in zip(states.sections, states.working_s.tolist(), strict=True)
    ]


def _notices(content: TaskData, tasks: Sequence[LoggedTask]) -> tuple[Notice, ...]:
    return tuple(dict.fromkeys([*content.notices, *(notice for task in tasks for notice in task.notices)]))
