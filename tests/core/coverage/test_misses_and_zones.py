"""Strips missed, and headland against body."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely

from furrowmap.core.coverage.field_boundary import boundary_on_map
from furrowmap.core.coverage.worked_ground import missed_strips, unworked_places, worked_ground
from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.readers.boundary_file import read_fields
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.session import Crs, Implement
from tests.core.implement.drives_with_tool import FRAME, PLACE_M, sample, states_of, trajectory_of
from tests.core.trajectory.drives import Drive, drive

NOTHING = shapely.Polygon()


def lane(south_m: float, width_m: float, west_m: float = 0.0, east_m: float = 100.0) -> shapely.Polygon:
    return shapely.box(west_m, south_m, east_m, south_m + width_m)


def cover(*lanes: shapely.Polygon) -> shapely.MultiPolygon:
    return shapely.MultiPolygon(list(shapely.get_parts(shapely.union_all(lanes))))


@pytest.mark.parametrize("gap_m", [0.05, 0.5, 1.6])
def test_strip_between_lanes__is_missed_if_narrower_than_the_tool(gap_m: float) -> None:
    ((kind, strip),) = missed_strips(cover(lane(0.0, 1.7), lane(1.7 + gap_m, 1.7)), NOTHING, 1.7, None)
    assert kind == "between passes"
    assert strip.area == pytest.approx(100.0 * gap_m, rel=1e-6)


@pytest.mark.parametrize("gap_m", [0.01, 1.8, 5.0])
def test_strip_between_lanes__is_none_if_wider_than_the_tool_or_a_finger(gap_m: float) -> None:
    assert missed_strips(cover(lane(0.0, 1.7), lane(1.7 + gap_m, 1.7)), NOTHING, 1.7, None) == []


def test_lanes_that_end_at_different_places__miss_nothing_beside_the_longer_one() -> None:
    assert missed_strips(cover(lane(0.0, 1.7), lane(1.7, 1.7, 20.0, 70.0)), NOTHING, 1.7, None) == []


def test_lane_between_two_longer_ones__misses_its_lacking_end() -> None:
    ((_, strip),) = missed_strips(cover(lane(0.0, 1.7), lane(1.6, 1.7, 0.0, 95.0), lane(3.2, 1.7)), NOTHING, 1.7, None)
    assert strip.area == pytest.approx(5.0 * 1.5, rel=1e-6)


def test_ground_in_doubt__is_no_miss() -> None:
    lanes = cover(lane(0.0, 1.7), lane(2.0, 1.7))
    ((_, strip),) = missed_strips(lanes, shapely.box(30.0, -5.0, 100.0, 5.0), 1.7, None)
    assert strip.area == pytest.approx(30.0 * 0.3, rel=1e-6)


@pytest.mark.parametrize("lost", ["positions", "positions at the end", "state"])
def test_lane_lost_for_some_seconds__is_no_miss_between_its_neighbours(lost: str) -> None:
    """Three lanes 0.8 m apart, the middle one with a gap of 5 s between its neighbours."""
    turn = (13.0, 0.1047, 15.0)
    truth = drive((30.0, 1.2, 0.0), turn, (30.0, 1.2, 0.0), (13.0, 0.1047, -15.0), (30.0, 1.2, 0.0))
    t = truth.t_s - truth.t_s[0]
    gap = {"positions": (55.0, 60.0), "positions at the end": (67.0, 72.0), "state": (0.0, 0.0)}[lost]
    kept = (t <= gap[0]) | (t >= gap[1])
    seen = Drive(truth.t_s[kept], truth.en_m[kept], truth.yaw_rad[kept], truth.speed_mps[kept])
    trajectory = trajectory_of(seen)
    down = [(2.0, 28.0), (45.0, 71.0), (88.0, 114.0)]
    unknown = (0.0, 0.0)
    if lost == "state":
        down[1:2] = [(45.0, 55.0), (60.0, 71.0)]
        unknown = (55.0, 60.0)
    states = states_of(trajectory, *down, unknown_s=unknown)
    ground = worked_ground(trajectory, states, Implement(0.82, (0.0, 0.0)), FRAME)
    assert ground.misses == ()


def test_strip_along_the_boundary__is_told_as_such_and_stays_inside() -> None:
    field = shapely.box(-0.5, -0.4, 100.0, 40.0)
    strips = missed_strips(cover(lane(0.0, 1.7)), NOTHING, 1.7, field)
    assert {kind for kind, _ in strips} == {"boundary"}
    assert sum(strip.area for _, strip in strips) == pytest.approx(0.4 * 100.5 + 0.5 * 1.7, rel=0.01)
    assert all(field.buffer(1e-9).covers(strip) for _, strip in strips)


@pytest.mark.parametrize("known", [True, False], ids=["boundary", "no boundary"])
def test_field_half_worked__states_what_is_left(known: bool) -> None:
    """One lane of 48 m by 1.7 m in a field of 60 by 20 m; two metres of it are driven with the tool's state unknown."""
    trajectory = trajectory_of(drive((54.0, 1.0, 0.0)), sigma=(0.01, 0.01, 0.02, 0.1, 0.1, 0.2))
    east, north = trajectory.xyz_m[0, :2]
    field = shapely.box(east - 3.0, north - 10.0, east + 57.0, north + 10.0)
    states = states_of(trajectory, (2.0, 50.0), unknown_s=(50.0, 52.0))
    ground = worked_ground(trajectory, states, Implement(1.7, (0.0, 0.0)), FRAME, field if known else None)
    figures = ground.figures
    if not known:
        assert (figures.field, ground.boundary, ground.unworked) == (None, None, ())
        return
    assert figures.field is not None
    assert (figures.field.area.grid_m2, figures.field.area.sigma_m2) == (pytest.approx(1200.0), 0.0)
    assert figures.field.worked_share == pytest.approx(48.0 * 1.7 / 1200.0, rel=0.01)
    assert figures.missed.grid_m2 == 0.0
    assert figures.field.unworked.grid_m2 == pytest.approx(1200.0 - 50.0 * 1.7, rel=1e-3)
    assert figures.field.unworked.sigma_m2 >= 2.0 * 1.7 / np.sqrt(3.0) * 0.99
    assert sum(place.area.grid_m2 for place in ground.unworked) == pytest.approx(figures.field.unworked.grid_m2)
    assert ground.boundary == field


def test_missed_island__is_between_passes_also_where_the_boundary_is_known() -> None:
    worked = cover(shapely.box(0.0, 0.0, 50.0, 50.0).difference(shapely.box(20.0, 20.0, 30.0, 20.8)))
    ((kind, strip),) = missed_strips(worked, NOTHING, 1.7, shapely.box(0.0, 0.0, 50.0, 50.0))
    assert kind == "between passes"
    assert strip.area == pytest.approx(8.0, rel=1e-6)


@pytest.mark.parametrize(("side_m", "told"), [(0.095, False), (0.11, True)])
def test_places__smaller_than_a_hundredth_of_a_square_metre_are_not_told(side_m: float, told: bool) -> None:
    field = shapely.box(0.0, 0.0, 30.0, 30.0)
    hole = shapely.box(10.0, 10.0, 10.0 + side_m, 10.0 + side_m)
    worked = cover(field.difference(hole))
    assert len(missed_strips(worked, NOTHING, 1.7, field)) == told
    assert len(unworked_places(worked, NOTHING, [], field)) == told
    assert unworked_places(worked, NOTHING, [("between passes", hole)], field) == []
    assert unworked_places(worked, hole, [], field) == []


@pytest.mark.parametrize(("wide_m", "told"), [(0.018, False), (0.022, True)])
def test_places__narrower_than_two_centimetres_are_not_told(wide_m: float, told: bool) -> None:
    field = shapely.box(0.0, 0.0, 30.0, 30.0)
    worked = cover(field.difference(shapely.box(10.0, 5.0, 10.0 + wide_m, 25.0)))
    assert len(missed_strips(worked, NOTHING, 1.7, field)) == told
    places = unworked_places(worked, NOTHING, [], field)
    assert [kind for kind, _ in places] == ["not worked"] * told
    assert [place.area for _, place in places] == pytest.approx([20.0 * wide_m] * told, rel=0.01)


@pytest.mark.parametrize(("away_m", "kind"), [(0.004, "boundary"), (0.006, "between passes")])
def test_strip__is_at_the_boundary_within_half_a_centimetre(away_m: float, kind: str) -> None:
    field = shapely.box(0.0, 0.0, 30.0, 30.0)
    strip = shapely.box(5.0, away_m, 25.0, 0.5)
    assert [told for told, _ in missed_strips(cover(field.difference(strip)), NOTHING, 1.7, field)] == [kind]


def test_ground_that_nobody_worked__is_told_the_largest_first() -> None:
    field = shapely.box(0.0, 0.0, 60.0, 30.0)
    holes = [shapely.box(5.0, 5.0, 8.0, 8.0), shapely.box(20.0, 5.0, 30.0, 15.0), shapely.box(40.0, 5.0, 45.0, 10.0)]
    worked = cover(field.difference(shapely.union_all(holes)))
    assert [place.area for _, place in unworked_places(worked, NOTHING, [], field)] == pytest.approx([100.0, 25.0, 9.0])
    assert unworked_places(worked, NOTHING, [], None) == []


def test_zones__turns_lie_in_the_headland_and_lanes_in_the_body() -> None:
    turn_s = 13.0
    truth = drive((50.0, 1.2, 0.0), (turn_s, 1.0, 15.0), (50.0, 1.2, 0.0), (turn_s, 1.0, -15.0), (50.0, 1.2, 0.0))
    trajectory = trajectory_of(truth)
    begins = [k * (50.0 + turn_s) for k in range(3)]
    states = states_of(trajectory, *((b + 2.0, b + 48.0) for b in begins))
    ground = worked_ground(trajectory, states, Implement(width_m=7.6, xy_m=(0.0, 0.0)), FRAME)
    body = [z.ground for z in ground.zones if z.kind == "body"]
    headland = [z.ground for z in ground.zones if z.kind == "headland"]
    assert len(headland) == 2  # one at each end
    assert shapely.union_all(body).intersection(ground.coverage).area == pytest.approx(ground.coverage.area, rel=1e-3)
    assert shapely.union_all(headland).intersection(shapely.union_all(body)).area < 1e-6
    t = truth.t_s - truth.t_s[0]
    turning = shapely.points(truth.en_m[(t > 50.5) & (t < 50.0 + turn_s - 0.5)] + PLACE_M)
    assert np.all(shapely.covers(shapely.union_all(headland), turning))


def test_zones__a_pass_across_the_turns_is_headland() -> None:
    """Three lanes, and a fourth pass over the ground on which the machine turned from the first to the second."""
    turn = (13.0, 1.0, 15.0)
    truth = drive(
        (40.0, 1.2, 0.0),
        turn,
        (40.0, 1.2, 0.0),
        (13.0, 1.0, -15.0),
        (37.5, 1.2, 0.0),
        (7.0, 1.0, -15.0),
        (20.0, 1.2, 0.0),
    )
    trajectory = trajectory_of(truth)
    states = states_of(trajectory, (2.0, 38.0), (55.0, 91.0), (108.0, 141.5), (150.0, 168.0))
    ground = worked_ground(trajectory, states, Implement(width_m=3.0, xy_m=(0.0, 0.0)), FRAME)
    headland = shapely.union_all([z.ground for z in ground.zones if z.kind == "headland"])
    shares = [p.ground.intersection(headland).area / p.ground.area for p in ground.passes]
    assert max(shares[:3]) < 0.15
    assert shares[3] > 0.85


@pytest.mark.parametrize(("along_s", "far"), [(12.0, False), (60.0, True)])
def test_zones__a_turn_is_one_place_unless_its_passes_end_far_apart(along_s: float, *, far: bool) -> None:
    """Of a way along the headland to a distant pass only the ends are turns; a near one takes up what it encloses."""
    quarter = (6.0, 1.0, 18.0)
    truth = drive((40.0, 1.2, 0.0), quarter, (along_s, 1.2, 0.0), quarter, (40.0, 1.2, 0.0))
    trajectory = trajectory_of(truth)
    again_s = 52.0 + along_s
    states = states_of(trajectory, (2.0, 39.0), (again_s + 1.0, again_s + 38.0))
    ground = worked_ground(trajectory, states, Implement(width_m=3.0, xy_m=(0.0, 0.0)), FRAME)
    headland = shapely.union_all([z.ground for z in ground.zones if z.kind == "headland"])
    t = truth.t_s - truth.t_s[0]
    place = np.array([truth.en_m[np.searchsorted(t, at_s)] for at_s in (39.0, 43.0, 46.0 + 0.5 * along_s, again_s)])
    leaving, turning, half_way, coming = place + PLACE_M
    assert headland.covers(shapely.Point(turning))
    enclosed = 0.85 * 0.5 * (leaving + coming) + 0.15 * half_way
    assert headland.covers(shapely.Point(enclosed)) == (not far)
    assert headland.covers(shapely.Point(half_way)) == (not far)
    assert len(shapely.get_parts(headland)) == (2 if far else 1)


def test_lifting_on_a_straight_way__is_no_turn() -> None:
    trajectory = trajectory_of(drive((60.0, 1.2, 0.0)))
    ground = worked_ground(
        trajectory, states_of(trajectory, (5.0, 25.0), (35.0, 55.0)), Implement(1.7, (-1.0, 0.0)), FRAME
    )
    assert {z.kind for z in ground.zones} == {"body"}


@pytest.mark.parametrize("name", ["tractor_loop", "tractor_fishtail"])
def test_sample__misses_and_zones_lie_in_the_field_beside_the_ground_worked(shared_data: Path, name: str) -> None:
    truth = sample(shared_data / name)
    (outline,) = read_fields(truth.boundary_file)[0]
    field = boundary_on_map(outline.outline, truth.frame)
    ground = worked_ground(truth.trajectory, truth.states, truth.session.implement, truth.frame, field)
    for place in (*ground.misses, *ground.zones):
        assert field.buffer(1e-6).covers(place.ground)
    assert all(m.ground.intersection(truth.coverage.union_all()).area < 0.02 for m in ground.misses)
    assert {z.kind for z in ground.zones} == {"headland", "body"}


def test_boundary_elsewhere__is_refused_with_its_place() -> None:
    paris = shapely.box(2.3, 48.8, 2.4, 48.9)
    with pytest.raises(InputError, match=r"48\.8500, 2\.3500") as error:
        boundary_on_map(paris, map_frame(Crs(map="EPSG:6677")))
    assert error.value.code == "boundary-elsewhere"
