"""Sorting records into the nodes of an octree, in bounded memory; each point's level is random."""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.runtime.record_spool import RecordSpool
from furrowmap.exporters.cloud.cube import DEPTH, Cube, codes_of, places, sorted_order
from furrowmap.exporters.cloud.records import Chosen, Records, gather_records

SLICE: Final = 1 << 16
"""Records copied in one go when a half of memory is sorted into the file: few enough for the processor's cache."""
CERTAIN_THRESHOLD: Final = 1 << 31
"""A threshold above all random numbers."""


class Key(NamedTuple):
    """A node of a COPC file: its level and its indices in that level."""

    level: int
    x: int
    y: int
    z: int

    def below(self, depth: int, code: int) -> "Key":
        """The node of a cell of this node's cube."""
        x, y, z = places(depth, code)
        return Key(self.level + depth, (self.x << depth) + x, (self.y << depth) + y, (self.z << depth) + z)


ROOT_KEY: Final = Key(0, 0, 0, 0)


PutNode = Callable[[Key, Sequence[Chosen]], Future[Any]]
"""Adds a complete node; a thread reads the records until the returned future is done."""


@dataclass(frozen=True)
class Plan:
    """The share of points that stays in each node.

    Nodes are numbered by level, then by their cells' codes: node `first[level] + code`.

    Attributes:
        first: (depth + 2,) number of the first node of each level, and of nodes.
        threshold: (nodes,) uint32: of the points in a node's cell, those with a random number (0 to 2^31 − 1) below it
            stay there or above.
        full: (8^depth,) bool: nodes of the deepest level with too many points.
    """

    depth: int
    first: NDArray[np.int64]
    threshold: NDArray[np.uint32]
    full: NDArray[np.bool_]

    def level_of(self, node: int) -> int:
        """The level of a node."""
        return int(np.searchsorted(self.first, node, side="right")) - 1

    def is_full(self, node: int) -> bool:
        """Whether it is of the deepest level and has too many points."""
        code = node - int(self.first[self.depth])
        return code >= 0 and bool(self.full[code])

    def codes_below(self, node: int) -> tuple[int, int]:
        """The codes of a node's cells of the deepest level, as first and end."""
        level = self.level_of(node)
        code = node - int(self.first[level])
        shift = 3 * (self.depth - level)
        return code << shift, (code + 1) << shift


def plan_levels(counts: NDArray[np.integer[Any]], depth: int, node_points: int) -> Plan:
    """The plan for a histogram of points by cell.

    From the root down, a node that receives more than `2 × node_points` points keeps a random `node_points` of them and
    passes the rest to its children; any other keeps all. `counts` (8^depth,) are the points in each cell.
    """
    first = np.cumsum([0, *(8**level for level in range(depth + 1))])
    reached = [counts]
    for _ in range(depth):
        reached.append(reached[-1].reshape(-1, 8).sum(axis=1))
    reached.reverse()
    threshold = np.empty(int(first[-1]), np.uint32)
    passed = np.ones(1)
    rest = np.zeros(1)
    for level, points in enumerate(reached):
        rest = points * passed
        keeps_all = (rest <= 2 * node_points) | (level == depth)
        passed = np.where(keeps_all, 0.0, passed * (1.0 - node_points / np.maximum(rest, 1.0)))
        threshold[first[level] : first[level + 1]] = np.rint((1.0 - passed) * CERTAIN_THRESHOLD)
        if level < depth:
            passed = np.repeat(passed, 8)
    return Plan(depth, first, threshold, rest > 2 * node_points)


def draw_nodes(
    codes: NDArray[np.uint32], plan: Plan, random: np.random.Generator
) -> tuple[NDArray[np.uint32], NDArray[np.int32]]:
    """The node of each point (n,) and the number of points in each node (nodes,)."""
    nodes = np.empty(len(codes), np.uint32)
    counts = np.zeros(int(plan.first[-1]), np.int32)
    draw(codes, plan.first, plan.threshold, plan.depth, random.integers(1 << 63, dtype=np.uint64), nodes, counts)
    return nodes, counts


@kernel()
def draw(codes, first, threshold, depth, state, nodes, counts):  # type: ignore[no-untyped-def]
    """Kernel of :func:`draw_nodes`: random numbers of SplitMix64 (Steele, Lea and Flood 2014)."""
    for i in range(len(codes)):
        state += np.uint64(0x9E3779B97F4A7C15)
        z = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        drawn = np.uint32((z ^ (z >> np.uint64(31))) >> np.uint64(33))
        # Bottom up, as most points stay near the bottom; thresholds do not decrease downwards.
        code = np.int64(codes[i])
        node = first[depth] + code
        for level in range(depth - 1, -1, -1):
            code >>= 3
            if drawn >= threshold[first[level] + code]:
                break
            node = first[level] + code
        nodes[i] = node
        counts[node] += 1


class Octree:
    """Sorts records into nodes.

    One cube is divided into at most 128³ cells (:mod:`~furrowmap.exporters.cloud.cube`). Where there are more than
    `memory_points`, records go to a file, sorted by cell in blocks, and three quarters of the memory are given back;
    the rest has two halves, one of which a thread writes to the file while the other is filled. At the end, ranges of
    cells that fit into a half are read back in the order of the cells' codes, into the halves by turns. A node is
    complete once its last cell has been read, so that only one node of each level is waiting. A cell with too many
    records for a node becomes the root of an octree of its own. At most `memory_points` records are in memory, the
    others in a file in `folder`; a leaf may have twice `node_points`; without a `cube` it is computed from the records.
    """

    def __init__(
        self,
        layout: np.dtype[np.void],
        memory_points: int,
        node_points: int,
        folder: Path,
        random: np.random.Generator,
        cube: Cube | None = None,
        key: Key = ROOT_KEY,
    ) -> None:
        self._memory_points = memory_points
        self._node_points = node_points
        self._folder = folder
        self._random = random
        self._cube = cube
        self._key = key
        self._depth = DEPTH if cube is None else min(DEPTH, cube.bits)
        self._buffer: Records = np.empty(0, layout)
        self._first = 0
        self._held = 0
        self._end = 0
        self._turn = 0
        self._reading: tuple[list[Future[Any]], list[Future[Any]]] = ([], [])
        self._low = np.full(3, np.iinfo(np.int64).max)
        self._high = np.full(3, np.iinfo(np.int64).min)
        self._spool: RecordSpool | None = None
        self._thread: ThreadPoolExecutor | None = None
        self._spilling: Future[None] | None = None
        self._counts = np.zeros(8**self._depth, np.int64)
        self._waiting: dict[int, list[Chosen]] = {}
        self._within: dict[int, Octree] = {}

    def room(self, wanted: int) -> Records:
        """Room for 1 to `wanted` records, to be filled before the next call."""
        if not len(self._buffer):
            self._buffer = np.empty(8 * -(-self._memory_points // 8), self._buffer.dtype)
            self._end = len(self._buffer)
        elif self._held == self._end:
            self._make_room()
        return self._buffer[self._held : min(self._held + wanted, self._end)]

    def filled(self, records: int, low: NDArray[np.int64], high: NDArray[np.int64]) -> None:
        """Take the first `records` of the room, whose X, Y and Z lie between `low` and `high`."""
        self._low, self._high = np.minimum(self._low, low), np.maximum(self._high, high)
        self._held += records

    def finish(self, put: PutNode) -> Cube:
        """Pass all nodes to `put`; needs at least one record."""
        self._await_spill()
        cube = self._enclose()
        if self._spool is None:
            self._sort(put, cube, Chosen.all_of(self._buffer[: self._held]))
        else:
            self._spill(self._spool, cube, self._buffer[self._first : self._held])
            self._gather(put, self._spool, cube)
        return cube

    def _sort(self, put: PutNode, cube: Cube, chosen: Chosen) -> None:
        """Pass the nodes of all points to `put`, which are in memory."""
        nodes = len(chosen) / (2 * self._node_points)
        self._depth = min(self._depth, 2 + math.ceil(math.log(max(nodes, 1.0), 4)))
        codes, counts = codes_of(chosen, cube, self._depth)
        self._place(put, chosen, codes, plan_levels(counts, self._depth, self._node_points), end=len(counts))

    def close(self) -> None:
        """Remove temporary files."""
        if self._thread is not None:
            self._thread.shutdown()
        if self._spool is not None:
            self._spool.close()
        for inner in self._within.values():
            inner.close()

    def _make_room(self) -> None:
        """Write the full half to the file in a thread, and continue in the other half; at first write all."""
        self._await_spill()
        cube = self._enclose()
        if self._spool is None or self._thread is None:
            self._spool = RecordSpool(self._buffer.dtype, self._folder)
            self._thread = ThreadPoolExecutor(1, "spill")
            for block in self._buffer.reshape(8, -1):  # blocks as long as the halves to come
                self._spill(self._spool, cube, block)
            self._buffer = np.empty(len(self._buffer) // 4, self._buffer.dtype)
            self._first, self._held, self._end = 0, 0, len(self._buffer) // 2
            return
        half = len(self._buffer) // 2
        full = self._buffer[self._first : self._end]
        self._spilling = self._thread.submit(self._spill, self._spool, cube, full)
        self._first, self._end = (half, len(self._buffer)) if self._first == 0 else (0, half)
        self._held = self._first

    def _await_spill(self) -> None:
        """Wait for the thread that writes to the file."""
        if self._spilling is not None:
            self._spilling.result()
            self._spilling = None

    def _spill(self, spool: RecordSpool, cube: Cube, records: Records) -> None:
        """Put records into the file."""
        chosen = Chosen.all_of(records)
        codes, counts = codes_of(chosen, cube, self._depth)
        there = np.flatnonzero(counts != 0)  # of the numbers themselves it takes four times as long
        self._counts[there] += counts[there]
        order = sorted_order(codes, counts, chosen.members)
        spool.append(
            (Chosen(records, order[start : start + SLICE]).gathered() for start in range(0, len(order), SLICE)),
            there,
            np.concatenate([[0], counts[there]]),
        )

    def _enclose(self) -> Cube:
        """The cube of all records so far, doubled as often as needed."""
        if self._cube is None:
            self._cube = Cube.around(self._low, self._high)
        while not self._cube.holds(self._low, self._high):
            self._cube, octant = self._cube.doubled(self._low)
            eighth = self._counts.reshape(-1, 8).sum(axis=1)
            self._counts = np.zeros_like(self._counts)
            self._counts.reshape(8, -1)[octant] = eighth
            if self._spool is not None:
                self._spool.shift_keys(3, octant << 3 * (self._depth - 1))
        return self._cube

    def _gather(self, put: PutNode, spool: RecordSpool, cube: Cube) -> None:
        """Take back what the file holds, stretch of cells by stretch of cells."""
        plan = plan_levels(self._counts, self._depth, self._node_points)
        # A cell that is read in one go is divided where it lies: halves may grow to the quarter of memory of an octree.
        half = min(int(self._counts.max()), self._memory_points // 4)
        if 2 * half > len(self._buffer):
            self._buffer = np.empty(2 * half, self._buffer.dtype)
        up_to = np.concatenate([[0], np.cumsum(self._counts)])
        first = 0
        while first < len(self._counts):
            most = up_to[first] + len(self._buffer) // 2
            end = max(int(np.searchsorted(up_to, most, side="right")) - 1, first + 1)
            end = int(np.searchsorted(up_to, up_to[end], side="right")) - 1  # and the empty cells that follow
            left = int(up_to[end] - up_to[first])
            for part in spool.parts(first, end, self._other_half):
                left -= len(part)
                chosen = Chosen.all_of(part)
                codes, _ = codes_of(chosen, cube, self._depth)
                self._place(put, chosen, codes, plan, end if left == 0 else first)
            first = end

    def _other_half(self) -> Records:
        """The half of memory that was not used last, once no node is read from it any more."""
        self._turn = 1 - self._turn
        wait(self._reading[self._turn])
        self._reading[self._turn].clear()
        half = len(self._buffer) // 2
        return self._buffer[self._turn * half : (self._turn + 1) * half]

    def _place(self, put: PutNode, chosen: Chosen, codes: NDArray[np.uint32], plan: Plan, end: int) -> None:
        """Sort points into nodes and output those whose cells, all before `end`, are complete."""

        def put_on(key: Key, parts: Sequence[Chosen]) -> Future[Any]:
            reading = put(key, parts)
            self._reading[self._turn].append(reading)
            return reading

        nodes, counts = draw_nodes(codes, plan, self._random)
        there = np.flatnonzero(counts != 0).tolist()
        order = sorted_order(nodes, counts, chosen.members)
        ends = counts
        for node in sorted({*there, *self._waiting, *self._within}):
            own = Chosen(chosen.records, order[ends[node - 1] if node else 0 : ends[node]])
            complete = plan.codes_below(node)[1] <= end
            if plan.is_full(node) and self._depth < self._enclose().bits:
                self._divide(put_on, node, plan, own, complete=complete)
            elif complete:
                put_on(self._key_of(node, plan), [*self._waiting.pop(node, []), own])
            else:
                self._waiting.setdefault(node, []).append(Chosen.all_of(own.gathered()))

    def _divide(self, put: PutNode, node: int, plan: Plan, chosen: Chosen, *, complete: bool) -> None:
        """Pass the points of a deepest node with too many to an octree within its cell."""
        inner = self._within.get(node)
        if inner is None:
            cube = self._enclose().cell(self._depth, node - int(plan.first[self._depth]))
            memory_points = max(self._memory_points // 4, 1)
            key = self._key_of(node, plan)
            inner = self._within[node] = Octree(
                self._buffer.dtype, memory_points, self._node_points, self._folder, self._random, cube, key
            )
        if complete and not inner._held and inner._spool is None:
            inner._sort(put, inner._enclose(), chosen)
        else:
            copied = 0
            while copied < len(chosen):
                room = inner.room(len(chosen) - copied)
                gather_records(chosen.records, chosen.members[copied : copied + len(room)], room)
                inner.filled(len(room), *inner._enclose().corners)
                copied += len(room)
            if complete:
                inner.finish(put)
        if complete:
            inner.close()
            del self._within[node]

    def _key_of(self, node: int, plan: Plan) -> Key:
        level = plan.level_of(node)
        return self._key.below(level, node - int(plan.first[level]))
