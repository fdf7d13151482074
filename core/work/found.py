"""The detected implement, reduced to what later scans and the report need."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.values.tool_states import ToolState
from furrowmap.core.work.levels import FEWEST_SCANS
from furrowmap.core.work.model import DepthImages, Implement, Levels, Region
from furrowmap.core.work.range_image import COLUMNS, median_image
from furrowmap.core.work.template import Template
from furrowmap.core.work.views import Heights, Views

USUAL_LIFT_M: Final = 0.45
"""Assumed lift where it is not observed, accurate to 10 or 15 cm."""
_IMAGES: Final = 15
"""Scans per depth image."""
_OFTEN: Final = 0.3
"""Least share of the scans in one state in which a pixel of the implement shows it."""
_MARGIN: Final = 8
"""Columns added on both sides of the implement."""


@dataclass(frozen=True)
class Outcome:
    """A template at the position of a reference scan with range image `image`, and its heights in all scans."""

    views: Views
    image: NDArray[np.float32]
    template: Template
    still_m: NDArray[np.float32]
    heights: Heights

    def likely(self, number: int) -> NDArray[np.bool_]:
        """Which points of a scan are more likely implement than clutter."""
        return self.views.likely(number, float(self.heights.height_m[number]), self.template, self.still_m)


@dataclass(frozen=True)
class Found:
    """An outcome that behaves like a tool, with its two positions."""

    outcome: Outcome
    levels: Levels


def describe_implement(found: Found, lift_m: float) -> Implement:
    """The implement; `lift_m` applies where its working position is out of view, if larger than the observed lift."""
    outcome, levels = found.outcome, found.levels
    shows, own = _shows(found)
    first, count = _arc(np.flatnonzero(shows.any(axis=0)))
    shown = (first - 2 * _MARGIN + np.arange(min(count + 4 * _MARGIN, COLUMNS))) % COLUMNS
    down, up = (
        median_image(np.stack([outcome.views.images[k][:, shown] for k in _showing(found, state)]))
        for state in (ToolState.DOWN, ToolState.UP)
    )
    azimuth = (shown[0] + 0.5 + np.arange(len(shown))) * (360.0 / COLUMNS)
    usual_m = levels.high_m - lift_m
    points, gain = outcome.heights.usual
    return Implement(
        region=_region(outcome, first, count),
        template=outcome.template,
        levels=levels,
        working_m=min(levels.low_m, usual_m) if levels.hidden == ToolState.DOWN else levels.low_m,
        points=points,
        gain=gain,
        images=DepthImages(up, down, own[:, shown], azimuth),
    )


def _shows(found: Found) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(lasers, COLUMNS): pixels that show the implement sometimes, and often."""
    outcome, levels = found.outcome, found.levels
    up = outcome.heights.height_m > 0.5 * (levels.low_m + levels.high_m)
    now_and_then, often = np.zeros((2, *outcome.image.shape), bool)
    for side in (outcome.heights.sure & up, outcome.heights.sure & ~up):
        count = np.zeros(outcome.image.shape, np.int32)
        for number in np.flatnonzero(side).tolist():
            likely, view = outcome.likely(number), outcome.views.views[number]
            count[view.laser[likely], view.column[likely]] += 1
        scans = int(np.count_nonzero(side))
        now_and_then |= count >= max(FEWEST_SCANS, scans // 50)
        often |= count > max(FEWEST_SCANS - 1, _OFTEN * scans)
    return now_and_then, often


def _region(outcome: Outcome, first: int, count: int) -> Region:
    """Search region for an implement in `count` columns from `first` on."""
    views = outcome.views
    columns = np.zeros(COLUMNS, bool)
    columns[(first - _MARGIN + np.arange(count + 2 * _MARGIN)) % COLUMNS] = True
    return Region(
        ground=views.ground,
        box_m=views.box_m,
        columns=columns,
        still_m=outcome.still_m,
        split=(first + count + (COLUMNS - count) // 2) % COLUMNS,
        clockwise=float(np.mean([scan.clockwise for scan in views.scans])) > 0.5,
        turn_s=float(np.median([scan.end_s - scan.begin_s for scan in views.scans])),
    )


def _arc(at: NDArray[np.intp]) -> tuple[int, int]:
    """First column and length of the shortest arc that contains the sorted columns `at`."""
    gaps = np.diff(np.append(at, at[0] + COLUMNS))
    widest = int(np.argmax(gaps))
    return int(at[(widest + 1) % len(at)]), COLUMNS - int(gaps[widest]) + 1


def _showing(found: Found, state: ToolState) -> list[int]:
    """Indices of a few scans with the implement in a state."""
    heights, levels = found.outcome.heights, found.levels
    if state == levels.hidden:
        away = np.flatnonzero(~heights.sure)
        return [int(k) for k in away[np.linspace(0, len(away) - 1, min(len(away), _IMAGES)).astype(np.intp)]]
    level = levels.low_m if state == ToolState.DOWN else levels.high_m
    off = np.where(heights.sure, np.abs(heights.height_m - level), np.inf)
    return [int(k) for k in np.argsort(off, kind="stable")[:_IMAGES]]
