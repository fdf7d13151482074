"""Statistics that reduce the heights of a cell to one."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from statistics import NormalDist
from typing import Final, Self

from furrowmap.core.runtime.errors import UsageError

NMAD: Final = 1.4826
"""Standard deviation over median absolute deviation of a normal distribution."""
TRIM: Final = 2.5
"""The trimmed mean excludes heights farther than this many NMAD from the median."""
_NAMES: Final = {"min": 0.0, "median": 50.0, "max": 100.0}


@dataclass(frozen=True)
class Statistic:
    """A statistic.

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
        raise UsageError("unknown-statistic", name=name)

    @property
    def needs_order(self) -> bool:
        """Whether the heights of a cell must be sorted for it."""
        return self.name not in {"mean", "min", "max"}

    @property
    def error_factor(self) -> float:
        """Standard error for n normal heights of unit variance times √n, asymptotically.

        For percentiles ``sqrt(p (1 - p)) / density`` (Stuart & Ord, Kendall's Advanced Theory of Statistics I, 10.10);
        nan for the least and the greatest height.
        """
        if math.isnan(self.percent):
            return 1.0
        p = self.percent / 100.0
        if not 0.0 < p < 1.0:
            return math.nan
        normal = NormalDist()
        return math.sqrt(p * (1.0 - p)) / normal.pdf(normal.inv_cdf(p))


MEDIAN: Final = Statistic.parse("median")
