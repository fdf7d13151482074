"""By how much what a live session showed differs from the run of its recording."""

from dataclasses import asdict

from furrowmap.core.live.difference import live_difference
from furrowmap.core.session.opened import OpenSession
from furrowmap.workflows.run.tools import CloudMade, RunTool, ToolFindings


class LiveTool(RunTool):
    """Holds what the last live session of the recording showed against the run."""

    def __init__(self, opened: OpenSession) -> None:
        self._folder = opened.file.parent

    def finish(self, made: CloudMade) -> ToolFindings:
        """The difference in place, heading and ground worked; nothing where no live session was."""
        found = made.found
        worked_m2 = found.work.ground.figures.worked.grid_m2 if found.work.ground is not None else None
        shown = live_difference(self._folder, found.frame.name, found.placement.poses, worked_m2)
        if shown is None:
            return ToolFindings()
        return ToolFindings({"live": asdict(shown)}, page={"live": shown})
