"""Points of clouds sorted into tiles for surfaces."""

from dataclasses import dataclass
from typing import Final

from furrowmap.core.runtime.errors import Notice
from furrowmap.core.surfaces.spool import PointSpool

CLASSED_SHARE: Final = 0.01
"""Least share of ground points in a classified cloud."""


@dataclass(frozen=True)
class SpooledClouds:
    """The points of clouds, sorted into tiles.

    Attributes:
        ground: those among them classified as ground in the files.
        span_s: earliest and latest UTC; None where unknown.
        notices: on differences between headers and points.
    """

    points: PointSpool
    ground: PointSpool
    count: int
    ground_count: int
    span_s: tuple[float, float] | None
    notices: tuple[Notice, ...]

    @property
    def classified(self) -> bool:
        """Whether the files have a ground class."""
        return self.ground_count > CLASSED_SHARE * self.count
