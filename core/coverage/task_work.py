"""The ground worked in each task of ISO 11783-10 task data: what a machine's own log shows, without a scanner."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import Geod
from shapely.geometry.base import BaseGeometry

from furrowmap.core.coverage.field_work import FieldWork, with_ground
from furrowmap.core.geodesy.crs_choice import choose_crs
from furrowmap.core.geodesy.longitudes import middle_deg
from furrowmap.core.geodesy.projection import MapFrame, map_frame
from furrowmap.core.readers.isoxml.log import LoggedTask, read_tasks, whole_width_m
from furrowmap.core.runtime.errors import InputError, Notice, RefusedError
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.trajectory.from_course import CourseTrajectory, trajectory_from_course
from furrowmap.core.trajectory.towed import towed
from furrowmap.core.values.session import MAX_IMPLEMENT_WIDTH_M, Crs, Implement
from furrowmap.core.values.tool_states import ToolState
from furrowmap.core.values.trajectory import Motion

WGS84: Final = Geod(ellps="WGS84")
FULL_WIDTH: Final = 0.99
"""Less than this share of the machine's width is a part of it."""


@dataclass(frozen=True)
class TaskWork:
    """The work of one task; area of its boundary on the ellipsoid, and what its log counts as swept, nan if unknown."""

    task: LoggedTask
    frame: MapFrame
    course: CourseTrajectory
    implement: Implement
    work: FieldWork
    boundary_area_m2: float
    logged_swept_m2: float
    notices: tuple[Notice, ...]


@dataclass(frozen=True)
class TaskWorks:
    """The work of the tasks with positions of a set of task data, in its order; notices on it and on other tasks."""

    works: tuple[TaskWork, ...]
    frame: MapFrame
    notices: tuple[Notice, ...]


def task_works(
    path: Path,
    *,
    crs: str | None = None,
    width_m: float | None = None,
    only: str | None = None,
    progress: Progress = silent,
) -> TaskWorks:
    """The ground worked in the tasks of a set of task data.

    Sections with states and places work each for itself, where the device description puts them against the positions.
    Without them the positions are those of the middle of the tool: a shift along the way changes no area.

    Raises InputError if it cannot be read, no task has positions, or no log says how wide the machine is; RefusedError
    if the CRS does not fit the place.

    Args:
        path: of the TASKDATA folder or an archive of it.
        crs: of the map; None for one that fits the place.
        width_m: of the machine; None for the widest that the logs show at work.
        only: id or name of the one task that is wanted.
    """
    content, tasks = read_tasks(path, only)
    notices = list(content.notices)
    placed = [task for task in tasks if len(task.track) > 1]
    notices += [notice for task in tasks if task not in placed for notice in task.notices]
    if not placed:
        raise InputError("no-positions.of-all-tasks", path=path, tasks=len(content.tasks))
    frame = _frame(placed, crs)
    width = width_m if width_m is not None else whole_width_m(placed)
    if not np.isfinite(width) or width <= 0.0:
        raise InputError("width-unknown", path=path)
    if width > MAX_IMPLEMENT_WIDTH_M:
        raise InputError("width-implausible.expect-width", width_m=width, widest_m=MAX_IMPLEMENT_WIDTH_M)
    works = []
    for k, task in enumerate(placed):
        progress("tasks", k / len(placed))
        try:
            works.append(_work(task, frame, width, use_sections=width_m is None))
        except (InputError, RefusedError) as error:
            if len(placed) == 1:
                raise
            notices.append(Notice("task-left-out", id=task.id, task=task.name, lines=error.lines[0]))
    progress("tasks", 1.0)
    return TaskWorks(tuple(works), frame, tuple(dict.fromkeys(notices)))


def _frame(tasks: Sequence[LoggedTask], crs: str | None) -> MapFrame:
    """The map that was asked for, or the one for the middle of most positions."""
    if crs is not None:
        return map_frame(Crs(map=crs))
    longest = max(tasks, key=lambda task: len(task.track))
    choice = choose_crs(*middle_deg(longest.track.lon_deg, longest.track.lat_deg))
    if choice is None:
        raise InputError("crs-unknown.near-pole", source=longest.track.source)
    return map_frame(Crs(map=choice.code))


def _work(task: LoggedTask, frame: MapFrame, width_m: float, *, use_sections: bool) -> TaskWork:
    """The work of a task: of its sections where they are known, else of a machine so wide, its middle the positions."""
    course = trajectory_from_course(task.track, frame)
    boundary, area_m2 = _boundary(task, frame)
    states = task.states
    notices = [*task.notices, *course.notices]
    sections = task.sections
    if sections is not None and not use_sections:
        count = len(sections.sections)
        notices.append(Notice("sections-unused", source=task.track.source, sections=count, width_m=width_m))
        states = replace(states, sections=())
        sections = None
    implement = Implement(width_m=width_m, xy_m=(0.0, 0.0))
    if sections is not None:
        notices += task.placement_notices
        course = replace(course, trajectory=towed(course.trajectory, sections.links))
        implement = Implement(width_m=sections.width_m, xy_m=sections.middle_m)
    work = with_ground(FieldWork(boundary=boundary, external=states), implement, course.trajectory, frame)
    swept, swept_notices = _logged_swept(task, course, implement, by_sections=sections is not None)
    if work.ground is None:
        swept_notices.append(Notice("state-unknown", source=task.track.source))
    return TaskWork(task, frame, course, implement, work, area_m2, swept, (*notices, *swept_notices))


def _boundary(task: LoggedTask, frame: MapFrame) -> tuple[BaseGeometry | None, float]:
    """The field's boundary in the map, and its area (m²) on the ellipsoid."""
    outline = task.field.boundary if task.field is not None else None
    if outline is None:
        return None, float("nan")
    area_m2 = sum(
        abs(WGS84.geometry_area_perimeter(shapely.orient_polygons(part))[0])
        for part in shapely.get_parts(outline)
        if isinstance(part, shapely.Polygon)
    )
    on_map = shapely.transform(outline, lambda xy: np.column_stack(frame.project(*xy.T)))
    return on_map, area_m2


def _logged_swept(
    task: LoggedTask, course: CourseTrajectory, implement: Implement, *, by_sections: bool
) -> tuple[float, list[Notice]]:
    """Path length times logged width, and a notice where only part of the width worked, not known by sections."""
    t = course.trajectory
    step_m = np.hypot(*np.diff(t.xyz_m[:, :2], axis=0).T)
    worked = (task.state[course.used][:-1] == ToolState.DOWN) & (np.diff(t.t_s) <= t.max_gap_s)
    worked &= t.motion[:-1] == Motion.FORWARD
    width: NDArray[np.float64] = task.width_m[course.used][:-1]
    distance_m = step_m[worked]
    known = width[worked]
    if not np.isfinite(known).any():
        return float("nan"), []
    known = np.where(np.isfinite(known), known, implement.width_m)
    swept = float(np.sum(distance_m * known))
    part = known < FULL_WIDTH * implement.width_m
    missing = float(np.sum(distance_m * np.maximum(implement.width_m - known, 0.0)))
    if by_sections or not part.any():
        return swept, []
    return swept, [
        Notice(
            "part-of-width",
            source=task.track.source,
            part_m=np.sum(distance_m[part]),
            whole_m=np.sum(distance_m),
            width_m=implement.width_m,
            missing_m2=missing,
        )
    ]
