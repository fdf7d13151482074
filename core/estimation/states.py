"""Which states a knot has, and in which columns of the equations they are."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.runtime import scratch

FloatArray = NDArray[np.float64]

POSITION: Final = 0
"""First column of a pose's position: easting, northing, height in metres."""
ROTATION: Final = 3
"""First column of its rotation vector, in radians about the map's axes."""
POSE: Final = 6
"""Columns of a pose, which every layout begins with."""


@dataclass(frozen=True)
class Block:
    """States beside the pose that a knot may have; a step adds to them.

    Attributes:
        name: of the states.
        size: number of columns.
    """

    name: str
    size: int


GNSS_DRIFT: Final = Block("gnss_drift_m", 3)
"""Slowly varying error of the GNSS positions: easting, northing, height in metres."""


@dataclass(frozen=True)
class Layout:
    """The states of each knot: its pose, then the blocks in their order.

    Attributes:
        blocks: beside the pose.
    """

    blocks: tuple[Block, ...]

    @property
    def size(self) -> int:
        """Columns of a knot."""
        return POSE + sum(block.size for block in self.blocks)

    def column(self, block: Block) -> int:
        """First column of a block within a knot.

        Raises:
            ValueError: if the layout does not hold the block.
        """
        return POSE + sum(b.size for b in self.blocks[: self.blocks.index(block)])


VEHICLE: Final = Layout((GNSS_DRIFT,))
"""Of a vehicle with GNSS and LiDAR."""


@dataclass(frozen=True)
class State:
    """Values of the states at the knots.

    Attributes:
        xyz_m: (n, 3) of the vehicle frame's origin, against the local origin.
        rotation: (n, 3, 3) vehicle to map.
        added: (n, layout.size − 6) of the blocks beside the pose.
        layout: which blocks these are.
    """

    xyz_m: FloatArray
    rotation: FloatArray
    added: FloatArray
    layout: Layout = VEHICLE

    def __getitem__(self, block: Block) -> FloatArray:
        """(n, block.size) values of a block."""
        first = self.layout.column(block) - POSE
        return self.added[:, first : first + block.size]

    def moved(self, step: FloatArray) -> State:
        """The state after a step (n, layout.size): position, rotation vector in the map's axes, added blocks."""
        xyz, rotation, added = (scratch.zeros(own.shape) for own in (self.xyz_m, self.rotation, self.added))
        for part in scratch.parts(len(step)):
            turn = Rotation.from_rotvec(step[part, ROTATION:POSE]) * Rotation.from_matrix(self.rotation[part])
            xyz[part] = self.xyz_m[part] + step[part, :ROTATION]
            rotation[part] = turn.as_matrix()
            added[part] = self.added[part] + step[part, POSE:]
        return replace(self, xyz_m=xyz, rotation=rotation, added=added)

    def part(self, chosen: slice) -> State:
        """The state at some knots."""
        return replace(self, xyz_m=self.xyz_m[chosen], rotation=self.rotation[chosen], added=self.added[chosen])

    def put(self, chosen: slice, part: State) -> State:
        """The state with another one at some knots."""
        xyz, rotation, added = self.xyz_m.copy(), self.rotation.copy(), self.added.copy()
        xyz[chosen], rotation[chosen], added[chosen] = part.xyz_m, part.rotation, part.added
        return replace(self, xyz_m=xyz, rotation=rotation, added=added)
