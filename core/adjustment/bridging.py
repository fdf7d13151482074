"""Gaps between positions: what the scans carry into them from both ends, joined in the middle.

Without positions a start is a guess: a straight line, or a curve by the speeds at both ends. In a turn it is metres and
tens of degrees off, further than relief can pull poses back; they come to rest where the scans of a stretch agree with
each other but not with what was seen before and after. So a gap is entered step by step from either end, each step no
longer than wheels and inertia can tell to within the relief's reach, as in matching scan by scan. Where the two meet
they differ by what has added up, which is spread evenly over the gap; the adjustment then starts near the truth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.estimation.knots import STEP_S, Chain, Knots, State
from furrowmap.core.trajectory.motion import longest_gap_s
from furrowmap.core.trajectory.positions import Positions
from furrowmap.core.values.gnss import Fix

FloatArray = NDArray[np.float64]
Kind = TypeVar("Kind", bound=np.generic)

APART_M: Final = 0.3
APART_RAD: Final = np.radians(5.0)
"""Where both sides are further apart in the middle, each goes on to the other end: one of them has lost its way."""
LOST: Final = 3.0
"""Sides that are nowhere nearer to each other than so many times this bridge nothing."""
LEAD_S: Final = 8.0
"""So much of the drive before each step takes part in it: its ground is what the step is matched to."""
STEP_IN_S: Final = 0.15
AHEAD_S: Final = 0.5
"""Poses so far beyond a step's scans go along, so that it ends on a motion and not on a single pose."""
HOLD_S: Final = 4.0
"""Poses in the gap that are longer ago than this have come to rest: they hold the later ones as positions do."""
ALIKE_S: Final = 1.0
"""So long before a gap, and after it, what is carried into it is brought to what is known there."""
CARRIED_M: Final = 0.004
"""How well, from one to the next."""
CARRIED_EVERY: Final = 4


@dataclass(frozen=True)
class Gap:
    """A time without positions within a chain of knots.

    Attributes:
        begin_s: the last position before it.
        end_s: the first one after it.
        chain: index of the chain.
    """

    begin_s: float
    end_s: float
    chain: int

    @property
    def middle_s(self) -> float:
        """Where what comes from both ends meets."""
        return 0.5 * (self.begin_s + self.end_s)


def gaps_between(t_s: FloatArray, knots: Knots) -> tuple[Gap, ...]:
    """The gaps between positions at times (m,), which increase, in which scans go on, as they do before and after.

    What is no longer than :func:`~furrowmap.core.trajectory.motion.longest_gap_s` wheels and inertia bridge alone.
    """
    longest_s = longest_gap_s(t_s) if len(t_s) > 1 else np.inf
    return tuple(
        Gap(float(t_s[i]), float(t_s[i + 1]), c)
        for i in np.flatnonzero(np.diff(t_s) > longest_s)
        for c, chain in enumerate(knots.chains)
        if chain.begin_s + ALIKE_S <= t_s[i] and t_s[i + 1] + ALIKE_S <= chain.end_s
    )


def in_gaps(t_s: FloatArray, gaps: Sequence[Gap]) -> NDArray[np.bool_]:
    """(n,) which of the times lie in a gap."""
    out = np.zeros(len(t_s), np.bool_)
    for gap in gaps:
        out |= (t_s > gap.begin_s) & (t_s < gap.end_s)
    return out


def outside(windows: Sequence[slice], t_s: NDArray[np.float64], gaps: Sequence[Gap]) -> list[slice]:
    """The windows without what lies in a gap; one that a gap cuts in two is two."""
    out = list(windows)
    for gap in gaps:
        first, last = (int(i) for i in np.searchsorted(t_s, (gap.begin_s, gap.end_s)))
        parts = [(w, slice(w.start, min(w.stop, first), w.step)) for w in out]
        parts += [(w, slice(max(w.start, last), w.stop, w.step)) for w in out if w.stop > first]
        out = [part for _, part in sorted(parts, key=lambda p: p[1].start) if part.stop > part.start]
    return out


def part_of(knots: Knots, chain: int, begin_s: float, end_s: float) -> tuple[slice, Knots]:
    """Which of all knots lie between two times, and they as a chain of their own."""
    whole = knots.chains[chain]
    first = max(0, int((begin_s - whole.begin_s) / STEP_S))
    last = min(whole.count - 1, int((end_s - whole.begin_s) / STEP_S))
    part = slice(whole.first + first, whole.first + last + 1)
    return part, Knots((Chain(0, last - first + 1, whole.begin_s + first * STEP_S),), knots.t_s[part])


def with_carried(
    positions: Positions,
    knots: Knots,
    state: State,
    origin_m: FloatArray,
    lever_m: FloatArray,
    begin_s: float,
    end_s: float,
) -> Positions:
    """Positions, and beside them those that poses within a gap have come to: from one time to another.

    Args:
        positions: of the antenna.
        knots: times of the poses.
        state: the poses.
        origin_m: local origin.
        lever_m: (3,) the antenna in the vehicle frame.
        begin_s: from here on poses count, which must lie in a gap.
        end_s: up to here.
    """
    chosen = np.flatnonzero((knots.t_s > begin_s) & (knots.t_s < end_s))[::CARRIED_EVERY]
    if not len(chosen):
        return positions
    count = len(chosen)
    order = np.argsort(np.concatenate([positions.t_s, knots.t_s[chosen]]), kind="stable")

    def both(values: NDArray[Kind], carried: NDArray[Kind]) -> NDArray[Kind]:
        return np.concatenate([values, carried])[order]

    small = np.full((count, 3), CARRIED_M)
    later = positions.t_s > knots.t_s[chosen[0]]
    return Positions(
        t_s=both(positions.t_s, knots.t_s[chosen]),
        xyz_m=both(positions.xyz_m, origin_m + state.xyz_m[chosen] + state.rotation[chosen] @ lever_m),
        white_m=both(positions.white_m, small),
        drift_m=both(positions.drift_m, small),
        run=both(positions.run + later, np.full(count, positions.run.max(initial=0) + 2)),
        fix=both(positions.fix, np.full(count, Fix.ESTIMATED, np.int8)),
        yaw_rad=both(positions.yaw_rad, np.full(count, np.nan)),
    )


def continued(knots: Knots, state: State, carried: State, begin_s: float, end_s: float) -> State:
    """Carried poses, moved rigidly to where they go on from a state.

    Args:
        knots: of both.
        state: outside the gap, where positions and a longer drive hold it.
        carried: of the same knots; in the few seconds in which it came about, roll and height may have moved along.
        begin_s: from here on the two are to be alike.
        end_s: up to here.
    """
    at = (knots.t_s >= begin_s) & (knots.t_s <= end_s)
    turn = Rotation.from_matrix(state.rotation[at] @ carried.rotation[at].transpose(0, 2, 1)).mean()
    here, there = carried.xyz_m[at].mean(axis=0), state.xyz_m[at].mean(axis=0)
    rotation = turn.as_matrix() @ carried.rotation
    return State(there + turn.apply(carried.xyz_m - here), rotation, carried.drift_m)


def apart(before: State, after: State) -> FloatArray:
    """(n,) how far apart two states are, in APART_M and APART_RAD."""
    way = np.linalg.norm(after.xyz_m - before.xyz_m, axis=1) / APART_M
    turn = Rotation.from_matrix(after.rotation @ before.rotation.transpose(0, 2, 1)).magnitude() / APART_RAD
    out: FloatArray = np.maximum(way, turn)
    return out


def joined_in_gap(knots: Knots, state: State, gap: Gap, before: State, after: State, meet: int) -> State:
    """The state with a gap's poses from both of its ends.

    Args:
        knots: of the state.
        state: whose poses outside the gap stay.
        gap: which is bridged.
        before: the same with what was carried into the gap from its begin, to the knot `meet` and beyond.
        after: from its end, down to that knot.
        meet: from this knot on poses are those that come from the end.
    """
    first, last = (int(i) for i in np.searchsorted(knots.t_s, (gap.begin_s, gap.end_s)))
    share = (knots.t_s[first:last] - gap.begin_s) / (gap.end_s - gap.begin_s)
    early = np.arange(first, last) < meet
    weight = np.where(early, share, share - 1.0)[:, None]
    shift = after.xyz_m[meet] - before.xyz_m[meet]
    turn = Rotation.from_matrix(after.rotation[meet] @ before.rotation[meet].T).as_rotvec()
    inside = slice(first, last)
    xyz = np.where(early[:, None], before.xyz_m[inside], after.xyz_m[inside])
    rotation = np.where(early[:, None, None], before.rotation[inside], after.rotation[inside])
    turned = (Rotation.from_rotvec(weight * turn) * Rotation.from_matrix(rotation)).as_matrix()
    return state.put(inside, State(xyz + weight * shift, turned, state.drift_m[inside]))
