"""Numbered intervals of time: passes of a tool, strips of a flight."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray


class Interval(Protocol):
    """Something that begins and ends."""

    @property
    def begin_s(self) -> float:
        """UTC of its beginning."""
        ...

    @property
    def end_s(self) -> float:
        """UTC of its end."""
        ...


def interval_numbers(intervals: Sequence[Interval], t_s: ArrayLike) -> NDArray[np.intp]:
    """Number (n,) of the interval at times (n,), 1 for the first, its ends included; 0 between intervals.

    Args:
        intervals: in the order of time, apart from each other.
        t_s: (n,) times.
    """
    t = np.atleast_1d(np.asarray(t_s, np.float64))
    if not intervals:
        return np.zeros(len(t), np.intp)
    number = np.searchsorted([when.begin_s for when in intervals], t, side="right")
    ends_s = np.array([when.end_s for when in intervals])
    return np.where((number > 0) & (t <= ends_s[number - 1]), number, 0)
