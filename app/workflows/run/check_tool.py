"""The surface of a run at the surveyed points of its session."""

from pathlib import Path

import numpy as np

from furrowmap.core.accuracy.point_check import surface_at_points
from furrowmap.core.accuracy.product_check import HeldHeights
from furrowmap.core.readers.surveyed_points import read_points
from furrowmap.core.runtime.errors import CHECK_POINTS_OFF
from furrowmap.core.session.opened import OpenSession
from furrowmap.exporters.files.result_folder import DSM
from furrowmap.workflows.run.tools import CloudMade, RunTool, ToolFindings


class CheckTool(RunTool):
    """Holds the heights of the surface against `check_points`."""

    def __init__(self, opened: OpenSession, points: Path) -> None:
        self._opened = opened
        self._points = points

    def check_inputs(self) -> None:
        """Read the points."""
        read_points(self._points, self._opened.frame.whole_crs)

    def finish(self, made: CloudMade) -> ToolFindings:
        """The difference from the surveyed heights, and whether it contradicts the result."""
        if not (self.folder / DSM).is_file():
            return ToolFindings()
        sigma = made.found.placement.poses.sigma.copy()
        at_points = surface_at_points(self.folder / DSM, self._points)
        checked = HeldHeights.of(at_points, float(np.sqrt(np.mean(sigma[:, 2] ** 2))))
        notice = checked.notice(self._points.name)
        account = {"check_points": checked.plain()}
        if notice is None:
            return ToolFindings(account)
        if notice.code != CHECK_POINTS_OFF:
            return ToolFindings(account, [notice])
        sigma[:, 2] = np.hypot(sigma[:, 2], checked.off_m)
        return ToolFindings(account, [notice], sigma=sigma)
