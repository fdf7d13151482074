"""What a session's files say of the field and of the tools, read before the scans are matched."""

from __future__ import annotations

from dataclasses import dataclass

import shapely
from shapely.geometry.base import BaseGeometry

from furrowmap.core.coverage.field_boundary import field_boundary, held_against_boundary
from furrowmap.core.coverage.field_work import FieldWork
from furrowmap.core.implement.external_states import external_states
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.session.opened import OpenSession
from furrowmap.core.values.tool_states import ToolStates
from furrowmap.core.values.trajectory import Trajectory


@dataclass(frozen=True)
class FieldFiles:
    """The boundary of the field, and the states of each implement; None where the session names no file.

    Attributes:
        field_notices: about the boundary.
        state_notices: about the states.
    """

    boundary: BaseGeometry | None
    states: tuple[ToolStates | None, ...]
    field_notices: tuple[Notice, ...]
    state_notices: tuple[Notice, ...]


def read_field_files(opened: OpenSession, trajectory: Trajectory) -> FieldFiles:
    """The files of the field and of the tools that a session names.

    Raises:
        InputError: if a file cannot be read, or is of another time or place than the trajectory.
    """
    boundary: BaseGeometry | None = None
    field_notices: list[Notice] = []
    if opened.inputs.boundary is not None:
        name = opened.session.field.name
        boundary, field_notices = field_boundary(opened.inputs.boundary, opened.frame, name, trajectory.xyz_m)
    task = opened.session.recording.task
    states: list[ToolStates | None] = []
    state_notices: list[Notice] = []
    for tool, files in zip(opened.session.implements, opened.inputs.tools, strict=True):
        found, about = external_states(files.states, tool, task, trajectory)
        states.append(found)
        state_notices += about
    return FieldFiles(boundary, tuple(states), tuple(field_notices), tuple(state_notices))


def boundary_notices(work: FieldWork, trajectory: Trajectory) -> list[Notice]:
    """Whether the ground worked, or where that is not known the drive, lies in the field."""
    worked = [one.ground.coverage for one in work.each if one.ground is not None]
    return held_against_boundary(work.boundary, shapely.union_all(worked) if worked else None, trajectory.xyz_m)
