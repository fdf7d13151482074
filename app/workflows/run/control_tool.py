"""The control points of a session, which correct its run: their layer, and their tables in the reports."""

from functools import cached_property

from markupsafe import Markup

from furrowmap.core.implement.machine_voxels import MachineVoxels
from furrowmap.core.pipeline.control.by_control import by_control, control_of
from furrowmap.core.pipeline.control.control_points import GroundControl, expect_in_sight
from furrowmap.core.pipeline.solution import Solution
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.session.opened import OpenSession
from furrowmap.core.values.trajectory import Trajectory
from furrowmap.exporters.reports.control_section import control_section
from furrowmap.exporters.vectors.control_layer import control_layer
from furrowmap.workflows.run.tools import CloudMade, RunTool, ToolFindings


class ControlTool(RunTool):
    """Corrects the positions of a run by its control points, and tells what they did."""

    corrects = True

    def __init__(self, opened: OpenSession) -> None:
        self._opened = opened

    @cached_property
    def _points(self) -> GroundControl:
        return control_of(self._opened)

    def check_inputs(self) -> None:
        """Read the points."""
        assert len(self._points)

    def expect_near(self, trajectory: Trajectory) -> None:
        """Refuse points none of which the scanner can see."""
        if self._opened.session.recording.lidar:
            expect_in_sight(self._points, trajectory.xyz_m)

    def corrected(self, solution: Solution, machine: MachineVoxels | None, progress: Progress) -> Solution:
        """The solution by the points."""
        return by_control(solution, self._points, machine, progress)

    def finish(self, made: CloudMade) -> ToolFindings:
        """The points with their residuals."""
        control = made.found.control
        if control is None:
            return ToolFindings()
        page = {"control": Markup(control_section(control))}  # noqa: S704 (of a template)
        return ToolFindings({"control_points": control.plain()}, layers=[control_layer(control)], page=page)
