"""Cubes and their cells, in steps of the coordinates."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.kernels import kernel
from furrowmap.exporters.cloud.records import Chosen, rows_of

DEPTH: Final = 7
"""Maximum number of halvings of a cube: 128 cells a side, 2 million in all."""

SPREAD: Final = np.array([sum(((v >> b) & 1) << (3 * b) for b in range(DEPTH)) for v in range(1 << DEPTH)], np.uint32)
"""The bits of a number below 2^DEPTH with two zeros between them."""


@dataclass(frozen=True)
class Cube:
    """A cube of 2^bits steps a side.

    Halved `depth` times, it has 8^depth cells. A cell's **code** interleaves the bits of its indices along x, y, z (x
    lowest: Morton order): the codes within a coarser cell are consecutive, and a code without its last three bits is
    that of the parent cell. `origin` is the least X, Y and Z in it.
    """

    origin: tuple[int, int, int]
    bits: int

    @classmethod
    def around(cls, low: NDArray[np.int64], high: NDArray[np.int64]) -> "Cube":
        """The smallest cube around points from `low` to `high`, of at least a step for each cell.

        They are centred along x and y but at its bottom, so that flat ground does not straddle cells.
        """
        bits = max(DEPTH, int((high - low).max()).bit_length())
        margin = ((1 << bits) - 1 - (high - low)) // 2
        return cls((int(low[0] - margin[0]), int(low[1] - margin[1]), int(low[2])), bits)

    @property
    def side(self) -> int:
        """Length of its edges in steps."""
        return 1 << self.bits

    @property
    def corners(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Least and greatest X, Y and Z in it."""
        low = np.array(self.origin, np.int64)
        return low, low + self.side - 1

    def holds(self, low: NDArray[np.int64], high: NDArray[np.int64]) -> bool:
        """Whether all points from `low` to `high` lie in it."""
        lowest, highest = self.corners
        return bool((low >= lowest).all() and (high <= highest).all())

    def doubled(self, low: NDArray[np.int64]) -> "tuple[Cube, int]":
        """A cube of twice the side, extended towards `low` or upward; and which of its eight this one is."""
        octant = 0
        origin = list(self.origin)
        for axis in range(3):
            if low[axis] < origin[axis]:
                origin[axis] -= self.side
                octant |= 1 << axis
        return Cube((origin[0], origin[1], origin[2]), self.bits + 1), octant

    def cell(self, depth: int, code: int) -> "Cube":
        """The cube of a cell."""
        bits = self.bits - depth
        x, y, z = places(depth, code)
        return Cube((self.origin[0] + (x << bits), self.origin[1] + (y << bits), self.origin[2] + (z << bits)), bits)


def places(depth: int, code: int) -> tuple[int, int, int]:
    """Indices of a cell along x, y and z."""
    x, y, z = (sum(((code >> (3 * b + axis)) & 1) << b for b in range(depth)) for axis in range(3))
    return x, y, z


def codes_of(chosen: Chosen, cube: Cube, depth: int) -> tuple[NDArray[np.uint32], NDArray[np.int32]]:
    """The cell of each chosen record (n,), and the number of them in each cell (8^depth,)."""
    codes = np.empty(len(chosen), np.uint32)
    counts = np.zeros(8**depth, np.int32)
    origin = np.array(cube.origin)
    locate(rows_of(chosen.records), chosen.members, origin, cube.bits - depth, SPREAD, codes, counts)
    return codes, counts


@kernel()
def locate(records, members, origin, bits, spread, codes, counts):  # type: ignore[no-untyped-def]
    """Kernel of :func:`codes_of`; a record begins with X, Y and Z as little-endian int32."""
    for i in range(len(members)):
        code = np.uint32(0)
        record = members[i]
        for axis in range(3):
            k = 4 * axis
            step = (
                np.uint32(records[record, k])
                | np.uint32(records[record, k + 1]) << np.uint32(8)
                | np.uint32(records[record, k + 2]) << np.uint32(16)
                | np.uint32(records[record, k + 3]) << np.uint32(24)
            )
            place = (np.int64(np.int32(step)) - origin[axis]) >> bits
            code |= spread[place] << np.uint32(axis)
        codes[i] = code
        counts[code] += 1


def sorted_order(
    keys: NDArray[np.uint32], counts: NDArray[np.int32], members: NDArray[np.uint32]
) -> NDArray[np.uint32]:
    """`members` (n,) in a stable sort by `keys` (n,), whose histogram `counts` becomes the end of each key in them."""
    order = np.empty(len(keys), np.uint32)
    count_sort(keys, counts, members, order)
    return order


@kernel()
def count_sort(keys, counts, members, order):  # type: ignore[no-untyped-def]
    """Kernel of :func:`sorted_order`."""
    done = 0
    for key in range(len(counts)):
        begin = done
        done += counts[key]
        counts[key] = begin
    for i in range(len(keys)):
        key = keys[i]
        order[counts[key]] = members[i]
        counts[key] += 1
