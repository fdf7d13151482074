"""Thinning to one point per voxel."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.values.extents import bounds


@dataclass(frozen=True)
class Voxels:
    """Points by voxel: the voxel of each point (n,), and the mean (m, 3) and number (m,) of each voxel's points."""

    of_point: IntArray
    mean_m: FloatArray
    count: IntArray

    def __len__(self) -> int:
        return len(self.mean_m)

    def mean_of(self, values: NDArray[Any]) -> FloatArray:
        """Mean (m,) of values (n,) of points in each voxel."""
        out: FloatArray = np.bincount(self.of_point, values, len(self)) / self.count
        return out


def voxels(xyz_m: FloatArray, cell_m: float) -> Voxels:
    """Group points (n, 3), finite, by voxels of a cell size; voxels are in the order of their first points."""
    if not cell_m > 0.0:
        raise ValueError(f"voxels of {cell_m} m")
    if not len(xyz_m):
        return Voxels(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0, np.int64))
    points = np.ascontiguousarray(xyz_m, np.float64)
    low, high = (np.floor(end / cell_m) for end in bounds(points))
    across = high - low + 1.0
    if np.prod(across) >= 2.0**62:
        raise ValueError(f"points span {across * cell_m} m, too many voxels of {cell_m} m")
    of_point, sums, count = _group(points, cell_m, low, across.astype(np.int64))
    return Voxels(of_point, sums / count[:, None] + low * cell_m, count)


@kernel()
def _group(xyz_m, cell_m, low, across):  # type: ignore[no-untyped-def]
    """Voxel of each point, sum of each voxel's points less the corner of all, and their number, by a hash table."""
    n = len(xyz_m)
    bits = 10
    table = np.full(1 << bits, -1, np.int64)
    keys, count, sums = np.empty(1024, np.int64), np.zeros(1024, np.int64), np.zeros((1024, 3))
    of_point = np.empty(n, np.int64)
    held = 0
    corner = low * cell_m
    for i in range(n):
        key = np.int64(0)
        for a in range(3):
            key = key * across[a] + np.int64(np.floor(xyz_m[i, a] / cell_m) - low[a])
        slot = np.int64((np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(64 - bits))
        while table[slot] >= 0 and keys[table[slot]] != key:
            slot = (slot + 1) & ((1 << bits) - 1)
        at = table[slot]
        if at < 0:
            if held == len(keys):
                more_keys, more_count = np.empty(2 * held, np.int64), np.zeros(2 * held, np.int64)
                more_sums = np.zeros((2 * held, 3))
                more_keys[:held], more_count[:held], more_sums[:held] = keys, count, sums
                keys, count, sums = more_keys, more_count, more_sums
            at = held
            keys[at] = key
            table[slot] = at
            held += 1
            if 2 * held > len(table):
                bits += 1
                table = np.full(1 << bits, -1, np.int64)
                for k in range(held):
                    slot = np.int64((np.uint64(keys[k]) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(64 - bits))
                    while table[slot] >= 0:
                        slot = (slot + 1) & ((1 << bits) - 1)
                    table[slot] = k
        of_point[i] = at
        count[at] += 1
        for a in range(3):
            sums[at, a] += xyz_m[i, a] - corner[a]
    return of_point, sums[:held].copy(), count[:held].copy()
