"""Returns placed in the map by the poses of an iterate."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.adjustment.coarse import CoarseKnots
from furrowmap.core.adjustment.knots import KNOT_STEP_S, Knots, State, place, turns
from furrowmap.core.matching.ground_registration import NO_COARSE, ChainPoses, PlacedReturns
from furrowmap.core.matching.height_grid import TilePassage, layers, passage_of
from furrowmap.core.matching.portions import Gap
from furrowmap.core.matching.returns import GroundReturns
from furrowmap.core.matching.walls import PlacedUpright, UprightReturns
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.scan import LaserRanges, shortened

GUARD_S: Final = 0.3
TOOL_MARGIN_M: Final = 0.15
"""Soil to either side of the implement that moves with it."""
TOOL_CELL_M: Final = 0.1


@dataclass(frozen=True)
class Tool:
    """The line at which an implement changes the soil; `xy_m` is its middle in the vehicle frame."""

    xy_m: tuple[float, float]
    half_width_m: float


@dataclass(frozen=True)
class Sensor:
    """The scanner as it is mounted.

    Attributes:
        xyz_m: (3,) in the vehicle frame.
        turn: (3, 3) rotation of the returns about the sensor, because the stated mounting is off.
        ranges: the lasers' constants; None where they are not known.
    """

    xyz_m: FloatArray
    turn: FloatArray
    ranges: LaserRanges | None = None

    def corrected(self, source: GroundReturns | UprightReturns, part: slice) -> NDArray[np.float32]:
        """(n, 3) some returns in the vehicle frame, by their constants and the mounting's turn."""
        vehicle = arrays.taken(source.xyz_m, part)
        if self.ranges is not None:
            vehicle = shortened(vehicle, source.laser[part], self.xyz_m, self.ranges.offset_m)
        if not np.array_equal(self.turn, np.eye(3)):
            vehicle = (vehicle @ self.turn.T + (self.xyz_m - self.turn @ self.xyz_m)).astype(np.float32)
        return vehicle


@dataclass(frozen=True)
class Placing:
    """Places returns; prepared once a step.

    Attributes:
        returns: of the whole recording.
        weight: (n,) uint8 of the returns in the surface.
        unused: gaps whose returns take no part.
        passage: of the implement; None where none is known.
        position_m: (knots, 3) contiguous.
        turn: (knots, 3) rotation vectors from knot to knot.
    """

    returns: GroundReturns
    weight: NDArray[np.uint8]
    sensor: Sensor
    knots: Knots
    state: State
    unused: Sequence[Gap]
    passage: TilePassage | None
    position_m: FloatArray
    rotation: FloatArray
    turn: FloatArray

    def ground(self, chain: int, part: slice) -> PlacedReturns:
        """Returns of the ground."""
        t_s, xyz_m = self._placed(chain, self.returns, part)
        layer = layers(t_s, xyz_m, self.passage, GUARD_S)
        # Of a whole portion a view, in which registration leaves the weights for the next surface; else a copy.
        weight = np.ascontiguousarray(self.weight[part])
        return PlacedReturns(t_s, xyz_m, layer, np.array(self.returns.half[part]), weight)

    def upright(self, chain: int, part: slice) -> PlacedUpright:
        """Upright returns."""
        source = self.returns.upright
        return PlacedUpright(*self._placed(chain, source, part), np.array(source.half[part]))

    def poses(self, chain: int, coarse: CoarseKnots | None) -> ChainPoses:
        """Where the equations of a chain belong."""
        grid = coarse.grids[chain] if coarse is not None else NO_COARSE
        return ChainPoses.of(self.knots.chains[chain], self.position_m, grid)

    def _placed(self, chain: int, source: GroundReturns | UprightReturns, part: slice) -> tuple[FloatArray, FloatArray]:
        """Copies of the times, and the places in the map."""
        c = self.knots.chains[chain]
        t_s = arrays.taken(source.t_s, part)
        vehicle = self.sensor.corrected(source, part)
        return t_s, place(t_s, vehicle, c.first, c.begin_s, KNOT_STEP_S, self.position_m, self.rotation, self.turn)


def placing_of(
    returns: GroundReturns,
    weight: NDArray[np.uint8],
    sensor: Sensor,
    knots: Knots,
    state: State,
    unused: Sequence[Gap],
    tool: Tool | None,
) -> Placing:
    """What places returns by a state."""
    position = np.ascontiguousarray(state.xyz_m)
    rotation = np.ascontiguousarray(state.rotation)
    passage = None
    if tool is not None:
        every = slice(None, None, 2)
        ahead = rotation[every, :2, 0]
        left = rotation[every, :2, 1]
        middle = position[every, :2] + tool.xy_m[0] * ahead + tool.xy_m[1] * left
        passage = passage_of(knots.t_s[every], middle, left, tool.half_width_m + TOOL_MARGIN_M, TOOL_CELL_M)
    (turn,) = arrays.in_parts(
        lambda part: [turns(rotation[part.start : part.stop + 1])[: part.stop - part.start]], len(rotation)
    )
    return Placing(returns, weight, sensor, knots, state, unused, passage, position, rotation, turn)
