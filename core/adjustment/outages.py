"""Outages of positions: gaps between them that wheels and inertia do not bridge alone."""

from __future__ import annotations

from typing import Final

import numpy as np

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.trajectory.motion import longest_gap_s
from furrowmap.core.values.time_span import Span
from furrowmap.core.values.trajectory import Trajectory

LEAST_S: Final = 3.0
"""Positions over a shorter time hardly show a heading, less so in a turn."""
WORST_DEG: Final = 8.0
"""With a larger standard deviation a first guess of the heading may be beyond the reach of relief."""


def outages(t_s: FloatArray, start: Trajectory) -> tuple[Span, ...]:
    """Gaps between positions: from the last one before each to the first one after it.

    What is no longer than :func:`~furrowmap.core.trajectory.motion.longest_gap_s` is none. Positions between two gaps
    that hardly show a heading do not part them.

    Args:
        t_s: (m,) times of the positions, which increase.
        start: first guess of the trajectory.
    """
    longest_s = longest_gap_s(t_s) if len(t_s) > 1 else np.inf
    out: list[Span] = []
    first = 0
    for last in np.flatnonzero(np.diff(t_s) > longest_s).tolist():
        between = float(t_s[first]), float(t_s[last])
        vague = between[1] - between[0] < LEAST_S or heading_sigma_deg(start, between) > WORST_DEG
        begin_s = out.pop()[0] if out and vague else between[1]
        out.append((begin_s, float(t_s[last + 1])))
        first = last + 1
    return tuple(out)


def heading_sigma_deg(start: Trajectory, span_s: Span) -> float:
    """The least standard deviation of a heading in a span of time; 0 where they are not known."""
    sigma = start.sigma[:, 5]
    if not np.isfinite(sigma).all():
        return 0.0
    inside = sigma[(start.t_s >= span_s[0]) & (start.t_s <= span_s[1])]
    return float(min(np.interp(span_s, start.t_s, sigma).min(), inside.min(initial=np.inf)))
