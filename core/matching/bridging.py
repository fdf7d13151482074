"""Gaps between positions: poses matched into them from both ends, joined in the middle.

Without positions a first guess is a straight line, or a curve by the speeds at both ends. In a turn it is metres and
tens of degrees off, beyond the reach of relief, and the poses would converge to where the scans of a stretch agree with
each other but not with those before and after. So a gap is entered step by step from either end, each step so short
that wheels and motion prior predict it within the relief's reach. The misclosure where the two meet is spread evenly
over the gap; the adjustment then starts near the truth.

Scans that no positions hold take no part: they would be matched to the wrong ground, with small standard deviations.
Where the scanner pauses, starts or stops in a gap, a first guess is metres off, beyond the reach of relief, and no
misclosure shows it. The same is true of scans between two pauses while positions do not show the heading, as before the
first metres of a drive.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.knots import KNOT_STEP_S, Chain, Knots, State, knots_over
from furrowmap.core.adjustment.vehicle import with_positions
from furrowmap.core.matching.gauss_newton import session_step
from furrowmap.core.matching.portions import Gap, in_gaps
from furrowmap.core.matching.problem import MAX_HEADING_SIGMA_DEG, Iterate, Problem, heading_sigma_deg, outages
from furrowmap.core.matching.returns import GroundReturns
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.gnss import Fix, Positions
from furrowmap.core.values.time_span import Span
from furrowmap.core.values.trajectory import Trajectory

Kind = TypeVar("Kind", bound=np.generic)
MAX_MISCLOSURE_M: Final = 0.3
MAX_MISCLOSURE_RAD: Final = np.radians(5.0)
"""Largest misclosure in the middle; beyond it each side goes on to the other end, because one of them is wrong."""
MAX_BRIDGED_MISCLOSURE: Final = 3.0
"""A gap whose sides are nowhere nearer to each other than this many times APART stays unbridged."""
LEAD_S: Final = 8.0
"""Time before each step whose returns take part in it: the ground to which the step is matched."""
STEP_IN_S: Final = 0.15
AHEAD_S: Final = 0.5
"""Time beyond a step's scans whose poses are estimated as well, so that it ends on a motion, not on a single pose."""
HOLD_S: Final = 4.0
"""Poses in the gap that are older than this are final: they constrain the later ones as positions do."""
GAP_MARGIN_S: Final = 1.0
"""Time before a gap, and after it, over which carried poses are moved to those known there."""
CARRIED_M: Final = 0.004
"""Standard deviation of a carried pose as a position; one in CARRIED_EVERY counts."""
CARRIED_EVERY: Final = 4
CARRY_CELL_M: Final = 0.2
CARRY_THIN: Final = 2
CARRY_STEPS: Final = 2
"""Cells, how many returns to one, and how many steps, with which poses are carried into a gap."""
MAX_PAUSE_S: Final = 2.0
"""A longer pause of the scanner does not let poses be carried on in such a gap."""
HELD_REACH_S: Final = 0.5
"""Scans up to this long after a position, or before one, are held by it."""
MAX_SHORT_GAP_S: Final = 3.0
"""Shorter gaps wheels, inertia and the speeds at their ends bridge alone, where headings are known there."""


def bridge_gaps(problem: Problem, it: Iterate) -> Iterate:
    """Take the poses in unused gaps from both of their ends; gaps in which that fails stay unused."""
    unbridged = []
    for gap in it.unused:
        inside = np.flatnonzero(in_gaps(problem.knots.t_s, [gap]))
        meet = int(inside[len(inside) // 2])
        before, after = (carry_poses(problem, it, gap, gap.middle_s, forward=forward) for forward in (True, False))
        if apart(before, after)[meet] > 1.0:
            before, after = (
                carry_poses(problem, it, gap, end_s, forward=forward)
                for end_s, forward in ((gap.end_s, True), (gap.begin_s, False))
            )
            meet = int(inside[np.argmin(apart(before, after)[inside])])
        if apart(before, after)[meet] > MAX_BRIDGED_MISCLOSURE:
            unbridged.append(gap)
        else:
            it = replace(it, state=join_in_gap(problem.knots, it.state, gap, before, after, meet))
    return replace(it, unused=tuple(unbridged))


def carry_poses(problem: Problem, it: Iterate, gap: Gap, to_s: float, *, forward: bool) -> State:
    """The state with poses carried into a gap from its begin, or from its end, to a time in it and somewhat beyond."""
    p = problem
    state = it.state
    length_s = to_s - gap.begin_s if forward else gap.end_s - to_s
    for number in range(1, int(np.ceil(length_s / STEP_IN_S)) + 2):
        reach_s = number * STEP_IN_S
        if forward:
            begin_s = gap.begin_s + reach_s - LEAD_S
            end_s = gap.begin_s + reach_s
            part, knots = part_of(p.knots, gap.chain, begin_s, end_s + AHEAD_S)
            rest = gap.begin_s, end_s - HOLD_S
        else:
            begin_s = gap.end_s - reach_s
            end_s = gap.end_s - reach_s + LEAD_S
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
    border = (gap.begin_s - GAP_MARGIN_S, gap.begin_s) if forward else (gap.end_s, gap.end_s + GAP_MARGIN_S)
    return continued(p.knots, it.state, state, *border)


def gaps_between(spans_s: Sequence[Span], knots: Knots) -> tuple[Gap, ...]:
    """The outages of positions, see :func:`~furrowmap.core.matching.problem.outages`, through which scans go on.

    They do so before and after them as well.
    """
    return tuple(
        Gap(begin_s, end_s, c)
        for begin_s, end_s in spans_s
        for c, chain in enumerate(knots.chains)
        if chain.begin_s + GAP_MARGIN_S <= begin_s and end_s + GAP_MARGIN_S <= chain.end_s
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
        state: outside the gap, where positions and a longer drive hold it.
        carried: of the same knots; in the few seconds in which it came about, roll and height may have moved along.
        begin_s: from here on the two are to be alike.
        end_s: up to here.
    """
    at = (knots.t_s >= begin_s) & (knots.t_s <= end_s)
    turn = Rotation.from_matrix(state.rotation[at] @ carried.rotation[at].transpose(0, 2, 1)).mean()
    here = carried.xyz_m[at].mean(axis=0)
    there = state.xyz_m[at].mean(axis=0)
    rotation = turn.as_matrix() @ carried.rotation
    return replace(carried, xyz_m=there + turn.apply(carried.xyz_m - here), rotation=rotation)


def apart(before: State, after: State) -> FloatArray:
    """(n,) how far apart two states are, in MAX_MISCLOSURE_M and MAX_MISCLOSURE_RAD."""
    way = np.linalg.norm(after.xyz_m - before.xyz_m, axis=1) / MAX_MISCLOSURE_M
    turn = Rotation.from_matrix(after.rotation @ before.rotation.transpose(0, 2, 1)).magnitude() / MAX_MISCLOSURE_RAD
    out: FloatArray = np.maximum(way, turn)
    return out


def join_in_gap(knots: Knots, state: State, gap: Gap, before: State, after: State, meet: int) -> State:
    """The state with a gap's poses from both of its ends.

    Args:
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


def held_by_positions(
    returns: GroundReturns, position_s: FloatArray, start: Trajectory
) -> tuple[GroundReturns, tuple[Span, ...]]:
    """The returns that positions hold, and the times whose scans they do not hold.

    Args:
        returns: of the ground, in the order of time.
        position_s: (m,) times of the positions, which increase.
    """
    if not len(returns) or len(position_s) < 2:
        return returns, ()
    gaps = outages(position_s, start)
    lost = [span for chain in knots_over(returns.t_s, MAX_PAUSE_S).chains for span in _unheld(chain, gaps, start)]
    return (returns.without(lost), tuple(lost)) if lost else (returns, ())


def _unheld(chain: Chain, gaps: Sequence[Span], start: Trajectory) -> list[Span]:
    """The times of a chain of scans that positions do not hold: parts of it, or gaps beside them."""
    gaps = [gap for gap in gaps if gap[0] < chain.end_s and gap[1] > chain.begin_s and not _is_short(gap, start)]
    borders = [chain.begin_s, *(t for gap in gaps for t in gap), chain.end_s]
    parts = list(zip(borders[::2], borders[1::2], strict=True))
    long = [not gaps or end_s - begin_s >= GAP_MARGIN_S for begin_s, end_s in parts]
    held = [
        is_long and heading_sigma_deg(start, part) <= MAX_HEADING_SIGMA_DEG
        for is_long, part in zip(long, parts, strict=True)
    ]
    # Poses are carried to what lies between two gaps from both sides.
    held[1:-1] = long[1:-1]
    lost = [part for part, is_held in zip(parts, held, strict=True) if not is_held]
    lost += [
        (begin_s + HELD_REACH_S * before, end_s - HELD_REACH_S * after)
        for (begin_s, end_s), before, after in zip(gaps, held[:-1], held[1:], strict=True)
        if not (before and after)
    ]
    inside = [(max(begin_s, chain.begin_s), min(end_s, chain.end_s)) for begin_s, end_s in lost]
    return _joined(sorted(span for span in inside if span[0] < span[1]))


def _is_short(gap: Span, start: Trajectory) -> bool:
    """Whether a first guess across a gap is near the truth."""
    return (
        gap[1] - gap[0] < MAX_SHORT_GAP_S
        and max(heading_sigma_deg(start, (t_s, t_s)) for t_s in gap) <= MAX_HEADING_SIGMA_DEG
    )


def _joined(spans: list[Span]) -> list[Span]:
    """Spans, in order, of which those that touch are one."""
    out: list[Span] = []
    for begin_s, end_s in spans:
        if out and begin_s <= out[-1][1]:
            out[-1] = out[-1][0], max(end_s, out[-1][1])
        else:
            out.append((begin_s, end_s))
    return out
