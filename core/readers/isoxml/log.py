"""ISO 11783-10 task data as a recording: positions and working states of the machine."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, ClassVar, Final

import numpy as np

from furrowmap.core.readers.facts import position_facts, timing_facts, utc_facts
from furrowmap.core.readers.isoxml.content import MAIN, TaskData, is_task_data, open_task_files
from furrowmap.core.readers.isoxml.tasks import LoggedTask, read_tasks, whole_width_m
from furrowmap.core.readers.reader import FileReader, Inspection
from furrowmap.core.readers.source import Head
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.gnss import GnssTrack, assumed_sigma_m
from furrowmap.core.values.scan import Clock, ClockReading
from furrowmap.core.values.tool_states import ToolState, ToolStates

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
    title: ClassVar[str] = "ISO 11783-10 task data (folder or .zip)"

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
        columns = {name: np.concatenate([getattr(t.track, name) for t in tasks]) for name in GnssTrack.columns()}
        off = [_time_sigmas(task.track) for task in tasks]
        sigma_m = np.hypot(assumed_sigma_m(columns["fix"]), np.concatenate([sigma_m for sigma_m, _ in off]))
        columns |= {"sigma_e_m": sigma_m, "sigma_n_m": sigma_m.copy()}
        source, worst_s = ", ".join(str(path) for path in self.paths), max(time_s for _, time_s in off)
        self.notices.append(
            Notice("positions-of-terminal", source=source, time_s=worst_s, sigma_m=float(np.median(sigma_m)))
        )
        return GnssTrack(**columns, source=source, service="")

    def states(self) -> ToolStates:
        """Whether the machine worked, over time; errors as of :meth:`track`."""
        parts = [task.states for task in self._tasks()]
        names = ("begin_s", "end_s", "state", "confidence", "begin_sigma_s", "end_sigma_s")
        columns: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        return ToolStates(**columns)

    def inspect(self) -> Inspection:
        """Read the whole first set and report what it contains."""
        content, tasks = read_tasks(open_task_files(self.paths[0]), self.options.task)
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
            content, tasks = read_tasks(open_task_files(path), self.options.task)
            self.notices += _notices(content, tasks)
            found += [task for task in tasks if len(task.track)]
        if not found:
            raise InputError("no-positions.tasks", paths=self.paths[0])
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
    en_m = np.column_stack([track.lon_deg, track.lat_deg]) * metres
    step_s = np.diff(track.t_s)
    chord_m, chord_s = en_m[2:] - en_m[:-2], step_s[1:] + step_s[:-1]
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
        "counted_area_m2": round(task.counted_m2, 1) if np.isfinite(task.counted_m2) else None,
    }


def _notices(content: TaskData, tasks: Sequence[LoggedTask]) -> tuple[Notice, ...]:
    return tuple(dict.fromkeys([*content.notices, *(notice for task in tasks for notice in task.notices)]))
