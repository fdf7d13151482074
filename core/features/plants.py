"""Plants: clusters of scatter points, parted at the saddles between their tops."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel

CROWN_CELL_M: Final = 0.25
MIN_PLANT_HEIGHT_M: Final = 0.3
MIN_CROWN_AREA_M2: Final = 0.1875
"""Three cells."""
SADDLE_M: Final = 0.5
SADDLE_SHARE: Final = 0.25
"""Two tops are two plants where the saddle between them lies this much below the lower one: metres, or this share."""


@dataclass(frozen=True)
class Plants:
    """n plants: place and height (n, 3) of the highest cell, height above the ground, area of the crown from above."""

    top_m: FloatArray
    height_m: FloatArray
    area_m2: FloatArray
    points: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.height_m)

    @classmethod
    def none(cls) -> "Plants":
        """No plants."""
        return cls(np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0, np.int64))


def plants(xyz_m: FloatArray, above_m: FloatArray) -> Plants:
    """Plants in scatter points (n, 3) at heights (n,) above the ground."""
    tall = above_m >= 0.5 * MIN_PLANT_HEIGHT_M
    xyz, above = xyz_m[tall], above_m[tall]
    if not len(xyz):
        return Plants.none()
    column = np.floor(xyz[:, :2] / CROWN_CELL_M).astype(np.int64)
    corner = column.min(axis=0) - 1
    shape = column.max(axis=0) - corner + 2
    cell = (column[:, 0] - corner[0]) * shape[1] + column[:, 1] - corner[1]
    height = np.zeros(np.prod(shape))
    np.maximum.at(height, cell, above)
    points = np.bincount(cell, minlength=len(height))
    smooth = np.where(height > 0.0, gaussian_filter(height.reshape(shape), 1.0).ravel(), 0.0)
    order = np.argsort(-smooth, kind="stable")
    order = order[: np.count_nonzero(smooth > 0.0)]
    basin = _basins(smooth, order, int(shape[1]), SADDLE_M, SADDLE_SHARE)
    there, number = np.unique(basin[order], return_inverse=True)
    area = np.bincount(number).astype(np.float64) * CROWN_CELL_M**2
    count = np.bincount(number, points[order]).astype(np.int64)
    tallest = np.zeros(len(there))
    np.maximum.at(tallest, number, height[order])
    kept = (tallest >= MIN_PLANT_HEIGHT_M) & (area >= MIN_CROWN_AREA_M2)
    row, col = np.divmod(there[kept], shape[1])
    place = (np.column_stack([row, col]) + corner + 0.5) * CROWN_CELL_M
    highest = np.full(len(height), -np.inf)
    np.maximum.at(highest, cell, xyz[:, 2])
    top = np.full(len(there), -np.inf)
    np.maximum.at(top, number, highest[order])
    return Plants(np.column_stack([place, top[kept]]), tallest[kept], area[kept], count[kept])


@kernel()
def _basins(height, order, columns, saddle_m, saddle_share):  # type: ignore[no-untyped-def]
    """Cell of the top of the plant of each cell, from the highest cell down; -1 for cells without any."""
    parent = np.full(len(height), -1, np.int64)
    for k in range(len(order)):
        at = order[k]
        best = -1
        parent[at] = at
        for step in (-columns - 1, -columns, -columns + 1, -1, 1, columns - 1, columns, columns + 1):
            beside = at + step
            if beside < 0 or beside >= len(height) or parent[beside] < 0 or beside == at:
                continue
            root = beside
            while parent[root] != root:
                parent[root] = parent[parent[root]]
                root = parent[root]
            if best < 0:
                best = root
                parent[at] = root
            elif root != best:
                lower, higher = (root, best) if height[root] < height[best] else (best, root)
                if height[lower] - height[at] < max(saddle_m, saddle_share * height[lower]):
                    parent[lower] = higher
                    best = higher
    for k in range(len(order)):
        root = order[k]
        while parent[root] != root:
            root = parent[root]
        parent[order[k]] = root
    return parent
