"""Levels of detail: the share of points that each node keeps, and the random level of each point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

CERTAIN: Final = 1 << 31
"""A threshold above all random numbers."""


@dataclass(frozen=True)
class Plan:
    """The share of points that stays in each node.

    Nodes are numbered by level, then by their cells' codes: node `first[level] + code`.

    Attributes:
        depth: the deepest level.
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
        code, shift = node - int(self.first[level]), 3 * (self.depth - level)
        return code << shift, (code + 1) << shift


def plan_levels(counts: NDArray[np.int64], depth: int, node_points: int) -> Plan:
    """The plan for a histogram of points by cell.

    From the root down, a node that receives more than `2 × node_points` points keeps a random `node_points` of them and
    passes the rest to its children; any other keeps all.

    Args:
        counts: (8^depth,) points in each cell.
        depth: the deepest level.
        node_points: points of a node that has children.
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
        threshold[first[level] : first[level + 1]] = np.rint((1.0 - passed) * CERTAIN)
        if level < depth:
            passed = np.repeat(passed, 8)
    return Plan(depth, first, threshold, rest > 2 * node_points)


def draw_nodes(
    codes: NDArray[np.uint32], plan: Plan, random: np.random.Generator
) -> tuple[NDArray[np.uint32], NDArray[np.int64]]:
    """The node of each point (n,) and the number of points in each node (nodes,)."""
    nodes, counts = np.empty(len(codes), np.uint32), np.zeros(int(plan.first[-1]), np.int64)
    draw(codes, plan.first, plan.threshold, plan.depth, random.integers(1 << 63, dtype=np.uint64), nodes, counts)
    return nodes, counts


@numba.njit(
    "void(uint32[::1], int64[::1], uint32[::1], int64, uint64, uint32[::1], int64[::1])", cache=True, nogil=True
)
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
