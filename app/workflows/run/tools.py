"""The interface of tools on the result of a run, which what stands above :mod:`.run` chains to it.

A tool takes part where that saves reading the cloud again, and tells what it found before the verdict is made.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

from furrowmap.core.images.image_frames import Frames
from furrowmap.core.implement.machine_voxels import MachineVoxels
from furrowmap.core.pipeline.run_result import RunResult
from furrowmap.core.pipeline.solution import Solution
from furrowmap.core.pointclouds.placed_scans import PlacedScan
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.values.trajectory import Trajectory
from furrowmap.exporters.cloud.layers import ChunkColumns
from furrowmap.exporters.cloud.writer import CopcSummary
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.vectors.field_layers import Layer

Vector = tuple[float, float, float]
Painter = Callable[[ChunkColumns, float], None]
"""Colours points in place; their coordinates are whole numbers of a scale. Called from several threads."""


@dataclass(frozen=True)
class ToolFindings:
    """What a tool adds to a run.

    Attributes:
        account: entries of `report.json`.
        layers: of `field.gpkg`.
        page: values for the template of the report page.
        sigma: standard deviations (n, 6) of the poses where the tool contradicts them; else None.
        seconds: by the name of the stage.
    """

    account: Mapping[str, Any] = field(default_factory=dict)
    notices: Sequence[Notice] = ()
    layers: Sequence[Layer] = ()
    page: Mapping[str, Any] = field(default_factory=dict)
    sigma: FloatArray | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)

    def judged(self, found: RunResult) -> RunResult:
        """The result with these standard deviations of its poses."""
        if self.sigma is None:
            return found
        poses = replace(found.placement.poses, sigma=self.sigma)
        return replace(found, placement=replace(found.placement, poses=poses))


@dataclass(frozen=True)
class CloudMade:
    """The result of a run whose cloud and surfaces are written, as the tools before have judged it."""

    found: RunResult
    cloud: CopcSummary
    progress: Progress


class RunTool:
    """A tool that does nothing: the base of all. The methods stand in the order in which they are called.

    Attributes:
        folder: of the products, from :meth:`open` on.
        stack: what is to be closed at the end goes onto it, from :meth:`open` on.
        origin_m: local origin of the points, from :meth:`begin` on.
        frames: images along the trajectory, from :meth:`begin` on; None without images.
    """

    measures: ClassVar[bool] = False
    """Whether :meth:`measure` does anything."""
    corrects: ClassVar[bool] = False
    """Whether :meth:`corrected` does anything."""
    folder: Path
    stack: ExitStack
    origin_m: Vector
    frames: Frames | None

    def check_inputs(self) -> None:
        """Raise the errors of the tool's files before anything is written."""

    def open(self) -> None:
        """Begin, before the work."""

    def expect_near(self, trajectory: Trajectory) -> None:
        """Raise InputError if what the tool corrects by does not lie where the drive goes; before scans are matched."""

    def corrected(self, solution: Solution, machine: MachineVoxels | None, progress: Progress) -> Solution:  # noqa: ARG002
        """The solution with a corrected trajectory, before points are placed by it."""
        return solution

    def preload(self) -> None:
        """Import what is needed late; called from another thread, while packets are read, and perhaps again."""

    def begin(self) -> None:
        """The frame of the points and the images are known."""

    def add(self, placed: PlacedScan) -> None:
        """Take the points of some scans."""

    def end_points(self, progress: Progress) -> None:
        """All points have been taken."""

    @property
    def painter(self) -> Painter | None:
        """What colours the points of the cloud, known after :meth:`begin`; None for no colours."""
        return None

    def measure(self, origin: Origin, progress: Progress) -> None:
        """Work on the points that were taken, beside the thread that writes the cloud."""

    def draw(self, origin: Origin, progress: Progress) -> None:
        """Make products of the surfaces, which are in the folder, beside the thread that writes the cloud."""

    def finish(self, made: CloudMade) -> ToolFindings:  # noqa: ARG002
        """What was found."""
        return ToolFindings()

    def describe(self, report: dict[str, Any]) -> None:
        """Write what describes the products, after `report.json` with this content."""
