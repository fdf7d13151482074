"""The detected implement: where it is seen, its shape and its travel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.tool_states import ToolState
from furrowmap.core.work.template import Template

Box = tuple[float, float, float, float]
"""From, to along x, from, to along y of the vehicle frame."""
Plane = tuple[float, float, float]
"""Height of the ground in the vehicle frame: ``z = a + b·x + c·y``."""


@dataclass(frozen=True)
class Hint:
    """The implement as stated in a session.

    Attributes:
        xy_m: middle of the line of the tool in the vehicle frame.
        width_m: working width.
        box_m: region of the implement, if stated.
        lift_m: lift, if stated.
    """

    xy_m: tuple[float, float]
    width_m: float
    box_m: Box | None = None
    lift_m: float | None = None

    @property
    def region_m(self) -> Box:
        """Where it is looked for: as stated, else around its line."""
        if self.box_m is not None:
            return self.box_m
        (x, y), half = self.xy_m, 0.5 * self.width_m + 0.5
        return (x - 2.0, x + 1.2, y - half, y + half)


@dataclass(frozen=True)
class Region:
    """Where the implement is seen.

    Attributes:
        ground: plane under the vehicle.
        box_m: around the implement.
        columns: (COLUMNS,) bool, columns of the range image that show it.
        still_m: (lasers, COLUMNS) float32, range of static pixels; nan elsewhere.
        split: the opposite column, at which points are split into revolutions.
        clockwise: whether azimuth increases within a scan.
        turn_s: duration of a revolution.
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
    """Depth images of the implement.

    Attributes:
        up_m: (lasers, n) float32, median range with the implement up, lowest laser first; nan where nothing is seen.
        down_m: the same with the implement down.
        implement: (lasers, n) bool, pixels that show the implement in any position.
        azimuth_deg: (n,) float64 of column centres, continuous across azimuth 0.
    """

    up_m: NDArray[np.float32]
    down_m: NDArray[np.float32]
    implement: NDArray[np.bool_]
    azimuth_deg: NDArray[np.float64]


@dataclass(frozen=True)
class Levels:
    """The two positions of a tool.

    Attributes:
        low_m: height of the lower one relative to the template; the lowest in view, where it works out of view.
        high_m: of the upper one.
        hidden: state in which the tool is out of view; UNKNOWN if none.
        sigma_m: standard deviation of heights of the static tool.
        jitter_m: the same including its motion at work.
    """

    low_m: float
    high_m: float
    hidden: ToolState
    sigma_m: float
    jitter_m: float


@dataclass(frozen=True)
class Implement:
    """The implement, for measuring its height in every scan and for the report.

    Attributes:
        region: search region.
        template: its side view.
        levels: its positions.
        working_m: height of the working position relative to the template; assumed where it works out of view.
        points: usual number of its points in a scan.
        gain: usual log-likelihood gain of each of them.
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
        """Height above the working position between down and up: the working depth, or half the lift if less."""
        half = 0.5 * self.lifted_m
        return working_depth_m if working_depth_m is not None and working_depth_m < 1.5 * half else half


@dataclass(frozen=True)
class Learned:
    """The implement, None where nothing moves up and down, with notices for the report."""

    implement: Implement | None
    notices: tuple[Notice, ...]
