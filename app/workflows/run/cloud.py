"""The cloud of a run: its points on their way to `cloud.copc.laz` and to the surfaces."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.pointclouds.placed import PlacedScan
from furrowmap.core.runtime.background import behind
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.surfaces.local_ground import GroundSampler
from furrowmap.core.values.clock import utc_to_las_time
from furrowmap.core.values.intervals import Interval, interval_numbers
from furrowmap.exporters.cloud.chunk import Columns
from furrowmap.exporters.cloud.file import CopcFormat, las_wkt
from furrowmap.exporters.cloud.points import PointBatch
from furrowmap.exporters.cloud.writer import CopcSummary, CopcWriter
from furrowmap.workflows.run.colours import RunColours

SCALE_M: Final = 0.001
"""Resolution of the cloud's coordinates."""
MOST_PASSES: Final = 65_535
"""What a LAS file has numbers for."""
UNCOLOURED: Final = np.zeros(3, np.uint16)
SCANS_BEHIND: Final = 32
"""Scans that wait to be packed."""


@contextmanager
def open_cloud(
    path: Path, frame: MapFrame, origin_m: tuple[float, float, float], colours: RunColours | None
) -> Iterator[RunCloud]:
    """The cloud in a file, coordinates against a local origin; with `colours` its points get theirs.

    A thread packs the points and sorts those that exceed the memory into a file.
    """
    extra = (("scan", "uint32", "scan (revolution) number"),)
    kind = CopcFormat(las_wkt(frame.whole_crs), origin_m, SCALE_M, extra, colour=colours is not None)
    with CopcWriter(path, kind) as writer, ExitStack() as packing:
        yield RunCloud(writer, packing, colours)


class RunCloud:
    """The cloud of a run, which is open."""

    def __init__(self, writer: CopcWriter, packing: ExitStack, colours: RunColours | None) -> None:
        self._writer, self._packing, self._colours = writer, packing, colours
        self._append = packing.enter_context(behind(writer.append, SCANS_BEHIND))
        self._watch = GroundSampler()

    def add(self, placed: PlacedScan) -> None:
        """Take the points of one scan."""
        scan = placed.scan
        self._watch.add(placed.xyz_m, placed.kept)
        self._append(
            PointBatch(
                placed.xyz_m,
                scan.t_s,
                intensity=scan.intensity,
                return_number=scan.return_number,
                returns=scan.returns,
                classification=placed.classification,
                rgb=np.broadcast_to(UNCOLOURED, (len(scan), 3)) if self._colours is not None else None,
                extra={"scan": scan.number},
            )
        )

    def finish(self, progress: Progress, passes: Sequence[Interval], description: str) -> CopcSummary:
        """Sort, compress and write the points, each with its class, the number of its pass and its colour."""
        self._packing.close()
        ground = self._watch.ground()

        # The few passes are turned into the points' time, not the many points into the passes'.
        spans = [_Span(*(float(utc_to_las_time(t_s)) for t_s in (when.begin_s, when.end_s))) for when in passes]

        def mark(points: Columns) -> None:
            ground.classify(points.x, points.y, points.z, SCALE_M, points.classification)
            if spans:
                points.point_source_id[:] = np.minimum(interval_numbers(spans, points.gps_time), MOST_PASSES)
            if self._colours is not None:
                self._colours.paint(points, SCALE_M)

        return self._writer.close(progress, mark, description)


@dataclass(frozen=True)
class _Span:
    """A pass in the points' time."""

    begin_s: float
    end_s: float
