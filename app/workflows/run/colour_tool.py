"""Colours of a run's cloud from the images of its camera, and the orthophoto."""

from furrowmap.core.pointclouds.placed_scans import PlacedScan
from furrowmap.core.runtime.progress import Progress
from furrowmap.exporters.files.provenance import Origin
from furrowmap.workflows.run.colours import RunColours
from furrowmap.workflows.run.tools import CloudMade, Painter, RunTool, ToolFindings


class ColourTool(RunTool):
    """Colours the cloud while it is written, and makes the orthophoto of its surface."""

    def __init__(self) -> None:
        self._colours: RunColours | None = None

    def begin(self) -> None:
        """Collect depths of the frames, if there are any."""
        if self.frames is not None:
            self._colours = self.stack.enter_context(RunColours(self.frames, self.origin_m))

    def add(self, placed: PlacedScan) -> None:
        """Take the points, which hide what is behind them."""
        if self._colours is not None:
            self._colours.add(placed)

    def end_points(self, progress: Progress) -> None:
        """Read the images."""
        if self._colours is not None:
            self._colours.finish(progress)

    @property
    def painter(self) -> Painter | None:
        """What colours the points of the cloud; None without images."""
        return self._colours.paint if self._colours is not None else None

    def draw(self, origin: Origin, progress: Progress) -> None:
        """Write the orthophoto."""
        if self._colours is not None:
            self._colours.write_orthophoto(self.folder, origin, progress)

    def finish(self, made: CloudMade) -> ToolFindings:  # noqa: ARG002
        """Figures of the colours."""
        if self._colours is None:
            return ToolFindings()
        figures, notices = self._colours.figures()
        return ToolFindings({"colours": figures}, notices)
