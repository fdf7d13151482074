"""When the tool was in the ground: a history of states in intervals of time."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


class ToolState(IntEnum):
    """Whether the tool works the ground."""

    UNKNOWN = -1
    UP = 0
    DOWN = 1

    @property
    def label(self) -> str:
        """The word that files and reports use."""
        return self.name.lower()


@dataclass(frozen=True)
class ToolStates:
    """States of the tool in intervals [begin, end) of time; between intervals the state is unknown.

    A border that two intervals share is a transition, and carries the same sigma in both. The first begin and the
    last end of a recording are no transitions: nothing is known of the tool outside, but the interval ends there
    exactly, and their sigma is 0.

    Attributes:
        begin_s: (n,) float64 UTC.
        end_s: (n,) float64 UTC, after `begin_s` and not after the next interval's `begin_s`.
        state: (n,) int8, values of :class:`ToolState`.
        confidence: (n,) float64, 0 to 1, that `state` is true.
        begin_sigma_s: (n,) float64 standard deviation of `begin_s`; nan where unknown.
        end_sigma_s: (n,) float64 standard deviation of `end_s`; nan where unknown.
        common_share: share of the transitions' variance that has one cause, such as a working position that is wrong
            throughout: it makes every time of `down` longer, or every one shorter.
    """

    begin_s: FloatArray
    end_s: FloatArray
    state: NDArray[np.int8]
    confidence: FloatArray
    begin_sigma_s: FloatArray
    end_sigma_s: FloatArray
    common_share: float = 0.0

    def __post_init__(self) -> None:
        n = len(self.begin_s)
        for name in ("begin_s", "end_s", "state", "confidence", "begin_sigma_s", "end_sigma_s"):
            if getattr(self, name).shape != (n,):
                raise ValueError(f"ToolStates.{name} has shape {getattr(self, name).shape}, not {(n,)}")
        if not bool(np.all(self.end_s > self.begin_s)):
            raise ValueError("ToolStates: an interval ends before it begins")
        if n > 1 and not bool(np.all(self.begin_s[1:] >= self.end_s[:-1])):
            raise ValueError("ToolStates: intervals overlap or are not in the order of time")

    def __len__(self) -> int:
        return len(self.begin_s)

    def at(self, t_s: ArrayLike) -> tuple[NDArray[np.int8], FloatArray]:
        """State (n,) int8 and confidence (n,) at times (n,): unknown, with confidence 0, where no interval reaches."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        state = np.full(t.shape, ToolState.UNKNOWN, np.int8)
        confidence = np.zeros(t.shape)
        if len(self):
            k = np.clip(np.searchsorted(self.begin_s, t, side="right") - 1, 0, None)
            inside = (t >= self.begin_s[k]) & (t < self.end_s[k])
            inside |= (k == len(self) - 1) & (t == self.end_s[k])
            state[inside] = self.state[k[inside]]
            confidence[inside] = self.confidence[k[inside]]
        return state, confidence
