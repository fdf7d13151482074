"""Worked ground: passes, coverage, overlaps, misses and figures."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from pyproj import Proj
from shapely.geometry.base import BaseGeometry

from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.session import Implement
from furrowmap.core.values.tool_states import ToolState, ToolStates
from furrowmap.core.values.trajectory import Motion, Trajectory
from furrowmap.core.work.misses import missed_strips, unworked_places
from furrowmap.core.work.ribbon import Ribbon, ribbons
from furrowmap.core.work.shapes import join, parts
from furrowmap.core.work.sweep import PassTimes, Sweep, pass_times, sweeps, tool_line, unknown_times
from furrowmap.core.work.uncertainty import OutlineErrors
from furrowmap.core.work.zones import zones


def overlapping(runs: Sequence[tuple[int, Sequence[Ribbon]]]) -> dict[tuple[int, int], list[shapely.Polygon]]:
    """For each pair of passes the places that both worked, a polygon a place; the earlier pass stands first.

    A pass that comes back to its own ground overlaps itself. Ribbons that follow each other in one run do not: where
    they touch, the tool turned.

    Args:
        runs: number of the pass and ribbons of each run, in the order of time.
    """
    pieces = np.array([r.polygon for _, ribbons in runs for r in ribbons], object)
    number = np.array([number for number, ribbons in runs for _ in ribbons], np.intp)
    run = np.repeat(np.arange(len(runs)), [len(ribbons) for _, ribbons in runs])
    first, second = shapely.STRtree(pieces).query(pieces, predicate="intersects")
    distinct = (first < second) & ~((run[first] == run[second]) & (second == first + 1))
    first, second = first[distinct], second[distinct]
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
    length, middle = np.diff(t), 0.5 * (t[1:] + t[:-1])
    knot, _, placed = trajectory.interval(middle)
    motion, state = trajectory.motion[knot], states.at(middle)[0]
    standing = placed & (motion == Motion.STANDING)
    forward, back = placed & (motion == Motion.FORWARD), placed & (motion == Motion.REVERSE)
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

    Attributes:
        number: 1 for the first.
        ground: what the tool's line swept while it moved forward; empty where no position is known.
        length_m: driven forward with the tool down.
        speed_mps: mean while moving; nan where it did not move.
        swept_m2: the areas of all its pieces added up, ground that it worked again counted again.
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
    """A place that two passes worked, or one pass twice.

    Attributes:
        pass_a: number of the earlier pass.
        pass_b: number of the later one; `pass_a` where a pass came back to its own ground.
    """

    pass_a: int
    pass_b: int
    ground: shapely.Polygon
    area: AreaFigure


@dataclass(frozen=True)
class FieldPlace:
    """A place of some kind.

    Attributes:
        kind: of a miss `between passes` or `boundary`, of a zone `headland` or `body`.
    """

    kind: str
    ground: shapely.Polygon
    area: AreaFigure


@dataclass(frozen=True)
class FieldFigures:
    """How much of a field was worked.

    Attributes:
        area: of the ground inside its boundary, which is taken as exact.
        worked_share: of that ground.
        unworked: ground of the field that was neither worked nor missed.
    """

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
        missed: all strips missed.
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

    Args:
        trajectory: of the vehicle frame, at any rate.
        states: when the tool was down.
        implement: width and place of the tool's line; taken as exact.
        boundary: the field in the map frame, if known; taken as exact.
    """
    times = pass_times(states)
    work = [[(sweep, ribbons(sweep)) for sweep in sweeps(trajectory, when, implement)] for when in times]
    runs = [(number, run) for number, pass_ in enumerate(work, start=1) for run in pass_]
    grounds = [join(r.polygon for _, pieces in pass_ for r in pieces) for pass_ in work]
    coverage = join(grounds)
    shared = overlapping([(number, pieces) for number, (_, pieces) in runs])
    gaps_s = trajectory.gaps_s
    unplaced = [_unplaced_ground(trajectory, gaps_s, when, implement) for when in times]
    unknown = [sweep for when in unknown_times(states) for sweep in sweeps(trajectory, when, implement)]
    swept_unknown = shapely.union_all([ribbon.polygon for sweep in unknown for ribbon in ribbons(sweep)])
    doubtful = shapely.union_all([swept_unknown, *unplaced])
    strips = missed_strips(coverage, doubtful, implement.width_m, boundary)
    left = unworked_places(coverage, doubtful, strips, boundary)
    areas = _Areas(frame, OutlineErrors(trajectory, [run for _, run in runs], states.common_share))
    parts = zip(times, work, grounds, areas.measure(grounds, unplaced), strict=True)
    passes = tuple(_pass(number, *part, implement) for number, part in enumerate(parts, start=1))
    pairs = [(pair, place) for pair, places in shared.items() for place in places]
    spent = hours(trajectory, states, times[0].begin_s, times[-1].end_s) if times else Hours(0, 0, 0, 0, 0, 0)
    (worked,) = areas.measure([coverage], [doubtful])
    shared_all = shapely.GeometryCollection([place for _, place in pairs])
    overlap, missing = areas.measure([shared_all, _all(strips)])
    length_m, moving_s = sum(p.length_m for p in passes), sum(sweep.moving_s for _, (sweep, _) in runs)
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
    runs: Sequence[tuple[Sweep, Sequence[Ribbon]]],
    ground: shapely.MultiPolygon,
    area: AreaFigure,
    implement: Implement,
) -> Pass:
    length_m = float(sum(sweep.distance_m[-1] for sweep, _ in runs))
    moving_s = sum(sweep.moving_s for sweep, _ in runs)
    return Pass(
        number=number,
        times=times,
        ground=ground,
        area=area,
        length_m=length_m,
        width_m=implement.width_m,
        speed_mps=length_m / moving_s if moving_s else float("nan"),
        swept_m2=float(sum(r.polygon.area for _, pieces in runs for r in pieces)),
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
        (area,), (unworked_area,) = self.measure([boundary]), self.measure([left], [doubtful])
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
