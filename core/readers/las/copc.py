"""The octree of a COPC file: the chunk of each node (COPC 1.0, copc.io)."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.las.header import LasHeader
from furrowmap.core.readers.las.laz import LazPoints
from furrowmap.core.readers.las.records import LasRecord
from furrowmap.core.runtime.errors import Notice

INFO_BYTES: Final = 160
ENTRY: Final = np.dtype([("key", "<i4", 4), ("offset", "<u8"), ("bytes", "<i4"), ("points", "<i4")])
MAX_LEVEL: Final = 30
MAX_PAGES: Final = 100_000
_INFO: Final = struct.Struct("<5d2Q2d")


@dataclass(frozen=True)
class CopcIndex:
    """An octree, checked against the file's chunks.

    Attributes:
        low: minimum x, y, z of the root's cube.
        side: length of that cube's sides.
        spacing: point spacing of the root.
        keys: (n, 4) int32 level, x, y, z of each node with points.
        chunks: (n,) index of the chunk with its points.
    """

    low: tuple[float, float, float]
    side: float
    spacing: float
    keys: NDArray[np.int32]
    chunks: NDArray[np.intp]

    def chunks_in(self, box: tuple[float, float, float, float] | None, resolution: float | None) -> NDArray[np.intp]:
        """Indices (n,) of the chunks for a box and a resolution, in the order of the file.

        Args:
            box: minimum x, minimum y, maximum x, maximum y; None for all.
            resolution: point spacing that is sufficient; None for all points.
        """
        level = self.keys[:, 0]
        keep = np.ones(len(level), bool)
        if resolution is not None:
            keep &= (level == 0) | (self.spacing / 2.0 ** (level - 1.0) > resolution)
        if box is not None:
            side = self.side / 2.0**level
            for axis in (0, 1):
                least = self.low[axis] + self.keys[:, 1 + axis] * side
                # Writers round cubes: a point may lie slightly outside its own.
                keep &= (least - 1e-6 * self.side <= box[2 + axis]) & (least + side + 1e-6 * self.side >= box[axis])
        return np.sort(self.chunks[keep])


def is_copc(records: Sequence[LasRecord]) -> bool:
    """Whether the file is marked as COPC."""
    return any((record.user, record.number) == ("copc", 1) for record in records)


def read_index(
    path: Path, file: BinaryIO, header: LasHeader, records: Sequence[LasRecord], laz: LazPoints
) -> tuple[CopcIndex | None, tuple[Notice, ...]]:
    """The octree of a file that is marked as COPC; None, with a notice, if it is invalid."""
    try:
        return _index(file, header, records, laz), ()
    except _OctreeError as fault:
        return None, (Notice("copc-index", path=path.name, fault=fault),)


class _OctreeError(Exception):
    """What is wrong with the octree."""


def _index(file: BinaryIO, header: LasHeader, records: Sequence[LasRecord], laz: LazPoints) -> CopcIndex:
    info = next(record for record in records if (record.user, record.number) == ("copc", 1))
    if len(info.data) < INFO_BYTES:
        raise _OctreeError(f"the info record has {len(info.data)} bytes instead of {INFO_BYTES}")
    *cube, root_at, root_bytes, _, _ = _INFO.unpack_from(info.data)
    x, y, z, half, spacing = cube
    if not (np.isfinite(cube).all() and half > 0 and spacing > 0):
        raise _OctreeError(f"half size of the cube {half:g}, spacing {spacing:g}")
    entries = _entries(file, header, int(root_at), int(root_bytes))
    nodes = entries[entries["points"] > 0]
    if int(nodes["points"].sum(dtype=np.int64)) != header.points or len(nodes) != len(laz.points):
        stated = f"{int(nodes['points'].sum(dtype=np.int64)):,} points in {len(nodes):,} nodes"
        raise _OctreeError(f"it has {stated}, the file {header.points:,} points in {len(laz.points):,} chunks")
    level, place = nodes["key"][:, :1], nodes["key"][:, 1:]
    if np.any(level < 0) or np.any(level > MAX_LEVEL) or np.any(place < 0) or np.any(place >= 2.0**level):
        raise _OctreeError("a node is outside the cube")
    chunks = np.searchsorted(laz.begins, nodes["offset"].astype(np.int64))
    fitting = chunks < len(laz.begins)
    at = np.minimum(chunks, len(laz.begins) - 1)
    for name, true in (("offset", laz.begins), ("bytes", laz.sizes), ("points", laz.points)):
        fitting &= nodes[name].astype(np.int64) == true[at]
    if not fitting.all():
        number = int(np.flatnonzero(~fitting)[0])
        node = "-".join(map(str, nodes["key"][number].tolist()))
        raise _OctreeError(f"node {node} is not a chunk of the file (byte {int(nodes['offset'][number]):,})")
    return CopcIndex((x - half, y - half, z - half), 2.0 * half, spacing, nodes["key"].copy(), chunks.astype(np.intp))


def _entries(file: BinaryIO, header: LasHeader, root_at: int, root_bytes: int) -> NDArray[np.void]:
    """All entries of all pages; each page is read once."""
    waiting = [(root_at, root_bytes)]
    seen: set[int] = set()
    pages = [np.zeros(0, ENTRY)]
    left = math.inf
    while waiting:
        at, size = waiting.pop()
        if at in seen:
            raise _OctreeError(f"the hierarchy page at byte {at:,} refers to itself")
        seen.add(at)
        if at < header.header_bytes or at + size > header.size_bytes or size < 0 or size % ENTRY.itemsize:
            raise _OctreeError(f"a hierarchy page at bytes {at:,} to {at + size:,} is outside the file")
        left = min(left, header.size_bytes) - size
        if left < 0 or len(seen) > MAX_PAGES:
            raise _OctreeError("hierarchy pages overlap")
        file.seek(at)
        page = np.frombuffer(file.read(size), ENTRY)
        pages.append(page[page["points"] >= 0])
        waiting += [(int(entry["offset"]), int(entry["bytes"])) for entry in page[page["points"] < 0]]
    return np.concatenate(pages)
