"""Scans that positions hold. Others would be matched to the wrong ground, with small standard deviations.

Scans in a gap between positions are carried in from its ends (see :mod:`~furrowmap.core.adjustment.bridging`), if they
go on through the whole gap. Where the scanner pauses, starts or stops in the gap, a first guess is metres off, beyond
the reach of relief, and no misclosure shows it. The same is true of scans between two pauses while positions do not
show the heading, as before the first metres of a drive.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from furrowmap.core.adjustment.bridging import ALIKE_S
from furrowmap.core.adjustment.outages import WORST_DEG, heading_sigma_deg, outages
from furrowmap.core.estimation.knots import Chain, knots_over
from furrowmap.core.matching.returns import GroundReturns
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.time_span import Span
from furrowmap.core.values.trajectory import Trajectory

PAUSE_S: Final = 2.0
"""A longer pause of the scanner does not let poses be carried on in such a gap."""
REACH_S: Final = 0.5
"""Scans up to this long after a position, or before one, are held by it."""
SHORT_S: Final = 3.0
"""Shorter gaps wheels, inertia and the speeds at their ends bridge alone, where headings are known there."""


def held_by_positions(
    returns: GroundReturns, position_s: FloatArray, start: Trajectory
) -> tuple[GroundReturns, tuple[Span, ...]]:
    """The returns that positions hold, and the times whose scans they do not hold.

    Args:
        returns: of the ground, in the order of time.
        position_s: (m,) times of the positions, which increase.
        start: first guess of the trajectory.
    """
    if not len(returns) or len(position_s) < 2:
        return returns, ()
    gaps = outages(position_s, start)
    lost = [span for chain in knots_over(returns.t_s, PAUSE_S).chains for span in _unheld(chain, gaps, start)]
    return (returns.without(lost), tuple(lost)) if lost else (returns, ())


def _unheld(chain: Chain, gaps: Sequence[Span], start: Trajectory) -> list[Span]:
    """The times of a chain of scans that positions do not hold: parts of it, or gaps beside them."""
    gaps = [gap for gap in gaps if gap[0] < chain.end_s and gap[1] > chain.begin_s and not _is_short(gap, start)]
    borders = [chain.begin_s, *(t for gap in gaps for t in gap), chain.end_s]
    parts = list(zip(borders[::2], borders[1::2], strict=True))
    long = [not gaps or end_s - begin_s >= ALIKE_S for begin_s, end_s in parts]
    held = [is_long and heading_sigma_deg(start, part) <= WORST_DEG for is_long, part in zip(long, parts, strict=True)]
    # Poses are carried to what lies between two gaps from both sides.
    held[1:-1] = long[1:-1]
    lost = [part for part, is_held in zip(parts, held, strict=True) if not is_held]
    lost += [
        (begin_s + REACH_S * before, end_s - REACH_S * after)
        for (begin_s, end_s), before, after in zip(gaps, held[:-1], held[1:], strict=True)
        if not (before and after)
    ]
    inside = [(max(begin_s, chain.begin_s), min(end_s, chain.end_s)) for begin_s, end_s in lost]
    return _joined(sorted(span for span in inside if span[0] < span[1]))


def _is_short(gap: Span, start: Trajectory) -> bool:
    """Whether a first guess across a gap is near the truth."""
    return gap[1] - gap[0] < SHORT_S and max(heading_sigma_deg(start, (t_s, t_s)) for t_s in gap) <= WORST_DEG


def _joined(spans: list[Span]) -> list[Span]:
    """Spans, in order, of which those that touch are one."""
    out: list[Span] = []
    for begin_s, end_s in spans:
        if out and begin_s <= out[-1][1]:
            out[-1] = out[-1][0], max(end_s, out[-1][1])
        else:
            out.append((begin_s, end_s))
    return out
