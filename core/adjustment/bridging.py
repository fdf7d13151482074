"""Gaps between positions: poses matched into them from both ends, joined in the middle.

Without positions a first guess is a straight line, or a curve by the speeds at both ends. In a turn it is metres and
tens of degrees off, beyond the reach of relief, and the poses would converge to where the scans of a stretch agree with
each other but not with those before and after. So a gap is entered step by step from either end, each step so short
that wheels and motion prior predict it within the relief's reach. The misclosure where the two meet is spread evenly
over the gap; the adjustment then starts near the truth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.problem import Iterate, Problem
from furrowmap.core.adjustment.steps import session_step
from furrowmap.core.estimation.knots import KNOT_STEP_S, Chain, Knots, State
from furrowmap.core.estimation.vehicle import with_positions
from furrowmap.core.matching.portions import Gap, in_gaps
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.gnss import Fix, Positions
from furrowmap.core.values.time_span import Span

Kind = TypeVar("Kind", bound=np.generic)

APART_M: Final = 0.3
APART_RAD: Final = np.radians(5.0)
"""Largest misclosure in the middle; beyond it each side goes on to the other end, because one of them is wrong."""
LOST: Final = 3.0
"""A gap whose sides are nowhere nearer to each other than this many times APART stays unbridged."""
LEAD_S: Final = 8.0
"""Time before each step whose returns take part in it: the ground to which the step is matched."""
STEP_IN_S: Final = 0.15
AHEAD_S: Final = 0.5
"""Time beyond a step's scans whose poses are estimated as well, so that it ends on a motion, not on a single pose."""
HOLD_S: Final = 4.0
"""Poses in the gap that are older than this are final: they constrain the later ones as positions do."""
ALIKE_S: Final = 1.0
"""Time before a gap, and after it, over which carried poses are moved to those known there."""
CARRIED_M: Final = 0.004
"""Standard deviation of a carried pose as a position; one in CARRIED_EVERY counts."""
CARRIED_EVERY: Final = 4
CARRY_CELL_M: Final = 0.2
CARRY_THIN: Final = 2
CARRY_STEPS: Final = 2
"""Cells, how many returns to one, and how many steps, with which poses are carried into a gap."""


def bridged(problem: Problem, it: Iterate) -> Iterate:
    """Take the poses in unused gaps from both of their ends; gaps in which that fails stay unused."""
    unbridged = []
    for gap in it.unused:
        inside = np.flatnonzero(in_gaps(problem.knots.t_s, [gap]))
        meet = int(inside[len(inside) // 2])
        before, after = (carried(problem, it, gap, gap.middle_s, forward=forward) for forward in (True, False))
        if apart(before, after)[meet] > 1.0:
            before, after = (
                carried(problem, it, gap, end_s, forward=forward)
                for end_s, forward in ((gap.end_s, True), (gap.begin_s, False))
            )
            meet = int(inside[np.argmin(apart(before, after)[inside])])
        if apart(before, after)[meet] > LOST:
            unbridged.append(gap)
        else:
            it = replace(it, state=joined_in_gap(problem.knots, it.state, gap, before, after, meet))
    return replace(it, unused=tuple(unbridged))


def carried(problem: Problem, it: Iterate, gap: Gap, to_s: float, *, forward: bool) -> State:
    """The state with poses carried into a gap from its begin, or from its end, to a time in it and somewhat beyond."""
    p, state = problem, it.state
    length_s = to_s - gap.begin_s if forward else gap.end_s - to_s
    for number in range(1, int(np.ceil(length_s / STEP_IN_S)) + 2):
        reach_s = number * STEP_IN_S
        if forward:
            begin_s, end_s = gap.begin_s + reach_s - LEAD_S, gap.begin_s + reach_s
            part, knots = part_of(p.knots, gap.chain, begin_s, end_s + AHEAD_S)
            rest = gap.begin_s, end_s - HOLD_S
        else:
            begin_s, end_s = gap.end_s - reach_s, gap.end_s - reach_s + LEAD_S
            part, knots = part_of(p.knots, gap.chain, begin_s - AHEAD_S, end_s)
            rest = begin_s + HOLD_S, gap.end_s
        ends = np.clip((begin_s, end_s), knots.t_s[0], knots.t_s[-1])
        within = slice(*np.searchsorted(p.returns.t_s, ends).tolist())
        positions = with_carried(p.positions, p.knots, state, (p.origin_m, p.lever_m), *rest)
        observations = with_positions(p.observations, positions)
        small = replace(p, returns=p.returns.part(within), positions=positions, knots=knots, observations=observations)
        weight = it.return_weight[within].copy()
        there = replace(it, state=state.part(part), observations=observations, return_weight=weight, unused=())
        for _ in range(CARRY_STEPS):
            there, _ = session_step(small, there, CARRY_CELL_M, CARRY_THIN, free=False)
        state = state.put(part, there.state)
    border = (gap.begin_s - ALIKE_S, gap.begin_s) if forward else (gap.end_s, gap.end_s + ALIKE_S)
    return continued(p.knots, it.state, state, *border)


def gaps_between(spans_s: Sequence[Span], knots: Knots) -> tuple[Gap, ...]:
    """The outages of positions, see :func:`~furrowmap.core.adjustment.outages.outages`, through which scans go on.

    They do so before and after them as well.
    """
    return tuple(
        Gap(begin_s, end_s, c)
        for begin_s, end_s in spans_s
        for c, chain in enumerate(knots.chains)
        if chain.begin_s + ALIKE_S <= begin_s and end_s + ALIKE_S <= chain.end_s
    )


def part_of(knots: Knots, chain: int, begin_s: float, end_s: float) -> tuple[slice, Knots]:
    """Which of all knots lie between two times, and they as a chain of their own."""
    whole = knots.chains[chain]
    first = max(0, int((begin_s - whole.begin_s) / KNOT_STEP_S))
    last = min(whole.count - 1, int((end_s - whole.begin_s) / KNOT_STEP_S))
    part = slice(whole.first + first, whole.first + last + 1)
    return part, Knots((Chain(0, last - first + 1, whole.begin_s + first * KNOT_STEP_S),), knots.t_s[part])


def with_carried(
    positions: Positions,
    knots: Knots,
    state: State,
    origin_and_lever_m: tuple[FloatArray, FloatArray],
    begin_s: float,
    end_s: float,
) -> Positions:
    """Positions, and beside them those that poses within a gap have come to: from one time to another.

    Args:
        positions: of the antenna.
        knots: times of the poses.
        state: the poses.
        origin_and_lever_m: the local origin, and the antenna in the vehicle frame, (3,) each.
        begin_s: from here on poses count, which must lie in a gap.
        end_s: up to here.
    """
    origin_m, lever_m = origin_and_lever_m
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
    return replace(carried, xyz_m=there + turn.apply(carried.xyz_m - here), rotation=rotation)


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
    return state.put(inside, replace(state.part(inside), xyz_m=xyz + weight * shift, rotation=turned))
