"""States of the implement, and of its sections, over time."""

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furrowmap.core.runtime.arrays import FloatArray, check_columns
from furrowmap.core.values.sections import Link, Section


class ToolState(IntEnum):
    """Whether the implement is in the ground."""

    UNKNOWN = -1
    UP = 0
    DOWN = 1

    @property
    def label(self) -> str:
        """Name in files and reports."""
        return self.name.lower()


@dataclass(frozen=True)
class SectionStates:
    """States of k sections of one implement in n intervals [begin, end) of time.

    Attributes:
        sections: from left to right.
        links: from the positions of the log to the frame of the implement; empty where these are the same.
        begin_s: (n,) float64 UTC.
        end_s: (n,) float64 UTC, after `begin_s` and not after the next interval's `begin_s`.
        state: (n, k) int8, values of :class:`ToolState`.
        begin_sigma_s: (n,) float64 standard deviation of `begin_s`; nan where unknown.
        is_drawn: whether the implement hangs on a drawbar, so that it turns against the vehicle.
    """

    sections: tuple[Section, ...]
    links: tuple[Link, ...]
    begin_s: FloatArray
    end_s: FloatArray
    state: NDArray[np.int8]
    begin_sigma_s: FloatArray
    end_sigma_s: FloatArray
    is_drawn: bool = False

    def __post_init__(self) -> None:
        check_columns(self, "begin_s", state=len(self.sections))
        if not bool(np.all(self.end_s > self.begin_s)) or not bool(np.all(self.begin_s[1:] >= self.end_s[:-1])):
            raise ValueError("SectionStates: an interval ends before it begins, or intervals overlap")

    def __len__(self) -> int:
        return len(self.begin_s)

    @property
    def span_m(self) -> tuple[float, float]:
        """The right and the left end of the line of all sections, y in the frame of the implement."""
        right_m = min(one.y_m - 0.5 * one.width_m for one in self.sections)
        left_m = max(one.y_m + 0.5 * one.width_m for one in self.sections)
        return right_m, left_m

    @property
    def width_m(self) -> float:
        """From the one end to the other."""
        return self.span_m[1] - self.span_m[0]

    @property
    def middle_m(self) -> tuple[float, float]:
        """The middle of the line of all sections in the frame of the implement."""
        x_m = sum(one.width_m * one.x_m for one in self.sections) / sum(one.width_m for one in self.sections)
        return x_m, 0.5 * sum(self.span_m)

    @property
    def working_s(self) -> FloatArray:
        """(k,) for how long each section worked."""
        return np.asarray((self.end_s - self.begin_s) @ (self.state == ToolState.DOWN), np.float64)

    def later(self, by_s: float) -> Self:
        """The same states `by_s` later."""
        return replace(self, begin_s=self.begin_s + by_s, end_s=self.end_s + by_s)


@dataclass(frozen=True)
class ToolStates:
    """States of the implement in intervals [begin, end) of time; between intervals the state is unknown.

    A boundary that two intervals share is a transition, with the same sigma in both. The first begin and the last end
    of a recording are not transitions: the intervals are limited there exactly, and their sigma is 0.

    Attributes:
        begin_s: (n,) float64 UTC.
        end_s: (n,) float64 UTC, after `begin_s` and not after the next interval's `begin_s`.
        state: (n,) int8, values of :class:`ToolState`.
        confidence: (n,) float64, probability of `state`, 0 to 1.
        begin_sigma_s: (n,) float64 standard deviation of `begin_s`; nan where unknown.
        common_share: share of the transitions' variance with a common cause, such as a wrong working position: it makes
            all intervals of `down` longer, or all shorter.
        sections: states of the sections of each implement that has some, in the order of time; while they are known,
            the implement is down where any of its sections is.
    """

    begin_s: FloatArray
    end_s: FloatArray
    state: NDArray[np.int8]
    confidence: FloatArray
    begin_sigma_s: FloatArray
    end_sigma_s: FloatArray
    common_share: float = 0.0
    sections: tuple[SectionStates, ...] = ()

    def __post_init__(self) -> None:
        check_columns(self, "begin_s")
        if not bool(np.all(self.end_s > self.begin_s)):
            raise ValueError("ToolStates: an interval ends before it begins")
        if not bool(np.all(self.begin_s[1:] >= self.end_s[:-1])):
            raise ValueError("ToolStates: intervals overlap or are not in the order of time")

    def __len__(self) -> int:
        return len(self.begin_s)

    def at(self, t_s: ArrayLike) -> tuple[NDArray[np.int8], FloatArray]:
        """State (n,) int8 and confidence (n,) at times (n,): unknown, with confidence 0, outside all intervals."""
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
