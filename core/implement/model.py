"""The implement as a session shows it: where it is seen, what it looks like, how far it travels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.implement.template import Template
from furrowmap.core.values.errors import Notice
from furrowmap.core.values.tool_states import ToolState

Box = tuple[float, float, float, float]
"""From, to along x, from, to along y of the vehicle frame."""
Plane = tuple[float, float, float]
"""Height of the ground in the vehicle frame: ``z = a + b·x + c·y``."""


@dataclass(frozen=True)
class Hint:
    """Where a session says the implement is.

    Attributes:
        xy_m: middle of the tool's line in the vehicle frame.
        width_m: working width.
        box_m: where it shows, if that is stated as well.
        lift_m: how far it is lifted, if that is.
    """

    xy_m: tuple[float, float]
    width_m: float
    box_m: Box | None = None
    lift_m: float | None = None


@dataclass(frozen=True)
class Region:
    """Where the implement shows.

    Attributes:
        ground: on which the vehicle stands.
        box_m: around the implement.
        columns: (COLUMNS,) bool, columns of the range image that show it.
        still_m: (lasers, COLUMNS) float32, range of what stands still there; nan elsewhere.
        split: the column farthest from it, where its view is cut into turns.
        clockwise: whether azimuth grows in the course of a scan.
        turn_s: how long a turn takes.
    """

    ground: Plane
    box_m: Box
    columns: NDArray[np.bool_]
    still_m: NDArray[np.float32]
    split: int
    clockwise: bool
    turn_s: float


@dataclass(frozen=True)
class DepthImages:
    """What the sensor sees of the implement.

    Attributes:
        up_m: (lasers, n) float32, median range with the implement up, lowest laser first; nan where nothing is seen.
        down_m: the same with the implement down.
        implement: (lasers, n) bool, pixels that show the implement in one position or another.
        azimuth_deg: (n,) float64 of the columns' middles, counted on through 360 where they pass azimuth 0.
    """

    up_m: NDArray[np.float32]
    down_m: NDArray[np.float32]
    implement: NDArray[np.bool_]
    azimuth_deg: NDArray[np.float64]


@dataclass(frozen=True)
class Levels:
    """The two positions of a tool.

    Attributes:
        low_m: height of the lower one against the template; of the lowest one in view, where it works out of view.
        high_m: of the upper one.
        hidden: the state in which the tool is out of view: UNKNOWN where it is in view in both.
        sigma_m: standard deviation of heights, the tool standing still.
        jitter_m: the same with the tool's own movement at work.
    """

    low_m: float
    high_m: float
    hidden: ToolState
    sigma_m: float
    jitter_m: float


@dataclass(frozen=True)
class Implement:
    """What is needed to see the implement in every scan, and to show it.

    Attributes:
        region: where to look for it.
        template: its side view.
        levels: its positions.
        working_m: height of the working position against the template; where it works out of view, as far below the
            lifted position as is usual.
        points: usual number of its points in a scan that shows it well.
        gain: usual log-likelihood gained by each of them.
        images: for a report.
    """

    region: Region
    template: Template
    levels: Levels
    working_m: float
    points: float
    gain: float
    images: DepthImages

    @property
    def lifted_m(self) -> float:
        """Height of the lifted tool above its working position."""
        return self.levels.high_m - self.working_m

    def threshold_m(self, working_depth_m: float | None) -> float:
        """The height above the working position that parts down from up: the working depth, or half the travel.

        A depth that the tool hardly clears when lifted cannot be meant from its working position.
        """
        half = 0.5 * self.lifted_m
        return working_depth_m if working_depth_m is not None and working_depth_m < 1.5 * half else half


@dataclass(frozen=True)
class Learned:
    """The implement, or why there is none.

    Attributes:
        implement: None where nothing was seen to move up and down.
        notices: for the report.
    """

    implement: Implement | None
    notices: tuple[Notice, ...]
