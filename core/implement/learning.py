"""Detection of the implement in sampled scans: what moves up and down while the rest of the body is static.

Scans are compared with a reference scan by the pixels of their range images. Equal pixels show the body (or the
implement in the same position); points above the ground that differ, but match those of the other scan at another
height, were lifted or lowered. Their side view is the template, which is refined with the heights of all scans in turn.
Several reference scans are tried, and the most likely outcome is used.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.implement.levels import MIN_LEVEL_SCANS, MOVED_M, find_positions
from furrowmap.core.implement.near_scans import IMAGE_COLUMNS, NearScan, median_image
from furrowmap.core.implement.seen_implement import (
    CELL_X_M,
    CELL_Z_M,
    Box,
    DepthImages,
    Hint,
    Learned,
    Levels,
    Region,
    SeenImplement,
    SideTemplate,
    fit_height,
)
from furrowmap.core.implement.views import FEWEST_POINTS, SEARCH_M, Heights, Views, ground_plane, views_of
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.tool_states import ToolState

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
    template: SideTemplate
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


def describe_implement(found: Found, lift_m: float) -> SeenImplement:
    """The implement; `lift_m` applies where its working position is out of view, if larger than the observed lift."""
    outcome = found.outcome
    levels = found.levels
    shows, own = _shows(found)
    at = np.flatnonzero(shows.any(axis=0))
    # The shortest arc that contains these columns.
    gaps = np.diff(np.append(at, at[0] + IMAGE_COLUMNS))
    widest = int(np.argmax(gaps))
    first = int(at[(widest + 1) % len(at)])
    count = IMAGE_COLUMNS - int(gaps[widest]) + 1
    shown = (first - 2 * _MARGIN + np.arange(min(count + 4 * _MARGIN, IMAGE_COLUMNS))) % IMAGE_COLUMNS
    down, up = (
        median_image(np.stack([outcome.views.images[k][:, shown] for k in _showing(found, state)]))
        for state in (ToolState.DOWN, ToolState.UP)
    )
    azimuth = (shown[0] + 0.5 + np.arange(len(shown))) * (360.0 / IMAGE_COLUMNS)
    usual_m = levels.high_m - lift_m
    points, gain = outcome.heights.usual
    return SeenImplement(
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
    outcome = found.outcome
    levels = found.levels
    up = outcome.heights.height_m > 0.5 * (levels.low_m + levels.high_m)
    now_and_then, often = np.zeros((2, *outcome.image.shape), bool)
    for side in (outcome.heights.sure & up, outcome.heights.sure & ~up):
        count = np.zeros(outcome.image.shape, np.int32)
        for number in np.flatnonzero(side).tolist():
            likely = outcome.likely(number)
            view = outcome.views.views[number]
            count[view.laser[likely], view.column[likely]] += 1
        scans = int(np.count_nonzero(side))
        now_and_then |= count >= max(MIN_LEVEL_SCANS, scans // 50)
        often |= count > max(MIN_LEVEL_SCANS - 1, _OFTEN * scans)
    return now_and_then, often


def _first_column(scans: Sequence[NearScan]) -> int:
    """Column at which most scans begin, some of them a little later for lack of returns."""
    first = np.array([scan.first_column for scan in scans])
    usual = int(np.bincount(first).argmax())
    after = (first - usual + IMAGE_COLUMNS // 2) % IMAGE_COLUMNS - IMAGE_COLUMNS // 2
    near = after[np.abs(after) < IMAGE_COLUMNS // 8]
    clockwise = np.mean([scan.clockwise for scan in scans]) > 0.5
    return int(usual + (near.min() if clockwise else near.max())) % IMAGE_COLUMNS


def _region(outcome: Outcome, first: int, count: int) -> Region:
    """Search region for an implement in `count` columns from `first` on."""
    views = outcome.views
    columns = np.zeros(IMAGE_COLUMNS, bool)
    columns[(first - _MARGIN + np.arange(count + 2 * _MARGIN)) % IMAGE_COLUMNS] = True
    return Region(
        ground=views.ground,
        box_m=views.box_m,
        columns=columns,
        still_m=outcome.still_m,
        begin=_first_column(views.scans),
        split=(first + count + (IMAGE_COLUMNS - count) // 2) % IMAGE_COLUMNS,
        clockwise=float(np.mean([scan.clockwise for scan in views.scans])) > 0.5,
        turn_s=float(np.median([scan.end_s - scan.begin_s for scan in views.scans])),
    )


def _showing(found: Found, state: ToolState) -> list[int]:
    """Indices of a few scans with the implement in a state."""
    heights = found.outcome.heights
    levels = found.levels
    if state == levels.hidden:
        away = np.flatnonzero(~heights.sure)
        return [int(k) for k in away[np.linspace(0, len(away) - 1, min(len(away), _IMAGES)).astype(np.intp)]]
    level = levels.low_m if state == ToolState.DOWN else levels.high_m
    off = np.where(heights.sure, np.abs(heights.height_m - level), np.inf)
    return [int(k) for k in np.argsort(off, kind="stable")[:_IMAGES]]


_SEARCH_REGION_M: Final[Box] = (-9.0, 4.0, -4.5, 4.5)
_CALM_M: Final = 0.03
"""Greatest difference in range of one pixel, or in height, between successive scans of a static object."""
_ALIKE: Final = 0.3
"""With a smaller share of differing points, two scans show the tool at the same height."""
_SAMPLED_PAIRS: Final = 24
"""Pairs of scans chosen for their dissimilarity, and as many evenly spread."""
_REFERENCES: Final = 6
_LEARNING_ROUNDS: Final = 2
_AT_M: Final = 0.04
"""Tolerance of the two positions."""
_OTHER_TRAVEL_M: Final = 0.10
_BETTER: Final = 1.01
"""Least difference of another travel, and least ratio of its fit, to replace the first."""
_BEYOND_M: Final = 0.2
"""Search range beyond both positions."""
_NO_GROUND: Final = Notice("implement-no-ground")


def learn_implement(scans: Sequence[NearScan], hint: Hint | None) -> Learned:
    """Find the implement in scans in order of time, all around the vehicle unless `hint` narrows the search."""
    ground = ground_plane(scans)
    if ground is None:
        return Learned(None, (_NO_GROUND,))
    views = views_of(scans, ground, hint.region_m if hint is not None else _SEARCH_REGION_M)
    found = _find(views)
    box = _box_of(found) if found is not None else None
    if box is not None and hint is None:
        found = _find(views_of(scans, ground, box))
    if found is None or box is None:
        return Learned(None, (_nothing(views, hint),))
    lift_m = hint.lift_m if hint is not None else None
    return Learned(describe_implement(found, lift_m or USUAL_LIFT_M), _out_of_view(found.levels.hidden, lift_m))


def _find(views: Views) -> Found | None:
    """What moves up and down, if anything."""
    pairs = views.pairs[views.pairs[:, 0] % 2 == 0] if len(views) else views.pairs
    if len(pairs) < MIN_LEVEL_SCANS:
        return None
    # Dissimilar scans, so that rare positions are represented: farthest-point sampling (Gonzalez 1985, Clustering to
    # minimize the maximum intercluster distance).
    numbers = pairs[:, 0]
    coarse = np.array([_coarse(views.side(number, None)) for number in numbers.tolist()])
    distance = np.full(len(numbers), np.inf)
    chosen = [len(numbers) // 2]
    while len(chosen) < min(_SAMPLED_PAIRS, len(numbers)):
        distance = np.minimum(distance, np.square(coarse - coarse[chosen[-1]]).sum(axis=1))
        chosen.append(int(np.argmax(distance)))
    unlike = np.array(chosen, np.intp)
    evenly = np.linspace(0, len(pairs) - 1, min(_SAMPLED_PAIRS, len(pairs))).astype(np.intp)
    some = np.unique(pairs[np.unique(np.append(unlike, evenly))])
    starts = pairs[np.append(unlike[: _REFERENCES // 2], evenly[:: 1 + 2 * len(evenly) // _REFERENCES]), 0]
    few = views.subset(some)
    outcomes = [_from_reference(few, k) for k in np.flatnonzero(np.isin(some, starts)).tolist()]
    likeliest = sorted(
        filter(None, outcomes), key=lambda outcome: -float(outcome.heights.gain[outcome.heights.sure].sum())
    )
    for outcome in likeliest:
        heights = views.heights(outcome.template, outcome.still_m)
        better = _refine(views, outcome.image, heights.height_m, heights.sure)
        levels = find_positions(views, better.heights) if better is not None else None
        if better is not None and levels is not None:
            found = Found(better, levels)
            return _by_travel(found) or found
    return None


def _by_travel(found: Found) -> Found | None:
    """The result with another travel between the two positions, if scans of the moving tool fit it better; else None.

    A scanner may see different parts of a lifted and of a lowered tool, so that the two side views match at a wrong
    height; a moving tool shows both sets of parts.
    """
    outcome = found.outcome
    levels = found.levels
    views = outcome.views
    height = outcome.heights.height_m
    sure = outcome.heights.sure
    at_low, at_high = (sure & (np.abs(height - level) < _AT_M) for level in (levels.low_m, levels.high_m))
    between = np.flatnonzero(sure & ~at_low & ~at_high)
    if levels.hidden != ToolState.UNKNOWN or len(between) < MIN_LEVEL_SCANS:
        return None
    lower = _mean_side(views, at_low, np.where(at_low, height, 0.0), outcome.still_m)
    upper = _mean_side(views, at_high, height, outcome.still_m)
    sides = [views.side(number, outcome.still_m) for number in between.tolist()]
    now_m = levels.high_m - levels.low_m
    step = round(now_m / CELL_Z_M)
    travels = np.arange(round(MOVED_M / CELL_Z_M), round(SEARCH_M / CELL_Z_M))
    worth = np.array([_worth(views, sides, lower, upper, levels, int(rows) - step) for rows in travels])
    best = int(np.argmax(worth))
    if abs(int(travels[best]) - step) * CELL_Z_M < _OTHER_TRAVEL_M:
        return None
    if worth[best] < _BETTER * _worth(views, sides, lower, upper, levels, 0):
        return None
    moved = height + np.where(at_high, (int(travels[best]) - step) * CELL_Z_M, 0.0)
    better = _refine(views, outcome.image, moved, at_low | at_high)
    levels_there = find_positions(views, better.heights) if better is not None else None
    return Found(better, levels_there) if better is not None and levels_there is not None else None


def _worth(
    views: Views, sides: Sequence[NDArray[np.float32]], lower: FloatArray, upper: FloatArray, levels: Levels, rows: int
) -> float:
    """Log-likelihood per point of scans of the moving tool for a travel larger by `rows`."""
    moved = np.zeros_like(upper)
    moved[:, max(0, -rows) : upper.shape[1] - max(0, rows)] = upper[:, max(0, rows) : upper.shape[1] - max(0, -rows)]
    template = SideTemplate.from_views(views.grid, lower + moved)
    low_m = levels.low_m - _BEYOND_M
    high_m = levels.high_m + rows * CELL_Z_M + _BEYOND_M
    gains = [fit_height(side, template, low_m, high_m)[0].gain / max(float(side.sum()), 1.0) for side in sides]
    return float(np.mean(gains))


def _coarse(side: NDArray[np.float32]) -> FloatArray:
    """A side view in cells of 0.3 m × 0.1 m, as square roots, so that dense cells do not dominate."""
    columns = side.shape[0] // 3 * 3
    rows = side.shape[1] // 5 * 5
    cells = side[:columns, :rows].reshape(columns // 3, 3, rows // 5, 5).sum(axis=(1, 3))
    roots: FloatArray = np.sqrt(cells.ravel(), dtype=np.float64)
    return roots


def _from_reference(views: Views, reference: int) -> Outcome | None:
    """What moves relative to one scan; None if nothing does, or if the tool moves in that scan."""
    image = views.images[reference]
    view = views.views[reference]
    beside = views.images[reference + 1 if reference % 2 == 0 else reference - 1]
    if not len(view) or view.differs(beside, _CALM_M).mean() > 0.5:
        return None
    template = SideTemplate.from_views(views.grid, views.side(reference, None).astype(np.float64))
    heights = views.heights(template, image)
    known = heights.sure & (np.abs(heights.height_m) > MOVED_M)
    if not known.any():
        return None
    height = np.where(known, heights.height_m, 0.0)
    for number, other in enumerate(views.views):
        known[number] |= len(other) >= FEWEST_POINTS and other.differs(image).mean() < _ALIKE
    outcome = None
    for _ in range(_LEARNING_ROUNDS):
        known[reference] = True
        outcome = _refine(views, image, height, known)
        if outcome is None:
            return None
        known = outcome.heights.sure
        height = outcome.heights.height_m
    return outcome


def _refine(views: Views, image: NDArray[np.float32], height: FloatArray, known: NDArray[np.bool_]) -> Outcome | None:
    """Static pixels, template and heights, refined from known heights; None if all are of one position."""
    middle = float(np.quantile(height[known], (0.02, 0.98)).mean())
    sides = [known & (height > middle), known & ~(height > middle)]
    if not all(side.any() for side in sides):
        return None
    still = views.still(image, sides)
    steady = np.zeros(len(height), bool)  # whether an adjacent scan has the tool at the same height
    first, second = views.pairs.T
    alike = np.abs(height[second] - height[first]) < _CALM_M
    steady[first[alike]] = steady[second[alike]] = True
    upper, lower = (_mean_side(views, side & steady, height, still) for side in sides)
    template = SideTemplate.from_views(views.grid, upper + lower)
    return Outcome(views, image, template, still, views.heights(template, still))


def _mean_side(views: Views, chosen: NDArray[np.bool_], height: FloatArray, still: NDArray[np.float32]) -> FloatArray:
    """Mean side view of chosen scans, lowered by their heights, with equal weights."""
    total = np.zeros((views.grid.columns, views.grid.rows))
    for number in np.flatnonzero(chosen).tolist():
        side = views.side(number, still, float(height[number]))
        total += side / max(float(side.sum()), 2.0 * FEWEST_POINTS)
    return total / max(int(np.count_nonzero(chosen)), 1)


def _box_of(found: Found) -> Box | None:
    """A box around the implement, from likely points in most of the best scans; None if these are scattered."""
    outcome = found.outcome
    views = found.outcome.views
    sure = np.flatnonzero(outcome.heights.sure)
    best = sure[np.argsort(-outcome.heights.explained[sure])][: max(MIN_LEVEL_SCANS, len(sure) // 3)]
    bounds = ((views.box_m[0], views.box_m[1]), (views.box_m[2], views.box_m[3]))
    cells = [round((high - low) / CELL_X_M) for low, high in bounds]
    often = np.zeros(cells)
    for number in best.tolist():
        xyz = views.views[number].xyz_m[outcome.likely(number)]
        often += np.histogram2d(xyz[:, 0], xyz[:, 1], cells, bounds)[0] > 0
    x, y = np.nonzero(often >= 0.5 * len(best))
    if not len(x):
        return None
    (x0, x1), (y0, y1) = (
        (low + CELL_X_M * int(at.min()), low + CELL_X_M * (int(at.max()) + 1))
        for at, (low, _) in zip((x, y), bounds, strict=True)
    )
    return (x0 - 0.5, x1 + 0.5, y0 - 0.3, y1 + 0.3)


def _nothing(views: Views, hint: Hint | None) -> Notice:
    """The reason for the missing states of the tool."""
    points = float(np.median([len(view) for view in views.views])) if len(views) else 0.0
    if hint is not None and points < FEWEST_POINTS:
        return Notice("implement-not-seen", points=points)
    return Notice("implement-never-moves")


def _out_of_view(hidden: ToolState, lift_m: float | None) -> tuple[Notice, ...]:
    if hidden == ToolState.DOWN:
        return (Notice("implement-out-of-view.down", lift_m=lift_m or USUAL_LIFT_M, stated=lift_m is not None),)
    return (Notice("implement-out-of-view.up"),) if hidden == ToolState.UP else ()
