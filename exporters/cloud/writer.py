"""Writing a cloud as COPC."""

import math
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import laspy
import numpy as np

from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.exporters.cloud.copc_file import CopcFile, CopcFormat, describe, las_header
from furrowmap.exporters.cloud.cube import Cube
from furrowmap.exporters.cloud.layers import ChunkColumns
from furrowmap.exporters.cloud.octree import Octree
from furrowmap.exporters.cloud.point_batches import Extent, PointBatch, pack
from furrowmap.exporters.cloud.records import held_layout
from furrowmap.exporters.files.atomic import atomic_output

MEMORY_POINTS: Final = 8_000_000
NODE_POINTS: Final = 50_000
MIN_NODE_POINTS: Final = 64
"""With fewer, a node with children might stay empty by chance: with 64 expected points once in 10^28 nodes."""


@dataclass(frozen=True)
class CopcSummary:
    """Summary of a written cloud: least corner or the origin, points by level from the root, points by class."""

    points: int
    low_m: tuple[float, float, float]
    high_m: tuple[float, float, float]
    nodes: int
    points_by_level: tuple[int, ...]
    points_by_class: dict[int, int]


class CopcWriter:
    """Writes a COPC file from batches of points: a context manager that writes the whole file or nothing.

    Points beyond `memory_points` are kept in a temporary file beside `path`; writing takes about 60 bytes of memory for
    each of `memory_points`, regardless of the total. An octree node that has children holds `node_points` points; the
    same batches and `seed` of the random levels give the same nodes. With `colours_later` batches have no colours: what
    completes the points, see :meth:`close`, gives them theirs.
    """

    def __init__(
        self,
        path: Path,
        kind: CopcFormat,
        *,
        memory_points: int = MEMORY_POINTS,
        node_points: int = NODE_POINTS,
        seed: int = 0,
        colours_later: bool = False,
    ) -> None:
        if node_points < MIN_NODE_POINTS or memory_points < 1:
            raise ValueError(f"no octree with {node_points} points a node, {memory_points} in memory")
        self._path = path
        self._kind = kind
        self._node_points = node_points
        self._header = las_header(kind)
        layout = held_layout(self._header.point_format.dtype(), colours_later=colours_later)
        random = np.random.default_rng(seed)
        self._octree = Octree(layout, memory_points, node_points, path.parent, random)
        self._extent: Extent | None = None
        self._stack = ExitStack()
        self._summary: CopcSummary | None = None

    def __enter__(self) -> Self:
        self._unfinished = self._stack.enter_context(atomic_output(self._path))
        self._stack.enter_context(closing(self._octree))
        return self

    def append(self, batch: PointBatch) -> None:
        """Add a batch; raises FurrowmapError if a value is out of range, ValueError if arrays do not fit."""
        done = 0
        while done < len(batch):
            room = self._octree.room(len(batch) - done)
            part = batch.part(done, done + len(room))
            extent = pack(part, room, self._kind.scale_m, week_time=self._kind.week_time)
            self._octree.filled(len(room), extent.low, extent.high)
            self._extent = extent if self._extent is None else self._extent.joined(extent)
            done += len(room)

    def close(
        self, progress: Progress = silent, complete: Callable[[ChunkColumns], None] | None = None, description: str = ""
    ) -> CopcSummary:
        """Sort, compress and write the points, and rename the file; a second call returns the same summary.

        `complete` completes the points of a node in place; it is called in any order, from several threads at once.
        """
        if self._summary is None:
            if description:
                describe(self._header, description)
            with self._stack:
                self._summary = self._write(progress, complete)
        return self._summary

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        else:
            self._stack.__exit__(kind, error, trace)

    def _write(self, progress: Progress, complete: Callable[[ChunkColumns], None] | None) -> CopcSummary:
        points = self._extent.points if self._extent is not None else 0
        with closing(
            CopcFile(self._unfinished, self._header, lambda done: progress("writing cloud", done / points), complete)
        ) as file:
            if self._extent is not None:
                cube = self._octree.finish(file.put)
                extent = self._extent
            else:
                cube = Cube((0, 0, 0), 0)
                extent = Extent.at_origin()
            # Mean distance of a node's points, which mostly lie on a surface across its cell.
            spacing_m = cube.side * self._kind.scale_m / math.sqrt(min(points, self._node_points) or 1)
            nodes, levels = file.finish(extent, cube, spacing_m)
            classes = file.points_by_class
        summary = CopcSummary(
            points,
            low_m=tuple(self._header.mins.tolist()),
            high_m=tuple(self._header.maxs.tolist()),
            nodes=nodes,
            points_by_level=tuple(levels.tolist()),
            points_by_class={number: int(classes[number]) for number in np.flatnonzero(classes).tolist()},
        )
        _check(self._unfinished, summary)
        return summary


def _check(path: Path, written: CopcSummary) -> None:
    """Read back the header, the hierarchy and the root's points."""
    with laspy.CopcReader.open(path) as reader:
        header = reader.header
        found = sum(entry.point_count for entry in reader.root_page.entries.values())
        root = reader.query(level=0)
        inside = not len(root) or all(
            (low <= axis.min()) and (axis.max() <= high)
            for low, high, axis in zip(written.low_m, written.high_m, (root.x, root.y, root.z), strict=True)
        )
        same = tuple(header.mins) == written.low_m and tuple(header.maxs) == written.high_m
        if (header.point_count, found, len(root)) != (written.points, written.points, sum(written.points_by_level[:1])):
            raise OSError(f"{path} contains {found} points, not the {written.points} written")
        if not (inside and same):
            raise OSError(f"{path} has other bounds than what was written")
