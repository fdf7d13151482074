"""Knots in time, the states at them, and the interface of observations of these.

Knots are close enough that the machine's sway is a line between two.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import ClassVar, Final, Protocol, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.banded import NormalEquations
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.values.trajectory import Motion, Trajectory

KNOT_STEP_S: Final = 0.025
"""Distance of the knots: at 3 Hz and 0.25° of sway a straight line between them is within 0.007° of it."""
MAX_SCAN_PAUSE_S: Final = 5.0
"""Where a laser scanner pauses for longer, a new chain of knots begins."""
MAX_CHAINS: Final = 150
"""Of more pauses only the longest part chains: each chain has coarse knots of its own, whose equations are dense."""
TIMES_AT_ONCE: Final = 1 << 20
"""So many times are looked at together."""
POSITION_COLUMN: Final = 0
"""First column of a pose's position: easting, northing, height in metres."""
ROTATION: Final = 3
"""First column of its rotation vector, in radians about the map's axes."""
POSE: Final = 6
"""Columns of a pose, which every layout begins with."""


@dataclass(frozen=True)
class StateBlock:
    """States beside the pose that a knot may have; a step adds to them."""

    name: str
    size: int


GNSS_DRIFT: Final = StateBlock("gnss_drift_m", 3)
"""Slowly varying error of the GNSS positions: easting, northing, height in metres."""


@dataclass(frozen=True)
class StateLayout:
    """The states of each knot: its pose, then the blocks in their order."""

    blocks: tuple[StateBlock, ...]

    @property
    def size(self) -> int:
        """Columns of a knot."""
        return POSE + sum(block.size for block in self.blocks)

    def column(self, block: StateBlock) -> int:
        """First column of a block within a knot. Raises ValueError if the layout does not hold the block."""
        return POSE + sum(b.size for b in self.blocks[: self.blocks.index(block)])


VEHICLE: Final = StateLayout((GNSS_DRIFT,))
"""Of a vehicle with GNSS and LiDAR."""


@dataclass(frozen=True)
class State:
    """Values of the states at the knots.

    Attributes:
        xyz_m: (n, 3) of the vehicle frame's origin, against the local origin.
        rotation: (n, 3, 3) vehicle to map.
        added: (n, layout.size − 6) of the blocks beside the pose.
    """

    xyz_m: FloatArray
    rotation: FloatArray
    added: FloatArray
    layout: StateLayout = VEHICLE

    def __getitem__(self, block: StateBlock) -> FloatArray:
        """(n, block.size) values of a block."""
        first = self.layout.column(block) - POSE
        return self.added[:, first : first + block.size]

    def moved(self, step: FloatArray) -> "State":
        """The state after a step (n, layout.size): position, rotation vector in the map's axes, added blocks."""

        def moved(part: slice) -> tuple[FloatArray, FloatArray, FloatArray]:
            turn = Rotation.from_rotvec(step[part, ROTATION:POSE]) * Rotation.from_matrix(self.rotation[part])
            return self.xyz_m[part] + step[part, :ROTATION], turn.as_matrix(), self.added[part] + step[part, POSE:]

        xyz, rotation, added = arrays.in_parts(moved, len(step))
        return State(xyz, rotation, added, self.layout)

    def part(self, chosen: slice) -> "State":
        """The state at some knots."""
        return replace(self, xyz_m=self.xyz_m[chosen], rotation=self.rotation[chosen], added=self.added[chosen])

    def put(self, chosen: slice, part: "State") -> "State":
        """The state with another one at some knots."""
        xyz = self.xyz_m.copy()
        rotation = self.rotation.copy()
        added = self.added.copy()
        xyz[chosen] = part.xyz_m
        rotation[chosen] = part.rotation
        added[chosen] = part.added
        return replace(self, xyz_m=xyz, rotation=rotation, added=added)


@dataclass(frozen=True)
class Chain:
    """Knots in equal steps of :data:`KNOT_STEP_S` without a pause; `first` is an index among all knots."""

    first: int
    count: int
    begin_s: float

    @property
    def end_s(self) -> float:
        """Time of its last knot."""
        return self.begin_s + (self.count - 1) * KNOT_STEP_S


@dataclass(frozen=True)
class Knots:
    """All chains of a recording."""

    chains: tuple[Chain, ...]
    t_s: FloatArray

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def linked(self) -> IntArray:
        """Knots that have a next one in their chain."""
        return np.concatenate([np.arange(c.first, c.first + c.count - 1) for c in self.chains])

    @property
    def inner(self) -> IntArray:
        """Knots that have neighbours on both sides in their chain."""
        return np.concatenate([np.arange(c.first + 1, c.first + c.count - 1) for c in self.chains])

    def at(self, t_s: FloatArray) -> tuple[IntArray, FloatArray, NDArray[np.bool_]]:
        """For each time the knot before it, the share of the interval to the next, and whether a chain covers it."""
        begin = np.array([c.begin_s for c in self.chains])
        which = np.maximum(np.searchsorted(begin, t_s, side="right") - 1, 0)
        first = np.array([c.first for c in self.chains])[which]
        count = np.array([c.count for c in self.chains])[which]
        place = (t_s - begin[which]) / KNOT_STEP_S
        inside = (place >= 0) & (place <= count - 1)
        local = np.clip(np.floor(place), 0, count - 2)
        return (first + local).astype(np.int64), np.where(inside, place - local, 0.0), inside


def knots_over(t_s: NDArray[np.float64], pause_s: float = MAX_SCAN_PAUSE_S) -> Knots:
    """Knots that cover the times (n,), which increase; a new chain begins after each longer pause."""
    # The times before which a chain ends; looked for in parts, since `t_s` may lie in a file.
    found = [np.zeros(0, np.int64)]
    lasting = [np.zeros(0)]
    for begin in range(0, len(t_s) - 1, TIMES_AT_ONCE):
        step_s = np.diff(t_s[begin : begin + TIMES_AT_ONCE + 1])
        at = np.flatnonzero(step_s > pause_s)
        found.append(begin + 1 + at)
        lasting.append(step_s[at])
    longest = np.argsort(-np.concatenate(lasting), kind="stable")[: MAX_CHAINS - 1]
    pauses = np.sort(np.concatenate(found)[longest])
    begins = np.concatenate([[0], pauses])
    ends = np.append(pauses, len(t_s))
    chains = []
    first = 0
    for begin, end in zip(begins, ends, strict=True):
        count = int(np.ceil((t_s[end - 1] - t_s[begin]) / KNOT_STEP_S)) + 2
        chains.append(Chain(first, count, float(t_s[begin]) - 0.5 * KNOT_STEP_S))
        first += count
    t = np.concatenate([c.begin_s + KNOT_STEP_S * np.arange(c.count) for c in chains])
    return Knots(tuple(chains), t)


def start_from(trajectory: Trajectory, knots: Knots, origin_m: FloatArray, layout: StateLayout = VEHICLE) -> State:
    """The state of a trajectory, constant beyond its ends, with zero in the added blocks.

    Across a gap in which the vehicle keeps its direction of travel it follows the cubic that leaves and reaches the
    gap's ends with the speeds and headings there; across any other it goes straight.
    """

    def guessed(part: slice) -> tuple[FloatArray, FloatArray]:
        xyz, rotation = _guessed(trajectory, np.clip(knots.t_s[part], *trajectory.span_s))
        return xyz - origin_m, rotation

    added = arrays.zeros((len(knots), layout.size - POSE))
    xyz, rotation = arrays.in_parts(guessed, len(knots))
    return State(xyz, rotation, added, layout)


def _guessed(trajectory: Trajectory, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places (n, 3) and rotations (n, 3, 3) at times within a trajectory, see :func:`start_from`."""
    xyz = np.column_stack([np.interp(t, trajectory.t_s, trajectory.xyz_m[:, k]) for k in range(3)])
    k = np.clip(np.searchsorted(trajectory.t_s, t, side="right") - 1, 0, len(trajectory) - 2)
    step = trajectory.t_s[k + 1] - trajectory.t_s[k]
    share = (t - trajectory.t_s[k]) / step
    start = Rotation.from_quat(trajectory.quaternion[k], scalar_first=True)
    rotation = start * Rotation.from_rotvec(share[:, None] * trajectory.turn_rad[k])
    motion = trajectory.motion[k]
    driven = (step > trajectory.max_gap_s) & (motion != Motion.STANDING) & (motion == trajectory.motion[k + 1])
    driven &= np.isfinite(trajectory.speed_mps[k] + trajectory.speed_mps[k + 1])
    if driven.any():
        k = k[driven]
        s = share[driven, None]
        step = step[driven, None]
        r = 1.0 - s
        begin = trajectory.xyz_m[k, :2]
        end = trajectory.xyz_m[k + 1, :2]
        nose = [
            Rotation.from_quat(trajectory.quaternion[j], scalar_first=True).as_matrix()[:, :2, 0] for j in (k, k + 1)
        ]
        leaving, reaching = (
            step * (trajectory.speed_mps[j, None] * forward) for j, forward in zip((k, k + 1), nose, strict=True)
        )
        # The cubic with these ends, and derivatives by the share of the gap there (Hermite).
        xyz[driven, :2] = (
            begin * r * r * (1 + 2 * s) + leaving * s * r * r + end * s * s * (1 + 2 * r) - reaching * s * s * r
        )
        slope = 6 * s * r * (end - begin) + leaving * r * (1 - 3 * s) + reaching * s * (3 * s - 2)
        tangent = slope * motion[driven, None]
        turned = np.arctan2(tangent[:, 1], tangent[:, 0])
        now = rotation[driven].as_matrix()[:, :2, 0]
        back = Rotation.from_rotvec(np.column_stack([np.zeros((len(k), 2)), turned - np.arctan2(now[:, 1], now[:, 0])]))
        matrix = rotation.as_matrix()
        matrix[driven] = (back * rotation[driven]).as_matrix()
        return xyz, matrix
    return xyz, rotation.as_matrix()


def turns(rotation: FloatArray) -> FloatArray:
    """(n, 3) rotation vectors from each knot to the next in the earlier one's frame; the last is zero."""
    d = np.swapaxes(rotation[:-1], 1, 2) @ rotation[1:]
    angle = np.arccos(np.clip(0.5 * (np.trace(d, axis1=1, axis2=2) - 1.0), -1.0, 1.0))
    out = np.zeros((len(rotation), 3))
    out[:-1] = (d[:, [2, 0, 1], [1, 2, 0]] - d[:, [1, 2, 0], [2, 0, 1]]) * (0.5 / np.sinc(angle / np.pi))[:, np.newaxis]
    return out


@kernel()
def place(t_s, vehicle_m, first, begin_s, step_s, xyz_m, rotation, turn):  # type: ignore[no-untyped-def]
    """Map coordinates (n, 3) of returns of one chain: straight between knots, small turns to first order."""
    n = len(t_s)
    out = np.empty((n, 3))
    for i in range(n):
        part = (t_s[i] - begin_s) / step_s
        k = int(part)
        share = part - k
        k += first
        px = vehicle_m[i, 0]
        py = vehicle_m[i, 1]
        pz = vehicle_m[i, 2]
        wx = share * turn[k, 0]
        wy = share * turn[k, 1]
        wz = share * turn[k, 2]
        px, py, pz = px + wy * pz - wz * py, py + wz * px - wx * pz, pz + wx * py - wy * px
        for a in range(3):
            out[i, a] = (
                xyz_m[k, a]
                + share * (xyz_m[k + 1, a] - xyz_m[k, a])
                + rotation[k, a, 0] * px
                + rotation[k, a, 1] * py
                + rotation[k, a, 2] * pz
            )
    return out


class Observation(Protocol):
    """Measurements of one kind, or prior knowledge, of the states at the knots.

    What an implementation keeps to:

    * :meth:`add` linearises its residuals at `state` and adds them to the equations. It reads neither what the
      equations hold nor other observations.
    * The unknowns are the step of :meth:`State.moved`. Column ``c`` of knot ``k`` is unknown
      ``k * state.layout.size + c``; `ROTATION` and ``state.layout.column(block)`` state the columns.
    * One equation links at most `linked` consecutive knots of one chain (`knots.linked`, `knots.inner`).
    * Weights are inverse variances, so that covariances of the solution hold. What lasts for several measurements, as
      a correlated error, is an added block or a larger standard deviation.
    * It is immutable. Robust weights are part of it: :meth:`reweighted` gives it with those at another state.

    Attributes:
        linked: consecutive knots that one equation links at most; the largest of all observations is the bandwidth of
            the normal equations.
    """

    linked: ClassVar[int] = 2

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """Add the linearised measurements to the equations of all knots."""
        ...

    def reweighted(self, knots: Knots, state: State) -> Self:  # noqa: ARG002
        """The observation with robust weights by its residuals at a state; itself where it has none."""
        return self


def normal_equations(observations: Iterable[Observation], knots: Knots, state: State) -> NormalEquations:
    """The equations of all knots at a state."""
    size = state.layout.size
    every = tuple(observations)
    equations = NormalEquations(len(knots) * size, max(one.linked for one in every) * size)
    for observation in every:
        observation.add(equations, knots, state)
    return equations
