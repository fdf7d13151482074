"""The implement found in a thinned recording: what moves up and down while the rest of the body stands still.

Scans are compared with a reference scan, pixel by pixel of their range images. Pixels that agree show the body (or the
implement in the same position); where they differ above the ground, and the points of one scan are those of the other
at another height, something has been lifted or lowered. Its side view becomes the template; the heights of all scans
and the template are then improved in turn. That is done from several reference scans, as one that shows little of the
implement may lead astray; the most likely outcome counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.implement.found import USUAL_LIFT_M, Found, Outcome, described
from furrowmap.core.implement.levels import FEWEST_SCANS, MOVED_M, find_positions
from furrowmap.core.implement.model import Box, Hint, Learned, Levels
from furrowmap.core.implement.near_scans import NearScan
from furrowmap.core.implement.template import CELL_X_M, CELL_Z_M, Template, fit_height
from furrowmap.core.implement.views import FEWEST_POINTS, SEARCH_M, Views, ground_plane, views_of
from furrowmap.core.values.errors import Notice
from furrowmap.core.values.tool_states import ToolState

FloatArray = NDArray[np.float64]

_ANYWHERE: Final[Box] = (-9.0, 4.0, -4.5, 4.5)
_CALM_M: Final = 0.03
"""Ranges of one pixel in successive scans that differ by more are of something that moves; so are heights."""
_ALIKE: Final = 0.3
"""Where a smaller share of a scan's points differs from another scan, the tool stands as it does there."""
_CHOSEN: Final = 24
"""So many pairs of scans are chosen for being unlike each other, and as many evenly over the session."""
_REFERENCES: Final = 6
_ROUNDS: Final = 2
_AT_M: Final = 0.04
"""A tool nearer than this to one of its positions is there."""
_OTHER_TRAVEL_M: Final = 0.10
_BETTER: Final = 1.01
"""Another travel must differ by so much, and fit by so much better, to be believed."""
_BEYOND_M: Final = 0.2
"""Heights are looked for so far beyond both positions."""
_NO_GROUND: Final = Notice(
    "implement-no-ground",
    "The ground near the vehicle is not where the scanner's mounting ([lidar] xyz_m, rpy_deg) puts it, so the "
    "implement cannot be told from it. Whether it works is unknown throughout.",
)


def learn_implement(scans: Sequence[NearScan], hint: Hint | None) -> Learned:
    """Find the implement in scans spread over a session.

    Args:
        scans: in the order of time.
        hint: where to look; without it, all around the vehicle.
    """
    ground = ground_plane(scans)
    if ground is None:
        return Learned(None, (_NO_GROUND,))
    views = views_of(scans, ground, _hinted(hint) if hint is not None else _ANYWHERE)
    found = _find(views)
    box = _box_of(found) if found is not None else None
    if box is not None and hint is None:
        found = _find(views_of(scans, ground, box))
    if found is None or box is None:
        return Learned(None, (_nothing(views, hint),))
    lift_m = hint.lift_m if hint is not None else None
    return Learned(described(found, lift_m or USUAL_LIFT_M), _out_of_view(found.levels.hidden, lift_m))


def _hinted(hint: Hint) -> Box:
    if hint.box_m is not None:
        return hint.box_m
    (x, y), half = hint.xy_m, 0.5 * hint.width_m + 0.5
    return (x - 2.0, x + 1.2, y - half, y + half)


def _find(views: Views) -> Found | None:
    """What moves up and down, if anything does."""
    pairs = views.pairs[views.pairs[:, 0] % 2 == 0] if len(views) else views.pairs
    if len(pairs) < FEWEST_SCANS:
        return None
    unlike = _unlike(views, pairs[:, 0])
    evenly = np.linspace(0, len(pairs) - 1, min(_CHOSEN, len(pairs))).astype(np.intp)
    some = np.unique(pairs[np.unique(np.append(unlike, evenly))])
    starts = pairs[np.append(unlike[: _REFERENCES // 2], evenly[:: 1 + 2 * len(evenly) // _REFERENCES]), 0]
    few = views.of(some)
    outcomes = [_from_reference(few, k) for k in np.flatnonzero(np.isin(some, starts)).tolist()]
    likeliest = sorted(
        filter(None, outcomes), key=lambda outcome: -float(outcome.heights.gain[outcome.heights.sure].sum())
    )
    for outcome in likeliest:
        heights = views.heights(outcome.template, outcome.still_m)
        better = _improved(views, outcome.image, heights.height_m, heights.sure)
        levels = find_positions(views, better.heights) if better is not None else None
        if better is not None and levels is not None:
            found = Found(better, levels)
            return _by_travel(found) or found
    return None


def _by_travel(found: Found) -> Found | None:
    """What is found with another travel between the two positions, where the scans on their way speak for one.

    A scanner may see other parts of a lifted tool than of a lowered one, so that one position's side view fits the
    other's at a height that is not true. On its way the tool shows both kinds of parts: the travel at which both
    positions together look most like that is the tool's. None where the travel found is as good.
    """
    outcome, levels = found.outcome, found.levels
    views, height, sure = outcome.views, outcome.heights.height_m, outcome.heights.sure
    at_low, at_high = (sure & (np.abs(height - level) < _AT_M) for level in (levels.low_m, levels.high_m))
    between = np.flatnonzero(sure & ~at_low & ~at_high)
    if levels.hidden != ToolState.UNKNOWN or len(between) < FEWEST_SCANS:
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
    better = _improved(views, outcome.image, moved, at_low | at_high)
    levels_there = find_positions(views, better.heights) if better is not None else None
    return Found(better, levels_there) if better is not None and levels_there is not None else None


def _worth(
    views: Views, sides: Sequence[NDArray[np.float32]], lower: FloatArray, upper: FloatArray, levels: Levels, rows: int
) -> float:
    """Log-likelihood a point of scans on their way, if the travel is larger by so many rows than the heights say."""
    moved = np.zeros_like(upper)
    moved[:, max(0, -rows) : upper.shape[1] - max(0, rows)] = upper[:, max(0, rows) : upper.shape[1] - max(0, -rows)]
    template = Template.of(views.grid, lower + moved)
    low_m, high_m = levels.low_m - _BEYOND_M, levels.high_m + rows * CELL_Z_M + _BEYOND_M
    gains = [fit_height(side, template, low_m, high_m)[0].gain / max(float(side.sum()), 1.0) for side in sides]
    return float(np.mean(gains))


def _unlike(views: Views, numbers: NDArray[np.intp]) -> NDArray[np.intp]:
    """Places in `numbers` of scans that are unlike each other: rare positions shall not drown in frequent ones.

    Each is the one farthest from all before it (Gonzalez 1985, Clustering to minimize the maximum intercluster
    distance) by a coarse side view.
    """
    coarse = np.array([_coarse(views.side(number, None)) for number in numbers.tolist()])
    distance = np.full(len(numbers), np.inf)
    chosen = [len(numbers) // 2]
    while len(chosen) < min(_CHOSEN, len(numbers)):
        distance = np.minimum(distance, np.square(coarse - coarse[chosen[-1]]).sum(axis=1))
        chosen.append(int(np.argmax(distance)))
    return np.array(chosen, np.intp)


def _coarse(side: NDArray[np.float32]) -> FloatArray:
    """A side view in cells of 0.3 m × 0.1 m, as roots, so that many points of one place do not outweigh all others."""
    columns, rows = side.shape[0] // 3 * 3, side.shape[1] // 5 * 5
    cells = side[:columns, :rows].reshape(columns // 3, 3, rows // 5, 5).sum(axis=(1, 3))
    roots: FloatArray = np.sqrt(cells.ravel(), dtype=np.float64)
    return roots


def _from_reference(views: Views, reference: int) -> Outcome | None:
    """What moves against one scan; None if nothing does, or if the scan shows something on its way.

    A scan that is cut in the middle of the tool shows a moving one at two heights.
    """
    image, view = views.images[reference], views.views[reference]
    beside = views.images[reference + 1 if reference % 2 == 0 else reference - 1]
    if not len(view) or view.differs(beside, _CALM_M).mean() > 0.5:
        return None
    template = Template.of(views.grid, views.side(reference, None).astype(np.float64))
    heights = views.heights(template, image)
    known = heights.sure & (np.abs(heights.height_m) > MOVED_M)
    if not known.any():
        return None
    height = np.where(known, heights.height_m, 0.0)
    for number, other in enumerate(views.views):
        known[number] |= len(other) >= FEWEST_POINTS and other.differs(image).mean() < _ALIKE
    outcome = None
    for _ in range(_ROUNDS):
        known[reference] = True
        outcome = _improved(views, image, height, known)
        if outcome is None:
            return None
        known, height = outcome.heights.sure, outcome.heights.height_m
    return outcome


def _improved(views: Views, image: NDArray[np.float32], height: FloatArray, known: NDArray[np.bool_]) -> Outcome | None:
    """What stands still, template, and heights anew, by the heights that are known; None if all are of one position."""
    middle = float(np.quantile(height[known], (0.02, 0.98)).mean())
    sides = [known & (height > middle), known & ~(height > middle)]
    if not all(side.any() for side in sides):
        return None
    still = views.still(image, sides)
    steady = _steady(views, height)
    upper, lower = (_mean_side(views, side & steady, height, still) for side in sides)
    template = Template.of(views.grid, upper + lower)
    return Outcome(views, image, template, still, views.heights(template, still))


def _steady(views: Views, height: FloatArray) -> NDArray[np.bool_]:
    """(scans,) whether the scan next to it shows the tool at the same height."""
    steady = np.zeros(len(height), bool)
    first, second = views.pairs.T
    alike = np.abs(height[second] - height[first]) < _CALM_M
    steady[first[alike]] = steady[second[alike]] = True
    return steady


def _mean_side(views: Views, chosen: NDArray[np.bool_], height: FloatArray, still: NDArray[np.float32]) -> FloatArray:
    """Mean side view of some scans, each lowered by its height and counted as one."""
    total = np.zeros((views.grid.columns, views.grid.rows))
    for number in np.flatnonzero(chosen).tolist():
        side = views.side(number, still, float(height[number]))
        total += side / max(float(side.sum()), 2.0 * FEWEST_POINTS)
    return total / max(int(np.count_nonzero(chosen)), 1)


def _box_of(found: Found) -> Box | None:
    """A box around the implement: where most of the scans that show it best have points that are likely its own.

    None where no place is: what was found is scattered, and no implement.
    """
    outcome, views = found.outcome, found.outcome.views
    sure = np.flatnonzero(outcome.heights.sure)
    best = sure[np.argsort(-outcome.heights.explained[sure])][: max(FEWEST_SCANS, len(sure) // 3)]
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
    """Why there are no states of the tool."""
    points = float(np.median([len(view) for view in views.views])) if len(views) else 0.0
    if hint is not None and points < FEWEST_POINTS:
        return Notice(
            "implement-not-seen",
            f"The scanner does not see the implement: where [implement] xy_m says it is, a scan has {points:.0f} "
            "points above the ground. Whether it works is unknown throughout.",
        )
    return Notice(
        "implement-never-moves",
        "Nothing that the scanner sees near the vehicle can be followed up and down in this recording: whether the "
        "implement works is unknown throughout.",
    )


def _out_of_view(hidden: ToolState, lift_m: float | None) -> tuple[Notice, ...]:
    if hidden == ToolState.DOWN:
        known = (
            "as the session states" if lift_m is not None else "an ordinary figure; [implement] lift_m states another"
        )
        text = (
            "The scanner sees the implement only when it is lifted. It is taken as down where it is out of view, and "
            f"its working position as {lift_m or USUAL_LIFT_M:g} m below the lifted one ({known}): times and "
            "heights are rough. A scanner that looks further down sees it at work."
        )
    elif hidden == ToolState.UP:
        text = "The scanner sees the implement only when it is down. It is taken as up where it is out of view."
    else:
        return ()
    return (Notice("implement-out-of-view", text),)
