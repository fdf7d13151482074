"""A session without a scanner's recording: the positions alone, and the ground worked."""

from __future__ import annotations

from dataclasses import replace
from itertools import zip_longest

from furrowmap.core.coverage.field_work import FieldWork, with_grounds
from furrowmap.core.pipeline.field_files import boundary_notices, read_field_files
from furrowmap.core.pipeline.notices import quality_notices
from furrowmap.core.pipeline.run_result import RunResult
from furrowmap.core.pipeline.solution import (
    StopWatch,
    aided_by_images,
    companions,
    held_against_control,
    run_result,
    with_doubtful_heights,
)
from furrowmap.core.pointclouds.placed_scans import Placement
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.session.opened import OpenSession
from furrowmap.core.trajectory.located import located_without_lidar


def run_without_scans(opened: OpenSession, progress: Progress) -> RunResult:
    """The ground worked by the states of the tools, along the positions."""
    session = opened.session
    watch = StopWatch()
    progress("reading positions", 0.0)
    positions = opened.positions()
    located = located_without_lidar(positions, session, opened.frame, companions(opened))
    guess = aided_by_images(opened, with_doubtful_heights(located), positions, progress)
    located = held_against_control(guess.located, guess.aid)
    files = read_field_files(opened, located.trajectory)
    watch.lap("positions")
    progress("work", 0.0)
    tools = session.implements or (None,)
    known = [
        FieldWork(boundary=files.boundary, external=external, tool=tool.name if tool is not None else "")
        for tool, external in zip_longest(tools, files.states)
    ]
    work = with_grounds(known, located.trajectory, opened.frame, tools)
    in_field = boundary_notices(work, located.trajectory)
    watch.lap("work")
    placement = Placement.without_scans(located.trajectory)
    notices = [
        *guess.position_notices,
        *located.notices,
        *quality_notices(placement.poses),
        *guess.image_notices,
        *files.field_notices,
        *in_field,
        *files.state_notices,
        *(Notice("ground-control-no-scans", file=path.name) for path in (opened.inputs.ground_control,) if path),
        *work.notices,
    ]
    found = run_result(opened, located, placement, work, (), notices, watch)
    return replace(found, image_aid=guess.aid)
