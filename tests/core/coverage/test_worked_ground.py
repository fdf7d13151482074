"""Ground worked, against closed forms, laws that hold for every drive, and the sample recordings' truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pyproj import Geod

from furrowmap.core.coverage.worked_ground import WorkedGround, worked_ground
from furrowmap.core.values.session import Implement
from furrowmap.core.values.tool_states import ToolStates
from furrowmap.core.values.trajectory import trajectory_from_attitude
from tests.core.implement.drives_with_tool import (
    FRAME,
    PLACE_M,
    Sample,
    disturbed,
    sample,
    states_of,
    thinned,
    trajectory_of,
)
from tests.core.trajectory.drives import Drive, drive

SAMPLES = ("tractor_loop", "tractor_fishtail")
TILLER = Implement(width_m=1.7, xy_m=(-1.62, 0.0))


def way_and_turn(truth: Drive, begin_s: float, end_s: float) -> tuple[float, float]:
    """Way of the axle in metres and turn in radians between times after the beginning."""
    t = truth.t_s - truth.t_s[0]
    fine = np.linspace(begin_s, end_s, 20_001)
    way = float(np.trapezoid(np.interp(fine, t, truth.speed_mps), fine))
    begin, end = np.interp([begin_s, end_s], t, truth.yaw_rad)
    return way, float(end - begin)


def worked(truth: Drive, *down_s: tuple[float, float], tool: Implement = TILLER) -> WorkedGround:
    trajectory = trajectory_of(truth)
    return worked_ground(trajectory, states_of(trajectory, *down_s), tool, FRAME)


def iou(a: shapely.Geometry, b: shapely.Geometry) -> float:
    return a.intersection(b).area / a.union(b).area


@pytest.mark.parametrize("x_m", [-3.0, 0.0, 2.5])
@pytest.mark.parametrize("yaw_deg", [0.0, 33.0, 200.0])
def test_straight_pass__is_width_times_way(x_m: float, yaw_deg: float) -> None:
    truth = drive((60.0, 1.5, 0.0), yaw_deg=yaw_deg)
    ground = worked(truth, (3.217, 55.551), tool=Implement(width_m=3.0, xy_m=(x_m, 0.4)))
    way, _ = way_and_turn(truth, 3.217, 55.551)
    (only,) = ground.passes
    assert only.area.grid_m2 == pytest.approx(3.0 * way, rel=1e-5)
    assert only.length_m == pytest.approx(way, rel=1e-5)
    assert only.speed_mps == pytest.approx(1.5, rel=1e-3)
    assert only.ground.minimum_rotated_rectangle.area == pytest.approx(only.ground.area, rel=1e-5)
    assert shapely.get_num_coordinates(only.ground) < 20
    assert ground.overlaps == ground.misses == ()


@pytest.mark.parametrize("turn_dps", [-12.0, 12.0])
@pytest.mark.parametrize("y_m", [0.0, 0.8])
def test_curved_pass__is_width_times_the_way_of_the_tool(turn_dps: float, y_m: float) -> None:
    """A point y to the left of the axle's middle goes forward by way − y · turn."""
    truth = drive((18.0, 1.4, turn_dps))
    tool = Implement(width_m=3.0, xy_m=(0.0, y_m))
    ground = worked(truth, (2.0, 16.0), tool=tool)
    way, turn = way_and_turn(truth, 2.0, 16.0)
    assert abs(turn) > np.radians(160.0)
    assert ground.figures.worked.grid_m2 == pytest.approx(3.0 * (way - y_m * turn), rel=5e-4)
    radius = 1.4 / np.radians(abs(turn_dps))
    centre = PLACE_M + truth.en_m[0] + np.array([0.0, np.sign(turn_dps) * radius])
    distance = np.hypot(*(shapely.get_coordinates(ground.coverage) - centre).T)
    middle = radius - np.sign(turn_dps) * y_m
    assert distance.min() > middle - 1.5 - 0.01  # as vertices of true arcs, not of chords
    assert distance.max() < middle + 1.5 + 0.01


def test_turn_within_the_tools_own_width__is_two_sectors() -> None:
    """The line turns about a place 1 m left of its middle: its arms of 3 m and 1 m sweep to both sides of it."""
    truth = drive((8.0, 0.3, np.degrees(0.3)))
    ground = worked(truth, (1.0, 7.0), tool=Implement(width_m=4.0, xy_m=(0.0, 0.0)))
    _, turn = way_and_turn(truth, 1.0, 7.0)
    assert ground.figures.worked.grid_m2 == pytest.approx(0.5 * turn * (3.0**2 + 1.0**2), rel=2e-3)


def test_two_lanes__overlap_and_leave_a_strip_as_they_lie() -> None:
    """A loop back onto a parallel lane: what the two lanes share is width less distance, times the common way."""
    turn_s = 180.0 / 15.0 + 1.0
    truth = drive((40.0, 1.2, 0.0), (turn_s, 1.2, 15.0), (40.0, 1.2, 0.0))
    there, back = (np.interp(s, truth.t_s - truth.t_s[0], truth.en_m[:, 1]) for s in (20.0, 60.0 + turn_s))
    distance_m = float(back - there)
    down = ((2.0, 38.0), (42.0 + turn_s, 78.0 + turn_s))
    for width_m in (distance_m + 0.5, distance_m - 0.4):
        tool = Implement(width_m=width_m, xy_m=(0.0, 0.0))
        ground = worked(truth, *down, tool=tool)
        a, b = (p.ground for p in ground.passes)
        length_m = min(a.bounds[2], b.bounds[2]) - max(a.bounds[0], b.bounds[0])
        if width_m > distance_m:
            (overlap,) = ground.overlaps
            assert (overlap.pass_a, overlap.pass_b) == (1, 2)
            assert overlap.area.grid_m2 == pytest.approx(0.5 * length_m, rel=2e-3)
            assert ground.misses == ()
        else:
            (miss,) = ground.misses
            assert miss.kind == "between passes"
            assert miss.area.grid_m2 == pytest.approx(0.4 * length_m, rel=2e-3)
            assert ground.overlaps == ()


def test_stop_while_working__leaves_one_pass_without_a_seam() -> None:
    truth = drive((20.0, 1.2, 0.0), (6.0, 0.0, 0.0), (20.0, 1.2, 0.0))
    ground = worked(truth, (2.0, 44.0))
    way, _ = way_and_turn(truth, 2.0, 44.0)
    (only,) = ground.passes
    assert len(only.ground.geoms) == 1
    assert only.area.grid_m2 == pytest.approx(1.7 * way, rel=1e-4)
    assert ground.figures.hours.idle_s == pytest.approx(6.0, abs=0.5)
    assert only.speed_mps == pytest.approx(way / (42.0 - ground.figures.hours.idle_s), rel=1e-3)


def test_reversing_while_down__works_nothing_but_what_is_driven_again() -> None:
    truth = drive((20.0, 1.2, 0.0), (8.0, -1.0, 0.0), (20.0, 1.2, 0.0))
    ground = worked(truth, (2.0, 46.0))
    forward = way_and_turn(truth, 2.0, 20.0)[0] + way_and_turn(truth, 28.0, 46.0)[0]
    back = -way_and_turn(truth, 20.0, 28.0)[0]
    (only,) = ground.passes
    assert only.area.grid_m2 == pytest.approx(1.7 * (forward - back), rel=1e-3)
    assert only.length_m == pytest.approx(forward, rel=1e-3)
    (again,) = ground.overlaps
    assert (again.pass_a, again.pass_b) == (1, 1)
    assert again.area.grid_m2 == pytest.approx(1.7 * back, rel=5e-3)


def test_fishtail_with_the_tool_left_down_in_reverse__works_the_two_ways_forward() -> None:
    truth = drive((15.0, 1.2, 0.0), (11.0, -1.0, 12.0), (15.0, 1.2, 0.0))
    whole, parted = worked(truth, (2.0, 39.0)), worked(truth, (2.0, 15.0), (26.0, 39.0))
    assert iou(whole.coverage, parted.coverage) > 0.999
    assert len(whole.passes) == 1


def test_unknown_state__is_not_worked_and_parts_a_pass() -> None:
    truth = drive((40.0, 1.2, 0.0))
    trajectory = trajectory_of(truth)
    states = states_of(trajectory, (2.0, 15.0), (20.0, 38.0), unknown_s=(15.0, 20.0))
    ground = worked_ground(trajectory, states, TILLER, FRAME)
    assert len(ground.passes) == 2
    assert ground.figures.hours.unknown_s == pytest.approx(5.0, abs=0.01)


def test_gap_of_positions__is_not_worked_and_told() -> None:
    truth = drive((40.0, 1.2, 0.0))
    t = truth.t_s - truth.t_s[0]
    kept = (t < 15.0) | (t > 20.0)
    seen = Drive(truth.t_s[kept], truth.en_m[kept], truth.yaw_rad[kept], truth.speed_mps[kept])
    ground = worked(seen, (2.0, 38.0))
    (only,) = ground.passes
    assert len(only.ground.geoms) == 2
    way, _ = way_and_turn(truth, 2.0, 38.0)
    assert only.area.grid_m2 == pytest.approx(1.7 * (way - 1.2 * ground.figures.hours.unplaced_s), rel=1e-3)
    assert ground.figures.hours.unplaced_s == pytest.approx(5.0, abs=0.21)


def test_pass__wholly_in_a_gap_of_positions_is_not_counted_as_seen() -> None:
    """Down four times: seen, in an outage, partly in it, seen."""
    truth = drive((80.0, 1.2, 0.0))
    t = truth.t_s - truth.t_s[0]
    kept = (t < 25.0) | (t > 50.0)
    seen = Drive(truth.t_s[kept], truth.en_m[kept], truth.yaw_rad[kept], truth.speed_mps[kept])
    ground = worked(seen, (2.0, 20.0), (27.0, 38.0), (45.0, 60.0), (70.0, 78.0))
    assert [one.ground.is_empty for one in ground.passes] == [False, True, False, False]
    assert (ground.figures.passes, ground.figures.unplaced_passes) == (3, 2)
    assert ground.passes[2].area.grid_m2 == pytest.approx(1.7 * 1.2 * 10.0, rel=0.03)


@pytest.mark.parametrize("gap_s", [(15.0, 20.0), (36.0, 39.5), (0.5, 39.5)])
def test_gap_of_positions__makes_areas_as_uncertain_as_the_ground_in_it(gap_s: tuple[float, float]) -> None:
    truth = drive((40.0, 1.2, 0.0))
    t = truth.t_s - truth.t_s[0]
    kept = (t < gap_s[0]) | (t > gap_s[1])
    trajectory = trajectory_of(
        Drive(truth.t_s[kept], truth.en_m[kept], truth.yaw_rad[kept], truth.speed_mps[kept]), sigma=(0.01,) * 6
    )
    ground = worked_ground(trajectory, states_of(trajectory, (2.0, 38.0)), TILLER, FRAME)
    missing = 1.7 * way_and_turn(truth, 2.0, 38.0)[0] - ground.figures.worked.grid_m2
    assert missing > 4.0
    for area in (ground.figures.worked, ground.passes[0].area):
        assert 0.4 * missing < area.sigma_m2 < 1.2 * missing


def test_side_slope__narrows_the_tool_as_seen_from_above() -> None:
    level = trajectory_of(drive((30.0, 1.5, 0.0)))
    _, pitch, heading = level.attitude_deg()
    leaning = trajectory_from_attitude(
        level.t_s, level.xyz_m, 15.0, pitch, heading, max_gap_s=1.0, speed_mps=level.speed_mps, motion=level.motion
    )
    flat, slope = (
        worked_ground(path, states_of(path, (2.0, 28.0)), TILLER, FRAME).figures.worked for path in (level, leaning)
    )
    assert slope.grid_m2 == pytest.approx(flat.grid_m2 * np.cos(np.radians(15.0)), rel=1e-6)


def test_nothing_worked__is_said_as_nothing() -> None:
    trajectory = trajectory_of(drive((30.0, 1.5, 0.0)))
    ground = worked_ground(trajectory, states_of(trajectory), TILLER, FRAME)
    assert ground.passes == ground.overlaps == ground.misses == ground.zones == ()
    assert ground.coverage.is_empty
    assert (ground.figures.worked.grid_m2, ground.figures.worked.sigma_m2, ground.figures.passes) == (0.0, 0.0, 0)


@st.composite
def drives(draw: st.DrawFn) -> Drive:
    """Drives of gentle turns to both sides, with stops and reversing."""
    legs = draw(
        st.lists(
            st.tuples(st.floats(4.0, 12.0), st.sampled_from([1.4, 0.9, 0.0, -0.8]), st.floats(-14.0, 14.0)),
            min_size=3,
            max_size=8,
        )
    )
    return drive(*legs, yaw_deg=draw(st.floats(0.0, 360.0)))


@settings(max_examples=25)
@given(truth=drives(), share=st.floats(0.2, 0.8), width_m=st.floats(0.8, 6.0), x_m=st.floats(-3.0, 2.0))
def test_any_drive__union_is_no_more_than_the_sum_and_overlap_is_the_rest(
    truth: Drive, share: float, width_m: float, x_m: float
) -> None:
    span = truth.t_s[-1] - truth.t_s[0]
    middle = share * span
    ground = worked(truth, (1.0, middle - 0.5), (middle + 0.5, span - 1.0), tool=Implement(width_m, (x_m, 0.1)))
    a, b = (p.area.grid_m2 for p in ground.passes)
    shared = sum(o.area.grid_m2 for o in ground.overlaps if o.pass_a != o.pass_b)
    union = ground.figures.worked.grid_m2
    assert max(a, b) - 1e-6 <= union <= a + b + 1e-6
    assert shared == pytest.approx(a + b - union, abs=0.002 * ground.figures.length_m + 1e-3)
    assert union <= ground.figures.swept_m2 + 1e-3
    assert all(p.area.grid_m2 <= p.swept_m2 + 1e-3 for p in ground.passes)
    shapes = [ground.coverage, *(x.ground for x in (*ground.passes, *ground.overlaps, *ground.misses, *ground.zones))]
    assert all(shapely.is_valid(shapes))
    assert all(x.ground.area > 0.0 for x in (*ground.overlaps, *ground.misses, *ground.zones))
    assert shapely.union_all([m.ground for m in ground.misses]).intersection(ground.coverage).area < 1e-6
    hours = ground.figures.hours
    parts = (hours.working_s, hours.turning_s, hours.idle_s, hours.unknown_s, hours.unplaced_s)
    assert sum(parts) == pytest.approx(hours.field_s)


@settings(max_examples=15)
@given(truth=drives(), turn_deg=st.floats(-180.0, 180.0), shift_m=st.tuples(st.floats(-900, 900), st.floats(-900, 900)))
def test_any_drive__moved_and_turned_works_the_same_ground(
    truth: Drive, turn_deg: float, shift_m: tuple[float, float]
) -> None:
    span = truth.t_s[-1] - truth.t_s[0]
    angle = np.radians(turn_deg)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = Drive(truth.t_s, truth.en_m @ rotation.T + shift_m, truth.yaw_rad + angle, truth.speed_mps)
    assume(np.any(truth.speed_mps > 0.5))
    one, other = (worked(d, (1.0, 0.5 * span), (0.5 * span + 1.0, span - 1.0)) for d in (truth, moved))
    assert other.figures.worked.grid_m2 == pytest.approx(one.figures.worked.grid_m2, rel=1e-3, abs=5e-3)
    assert other.figures.length_m == pytest.approx(one.figures.length_m, rel=1e-6, abs=1e-6)
    back = shapely.transform(other.coverage, lambda xy: (xy - PLACE_M - shift_m) @ rotation + PLACE_M)
    assert back.symmetric_difference(one.coverage).area <= 0.006 * one.coverage.length + 1e-3


def test_rate__changes_nothing_but_millimetres() -> None:
    truth = drive((20.0, 1.4, 0.0), (12.0, 1.2, 11.0), (20.0, 1.4, 0.0))
    every = {}
    for step in (1, 10):  # 10 and 1 a second
        seen = Drive(truth.t_s[::step], truth.en_m[::step], truth.yaw_rad[::step], truth.speed_mps[::step])
        trajectory = trajectory_of(seen)
        trajectory = trajectory_from_attitude(
            trajectory.t_s,
            trajectory.xyz_m,
            *trajectory.attitude_deg(),
            max_gap_s=2.5,
            speed_mps=trajectory.speed_mps,
            motion=trajectory.motion,
        )
        every[step] = worked_ground(trajectory, states_of(trajectory, (3.0, 48.0)), TILLER, FRAME)
    assert every[10].figures.worked.grid_m2 == pytest.approx(every[1].figures.worked.grid_m2, rel=3e-3)
    assert iou(every[10].coverage, every[1].coverage) > 0.995


def test_ellipsoidal_area__is_that_of_the_geodesic_polygon() -> None:
    """Far off the central meridian, where the map stretches by 0.5 per thousand."""
    truth = drive((400.0, 6.0, 0.4))
    trajectory = trajectory_of(
        Drive(truth.t_s, truth.en_m + np.array([190_000.0, 0.0]), truth.yaw_rad, truth.speed_mps)
    )
    ground = worked_ground(trajectory, states_of(trajectory, (2.0, 398.0)), Implement(40.0, (0.0, 0.0)), FRAME)
    fine = shapely.segmentize(ground.coverage, 5.0)
    lon_lat = shapely.transform(fine, lambda xy: np.column_stack(FRAME.to_lon_lat(*xy.T)))
    (polygon,) = shapely.get_parts(lon_lat)
    expected = abs(Geod(ellps="GRS80").geometry_area_perimeter(polygon)[0])
    assert abs(ground.figures.worked.grid_m2 / expected - 1.0) > 5e-4
    assert ground.figures.worked.ellipsoid_m2 == pytest.approx(expected, rel=1e-6)


@pytest.fixture(scope="module", params=SAMPLES)
def truth(request: pytest.FixtureRequest, shared_data: Path) -> Sample:
    return sample(shared_data / request.param)


def test_sample__true_poses_and_states_give_the_true_ground(truth: Sample) -> None:
    ground = worked_ground(truth.trajectory, truth.states, truth.session.implement, truth.frame)
    assert ground.figures.worked.grid_m2 == pytest.approx(truth.coverage.area.sum(), rel=1e-3)
    assert iou(ground.coverage, truth.coverage.union_all()) > 0.998
    assert len(ground.passes) == len(truth.passes)
    for ours, true in zip(ground.passes, truth.passes.itertuples(), strict=True):
        assert ours.area.grid_m2 == pytest.approx(true.area_m2, rel=1e-3)
        assert iou(ours.ground, true.geometry) > 0.998
        assert ours.length_m == pytest.approx(true.length_m, abs=0.01)
    assert [(o.pass_a, o.pass_b) for o in ground.overlaps] == [
        (o.pass_a, o.pass_b) for o in truth.overlaps.itertuples()
    ]
    assert ground.figures.overlap.grid_m2 == pytest.approx(truth.overlaps.area.sum(), abs=0.01)


@pytest.mark.parametrize(("rate_hz", "noise_m", "noise_deg"), [(10, 0.01, 0.3), (100, 0.02, 1.0)])
def test_sample__noise_inflates_no_area(truth: Sample, rate_hz: int, noise_m: float, noise_deg: float) -> None:
    step = 100 // rate_hz
    clean = thinned(truth.trajectory, step)
    areas, lengths = [], []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        noise = rng.normal(0, noise_m, (len(clean), 2)), rng.normal(0, noise_deg, len(clean))
        noisy = disturbed(clean, *noise, (noise_m, noise_m, noise_m, 0.1, 0.1, noise_deg))
        figures = worked_ground(noisy, truth.states, truth.session.implement, truth.frame).figures
        areas.append(figures.swept_m2)
        lengths.append(figures.length_m)
    assert np.mean(areas) == pytest.approx(truth.passes.area.sum(), rel=2e-3)
    assert np.mean(lengths) == pytest.approx(truth.passes.length_m.sum(), rel=3e-3)


def test_touching_intervals_of_down__are_one_pass() -> None:
    trajectory = trajectory_of(drive((30.0, 1.5, 0.0)))
    t0 = trajectory.t_s[0]
    cuts = t0 + np.array([0.0, 5.0, 12.0, 25.0])
    states = ToolStates(cuts[:-1], cuts[1:], np.array([0, 1, 1], np.int8), np.ones(3), np.zeros(3), np.zeros(3))
    ground = worked_ground(trajectory, states, TILLER, FRAME)
    assert [(p.times.begin_s, p.times.end_s) for p in ground.passes] == [(t0 + 5.0, t0 + 25.0)]
