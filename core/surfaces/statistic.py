"""Which height stands for the returns of a cell."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from statistics import NormalDist
from typing import Final, Self

from furrowmap.core.values.errors import UsageError

NMAD: Final = 1.4826
"""Times the median absolute deviation is the standard deviation of what is normally distributed."""
TRIM: Final = 2.5
"""The trimmed mean leaves out what lies further than this many NMAD from the median."""
_NAMES: Final = {"min": 0.0, "median": 50.0, "max": 100.0}


@dataclass(frozen=True)
class Statistic:
    """How the heights of a cell become one.

    Attributes:
        name: "median", "trimmed", "mean", "min", "max" or "p" and a percentage such as "p90".
        percent: of a percentile, 0 to 100; nan for the two means.
    """

    name: str
    percent: float = math.nan

    @classmethod
    def parse(cls, name: str) -> Self:
        """The statistic of a name.

        Raises:
            UsageError: if there is none of that name.
        """
        word = name.strip().lower()
        if word in {"mean", "trimmed"}:
            return cls(word)
        if word in _NAMES:
            return cls(word, _NAMES[word])
        number = re.fullmatch(r"p(\d{1,3}(?:\.\d+)?)", word)
        if number and float(number[1]) <= 100.0:
            return cls(word, float(number[1]))
        raise UsageError(
            f"There is no statistic '{name}'.",
            "It says which height stands for the returns of a cell.",
            "Choose median, trimmed, mean, min, max, or a percentile such as p90.",
            code="unknown-statistic",
        )

    @property
    def needs_order(self) -> bool:
        """Whether the heights of a cell have to be ordered for it; the others add up as points come."""
        return self.name not in {"mean", "min", "max"}

    @property
    def error_factor(self) -> float:
        """Its standard deviation where the heights' is 1 and there are many of them, times the root of their number.

        For percentiles ``sqrt(p (1 - p)) / density`` of the normal distribution (Stuart & Ord, Kendall's Advanced
        Theory of Statistics I, 10.10); nan for the least and the greatest height, whose error does not fall that way.
        """
        if math.isnan(self.percent):
            return 1.0
        p = self.percent / 100.0
        if not 0.0 < p < 1.0:
            return math.nan
        normal = NormalDist()
        return math.sqrt(p * (1.0 - p)) / normal.pdf(normal.inv_cdf(p))


MEDIAN: Final = Statistic.parse("median")
