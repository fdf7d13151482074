"""The tasks of a set of task data as drives with working states: logs joined, clocks taken to UTC."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.isoxml.content import Partfield, Task, TaskData, read_content
from furrowmap.core.readers.isoxml.files import TaskFiles
from furrowmap.core.readers.isoxml.time_log import TimeLog, read_time_log
from furrowmap.core.readers.isoxml.work import LoggedWork, logged_work
from furrowmap.core.values.errors import InputError, Notice
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.core.values.tool_states import ToolState, ToolStates

FloatArray = NDArray[np.float64]

LONGEST_HOLD_S: Final = 15.0
"""For so long a record's state is taken to last where no other follows."""
QUARTER_S: Final = 900.0
FARTHEST_ZONE_S: Final = 15 * 3600.0
"""No zone is further from UTC than 14 hours; a GPS time that is further from the terminal's clock is none."""
STEADY_S: Final = 2.0
_FIXES: Final = {1: Fix.SINGLE, 2: Fix.DGPS, 3: Fix.PPS, 4: Fix.FIXED, 5: Fix.FLOAT, 6: Fix.ESTIMATED, 7: Fix.MANUAL,
                 8: Fix.SIMULATED}  # fmt: skip
"""What the codes of NMEA 2000 are in those of NMEA 0183."""


@dataclass(frozen=True)
class LoggedTask:
    """A task with what its time logs hold, n records with a position, in the order of time.

    Attributes:
        id: of the task.
        name: of the task.
        field: its field; None where it has none that is known.
        track: (n,) positions.
        state: (n,) int8, values of :class:`ToolState`.
        width_m: (n,) what worked of the machine's width; nan where unknown.
        states: of all records, those without a position too.
        counted_m2: what the machine's own counter of area gained, all logs added up; nan where it has none.
        local_minus_utc_s: what was taken off the terminal's clock; nan where nothing tells it (0 was).
        logs: names of the time logs.
        notices: what is odd, missing or damaged.
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


def read_tasks(files: TaskFiles, only: str | None = None) -> tuple[TaskData, list[LoggedTask]]:
    """The content of a set of task data, and its tasks that have a time log.

    Args:
        files: of the set.
        only: id or name of the task that is wanted; None for all.

    Raises:
        InputError: if the set cannot be read, or has no such task. A time log that cannot be read is told.
    """
    content = read_content(files)
    wanted = [task for task in content.tasks if only is None or only in (task.id, task.name)]
    if only is not None and not wanted:
        known = ", ".join(f"{task.id} ({task.name})" for task in content.tasks) or "none"
        raise InputError(
            f"{files.path}: there is no task {only!r} in it.",
            "Nothing of another task was used.",
            f"Its tasks: {known}.",
            code="no-such-task",
        )
    return content, [_logged(files, content, task) for task in wanted if task.logs]


def _logged(files: TaskFiles, content: TaskData, task: Task) -> LoggedTask:
    notices: list[Notice] = []
    logs = []
    for name in task.logs:
        try:
            log = read_time_log(files.read(f"{name}.XML"), files.read(f"{name}.BIN"), files.named(name))
        except InputError as error:
            notices.append(Notice("time-log-lost", f"{error.lines[0]} This log of task {task.id} is missing."))
            continue
        notices += log.notices
        if len(log):
            logs.append((log, logged_work(log, content.elements)))
        else:
            notices.append(Notice("time-log-empty", f"{files.named(name)}: the time log holds no record."))
    logs.sort(key=lambda one: one[0].clock_s[0])
    local_s = _local_minus_utc_s(files.named(task.id), [log for log, _ in logs], task, notices)
    notices += [notice for _, work in logs for notice in work.notices]
    counted = [work.counted_m2 for _, work in logs if np.isfinite(work.counted_m2)]
    track, state, width, states = _joined(files.named(task.id), logs, local_s, notices)
    if not len(track):
        notices.append(Notice("no-positions", f"{files.named(task.id)}: no record of its time logs has a position."))
    return LoggedTask(
        id=task.id,
        name=task.name,
        field=content.partfields.get(task.partfield),
        track=track,
        state=state,
        width_m=width,
        states=states,
        counted_m2=float(sum(counted)) if counted else float("nan"),
        local_minus_utc_s=local_s,
        logs=task.logs,
        notices=tuple(notices),
    )


def _joined(
    name: str, logs: Sequence[tuple[TimeLog, LoggedWork]], local_s: float, notices: list[Notice]
) -> tuple[GnssTrack, NDArray[np.int8], FloatArray, ToolStates]:
    """Positions, state and width of all records that have a position, and the states of all.

    Several records of one moment count as one, of which the last tells what held; those that run back in time are told
    and left out.
    """
    n = sum(len(log) for log, _ in logs)

    def column(parts: Iterable[NDArray[Any]]) -> FloatArray:
        """The records' values (n,) from those of each log."""
        return np.concatenate([np.zeros(0), *parts])

    clock_s = column(log.clock_s for log, _ in logs)
    state = column(work.state for _, work in logs).astype(np.int8)
    forward = np.flatnonzero(clock_s >= np.maximum.accumulate(clock_s))
    if len(forward) < n:
        text = f"{name}: {n - len(forward)} records run back in time and are left out."
        notices.append(Notice("time-backwards", text))
    last = forward[np.diff(clock_s[forward], append=np.inf) > 0]
    t_s = clock_s - (local_s if np.isfinite(local_s) else 0.0)
    states = _intervals(t_s[last], state[last])
    lat = column(log.lat_deg for log, _ in logs)
    placed = last[np.isfinite(lat[last])]
    missing = len(last) - len(placed)
    if missing and len(placed):
        notices.append(Notice("positions-missing", f"{name}: {missing} of {len(last)} records have no position."))
    status = column(log.status for log, _ in logs)[placed].astype(np.int64)
    if len(placed) and (status < 0).any():
        text = f"{name}: {int((status < 0).sum())} positions do not say how good they are; they are taken as single."
        notices.append(Notice("quality-unknown", text))
    track = GnssTrack.build(
        t_s[placed],
        source=name,
        lon_deg=column(log.lon_deg for log, _ in logs)[placed],
        lat_deg=lat[placed],
        height_m=column(log.up_m for log, _ in logs)[placed],
        fix=np.array([_FIXES.get(code, Fix.SINGLE) for code in status.tolist()], np.int8),
        satellites=column(log.satellites for log, _ in logs)[placed],
        hdop=column(log.hdop for log, _ in logs)[placed],
    )
    width = column(work.width_m for _, work in logs)[placed]
    return track, state[placed], width, states


def _intervals(t_s: FloatArray, state: NDArray[np.int8]) -> ToolStates:
    """Each record's state until the next record; unknown beyond :data:`LONGEST_HOLD_S`.

    A state that changed did so since the record before, so its time is off by up to a step: uniformly, hence the sigma.
    """
    step = np.diff(t_s)
    near = step <= LONGEST_HOLD_S
    begins = np.ones(len(t_s), bool)
    begins[1:] = (state[1:] != state[:-1]) | ~near
    first = np.flatnonzero(begins)
    last = np.append(first[1:] - 1, len(t_s) - 1) if len(first) else first
    ends = [t_s[k + 1] if k + 1 < len(t_s) and near[k] else t_s[k] for k in last.tolist()]
    linked = np.append(False, near)
    slip = np.append(0.0, step) / np.sqrt(3.0)
    begin_sigma = [slip[k] if linked[k] else (0.0 if k == 0 else np.nan) for k in first.tolist()]
    end_sigma = [slip[k + 1] if k + 1 < len(t_s) and near[k] else (0.0 if k + 1 == len(t_s) else np.nan) for k in last]
    begin, end = t_s[first], np.array(ends, np.float64)
    known = (state[first] != ToolState.UNKNOWN) & (end > begin)
    return ToolStates(
        begin_s=begin[known],
        end_s=end[known],
        state=state[first][known],
        confidence=np.ones(int(known.sum())),
        begin_sigma_s=np.array(begin_sigma, np.float64)[known],
        end_sigma_s=np.array(end_sigma, np.float64)[known],
    )


def _local_minus_utc_s(name: str, logs: Sequence[TimeLog], task: Task, notices: list[Notice]) -> float:
    """How far the terminal's clock is ahead of UTC: by the records' GPS times, or by the zone of the task's times.

    Returns:
        nan where neither tells.
    """
    ahead = np.concatenate([log.clock_s - log.gps_s for log in logs]) if logs else np.zeros(0)
    ahead = ahead[np.isfinite(ahead)]
    if len(ahead):
        middle = float(np.median(ahead))
        steady = float(np.median(np.abs(ahead - middle))) < STEADY_S
        if steady and abs(middle) < FARTHEST_ZONE_S:
            if abs(middle) > STEADY_S:
                text = f"{name}: the terminal's clock is {middle:+.1f} s ahead of its GPS time, which is taken."
                notices.append(Notice("clock-by-gps", text))
            return middle
        text = f"{name}: its GPS times lie {abs(middle):,.0f} s from the terminal's clock and are not believed."
        notices.append(Notice("gps-time-unused", text))
    local_s = _by_zone(logs, task)
    if local_s is not None:
        return local_s
    if logs:
        text = f"{name}: nothing tells how far its times are from UTC, so they are taken as UTC."
        notices.append(Notice("local-time", text))
    return float("nan")


def _by_zone(logs: Sequence[TimeLog], task: Task) -> float | None:
    """What the zones of the task's times tell; None where there is none.

    Some terminals write the clock that the records have, with its zone; others write UTC, and the difference of the
    two is a whole number of quarters of an hour.
    """
    zoned = [when for span in task.spans if (when := _zoned(span.begin)) is not None]
    for when in zoned:
        zone_s = (when.utcoffset() or dt.timedelta()).total_seconds()
        face_s = when.timestamp() + zone_s
        if any(log.clock_s[0] - QUARTER_S < face_s < log.clock_s[-1] + QUARTER_S for log in logs):
            return zone_s
    if not zoned or not logs:
        return None
    off = [min((log.clock_s[0] - when.timestamp() for when in zoned), key=_from_quarter) for log in logs]
    local_s = QUARTER_S * round(float(np.median(off)) / QUARTER_S)
    return local_s if abs(local_s) < FARTHEST_ZONE_S else None


def _from_quarter(seconds: float) -> float:
    """How far a difference of clocks is from one of zones."""
    return abs(seconds - QUARTER_S * round(seconds / QUARTER_S))


def _zoned(text: str) -> dt.datetime | None:
    """A time of the XML; None where it states no zone."""
    try:
        when = dt.datetime.fromisoformat(text)
    except ValueError:
        return None
    return when if when.tzinfo is not None else None


def whole_width_m(tasks: Sequence[LoggedTask]) -> float:
    """The machine's width: the widest that worked in any of the tasks, or that is logged; nan where no log says."""
    for chosen in ([task.width_m[task.state == ToolState.DOWN] for task in tasks], [task.width_m for task in tasks]):
        width = np.concatenate([np.zeros(0), *chosen])
        if (width > 0.0).any():
            return float(np.nanmax(width))
    return float("nan")
