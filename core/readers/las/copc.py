"""The octree of a COPC file: which chunk holds what part of the cloud (COPC 1.0, copc.io)."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.las.header import LasHeader, is_number
from furrowmap.core.readers.las.laz import LazPoints
from furrowmap.core.readers.las.records import Record
from furrowmap.core.values.errors import Notice

INFO_BYTES: Final = 160
ENTRY: Final = np.dtype([("key", "<i4", 4), ("offset", "<u8"), ("bytes", "<i4"), ("points", "<i4")])
DEEPEST: Final = 30
MOST_PAGES: Final = 100_000
_INFO: Final = struct.Struct("<5d2Q2d")


@dataclass(frozen=True)
class CopcIndex:
    """An octree that has been checked against the file's chunks.

    Attributes:
        low: least x, y, z of the root's cube.
        side: of that cube.
        spacing: between points of the root.
        keys: (n, 4) int32 level, x, y, z of each node that has points.
        chunks: (n,) number of the chunk that holds its points.
    """

    low: tuple[float, float, float]
    side: float
    spacing: float
    keys: NDArray[np.int32]
    chunks: NDArray[np.intp]

    def chunks_in(self, box: tuple[float, float, float, float] | None, resolution: float | None) -> NDArray[np.intp]:
        """Numbers (n,) of the chunks that may hold points of a box and are coarse enough, in the order of the file.

        Args:
            box: least x, least y, greatest x, greatest y; None for all.
            resolution: distance of points that is fine enough; None for all.
        """
        level = self.keys[:, 0]
        keep = np.ones(len(level), bool)
        if resolution is not None:
            keep &= (level == 0) | (self.spacing / 2.0 ** (level - 1.0) > resolution)
        if box is not None:
            side = self.side / 2.0**level
            for axis in (0, 1):
                least = self.low[axis] + self.keys[:, 1 + axis] * side
                # Writers round cubes: a point may lie a hair outside its own.
                keep &= (least - 1e-6 * self.side <= box[2 + axis]) & (least + side + 1e-6 * self.side >= box[axis])
        return np.sort(self.chunks[keep])


def is_copc(records: Sequence[Record]) -> bool:
    """Whether the file says that it is one."""
    return any((record.user, record.number) == ("copc", 1) for record in records)


def read_index(
    path: Path, file: BinaryIO, header: LasHeader, records: Sequence[Record], laz: LazPoints
) -> tuple[CopcIndex | None, tuple[Notice, ...]]:
    """The octree of a file that says it is COPC; None, and a notice why, where it cannot be so."""
    try:
        return _index(file, header, records, laz), ()
    except _LieError as lie:
        text = f"{path.name}: its octree cannot be used, {lie}. The points are read one after the other, all of them."
        return None, (Notice("copc-index", text),)


class _LieError(Exception):
    """What is wrong with the octree."""


def _index(file: BinaryIO, header: LasHeader, records: Sequence[Record], laz: LazPoints) -> CopcIndex:
    info = next(record for record in records if (record.user, record.number) == ("copc", 1))
    if len(info.data) < INFO_BYTES:
        raise _LieError(f"the info record has {len(info.data)} bytes of {INFO_BYTES}")
    *cube, root_at, root_bytes, _, _ = _INFO.unpack_from(info.data)
    x, y, z, half, spacing = cube
    if not (is_number(tuple(cube)) and half > 0 and spacing > 0):
        raise _LieError(f"half a side of its cube is {half:g}, its spacing {spacing:g}")
    entries = _entries(file, header, int(root_at), int(root_bytes))
    nodes = entries[entries["points"] > 0]
    if int(nodes["points"].sum(dtype=np.int64)) != header.points or len(nodes) != len(laz.points):
        promised = f"{int(nodes['points'].sum(dtype=np.int64)):,} points in {len(nodes):,} nodes"
        raise _LieError(f"it has {promised}, the file {header.points:,} in {len(laz.points):,} chunks")
    level, place = nodes["key"][:, :1], nodes["key"][:, 1:]
    if np.any(level < 0) or np.any(level > DEEPEST) or np.any(place < 0) or np.any(place >= 2.0**level):
        raise _LieError("a node lies outside its cube")
    chunks = np.searchsorted(laz.begins, nodes["offset"].astype(np.int64))
    fitting = chunks < len(laz.begins)
    at = np.minimum(chunks, len(laz.begins) - 1)
    for name, true in (("offset", laz.begins), ("bytes", laz.sizes), ("points", laz.points)):
        fitting &= nodes[name].astype(np.int64) == true[at]
    if not fitting.all():
        number = int(np.flatnonzero(~fitting)[0])
        node = "-".join(map(str, nodes["key"][number].tolist()))
        raise _LieError(f"node {node} is no chunk of the file (byte {int(nodes['offset'][number]):,})")
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
            raise _LieError(f"the page of its hierarchy at byte {at:,} refers back to itself")
        seen.add(at)
        if at < header.header_bytes or at + size > header.size_bytes or size < 0 or size % ENTRY.itemsize:
            raise _LieError(f"a page of its hierarchy should lie at bytes {at:,} to {at + size:,}")
        left = min(left, header.size_bytes) - size
        if left < 0 or len(seen) > MOST_PAGES:
            raise _LieError("the pages of its hierarchy overlap")
        file.seek(at)
        page = np.frombuffer(file.read(size), ENTRY)
        pages.append(page[page["points"] >= 0])
        waiting += [(int(entry["offset"]), int(entry["bytes"])) for entry in page[page["points"] < 0]]
    return np.concatenate(pages)
