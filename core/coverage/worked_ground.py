"""Worked ground: passes, coverage, overlaps, misses, headland and figures."""

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import Proj
from shapely.geometry.base import BaseGeometry

from furrowmap.core.coverage.section_lines import LineParts, line_parts
from furrowmap.core.coverage.shapes import Ribbon, areal, close_gaps, grow, join, parts, ribbons
from furrowmap.core.coverage.sweep import PassTimes, Sweep, part_sweeps, pass_times, sweeps, tool_line, unknown_times
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.values.gnss import DRIFT_CORRELATION_S
from furrowmap.core.values.session import Implement
from furrowmap.core.values.tool_states import ToolState, ToolStates
from furrowmap.core.values.trajectory import SIGMA_NAMES, Motion, Trajectory

IntArray = NDArray[np.intp]


@dataclass(frozen=True)
class ForwardRun:
    """A run forward of the tool's whole line, and the sweeps of the parts of it that work, each with its ribbons."""

    sweep: Sweep
    parts: tuple[tuple[Sweep, tuple[Ribbon, ...]], ...]

    @property
    def ribbons(self) -> list[Ribbon]:
        """Of all parts."""
        return [ribbon for _, pieces in self.parts for ribbon in pieces]


def _runs(
    trajectory: Trajectory, times: PassTimes, implement: Implement, lines: LineParts | None
) -> Iterator[ForwardRun]:
    """The runs of a pass; without parts the whole line works."""
    if lines is None:
        for sweep in sweeps(trajectory, times, implement):
            yield ForwardRun(sweep, ((sweep, tuple(ribbons(sweep))),))
        return
    for sweep, found in part_sweeps(trajectory, times, implement, lines.within(times)):
        yield ForwardRun(sweep, tuple((part, tuple(ribbons(part))) for part in found))


HEADING_CORRELATION_S: Final = 3.0
"""Time over which the error of the heading changes, measured on trajectories of the sample recordings."""
STEP_M: Final = 3.0
"""Bits of an outline that move as one."""
MAX_BITS: Final = 1_000_000
"""Of longer outlines than these bits make, the bits are longer."""
TOUCHING_M: Final = 0.01
"""What of an outline lies further from the tool's way was not drawn by it: a boundary, taken as exact."""


class OutlineErrors:
    """The ways that outlines come from, and how wrong they are; errors of the stated width and mounting are not in it.

    Args:
        trajectory: its sigma is that of a Gauss-Markov process of :data:`DRIFT_CORRELATION_S` in position and
            :data:`HEADING_CORRELATION_S` in heading.
        runs: all sweeps, each with its ribbons.
        common_share: share of the variance of the transitions' times that makes every pass longer, or every one
            shorter.
    """

    def __init__(
        self, trajectory: Trajectory, runs: Sequence[tuple[Sweep, Sequence[Ribbon]]], common_share: float = 0.0
    ) -> None:
        self._trajectory = trajectory
        self._common_share = common_share
        sides = [_segments(side, sweep.t_s[0]) for sweep, pieces in runs for r in pieces for side in (r.left, r.right)]
        ends = [end for sweep, _ in runs for end in _ends(sweep)]
        self._slip_m = np.array([slip for sweep, _ in runs for slip in (sweep.begin_slip_m, sweep.end_slip_m)])
        self._outward = np.array([_outward(sweep, k) for sweep, _ in runs for k in (0, -1)]).reshape(-1, 2)
        segments = np.concatenate([np.empty((0, 2, 3)), *sides, *ends])
        self._begin_s = segments[:, 0, 2]
        self._end_s = segments[:, 1, 2]
        self._end = np.concatenate([np.full(len(segments) - len(ends), -1), np.arange(len(ends))])
        self._lines = np.asarray(shapely.linestrings(segments[:, :, :2]), object)
        self._tree = shapely.STRtree(self._lines)

    def sigma_m2(self, shapes: Sequence[BaseGeometry]) -> FloatArray:
        """Standard deviation (n,) of the area of each of `shapes`; nan where a sigma that it needs is unknown.

        What several parts of one shape have in common is taken into account.
        """
        shape, place, normal = _outlines(shapes)
        points = np.asarray(shapely.points(place), object)
        found, source = self._sources(points)
        shape = shape[found]
        place = place[found]
        normal = normal[found]
        line = self._lines[source]
        share = shapely.line_locate_point(line, points[found], normalized=True)
        t = self._begin_s[source] + share * (self._end_s[source] - self._begin_s[source])
        variance = np.zeros(len(shapes))
        order = np.lexsort((t, shape))
        for effect, correlation_s in self._effects(t, place, normal):
            _add_correlated(shape[order], t[order], effect[order], correlation_s, variance)
        self._add_transitions(shape, self._end[source], normal, variance)
        return np.sqrt(np.maximum(variance, 0.0))

    def _sources(self, points: NDArray[np.object_]) -> tuple[IntArray, IntArray]:
        """(which of `points`, index of the nearest line), for those that lie on a line."""
        point, line = self._tree.query(points, predicate="dwithin", distance=TOUCHING_M)
        order = np.lexsort((shapely.distance(points[point], self._lines[line]), point))
        point = point[order]
        line = line[order]
        nearest = np.diff(point, prepend=-1) > 0
        return point[nearest], line[nearest]

    def _effects(self, t_s: FloatArray, place: FloatArray, normal: FloatArray) -> list[tuple[FloatArray, float]]:
        """What one standard deviation of easting, of northing and of heading at `t_s` adds to an area, each (n,)."""
        knots = self._trajectory.t_s
        sigma = self._trajectory.sigma
        e, n, heading = (
            np.interp(t_s, knots, sigma[:, SIGMA_NAMES.index(name)]) for name in ("e_m", "n_m", "heading_deg")
        )
        lever = place - np.column_stack([np.interp(t_s, knots, self._trajectory.xyz_m[:, k]) for k in range(2)])
        turned = normal[:, 0] * lever[:, 1] - normal[:, 1] * lever[:, 0]
        return [
            (e * normal[:, 0], DRIFT_CORRELATION_S),
            (n * normal[:, 1], DRIFT_CORRELATION_S),
            (np.radians(heading) * turned, HEADING_CORRELATION_S),
        ]

    def _add_transitions(self, shape: IntArray, end: IntArray, normal: FloatArray, variance: FloatArray) -> None:
        """Add the variance from the times of the tool's transitions: each by itself, and what they have in common."""
        at_end = end >= 0
        shape = shape[at_end]
        end = end[at_end]
        normal = normal[at_end]
        moved = np.einsum("ij,ij->i", normal, self._outward[end])
        keys, which = np.unique(np.column_stack([shape, end]), axis=0, return_inverse=True)
        added = np.bincount(which.ravel(), weights=moved, minlength=len(keys)) * self._slip_m[keys[:, 1]]
        together = np.bincount(keys[:, 0], weights=added, minlength=len(variance))
        np.add.at(variance, keys[:, 0], (1.0 - self._common_share) * added**2)
        variance += self._common_share * together**2


def _segments(side: FloatArray, t0_s: float) -> FloatArray:
    """(n − 1, 2, 3) the lines between the vertices of a ribbon's side, with UTC."""
    side = side + np.array([0.0, 0.0, t0_s])
    return np.stack([side[:-1], side[1:]], axis=1)


def _ends(sweep: Sweep) -> list[FloatArray]:
    """(1, 2, 3) the tool's line at the beginning and the end of a sweep."""
    ends = []
    for k in (0, -1):
        middle = sweep.middle_m[k, :2]
        half = sweep.half_m[k]
        t = sweep.t_s[k]
        ends.append(np.array([[[*(middle + half), t], [*(middle - half), t]]]))
    return ends


def _outward(sweep: Sweep, k: int) -> FloatArray:
    """The unit vector at right angles to the tool's line, away from the sweep: backward at its beginning (0)."""
    x, y = sweep.half_m[k].tolist()
    return np.array([y, -x]) / math.copysign(math.hypot(x, y), -1.0 if k == 0 else 1.0)


def _outlines(shapes: Sequence[BaseGeometry]) -> tuple[IntArray, FloatArray, FloatArray]:
    """Bits of the outlines: (n,) which shape, (n, 2) middle, (n, 2) normal times length, outward."""
    pieces, shape = shapely.get_parts(np.asarray(shapes, object), return_index=True)
    step_m = max(STEP_M, float(shapely.length(pieces).sum()) / MAX_BITS)
    rings, piece = shapely.get_rings(shapely.segmentize(pieces, step_m), return_index=True)
    xy, ring = shapely.get_coordinates(rings, return_index=True)
    same = ring[1:] == ring[:-1]
    begin = xy[:-1][same]
    step = np.diff(xy, axis=0)[same]
    ring = ring[1:][same]
    middle = begin + 0.5 * step
    away = begin - begin[np.searchsorted(ring, ring)]
    twice = np.bincount(ring, weights=away[:, 0] * step[:, 1] - away[:, 1] * step[:, 0], minlength=len(rings))
    hole = np.diff(piece, prepend=-1) == 0
    sign = np.where(twice > 0, 1.0, -1.0) * np.where(hole, -1.0, 1.0)
    normal = sign[ring][:, None] * np.column_stack([step[:, 1], -step[:, 0]])
    return shape[piece[ring]], middle, normal


@kernel()
def _add_correlated(shape, t_s, effect, correlation_s, variance):  # type: ignore[no-untyped-def]
    """Add Σᵢⱼ effectᵢ effectⱼ exp(−|tᵢ − tⱼ| / correlation) of each shape; sorted by shape, then time."""
    carried = 0.0
    for i in range(len(t_s)):
        if i > 0 and shape[i] == shape[i - 1]:
            carried = (carried + effect[i - 1]) * np.exp(-(t_s[i] - t_s[i - 1]) / correlation_s)
        else:
            carried = 0.0
        variance[shape[i]] += effect[i] * (effect[i] + 2.0 * carried)


MIN_STRIP_WIDTH_M: Final = 0.02
"""Narrower strips are ignored."""
MIN_STRIP_AREA_M2: Final = 0.01
TOUCHES_M: Final = 0.005
SAME_TIME_S: Final = 1e-5
"""Between the end of a ribbon and the beginning of that which follows it lies nothing but rounding."""

TURN_RAD: Final = np.radians(60.0)
"""Between two passes whose headings differ by less the tool was lifted, but the machine did not turn."""
HEADLAND_REACH_M: Final = 12.0
REACH_WIDTHS: Final = 3.0
"""No turn reaches further from the ends of its passes than the larger of these; what does is a drive elsewhere."""
INSIDE_SHARE: Final = 0.5


def overlapping(passes: Sequence[Sequence[ForwardRun]]) -> dict[tuple[int, int], list[shapely.Polygon]]:
    """For each pair of passes the places that both worked, a polygon a place; the earlier pass stands first.

    A pass that comes back to its own ground overlaps itself. Ribbons that follow each other in one run do not: where
    they touch, the tool turned, or other sections of it work. `passes` are the runs of each, in the order of time.
    """
    runs = [(number, run) for number, found in enumerate(passes, start=1) for run in found]
    rows = [
        (ribbon.polygon, number, k, sweep.t_s[0] + ribbon.left[0, 2], sweep.t_s[0] + ribbon.left[-1, 2])
        for k, (number, run) in enumerate(runs)
        for sweep, pieces in run.parts
        for ribbon in pieces
    ]
    pieces = np.array([row[0] for row in rows], object)
    number = np.array([row[1] for row in rows], np.intp)
    run = np.array([row[2] for row in rows], np.intp)
    begin_s = np.array([row[3] for row in rows], np.float64)
    end_s = np.array([row[4] for row in rows], np.float64)
    first, second = shapely.STRtree(pieces).query(pieces, predicate="intersects")
    follows = (run[first] == run[second]) & (np.abs(begin_s[second] - end_s[first]) < SAME_TIME_S)
    distinct = (first < second) & ~follows
    first = first[distinct]
    second = second[distinct]
    shared = defaultdict(list)
    for a, b, piece in zip(
        number[first].tolist(),
        number[second].tolist(),
        shapely.intersection(pieces[first], pieces[second]),
        strict=True,
    ):
        if piece.area > 0.0:
            shared[a, b].append(piece)
    found = {pair: parts(shapely.union_all(shapely.make_valid(places))) for pair, places in sorted(shared.items())}
    return {pair: places for pair, places in found.items() if places}


def missed_strips(
    coverage: shapely.MultiPolygon, doubtful: BaseGeometry, width_m: float, boundary: BaseGeometry | None
) -> list[tuple[str, shapely.Polygon]]:
    """The strips missed, each with its kind: `between passes`, or `boundary` where the field's boundary is one side.

    A strip is ground not worked that is narrower than the tool, so that no whole pass has room in it: what a closing
    (widening all that is worked, or lies outside the field, by half the tool's width and narrowing it again) adds.
    Wider ground was not missed, it has not been worked yet. No part of `doubtful`, ground of which it is not known
    whether it was worked, is a miss.
    """
    taken: BaseGeometry = coverage
    if boundary is not None:
        box = shapely.box(*shapely.union(coverage, boundary).bounds).buffer(2.0 * width_m, join_style="mitre")
        taken = coverage.union(box.difference(boundary))
    strips = close_gaps(taken, width_m)
    if boundary is not None:
        strips = areal(strips.intersection(boundary))
    strips = areal(strips.difference(coverage.union(doubtful)))
    wide = grow(grow(strips, -0.5 * MIN_STRIP_WIDTH_M), 0.5 * MIN_STRIP_WIDTH_M).intersection(strips)
    found = []
    for strip in parts(wide):
        at_boundary = boundary is not None and strip.distance(boundary.boundary) < TOUCHES_M
        if strip.area >= MIN_STRIP_AREA_M2:
            found.append(("boundary" if at_boundary else "between passes", strip))
    return found


def unworked_places(
    coverage: shapely.MultiPolygon,
    doubtful: BaseGeometry,
    strips: Sequence[tuple[str, shapely.Polygon]],
    boundary: BaseGeometry | None,
) -> list[tuple[str, shapely.Polygon]]:
    """Ground of the field neither worked nor missed, by place with the kind `not worked`, the largest first.

    No part of `doubtful`, of which it is not known whether it was worked, is counted; without a boundary there is none.
    """
    if boundary is None:
        return []
    rest = boundary.difference(shapely.union_all([coverage, doubtful, *(strip for _, strip in strips)]))
    wide = areal(grow(grow(rest, -0.5 * MIN_STRIP_WIDTH_M), 0.5 * MIN_STRIP_WIDTH_M).intersection(rest))
    return [("not worked", place) for place in parts(wide) if place.area >= MIN_STRIP_AREA_M2]


def zones(
    trajectory: Trajectory,
    passes: Sequence[Sequence[ForwardRun]],
    implement: Implement,
    boundary: BaseGeometry | None,
) -> list[tuple[str, shapely.Polygon]]:
    """The field's zones, `headland` and `body`, each a list of places that do not overlap.

    The headland is the ground that turns take up, and whatever was worked mostly on it; the body is all other ground
    worked, with the strips left between its passes. Neither reaches over the field's boundary, where that is known.
    `passes` are the runs of each pass, in the order of time.
    """
    turning = shapely.union_all(list(_turns(trajectory, [runs for runs in passes if runs], implement)))
    pieces = np.array([ribbon.polygon for runs in passes for run in runs for ribbon in run.ribbons], object)
    places = shapely.get_parts(turning)
    piece, place = shapely.STRtree(places).query(pieces, predicate="intersects")
    shared_m2 = shapely.area(shapely.intersection(pieces[piece], places[place]))
    on_turn_m2 = np.bincount(piece, shared_m2, len(pieces))
    on_turns = on_turn_m2 > INSIDE_SHARE * shapely.area(pieces)
    width_m = implement.width_m
    body = close_gaps(shapely.union_all(pieces[~on_turns]), width_m)
    headland = close_gaps(shapely.union_all([turning, *pieces[on_turns]]), width_m).difference(body)
    if boundary is not None:
        body = areal(body.intersection(boundary))
        headland = areal(headland.intersection(boundary))
    return [("body", part) for part in parts(body)] + [("headland", part) for part in parts(headland)]


def _turns(
    trajectory: Trajectory, passes: Sequence[Sequence[ForwardRun]], implement: Implement
) -> Iterator[BaseGeometry]:
    """The ground that each turn between two passes takes up: the hull of the tool's line near the passes' ends."""
    reach_m = max(HEADLAND_REACH_M, REACH_WIDTHS * implement.width_m)
    for before, after in pairwise(passes):
        leaving = before[-1].sweep
        coming = after[0].sweep
        a = leaving.half_m[-1]
        b = coming.half_m[0]
        turn = np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b)
        if abs(turn) < TURN_RAD:
            continue
        knots = slice(*np.searchsorted(trajectory.t_s, [leaving.t_s[-1], coming.t_s[0]]).tolist())
        middle, left = (axis[:, :2] for axis in tool_line(trajectory, knots, implement))
        half = 0.5 * implement.width_m * left
        way = np.concatenate([leaving.middle_m[-1:, :2], middle, coming.middle_m[:1, :2]])
        half = np.concatenate([leaving.half_m[-1:], half, coming.half_m[:1]])
        near = [np.hypot(*(way - way[end]).T) <= reach_m for end in (0, -1)]
        if math.dist(way[0], way[-1]) <= 2.0 * reach_m:
            near = [near[0] | near[1]]
        for part in near:
            yield shapely.MultiPoint(np.concatenate([(way + half)[part], (way - half)[part]])).convex_hull


@dataclass(frozen=True)
class Hours:
    """Seconds between the beginning of the first pass and the end of the last; the parts add up to the whole.

    Attributes:
        field_s: the whole.
        working_s: forward, the tool down.
        turning_s: moving with the tool up, or backwards.
        idle_s: standing.
        unknown_s: moving forward, the tool's state unknown.
        unplaced_s: without a position.
    """

    field_s: float
    working_s: float
    turning_s: float
    idle_s: float
    unknown_s: float
    unplaced_s: float


def hours(trajectory: Trajectory, states: ToolStates, begin_s: float, end_s: float) -> Hours:
    """How the time from `begin_s` to `end_s` was spent."""
    cuts = np.concatenate([trajectory.t_s, states.begin_s, states.end_s, [begin_s, end_s]])
    t = np.unique(np.clip(cuts, begin_s, end_s))
    length = np.diff(t)
    middle = 0.5 * (t[1:] + t[:-1])
    knot, _, placed = trajectory.interval(middle)
    motion = trajectory.motion[knot]
    state = states.at(middle)[0]
    standing = placed & (motion == Motion.STANDING)
    forward = placed & (motion == Motion.FORWARD)
    back = placed & (motion == Motion.REVERSE)
    spent = [
        forward & (state == ToolState.DOWN),
        forward & (state == ToolState.UP) | back,
        standing,
        forward & (state == ToolState.UNKNOWN),
        ~placed,
    ]
    return Hours(float(end_s - begin_s), *(float(length[part].sum()) for part in spent))


@dataclass(frozen=True)
class AreaFigure:
    """How much ground, seen from above.

    Attributes:
        grid_m2: in the map's plane.
        ellipsoid_m2: on the ellipsoid: the map's scale at the place taken out.
        sigma_m2: standard deviation of either, from positions, headings, times of transitions, and ground of which it
            is not known whether it was worked; nan where unknown.
    """

    grid_m2: float
    ellipsoid_m2: float
    sigma_m2: float


@dataclass(frozen=True)
class Pass:
    """The ground worked from one lowering of the tool to its lifting.

    It is empty where no position is known; `speed_mps` is the mean while moving, or nan; `swept_m2` counts ground that
    the pass worked again.
    """

    number: int
    times: PassTimes
    ground: shapely.MultiPolygon
    area: AreaFigure
    length_m: float
    width_m: float
    speed_mps: float
    swept_m2: float


@dataclass(frozen=True)
class Overlap:
    """A place that two passes worked, the earlier one `pass_a`, or one pass twice, which both then are."""

    pass_a: int
    pass_b: int
    ground: shapely.Polygon
    area: AreaFigure


@dataclass(frozen=True)
class FieldPlace:
    """A place; `kind` is `between passes` or `boundary` of a miss, `headland` or `body` of a zone."""

    kind: str
    ground: shapely.Polygon
    area: AreaFigure


@dataclass(frozen=True)
class FieldFigures:
    """How much of a field, whose boundary is taken as exact, was worked, and what was neither worked nor missed."""

    area: AreaFigure
    worked_share: float
    unworked: AreaFigure


@dataclass(frozen=True)
class WorkFigures:
    """Summary figures.

    Attributes:
        worked: the ground worked, once however often.
        swept_m2: width times path length of all passes, as the counter of a machine.
        overlap: the places of all pairs of passes, added up.
        field: how much of the field was worked; None where its boundary is not known.
        passes: those whose ground is known at least in part.
        unplaced_passes: those with time without a position, whose ground is not known there, or nowhere.
        length_m: driven forward with the tool down.
        speed_mps: mean while working; nan where nothing was worked.
        work_rate_ha_h: ground worked an hour in the field, turns and stops included; nan likewise.
    """

    worked: AreaFigure
    swept_m2: float
    overlap: AreaFigure
    missed: AreaFigure
    field: FieldFigures | None
    passes: int
    unplaced_passes: int
    length_m: float
    speed_mps: float
    work_rate_ha_h: float
    hours: Hours


@dataclass(frozen=True)
class WorkedGround:
    """The worked ground of a session.

    Attributes:
        passes: in the order of time.
        overlaps: by pass and later pass.
        misses: strips left, from the largest to the smallest.
        boundary: the field; None where it is not known.
        unworked: ground of the field that was neither worked nor missed, from the largest place to the smallest.
    """

    passes: tuple[Pass, ...]
    coverage: shapely.MultiPolygon
    overlaps: tuple[Overlap, ...]
    misses: tuple[FieldPlace, ...]
    boundary: BaseGeometry | None
    unworked: tuple[FieldPlace, ...]
    zones: tuple[FieldPlace, ...]
    figures: WorkFigures


def worked_ground(
    trajectory: Trajectory,
    states: ToolStates,
    implement: Implement,
    frame: MapFrame,
    boundary: BaseGeometry | None = None,
) -> WorkedGround:
    """The ground that the tool worked.

    Its states and the trajectory of the vehicle frame may have any rate; width and place of the tool's line, and the
    boundary of the field, are taken as exact. While the states of its sections are known, those that are down work.
    """
    times = pass_times(states)
    at_work = line_parts(states.sections, implement, ToolState.DOWN)
    work = [list(_runs(trajectory, when, implement, at_work)) for when in times]
    runs = [run for pass_ in work for run in pass_]
    grounds = [join(ribbon.polygon for run in pass_ for ribbon in run.ribbons) for pass_ in work]
    coverage = join(grounds)
    shared = overlapping(work)
    gaps_s = trajectory.gaps_s
    unplaced = [_unplaced_ground(trajectory, gaps_s, when, implement) for when in times]
    unknown = [run for when in unknown_times(states) for run in _runs(trajectory, when, implement, None)]
    in_doubt = line_parts(states.sections, implement, ToolState.UNKNOWN)
    if in_doubt is not None:
        unknown += [run for when in times for run in _runs(trajectory, when, implement, in_doubt)]
    swept_unknown = shapely.union_all([ribbon.polygon for run in unknown for ribbon in run.ribbons])
    doubtful = shapely.union_all([swept_unknown, *unplaced])
    strips = missed_strips(coverage, doubtful, implement.width_m, boundary)
    left = unworked_places(coverage, doubtful, strips, boundary)
    errors = OutlineErrors(trajectory, [part for run in runs for part in run.parts], states.common_share)
    areas = _Areas(frame, errors)
    parts = zip(times, work, grounds, areas.measure(grounds, unplaced), strict=True)
    passes = tuple(_pass(number, *part, implement) for number, part in enumerate(parts, start=1))
    pairs = [(pair, place) for pair, places in shared.items() for place in places]
    spent = hours(trajectory, states, times[0].begin_s, times[-1].end_s) if times else Hours(0, 0, 0, 0, 0, 0)
    (worked,) = areas.measure([coverage], [doubtful])
    shared_all = shapely.GeometryCollection([place for _, place in pairs])
    overlap, missing = areas.measure([shared_all, _all(strips)])
    length_m = sum(p.length_m for p in passes)
    moving_s = sum(run.sweep.moving_s for run in runs)
    figures = WorkFigures(
        worked=worked,
        swept_m2=sum(p.swept_m2 for p in passes),
        overlap=overlap,
        missed=missing,
        field=areas.measure_field(boundary, coverage, _all(left), doubtful) if boundary is not None else None,
        passes=sum(not one.ground.is_empty for one in passes),
        unplaced_passes=sum(_has_gap(trajectory, when) for when in times),
        length_m=length_m,
        speed_mps=length_m / moving_s if moving_s else float("nan"),
        work_rate_ha_h=0.36 * worked.ellipsoid_m2 / spent.field_s if spent.field_s else float("nan"),
        hours=spent,
    )
    return WorkedGround(
        passes=passes,
        coverage=coverage,
        overlaps=areas.overlaps(pairs),
        misses=areas.places(strips),
        boundary=boundary,
        unworked=areas.places(left),
        zones=areas.places(zones(trajectory, work, implement, boundary)),
        figures=figures,
    )


def _all(places: Sequence[tuple[str, shapely.Polygon]]) -> shapely.MultiPolygon:
    return shapely.MultiPolygon([ground for _, ground in places])


def _has_gap(trajectory: Trajectory, times: PassTimes) -> bool:
    """Whether a pass has time without a position: in a gap of the trajectory, or beyond its ends."""
    begin_s, end_s = trajectory.span_s
    beyond_s = max(begin_s - times.begin_s, times.end_s - end_s)
    gaps_s = trajectory.gaps_s
    return beyond_s > trajectory.max_gap_s or bool(
        ((gaps_s[:, 0] < times.end_s) & (gaps_s[:, 1] > times.begin_s)).any()
    )


def _unplaced_ground(
    trajectory: Trajectory, gaps_s: FloatArray, times: PassTimes, implement: Implement
) -> BaseGeometry:
    """Where the tool may have been in gaps during a pass: between its last place before and its first after each."""
    found = []
    for begin_s in gaps_s[(gaps_s[:, 0] < times.end_s) & (gaps_s[:, 1] > times.begin_s), 0]:
        knot = int(np.searchsorted(trajectory.t_s, begin_s))
        middle, left = tool_line(trajectory, slice(knot, knot + 2), implement)
        half = 0.5 * implement.width_m * left
        found.append(shapely.MultiPoint(np.concatenate([middle + half, middle - half])[:, :2]).convex_hull)
    return shapely.union_all(found)


def _pass(
    number: int,
    times: PassTimes,
    runs: Sequence[ForwardRun],
    ground: shapely.MultiPolygon,
    area: AreaFigure,
    implement: Implement,
) -> Pass:
    length_m = float(sum(run.sweep.distance_m[-1] for run in runs))
    moving_s = sum(run.sweep.moving_s for run in runs)
    return Pass(
        number=number,
        times=times,
        ground=ground,
        area=area,
        length_m=length_m,
        width_m=implement.width_m,
        speed_mps=length_m / moving_s if moving_s else float("nan"),
        swept_m2=float(sum(ribbon.polygon.area for run in runs for ribbon in run.ribbons)),
    )


class _Areas:
    """Measures shapes."""

    def __init__(self, frame: MapFrame, errors: OutlineErrors) -> None:
        self._frame = frame
        self._errors = errors

    def measure(
        self, shapes: Sequence[BaseGeometry], doubtful: Sequence[BaseGeometry] | None = None
    ) -> list[AreaFigure]:
        """The areas of `shapes`, each with the ground in `doubtful` that may belong to it but is not counted.

        Any part of such ground is as likely as any other: a third of its square is added to the variance.
        """
        sigma = self._errors.sigma_m2(shapes)
        if doubtful is not None:
            sigma = np.hypot(sigma, shapely.area(shapely.difference(doubtful, shapes)) / np.sqrt(3.0))
        grid = shapely.area(np.asarray(shapes, object))
        columns = (grid, self._on_ellipsoid(shapes), sigma)
        return [AreaFigure(*values) for values in zip(*(column.tolist() for column in columns), strict=True)]

    def measure_field(
        self, boundary: BaseGeometry, coverage: BaseGeometry, left: BaseGeometry, doubtful: BaseGeometry
    ) -> FieldFigures:
        """How much of the ground inside `boundary` was worked; `left` is what was not."""
        (area,) = self.measure([boundary])
        (unworked_area,) = self.measure([left], [doubtful])
        share = coverage.intersection(boundary).area / boundary.area
        return FieldFigures(replace(area, sigma_m2=0.0), share, unworked_area)

    def overlaps(self, shared: Sequence[tuple[tuple[int, int], shapely.Polygon]]) -> tuple[Overlap, ...]:
        """The places shared by pairs of passes."""
        found = self.measure([place for _, place in shared])
        return tuple(Overlap(*pair, place, area) for (pair, place), area in zip(shared, found, strict=True))

    def places(self, shapes: Sequence[tuple[str, shapely.Polygon]]) -> tuple[FieldPlace, ...]:
        """The places of `shapes`, each given with its kind."""
        return tuple(
            FieldPlace(kind, ground, area)
            for (kind, ground), area in zip(shapes, self.measure([ground for _, ground in shapes]), strict=True)
        )

    def _on_ellipsoid(self, shapes: Sequence[BaseGeometry]) -> FloatArray:
        """Areas (n,) on the ellipsoid: each polygon's by the map's areal scale at its centroid."""
        # Along a polygon the scale is linear to a part in 10⁸ per kilometre squared: that at the centroid is the mean.
        pieces, shape = shapely.get_parts(np.asarray(shapes, object), return_index=True)
        middle = shapely.get_coordinates(shapely.centroid(pieces))
        scale = np.ones(len(pieces))
        if len(pieces):
            factors = Proj(self._frame.crs).get_factors(*self._frame.to_lon_lat(*middle.T))
            scale = np.asarray(factors.areal_scale, np.float64)
        return np.bincount(shape, shapely.area(pieces) / scale, len(shapes)).astype(np.float64)
