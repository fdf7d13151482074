"""Returns in portions of time that fit into memory, without those in gaps, and threads that work on them."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.adjustment.knots import Knots
from furrowmap.core.runtime.arrays import FloatArray

Found = TypeVar("Found")
Portion = tuple[int, slice]
"""Number of a chain, and which of the returns."""

MATCH_WINDOW_S: Final = 3.0
BLOCK_S: Final = 20.0
THREADS: Final = 2


@dataclass(frozen=True)
class Gap:
    """A time without positions within a chain of knots.

    Attributes:
        begin_s: the last position before it.
        end_s: the first one after it.
    """

    begin_s: float
    end_s: float
    chain: int

    @property
    def middle_s(self) -> float:
        """Half-way through the gap."""
        return 0.5 * (self.begin_s + self.end_s)


def in_gaps(t_s: FloatArray, gaps: Sequence[Gap]) -> NDArray[np.bool_]:
    """(n,) which of the times lie in a gap."""
    out = np.zeros(len(t_s), np.bool_)
    for gap in gaps:
        out |= (t_s > gap.begin_s) & (t_s < gap.end_s)
    return out


def windows(t_s: FloatArray, knots: Knots, thin: int, gaps: Sequence[Gap]) -> list[Portion]:
    """Every `thin`-th return in windows of MATCH_WINDOW_S that overlap by half."""
    return _portions(t_s, knots, MATCH_WINDOW_S, 0.5 * MATCH_WINDOW_S, thin, gaps)


def blocks(t_s: FloatArray, knots: Knots, thin: int, gaps: Sequence[Gap]) -> list[Portion]:
    """Every `thin`-th return in blocks of BLOCK_S."""
    return _portions(t_s, knots, BLOCK_S, BLOCK_S, thin, gaps)


def _portions(
    t_s: FloatArray, knots: Knots, length_s: float, step_s: float, thin: int, gaps: Sequence[Gap]
) -> list[Portion]:
    """The first of each chain begins early, so that all overlap alike."""
    out: list[Portion] = []
    for c, chain in enumerate(knots.chains):
        begins = np.arange(chain.begin_s - length_s + step_s, chain.end_s, step_s)
        first = np.searchsorted(t_s, np.maximum(begins, chain.begin_s))
        last = np.searchsorted(t_s, np.minimum(begins + length_s, chain.end_s))
        slices = [slice(int(a), int(b), thin) for a, b in zip(first, last, strict=True) if b > a]
        out += [(c, part) for part in outside(slices, t_s, gaps)]
    return out


def outside(portions: Sequence[slice], t_s: FloatArray, gaps: Sequence[Gap]) -> list[slice]:
    """The portions without the returns in gaps; one that a gap cuts in two is two."""
    out = list(portions)
    for gap in gaps:
        first, last = (int(i) for i in np.searchsorted(t_s, (gap.begin_s, gap.end_s)))
        parts = [(w, slice(w.start, min(w.stop, first), w.step)) for w in out]
        parts += [(w, slice(max(w.start, last), w.stop, w.step)) for w in out if w.stop > first]
        out = [part for _, part in sorted(parts, key=lambda p: p[1].start) if part.stop > part.start]
    return out


def shares(portions: Sequence[Portion]) -> list[Sequence[Portion]]:
    """Even shares of the portions, one for each thread: the kernels release the interpreter's lock."""
    cuts = np.linspace(0, len(portions), THREADS + 1).astype(int)
    return [portions[a:b] for a, b in pairwise(cuts.tolist()) if b > a]
