"""The cloud of a run: its points on their way to `cloud.copc.laz` and to the surfaces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import numpy as np

from furrowmap.core.crops.parcel_points import ParcelPoints
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.pointclouds.placed import PlacedScan
from furrowmap.core.runtime.background import behind
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.surfaces.local_ground import GroundSampler
from furrowmap.core.values.clock import utc_to_las_time
from furrowmap.core.values.intervals import Interval, interval_numbers
from furrowmap.core.work.field_surfaces import FieldPoints
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


class RunSink:
    """The sink of a run whose points go into its cloud, its surfaces and its parcels, where it has any."""

    def __init__(
        self, cloud: RunCloud, land: FieldPoints, colours: RunColours, parcels: ParcelPoints | None = None
    ) -> None:
        self._cloud, self._land, self._colours, self._parcels = cloud, land, colours, parcels
        self._origin_m = (0.0, 0.0, 0.0)

    def begin(self, frame: MapFrame, origin_m: tuple[float, float, float]) -> None:
        """Pass the local origin on to all."""
        self._origin_m = origin_m
        self._cloud.begin(frame, origin_m)
        self._land.begin(origin_m)

    def add(self, placed: PlacedScan) -> None:
        """Pass the points of a scan on to all."""
        self._cloud.add(placed)
        self._land.add(placed)
        self._colours.add(placed)
        if self._parcels is not None:
            self._parcels.add(placed.xyz_m[placed.kept] + self._origin_m)


class RunCloud:
    """Writes the cloud of a run; a thread packs the points and sorts those that exceed the memory into a file."""

    def __init__(self, path: Path, colours: RunColours) -> None:
        self._path, self._colours = path, colours
        self._writer: CopcWriter | None = None
        self._append: Callable[[PointBatch], None] | None = None
        self._packing = ExitStack()
        self._watch = GroundSampler()

    def __enter__(self) -> Self:
        return self

    def begin(self, frame: MapFrame, origin_m: tuple[float, float, float]) -> None:
        """Open the file, now that its CRS and local origin are known."""
        extra = (("scan", "uint32", "scan (revolution) number"),)
        self._rgb = UNCOLOURED if self._colours.has_frames else None
        kind = CopcFormat(las_wkt(frame.whole_crs), origin_m, SCALE_M, extra, colour=self._rgb is not None)
        self._writer = CopcWriter(self._path, kind).__enter__()
        self._append = self._packing.enter_context(behind(self._writer.append, SCANS_BEHIND))

    def add(self, placed: PlacedScan) -> None:
        """Take the points of one scan."""
        assert self._append is not None
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
                rgb=np.broadcast_to(self._rgb, (len(scan), 3)) if self._rgb is not None else None,
                extra={"scan": scan.number},
            )
        )

    def finish(self, progress: Progress, passes: Sequence[Interval], description: str) -> CopcSummary:
        """Sort, compress and write the points, each with its class, the number of its pass and its colour.

        Args:
            progress: receives the stage "writing cloud".
            passes: of the tool, or strips of a flight.
            description: of the cloud.
        """
        assert self._writer is not None
        self._packing.close()
        ground = self._watch.ground()

        # The few passes are turned into the points' time, not the many points into the passes'.
        spans = [_Span(_las(when.begin_s), _las(when.end_s)) for when in passes]

        def mark(points: Columns) -> None:
            ground.classify(points.x, points.y, points.z, SCALE_M, points.classification)
            if spans:
                points.point_source_id[:] = np.minimum(interval_numbers(spans, points.gps_time), MOST_PASSES)
            self._colours.paint(points, SCALE_M)

        return self._writer.close(progress, mark, description)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._writer is not None:
            stack = ExitStack()
            stack.push(self._writer)
            stack.push(self._packing)
            stack.__exit__(kind, error, trace)


@dataclass(frozen=True)
class _Span:
    """A pass in the points' time."""

    begin_s: float
    end_s: float


def _las(t_s: float) -> float:
    return float(utc_to_las_time(t_s))
