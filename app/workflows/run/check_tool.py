"""The surface of a run at the surveyed points of its session that are to check."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from furrowmap.core.accuracy.point_check import ProductAtPoints, surface_at_points
from furrowmap.core.accuracy.product_check import HeldHeights
from furrowmap.core.pipeline.control.control_points import checks_among
from furrowmap.core.readers.surveyed_points import read_points
from furrowmap.core.runtime.errors import CHECK_POINTS_OFF
from furrowmap.core.session.opened import OpenSession
from furrowmap.exporters.files.result_folder import DSM
from furrowmap.workflows.run.tools import CloudMade, RunTool, ToolFindings


class CheckTool(RunTool):
    """Holds the heights of the surface against `check_points`, and what `control_points` keeps for checking."""

    def __init__(self, opened: OpenSession) -> None:
        self._opened = opened
        inputs = opened.inputs
        named = (inputs.check_points, inputs.ground_control)
        self._files = tuple(dict.fromkeys(path for path in named if path is not None))

    def check_inputs(self) -> None:
        """Read the points."""
        for path in self._files:
            read_points(path, self._opened.frame.whole_crs)

    def finish(self, made: CloudMade) -> ToolFindings:
        """The difference from the surveyed heights, and whether it contradicts the result."""
        if not (self.folder / DSM).is_file():
            return ToolFindings()
        parts = [part for path in self._files if len((part := self._compared(path)).points)]
        if not parts:
            return ToolFindings()
        sigma = made.found.placement.poses.sigma.copy()
        names = ", ".join(path.name for path in self._files)
        checked = HeldHeights.of(_together(parts), float(np.sqrt(np.mean(sigma[:, 2] ** 2))))
        notice = checked.notice(names)
        account = {"check_points": checked.plain()}
        if notice is None:
            return ToolFindings(account)
        if notice.code != CHECK_POINTS_OFF:
            return ToolFindings(account, [notice])
        sigma[:, 2] = np.hypot(sigma[:, 2], checked.off_m)
        return ToolFindings(account, [notice], sigma=sigma)

    def _compared(self, path: Path) -> ProductAtPoints:
        """The surface at the points of a file that are to check: of control points those with that role."""
        surface = surface_at_points(self.folder / DSM, path)
        return surface if path != self._opened.inputs.ground_control else _checks(surface, path)


def _checks(surface: ProductAtPoints, path: Path) -> ProductAtPoints:
    """A surface at the points that a column of roles keeps for checking."""
    chosen = checks_among(path, surface.survey)
    survey = surface.survey
    names = tuple(np.array(survey.name, object)[chosen].tolist())
    survey = replace(survey, name=names, xyz_m=survey.xyz_m[chosen], sigma_m=survey.sigma_m[chosen], role=(), target=())
    points = tuple(point for point, check in zip(surface.points, chosen, strict=True) if check)
    return replace(surface, points=points, survey=survey)


def _together(parts: list[ProductAtPoints]) -> ProductAtPoints:
    """A surface at the points of several files."""
    survey = replace(
        parts[0].survey,
        name=tuple(name for part in parts for name in part.survey.name),
        xyz_m=np.concatenate([part.survey.xyz_m for part in parts]),
        sigma_m=np.concatenate([part.survey.sigma_m for part in parts]),
        role=(),
        target=(),
    )
    return replace(parts[0], points=tuple(point for part in parts for point in part.points), survey=survey)
