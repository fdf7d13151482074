"""The implement found in a thinned recording: what moves up and down while the rest of the body stands still.

Scans are compared with a reference scan, pixel by pixel of their range images. Pixels that agree show the body (or the
implement in the same position); where they differ above the ground, and the points of one scan are those of the other
at another height, something has been lifted or lowered. Its side view becomes the template; the heights of all scans
and the template are then improved in turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.implement.near_scans import NearScan
from furrowmap.core.implement.range_image import COLUMNS, median_image
from furrowmap.core.implement.template import CELL_X_M, CELL_Z_M, Grid, Template, fit_height
from furrowmap.core.values.errors import Notice
from furrowmap.core.values.tool_states import ToolState

FloatArray = NDArray[np.float64]

CUT_M: Final = 0.15
CUT_PER_M: Final = 0.03
"""Points lower than this above the ground, and by so much more a metre of distance from the axle, may be soil, clods or
straw: they tell nothing of the tool."""
TOP_M: Final = 3.2
"""Above this height no tool is expected."""
_CALM_M: Final = 0.03
"""Ranges of one pixel in successive scans that differ by more are of something that moves."""
AGREE_M: Final = 0.06
"""Ranges of one pixel that differ by less are of one thing: some times the usual noise, and the slant in a pixel."""
_SEARCH_M: Final = 1.2
"""No tool is lifted higher than this."""
_MOVED_M: Final = 0.08
"""Less travel than this is taken for a frame that swings."""
USUAL_LIFT_M: Final = 0.45
"""How high a tool is lifted at the headland where nothing shows it: three-point linkages lift by 0.6 m and more at
their ends (ISO 730: 610 mm in category 1, 650 mm in category 2), and are not used to the last."""
_NOISE_M: Final = 0.03
"""Heights of successive scans that scatter by more are no heights of a tool."""
FEWEST_POINTS: Final = 25
_FEWEST_SCANS: Final = 3
_ROUNDS: Final = 3
_TRIES: Final = 6
_IMAGES: Final = 15
_MARGIN: Final = 8
"""Columns on both sides of the implement that are looked at beside its own."""

Box = tuple[float, float, float, float]
"""From, to along x, from, to along y of the vehicle frame."""
_ANYWHERE: Final[Box] = (-9.0, 4.0, -4.5, 4.5)


@dataclass(frozen=True)
class Hint:
    """Where a session says the implement is.

    Attributes:
        xy_m: middle of the tool's line in the vehicle frame.
        width_m: working width.
    """

    xy_m: tuple[float, float]
    width_m: float


@dataclass(frozen=True)
class Region:
    """Where the implement shows.

    Attributes:
        ground: height of the ground in the vehicle frame: ``z = a + b·x + c·y``.
        box_m: around it.
        columns: (COLUMNS,) bool, columns of the range image that show it.
        still_m: (lasers, COLUMNS) float32, range of what stands still there; nan elsewhere.
        split: the column farthest from it, where its view is cut into turns.
        clockwise: whether azimuth grows in the course of a scan.
        turn_s: how long a turn takes.
    """

    ground: tuple[float, float, float]
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
    azimuth_deg: FloatArray


@dataclass(frozen=True)
class Implement:
    """The implement as a session shows it.

    Attributes:
        region: where to look for it.
        template: its side view, lifted by minus `working_m` from its working position.
        working_m: height of the working position against the template; where it works out of view, as far below the
            lifted position as is usual.
        lifted_m: height of the lifted tool above its working position.
        lowest_m: lowest height at which it is in view, 0 where that is the working position.
        hidden: the state in which it is out of view: UNKNOWN where it is in view in both.
        sigma_m: standard deviation of heights, the tool standing still.
        jitter_m: the same with the tool's own movement at work.
        points: usual number of its points in a scan where it is in view.
        images: for a report.
    """

    region: Region
    template: Template
    working_m: float
    lifted_m: float
    lowest_m: float
    hidden: ToolState
    sigma_m: float
    jitter_m: float
    points: float
    images: DepthImages


@dataclass(frozen=True)
class Learned:
    """The implement, or why there is none.

    Attributes:
        implement: None where nothing was seen to move up and down.
        notices: for the report.
    """

    implement: Implement | None
    notices: tuple[Notice, ...]


def learn_implement(scans: Sequence[NearScan], hint: Hint | None) -> Learned:
    """Find the implement in scans spread over a session.

    Args:
        scans: in the order of time.
        hint: where to look; without it, all around the vehicle.
    """
    ground = _ground(scans)
    seen = _Seen.of(scans, ground, _hinted(hint) if hint is not None else _ANYWHERE)
    found = _find(seen)
    if found is not None and hint is None:
        box = _box_of(found)
        found = _find(_Seen.of(scans, ground, box)) if box is not None else None
    if found is None:
        return Learned(None, (_nothing(seen, hint),))
    return Learned(_described(found), _out_of_view(found.hidden))


def _hinted(hint: Hint) -> Box:
    (x, y), half = hint.xy_m, 0.5 * hint.width_m + 0.5
    return (x - 2.0, x + 1.2, y - half, y + half)


@dataclass(frozen=True)
class _View:
    """Points of a scan that may be the implement: float32, but `laser` (uint8) and `column` (int32)."""

    x_m: NDArray[np.float32]
    y_m: NDArray[np.float32]
    z_m: NDArray[np.float32]
    range_m: NDArray[np.float32]
    laser: NDArray[np.uint8]
    column: NDArray[np.int32]

    def differs(self, image: NDArray[np.float32], by_m: float = AGREE_M) -> NDArray[np.bool_]:
        """(n,) whether `image` shows something else there."""
        differs: NDArray[np.bool_] = _differs(image, self.laser, self.column, self.range_m, by_m)
        return differs


@dataclass(frozen=True)
class _Seen:
    """The session as its scans show it.

    Attributes:
        scans: near points of each.
        images: range image of each.
        views: of each, the points that may be the implement.
        ground: as in :class:`Region`.
        box_m: where the implement is looked for.
        grid: of side views.
    """

    scans: Sequence[NearScan]
    images: list[NDArray[np.float32]]
    views: list[_View]
    ground: tuple[float, float, float]
    box_m: Box
    grid: Grid

    @classmethod
    def of(cls, scans: Sequence[NearScan], ground: tuple[float, float, float], box: Box) -> _Seen:
        lasers = 1 + max((int(scan.laser.max(initial=0)) for scan in scans), default=0)
        grid = Grid(box[0], CUT_M, round((box[1] - box[0]) / CELL_X_M), round((TOP_M - CUT_M) / CELL_Z_M))
        views = [_view(scan, ground, box) for scan in scans]
        return cls(scans, [scan.image(lasers) for scan in scans], views, ground, box, grid)

    def side(self, number: int, kept: NDArray[np.bool_], lifted_m: float = 0.0) -> NDArray[np.float32]:
        """Side view of the points `kept` of a scan, lowered by `lifted_m`."""
        view = self.views[number]
        return self.grid.side_view(view.x_m[kept], view.z_m[kept] - np.float32(lifted_m))

    def heights(self, template: Template, still_m: NDArray[np.float32]) -> _Heights:
        """What `template` finds in the scans, where they differ from what stands still."""
        found = np.zeros((len(self.views), 3))
        for number, view in enumerate(self.views):
            side = self.side(number, view.differs(still_m))
            fit, _ = fit_height(side, template, -_SEARCH_M, _SEARCH_M)
            found[number] = fit.height_m, fit.explained, side.sum()
        return _Heights(*found.T)


@dataclass(frozen=True)
class _Heights:
    """What a template finds in all scans.

    Attributes:
        height_m: (scans,) against the reference scan; nan where nothing fits.
        explained: (scans,) points that are the tool.
        there: (scans,) points that were there to be explained.
    """

    height_m: FloatArray
    explained: FloatArray
    there: FloatArray

    @property
    def sure(self) -> NDArray[np.bool_]:
        """(scans,) whether the tool is seen there: its points are many, and many of those that there are."""
        usual = np.quantile(self.explained, 0.9)
        return (
            (np.abs(self.height_m) < _SEARCH_M - 2 * CELL_Z_M)
            & (self.explained > max(FEWEST_POINTS, 0.15 * usual))
            & (self.explained > 0.4 * self.there)
        )


@dataclass(frozen=True)
class _Found:
    """A template and what it finds.

    Attributes:
        seen: the session.
        template: of the reference's position.
        still_m: as in :class:`Region`.
        heights: of all scans.
        low_m: height of the lower position, against the reference.
        high_m: of the upper one.
        hidden: as in :class:`Implement`.
        sigma_m: as there.
        jitter_m: as there.
    """

    seen: _Seen
    template: Template
    still_m: NDArray[np.float32]
    heights: _Heights
    low_m: float
    high_m: float
    hidden: ToolState
    sigma_m: float
    jitter_m: float

    def likely(self, number: int) -> NDArray[np.bool_]:
        """Which points of a scan's view are rather the implement than clutter."""
        view, grid = self.seen.views[number], self.seen.grid
        column = ((view.x_m - grid.x_m) / CELL_X_M).astype(np.intp)
        row = ((view.z_m - self.heights.height_m[number] - grid.z_m) / CELL_Z_M).astype(np.intp)
        likely: NDArray[np.bool_] = (
            view.differs(self.still_m) & (column < grid.columns) & (row >= 0) & (row < grid.rows)
        )
        likely[likely] = self.template.odds[column[likely], row[likely]] > 1.0
        return likely


def _find(seen: _Seen) -> _Found | None:
    """What moves up and down, if anything does."""
    if len(seen.scans) < 2 * _FEWEST_SCANS:
        return None
    best: tuple[float, int, _Heights] | None = None
    calm = _calm(seen)
    still = np.flatnonzero(calm)
    if not len(still):
        return None
    waiting = [int(still[len(still) * k // 10]) for k in (5, 2, 8)]
    tried: set[int] = set()
    while waiting and len(tried) < _TRIES:
        reference = waiting.pop(0)
        if reference in tried:
            continue
        tried.add(reference)
        template = Template.of(seen.grid, seen.side(reference, _all(seen, reference)).astype(np.float64))
        heights = seen.heights(template, seen.images[reference])
        moved = heights.sure & (np.abs(heights.height_m) > _MOVED_M)
        if not moved.any():
            continue
        worth = np.where(moved, np.minimum(heights.explained, len(seen.views[reference].x_m)), 0.0)
        if best is None or worth.sum() > best[0]:
            best = float(worth.sum()), reference, heights
        waiting.append(int(np.argmax(calm * worth * np.abs(np.nan_to_num(heights.height_m)))))
    return _improved(seen, best[1], best[2]) if best is not None else None


def _calm(seen: _Seen) -> NDArray[np.bool_]:
    """(scans,) whether most of what a scan shows is as in the scan next to it.

    Where the tool moves it is not: a scan cut in the middle of the tool then shows it at two heights.
    """
    calm = np.zeros(len(seen.scans), bool)
    for number, other in _pairs(seen).tolist():
        for one, two in ((number, other), (other, number)):
            view = seen.views[one]
            calm[one] = len(view.x_m) > 0 and view.differs(seen.images[two], _CALM_M).mean() < 0.5
    return calm


def _pairs(seen: _Seen) -> NDArray[np.intp]:
    """(n, 2) numbers of scans that follow each other in the recording."""
    index = np.array([scan.index for scan in seen.scans])
    first = np.flatnonzero(np.diff(index) == 1)
    return np.column_stack([first, first + 1])


def _all(seen: _Seen, number: int) -> NDArray[np.bool_]:
    return np.ones(len(seen.views[number].x_m), bool)


def _improved(seen: _Seen, reference: int, heights: _Heights) -> _Found | None:
    """Template, what stands still, and heights in turn, from what moved against the reference scan."""
    known = heights.sure & (np.abs(heights.height_m) > _MOVED_M)
    height = np.where(known, heights.height_m, 0.0)
    still = template = None
    for _ in range(_ROUNDS):
        known[reference] = True
        middle = 0.5 * sum(np.quantile(height[known], (0.02, 0.98)))
        same_side = (height > middle) == (height[reference] > middle)
        other = known & ~same_side
        if not other.any():
            return None
        still = _still(seen, reference, other)
        views = np.zeros((seen.grid.columns, seen.grid.rows))
        for number in np.flatnonzero(known & _steady(seen, height)).tolist():
            side = seen.side(number, seen.views[number].differs(still), float(height[number]))
            views += side / max(float(side.sum()), 2.0 * FEWEST_POINTS)
        template = Template.of(seen.grid, views)
        heights = seen.heights(template, still)
        known, height = heights.sure, np.nan_to_num(heights.height_m)
    assert template is not None
    assert still is not None
    levels = _levels(seen, heights)
    return _Found(seen, template, still, heights, *levels) if levels is not None else None


def _steady(seen: _Seen, height: FloatArray) -> NDArray[np.bool_]:
    """(scans,) whether the scan next to it shows the tool at the same height."""
    steady = np.zeros(len(height), bool)
    first, second = _pairs(seen).T
    alike = np.abs(height[second] - height[first]) < _CALM_M
    steady[first[alike]] = steady[second[alike]] = True
    return steady


def _still(seen: _Seen, reference: int, other: NDArray[np.bool_]) -> NDArray[np.float32]:
    """The reference's range image where scans in the `other` position and those in its own agree with it."""
    image = seen.images[reference]
    still = np.ones(image.shape, bool)
    for side in (other, ~other):
        there, agree = np.zeros(image.shape, np.int32), np.zeros(image.shape, np.int32)
        for number in np.flatnonzero(side).tolist():
            scan = seen.scans[number]
            _compare(image, scan.laser, scan.column, scan.range_m, there, agree)
        still &= (there >= _FEWEST_SCANS) & (agree > 0.6 * there)
    return np.where(still, image, np.float32(np.nan))


def _levels(seen: _Seen, heights: _Heights) -> tuple[float, float, ToolState, float, float] | None:
    """Lower and upper position, the state in which the tool is out of view, and the heights' sigma and jitter.

    None where the heights are no heights of a tool that is lifted and lowered.
    """
    sure, height = heights.sure, heights.height_m
    if np.count_nonzero(sure) < 2 * _FEWEST_SCANS:
        return None
    upper = sure & (height > _split(height[sure]))
    lower = sure & ~upper
    low, high = float(np.median(height[lower])), float(np.median(height[upper]))
    if high - low < _MOVED_M or min(np.count_nonzero(lower), np.count_nonzero(upper)) < _FEWEST_SCANS:
        return None
    away = np.count_nonzero(~sure)
    sigma_low, sigma_high = (_sigma(seen, height, side) for side in (lower, upper))
    limit = min(_NOISE_M, (high - low) / 8.0)
    if sigma_low < limit and sigma_high < limit:
        return low, high, ToolState.UNKNOWN, min(sigma_low, sigma_high), max(sigma_low, sigma_high)
    # out of view in one state: the few heights on that side are those of the tool on its way
    if sigma_high < limit and sigma_low < 2 * _NOISE_M and away > np.count_nonzero(lower):
        return float(np.quantile(height[lower], 0.1)), high, ToolState.DOWN, sigma_high, sigma_high
    if sigma_low < limit and sigma_high < 2 * _NOISE_M and away > np.count_nonzero(upper):
        return low, float(np.quantile(height[upper], 0.9)), ToolState.UP, sigma_low, sigma_low
    return None


def _split(height: FloatArray) -> float:
    """The height that parts `height` into two groups with the least variance within (Otsu 1979)."""
    ordered = np.sort(height)
    n = np.arange(1, len(ordered))
    total, square = np.cumsum(ordered)[:-1], np.cumsum(ordered**2)[:-1]
    whole, whole_square = float(ordered.sum()), float((ordered**2).sum())
    within = square - total**2 / n + (whole_square - square) - (whole - total) ** 2 / (len(ordered) - n)
    k = int(np.argmin(within))
    return float(0.5 * (ordered[k] + ordered[k + 1]))


def _sigma(seen: _Seen, height: FloatArray, side: NDArray[np.bool_]) -> float:
    """Standard deviation of the heights on one side, by the differences of successive scans."""
    first, second = _pairs(seen).T
    step = (height[second] - height[first])[side[first] & side[second]]
    return float(1.4826 * np.median(np.abs(step)) / np.sqrt(2.0)) if len(step) else float("inf")


def _box_of(found: _Found) -> Box | None:
    """A box around the implement: where most of the scans that show it best have points that are likely its own.

    None where no place is: what was found is scattered, and no implement.
    """
    seen = found.seen
    order = np.argsort(np.where(found.heights.sure, found.heights.explained, 0.0))
    best = order[-max(_FEWEST_SCANS, len(order) // 10) :]
    bounds = ((seen.box_m[0], seen.box_m[1]), (seen.box_m[2], seen.box_m[3]))
    cells = [round((high - low) / CELL_X_M) for low, high in bounds]
    often = np.zeros(cells)
    for number in best:
        view = seen.views[number]
        likely = found.likely(number)
        often += np.histogram2d(view.x_m[likely], view.y_m[likely], cells, bounds)[0] > 0
    x, y = np.nonzero(often >= 0.5 * len(best))
    if not len(x):
        return None
    (x0, x1), (y0, y1) = (
        (low + CELL_X_M * int(at.min()), low + CELL_X_M * (int(at.max()) + 1))
        for at, (low, _) in zip((x, y), bounds, strict=True)
    )
    return (x0 - 0.5, x1 + 0.5, y0 - 0.3, y1 + 0.3)


def _ground(scans: Sequence[NearScan]) -> tuple[float, float, float]:
    """The plane on which the vehicle stands, as all scans together show it."""
    xyz = np.concatenate([scan.xyz_m[::7] for scan in scans]).astype(np.float64) if scans else np.zeros((0, 3))
    basis = np.column_stack([np.ones(len(xyz)), xyz[:, :2]])
    plane = np.zeros(3)
    for tolerance_m in (0.5, 0.3, 0.15, 0.1):
        near = np.abs(xyz[:, 2] - basis @ plane) < tolerance_m
        if np.count_nonzero(near) < 100:
            break
        plane = np.linalg.lstsq(basis[near], xyz[near, 2], rcond=None)[0]
    a, b, c = plane.tolist()
    return a, b, c


def _view(scan: NearScan, ground: tuple[float, float, float], box: Box) -> _View:
    x, y, z = scan.xyz_m.T
    above = z - np.float32(ground[0]) - np.float32(ground[1]) * x - np.float32(ground[2]) * y
    kept = (above > CUT_M + CUT_PER_M * np.hypot(x, y)) & (above < TOP_M)
    kept &= (x > box[0]) & (x < box[1]) & (y > box[2]) & (y < box[3])
    return _View(x[kept], y[kept], above[kept], scan.range_m[kept], scan.laser[kept], scan.column[kept])


def _nothing(seen: _Seen, hint: Hint | None) -> Notice:
    """Why there are no states of the tool."""
    points = float(np.median([len(view.x_m) for view in seen.views])) if seen.views else 0.0
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


def _out_of_view(hidden: ToolState) -> tuple[Notice, ...]:
    if hidden == ToolState.DOWN:
        text = (
            "The scanner sees the implement only when it is lifted. It is taken as down where it is out of view, and "
            f"its working position as {USUAL_LIFT_M:g} m below the lifted one: times and heights are rough. A scanner "
            "that looks further down sees it at work."
        )
    elif hidden == ToolState.UP:
        text = "The scanner sees the implement only when it is down. It is taken as up where it is out of view."
    else:
        return ()
    return (Notice("implement-out-of-view", text),)


def _described(found: _Found) -> Implement:
    """What is needed to see the implement in every scan, and to show it."""
    seen, heights = found.seen, found.heights
    sure = np.flatnonzero(heights.sure)
    shows = np.zeros(seen.images[0].shape, np.int32)
    for number in sure.tolist():
        likely, view = found.likely(number), seen.views[number]
        shows[view.laser[likely], view.column[likely]] += 1
    implement = shows >= max(_FEWEST_SCANS, len(sure) // 100)
    first, count = _arc(np.flatnonzero(implement.any(axis=0)))
    columns = np.zeros(COLUMNS, bool)
    columns[(first - _MARGIN + np.arange(count + 2 * _MARGIN)) % COLUMNS] = True
    region = Region(
        ground=seen.ground,
        box_m=seen.box_m,
        columns=columns,
        still_m=found.still_m,
        split=(first + count + (COLUMNS - count) // 2) % COLUMNS,
        clockwise=float(np.mean([scan.clockwise for scan in seen.scans])) > 0.5,
        turn_s=float(np.median([scan.end_s - scan.begin_s for scan in seen.scans])),
    )
    shown = (first - 2 * _MARGIN + np.arange(min(count + 4 * _MARGIN, COLUMNS))) % COLUMNS
    down, up = (
        median_image(np.stack([seen.images[k][:, shown] for k in _showing(found, state)]))
        for state in (ToolState.DOWN, ToolState.UP)
    )
    azimuth = (shown[0] + 0.5 + np.arange(len(shown))) * (360.0 / COLUMNS)
    working_m = min(found.low_m, found.high_m - USUAL_LIFT_M) if found.hidden == ToolState.DOWN else found.low_m
    return Implement(
        region=region,
        template=found.template,
        working_m=working_m,
        lifted_m=found.high_m - working_m,
        lowest_m=found.low_m - working_m,
        hidden=found.hidden,
        sigma_m=found.sigma_m,
        jitter_m=found.jitter_m,
        points=float(np.median(heights.explained[sure])),
        images=DepthImages(up, down, implement[:, shown], azimuth),
    )


def _arc(at: NDArray[np.intp]) -> tuple[int, int]:
    """First column and number of columns of the shortest arc that holds the columns `at`, given in their order."""
    gaps = np.diff(np.append(at, at[0] + COLUMNS))
    widest = int(np.argmax(gaps))
    return int(at[(widest + 1) % len(at)]), COLUMNS - int(gaps[widest]) + 1


def _showing(found: _Found, state: ToolState) -> list[int]:
    """Numbers of a few scans with the implement in a state."""
    heights = found.heights
    if state == found.hidden:
        away = np.flatnonzero(~heights.sure)
        return [int(k) for k in away[np.linspace(0, len(away) - 1, min(len(away), _IMAGES)).astype(np.intp)]]
    level = found.low_m if state == ToolState.DOWN else found.high_m
    off = np.where(heights.sure, np.abs(heights.height_m - level), np.inf)
    return [int(k) for k in np.argsort(off, kind="stable")[:_IMAGES]]


@numba.njit(cache=True, nogil=True)
def _differs(image, laser, column, range_m, by_m):  # type: ignore[no-untyped-def]
    """Whether neither the pixel of a point nor its neighbours in azimuth show its range."""
    out = np.empty(len(range_m), np.bool_)
    columns = image.shape[1]
    for i in range(len(range_m)):
        out[i] = True
        for step in (-1, 0, 1):
            if abs(image[laser[i], (column[i] + step) % columns] - range_m[i]) < by_m:
                out[i] = False
    return out


@numba.njit(cache=True, nogil=True)
def _compare(image, laser, column, range_m, there, agree):  # type: ignore[no-untyped-def]
    """Count for each pixel the points of a scan, and those whose range the image shows there."""
    columns = image.shape[1]
    for i in range(len(range_m)):
        there[laser[i], column[i]] += 1
        for step in (-1, 0, 1):
            if abs(image[laser[i], (column[i] + step) % columns] - range_m[i]) < AGREE_M:
                agree[laser[i], column[i]] += 1
                break
