"""Control points: their file, what the scanner sees of them, and the trajectory that they correct."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyproj
import pytest

from furrowmap.core.pipeline.control.control_points import (
    GroundControl,
    PointState,
    expect_in_sight,
    read_control,
)
from furrowmap.core.pipeline.control.correction import correction, error_model
from furrowmap.core.pipeline.control.returns_at_points import MAX_POINT_RETURNS, ReturnsAround, ReturnsAtPoints
from furrowmap.core.pipeline.control.seen_points import (
    SeenHeight,
    SeenPoint,
    SeenTarget,
    Sight,
    Unseen,
    seen_point,
    visits,
)
from furrowmap.core.pointclouds.placed_scans import PlacedScan
from furrowmap.core.pointclouds.survey_targets import Target, TargetKind, TargetSizes
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.rotation import Mounting, quaternion_to_matrix
from furrowmap.core.values.scan import PointClass, Scan
from furrowmap.core.values.trajectory import Trajectory, trajectory_from_attitude

MAP = pyproj.CRS(25832)
HEAD = "name,e_m,n_m,h_m,role\n"
T0_S = 1_780_000_000.0


def table(folder: Path, text: str) -> Path:
    path = folder / "points.csv"
    path.write_text(text, encoding="utf-8")
    return path


def drive(sigma_h_m: float = 0.02, sigma_deg: float = 0.02) -> Trajectory:
    """To and fro for a minute over 30 m, level."""
    t_s = np.arange(0.0, 60.0, 0.1)
    east = 15.0 * np.sin(2.0 * np.pi * t_s / 60.0)
    north = 10.0 * np.cos(2.0 * np.pi * t_s / 60.0)
    straight = trajectory_from_attitude(
        T0_S + t_s, np.column_stack([east, north, np.full(len(t_s), 50.0)]), 0.0, 0.0, 90.0, max_gap_s=1.0
    )
    sigma = np.column_stack([np.full((len(t_s), 2), 0.01), np.full(len(t_s), sigma_h_m)])
    return replace(straight, sigma=np.column_stack([sigma, np.full((len(t_s), 3), sigma_deg)]))


def control(points: FloatArray, checks: int = 0, sigma_m: float = 0.003) -> GroundControl:
    """Points, of which the last ones are to check."""
    count = len(points)
    names = tuple(f"P{k}" for k in range(count))
    is_check = np.arange(count) >= count - checks
    return GroundControl("points.csv", names, points, np.full((count, 3), sigma_m), is_check, (Target(),) * count)


def seen_at(above_m: FloatArray, t_s: FloatArray) -> list[SeenPoint]:
    """Each height in one visit."""
    return [
        SeenPoint((SeenHeight(float(above), (0.0, 0.0), 0.003, float(t), 100),))
        for above, t in zip(above_m, t_s, strict=True)
    ]


CORNERS = np.array([[12.0, 8.0, 50.0], [-12.0, 8.0, 50.0], [-12.0, -8.0, 50.0], [12.0, -8.0, 50.0], [0.0, 0.0, 50.0]])


def test_roles__say_which_points_correct(tmp_path: Path) -> None:
    path = table(tmp_path, HEAD + "A,1,2,3,GCP\nB,4,5,6,Check Point\nC,7,8,9,\nD,1,1,1,control\n")
    found = read_control(path, MAP)
    assert found.name == ("A", "B", "C", "D")
    assert found.is_check.tolist() == [False, True, False, False]
    np.testing.assert_allclose(found.sigma_m, 0.01)


def test_points__without_roles_all_correct(tmp_path: Path) -> None:
    path = table(tmp_path, "name,e_m,n_m,h_m,sigma_h_m\nA,1,2,3,0.002\nB,4,5,6,\n")
    found = read_control(path, MAP)
    assert not found.is_check.any()
    np.testing.assert_allclose(found.sigma_m[:, 2], [0.002, 0.01])
    with pytest.raises(InputError, match="no column says which"):
        read_control(path, MAP, check_file=path)


@pytest.mark.parametrize(
    ("rows", "code"), [("A,1,2,3,check\n", "ground-control-none"), ("A,1,2,3,maybe\n", "ground-control-role")]
)
def test_roles__that_leave_nothing_or_are_unknown_are_refused(rows: str, code: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        read_control(table(tmp_path, HEAD + rows), MAP)
    assert refused.value.code == code
    assert len(str(refused.value).splitlines()) == 3


def test_points_elsewhere__are_refused_with_the_likely_reason() -> None:
    track = np.array([[5000.0, 9000.0, 0.0], [5010.0, 9000.0, 0.0]])
    with pytest.raises(InputError, match="Compare their locations") as refused:
        expect_in_sight(control(np.array([[6000.0, 9000.0, 0.0]])), track)
    assert refused.value.code == "ground-control-nowhere"
    with pytest.raises(InputError, match="swapped 1 point lies"):
        expect_in_sight(control(np.array([[9000.0, 5000.0, 0.0]])), track)
    expect_in_sight(control(np.array([[5100.0, 9000.0, 0.0], [0.0, 0.0, 0.0]])), track)


def test_visits__end_at_pauses_and_are_not_longer_than_twenty_seconds() -> None:
    t_s = np.array([100.0, 5.0, 0.0, 101.0, 45.0, 30.0, 12.0])
    assert visits(t_s).tolist() == [3, 0, 0, 3, 2, 1, 0]


def flat_returns(slope: float, t_s: float, noise_m: float = 0.01, count: int = 400) -> ReturnsAround:
    chance = np.random.default_rng(3)
    xy = chance.uniform(-0.3, 0.3, (count, 2))
    z = 0.04 + slope * xy[:, 0] + chance.normal(0.0, noise_m, count)
    return ReturnsAround(np.column_stack([xy, z]), np.full(count, T0_S + t_s), np.full(count, 30.0))


def test_height__is_that_of_the_plane_with_its_sigma() -> None:
    path = drive(sigma_deg=0.0)
    found = seen_point(np.zeros(3), flat_returns(0.1, 20.0), Sight(path, Mounting()), Target())
    (height,) = found.heights
    assert height.above_m == pytest.approx(0.04, abs=0.002)
    assert height.slope == pytest.approx((0.1, 0.0), abs=0.01)
    assert height.sigma_m == pytest.approx(0.003, abs=0.0005)
    far = seen_point(
        np.array([20.0, 0.0, 50.0]), flat_returns(0.0, 0.0), Sight(drive(sigma_deg=0.1), Mounting()), Target()
    )
    away_m = np.hypot(20.0, 10.0)
    assert far.heights[0].sigma_m == pytest.approx(np.hypot(0.003, np.radians(0.1) * away_m), rel=0.05)


@pytest.mark.parametrize(
    ("around", "why"),
    [
        (flat_returns(0.0, 0.0, count=0), Unseen.NO_RETURNS),
        (flat_returns(0.0, 0.0, count=4), Unseen.FEW_RETURNS),
        (flat_returns(0.8, 0.0), Unseen.STEEP),
        (flat_returns(0.0, 0.0, noise_m=0.2), Unseen.ROUGH),
    ],
)
def test_points_without_level_ground__say_why(around: ReturnsAround, why: Unseen) -> None:
    assert seen_point(np.zeros(3), around, Sight(drive(), Mounting()), Target()) == SeenPoint(why_not=why)


STILL = Sight(drive(sigma_deg=0.0), Mounting())
"""Whose attitude has no error."""


def on_board(xy: FloatArray, middle: FloatArray, side_m: float, turn_deg: float) -> FloatArray:
    """1 on bright, −1 on dark quarters, 0 off a checkerboard."""
    turn = np.radians(turn_deg)
    u, v = ((xy - middle) @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])).T
    return np.where(np.maximum(np.abs(u), np.abs(v)) < 0.5 * side_m, np.sign(u * v), 0.0)


@pytest.mark.parametrize("kind", [TargetKind.DISC, TargetKind.CHECKERBOARD])
def test_flat_target__is_found_within_its_sigma(kind: TargetKind) -> None:
    chance = np.random.default_rng(6)
    errors = []
    for turn_deg in np.linspace(0.0, 85.0, 12):
        xy = chance.uniform(-1.6, 1.6, (20_000, 2))
        middle = chance.uniform(-0.1, 0.1, 2)
        where = on_board(xy, middle, 0.4, turn_deg)
        disc = np.where(np.hypot(*(xy - middle).T) < 0.2, 120.0, 30.0)
        bright = disc if kind is TargetKind.DISC else 30.0 + np.where(where > 0, 90.0, -20.0 * (where < 0))
        returns = ReturnsAround(
            np.column_stack([xy, np.zeros(len(xy))]),
            np.full(len(xy), T0_S),
            bright + chance.normal(0.0, 2.0, len(xy)),
        )
        found = seen_point(np.zeros(3), returns, STILL, Target(kind, 0.4))
        assert found.target is not None
        assert found.picture is not None
        assert found.picture.off_m == found.target.off_m
        errors.append((np.array(found.target.off_m) - middle) / found.target.sigma_m)
        assert len(found.heights) == 1
    assert np.sqrt(np.mean(np.square(errors))) < 1.5


@pytest.mark.parametrize("kind", [TargetKind.DISC, TargetKind.CHECKERBOARD, TargetKind.CORNER])
def test_targets__that_are_not_there_are_not_found(kind: TargetKind) -> None:
    """Even ground, the edge and the corner of a bright area, a disc where a board is looked for."""
    chance = np.random.default_rng(8)
    xy = chance.uniform(-1.6, 1.6, (6000, 2))
    scenes = [np.zeros(len(xy)), xy @ [0.6, 0.8] > 0.1, (xy > 0.1).all(axis=1)]
    if kind is TargetKind.CHECKERBOARD:
        scenes += [np.hypot(*xy.T) < 0.2, np.hypot(*xy.T) < 0.3]
    for scene in scenes if kind is not TargetKind.DISC else scenes[:2]:
        bright = 30.0 + 60.0 * scene + chance.normal(0.0, 3.0, len(xy))
        returns = ReturnsAround(
            np.column_stack([xy, chance.normal(0.0, 0.01, len(xy))]), np.full(len(xy), T0_S), bright
        )
        found = seen_point(np.zeros(3), returns, STILL, Target(kind, 0.0 if kind is TargetKind.CORNER else 0.4))
        assert found.target is None
        assert found.why_not is Unseen.NO_TARGET
        assert len(found.heights) == (kind is not TargetKind.CORNER)


@pytest.mark.parametrize("kind", list(TargetKind))
def test_returns__beyond_the_reach_of_a_target_take_no_part(kind: TargetKind) -> None:
    """Other targets of the same file may reach farther."""
    target = Target(kind, 0.1 if kind in (TargetKind.DISC, TargetKind.CHECKERBOARD) else 0.0)
    turn = np.linspace(0.0, 2.0 * np.pi, 50)
    ring = 1.01 * target.reach_m * np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    returns = ReturnsAround(ring, np.full(len(ring), T0_S), np.full(len(ring), 40.0))
    assert seen_point(np.zeros(3), returns, STILL, target) == SeenPoint(why_not=Unseen.NO_RETURNS)


def corner_returns(chance: np.random.Generator, middle: FloatArray, turn_rad: float, upright: bool) -> FloatArray:
    """Returns of two walls and the ground round an outer corner, or of a hedge, with noise of 1 cm."""
    plane = chance.uniform(0.0, 1.4, (3, 400, 2))
    ground = np.column_stack([chance.uniform(-1.4, 1.4, (900, 2)), np.zeros(900)])
    ground = ground[(ground[:, :2] > 0.0).any(axis=1)]
    one = np.column_stack([-plane[0, :, 0], np.zeros(400), plane[0, :, 1]])
    other = np.column_stack([np.zeros(400), -plane[1, :, 0], plane[1, :, 1]])
    hedge = chance.uniform(-1.4, 1.4, (900, 3))
    xyz = np.concatenate([ground, one, other]) if upright else hedge
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    turned = xyz @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return turned + middle + chance.normal(0.0, 0.01, xyz.shape)


def test_corner__of_two_walls_and_the_ground_is_found_within_its_sigma() -> None:
    chance = np.random.default_rng(2)
    errors = []
    for turn_rad in np.linspace(0.0, 6.0, 12):
        middle = chance.uniform(-0.1, 0.1, 3)
        xyz = corner_returns(chance, middle, turn_rad, upright=True)
        returns = ReturnsAround(xyz, np.full(len(xyz), T0_S), np.full(len(xyz), 40.0))
        found = seen_point(np.zeros(3), returns, STILL, Target(TargetKind.CORNER))
        assert found.target is not None
        assert found.visits == 1
        assert seen_point(np.zeros(3), returns, STILL, Target(TargetKind.CORNER)).target.off_m == found.target.off_m
        errors.append((np.array(found.target.off_m) - middle) / found.target.sigma_m)
    assert 0.2 < np.sqrt(np.mean(np.square(errors))) < 1.5
    hedge = corner_returns(chance, np.zeros(3), 0.0, upright=False)
    returns = ReturnsAround(hedge, np.full(len(hedge), T0_S), np.full(len(hedge), 40.0))
    assert seen_point(np.zeros(3), returns, STILL, Target(TargetKind.CORNER)).why_not is Unseen.NO_TARGET


def test_corners__correct_all_axes() -> None:
    path = drive(sigma_deg=0.0)
    off_m = (0.04, -0.03, 0.05)
    seen = [
        SeenPoint(target=SeenTarget(off_m, (0.003,) * 3, np.array([T0_S + 12.0 * k]), np.ones(1))) for k in range(5)
    ]
    found = correction(control(CORNERS), seen, path, error_model(path, CORNERS, held=True))
    np.testing.assert_allclose(found.applied(path).xyz_m - path.xyz_m, -np.tile(off_m, (len(path), 1)), atol=0.002)
    assert found.result.plain()["corrected"] == [True, True, True]


def test_targets__are_those_of_the_column_or_of_the_session(tmp_path: Path) -> None:
    rows = "name,e_m,n_m,h_m,target\nA,1,2,3,Disc\nB,4,5,6,checkerboard\nC,7,8,9,corner\nD,1,1,1,ground\nE,2,2,2,\n"
    both = TargetSizes(0.4, 0.5)
    with pytest.raises(InputError, match="no target is stated for point E"):
        read_control(table(tmp_path, rows), MAP, both)
    found = read_control(table(tmp_path, rows.replace("E,2,2,2,\n", "")), MAP, both).target
    assert [target.kind.value for target in found] == ["disc", "checkerboard", "corner", "ground"]
    assert [target.size_m for target in found] == [0.4, 0.5, 0.0, 0.0]
    bare = table(tmp_path, "name,e_m,n_m,h_m\nA,1,2,3\n")
    for sizes, kind in (
        (TargetSizes(), "ground"),
        (TargetSizes(disc_m=0.4), "disc"),
        (TargetSizes(None, 0.5), "checkerboard"),
    ):
        assert [target.kind.value for target in read_control(bare, MAP, sizes).target] == [kind]
    with pytest.raises(InputError, match="point B is a checkerboard") as refused:
        read_control(table(tmp_path, rows), MAP, TargetSizes(disc_m=0.4))
    assert "`control_checkerboard_m` (side of the board)" in str(refused.value)
    with pytest.raises(InputError, match="has the target 'cone'"):
        read_control(table(tmp_path, rows.replace("corner", "cone")), MAP, both)


def test_returns__are_gathered_alike_however_scans_come_together() -> None:
    chance = np.random.default_rng(4)
    xyz = chance.uniform(-2.0, 2.0, (3000, 3))
    points = np.array([[100.0, 200.0, 0.0], [101.0, 200.5, 0.0]])

    def placed(part: slice) -> PlacedScan:
        count = len(xyz[part])
        small = np.ones(count, np.uint8)
        scan = Scan(
            0, T0_S + np.arange(3000.0)[part], np.zeros((count, 3), np.float32), small, small, small.astype(np.uint16),
            small, small,
        )  # fmt: skip
        return PlacedScan(scan, xyz[part], np.full(count, PointClass.OTHER, np.uint8), 0)

    whole = ReturnsAtPoints(points, (100.0, 200.0, 0.0), 0.5)
    whole.add(placed(slice(None)))
    parts = ReturnsAtPoints(points, (100.0, 200.0, 0.0), 0.5)
    for begin in range(0, 3000, 700):
        parts.add(placed(slice(begin, begin + 700)))
    for number, place in enumerate(points - [100.0, 200.0, 0.0]):
        near = np.hypot(*(xyz - place)[:, :2].T) <= 0.5
        np.testing.assert_array_equal(whole.at(number).xyz_m, (xyz - place)[near])
        np.testing.assert_array_equal(parts.at(number).xyz_m, whole.at(number).xyz_m)
    assert near.sum() < MAX_POINT_RETURNS


def test_heights__correct_heights_and_tilt_alone() -> None:
    path = drive(sigma_deg=0.1)
    tilt = 0.001
    above = 0.05 + tilt * CORNERS[:, 1]
    model = error_model(path, CORNERS, held=True)
    found = correction(control(CORNERS, checks=1), seen_at(above, T0_S + np.arange(5) * 12.0), path, model)
    corrected = found.applied(path)
    moved = corrected.xyz_m - path.xyz_m
    np.testing.assert_array_equal(moved[:, :2], 0.0)
    np.testing.assert_allclose(moved[:, 2], -0.05 - tilt * path.xyz_m[:, 1], atol=0.001)
    assert (corrected.sigma[:, 2] < path.sigma[:, 2]).all()
    assert (corrected.sigma[:, 3] < path.sigma[:, 3]).all()
    np.testing.assert_array_equal(corrected.sigma[:, :2], path.sigma[:, :2])
    np.testing.assert_array_equal(corrected.sigma[:, 5], path.sigma[:, 5])
    ground = np.column_stack([CORNERS[:, :2], 50.0 + above])
    seen = (ground - path.xyz_m[0]) @ quaternion_to_matrix(path.quaternion[:1])[0]
    placed = corrected.xyz_m[0] + seen @ quaternion_to_matrix(corrected.quaternion[:1])[0].T
    np.testing.assert_allclose(placed, CORNERS, atol=0.001)
    check = found.result.points[-1]
    assert check.state is PointState.CHECK
    assert abs(check.residual_m[2]) < 0.003
    assert [point.state for point in found.result.points[:4]] == [PointState.USED] * 4
    assert [notice.code for notice in found.notices] == []


@pytest.mark.parametrize(("up_m", "told"), [(0.02, False), (0.3, True)])
def test_shift__is_told_where_the_positions_are_off_by_more_than_they_state(up_m: float, told: bool) -> None:
    path = drive(sigma_h_m=0.02)
    model = error_model(path, CORNERS, held=True)
    found = correction(control(CORNERS), seen_at(np.full(5, up_m), T0_S + np.arange(5) * 12.0), path, model)
    shifts = [notice for notice in found.notices if notice.code == "ground-control-shift"]
    assert len(shifts) == told
    for notice in shifts:
        values = dict(notice.values)
        assert values["up_m"] == pytest.approx(up_m, abs=0.01)
        assert (values["east_m"], values["north_m"]) == (0.0, 0.0)
        assert "+0.000 m north and +0." in notice.text


def test_point_in_error__is_named_and_left_out() -> None:
    path = drive()
    above = np.array([0.05, 0.052, 0.15, 0.049, 0.051])
    model = error_model(path, CORNERS, held=True)
    found = correction(control(CORNERS), seen_at(above, T0_S + np.arange(5) * 12.0), path, model)
    (left_out,) = (point for point in found.result.points if point.state is PointState.LEFT_OUT)
    assert left_out.name == "P2"
    assert left_out.residual_m[2] == pytest.approx(0.1, abs=0.01)
    assert left_out.worst > 3.29
    notice = next(notice for notice in found.notices if notice.code == "ground-control-left-out")
    assert "P2 (H +0.09" in notice.text
    assert found.result.plain()["left_out"] == 1


def test_points__that_are_few_unseen_or_contradict_are_told() -> None:
    path = drive()
    model = error_model(path, CORNERS, held=True)
    times = T0_S + np.arange(5) * 12.0
    one = [*seen_at(np.array([0.03]), times[:1]), SeenPoint(why_not=Unseen.STEEP)]
    found = correction(control(CORNERS[:2]), one, path, model)
    assert [notice.code for notice in found.notices] == ["ground-control-unseen", "ground-control-few"]
    assert found.result.points[1].why_not is Unseen.STEEP
    found = correction(control(CORNERS[:2]), seen_at(np.array([0.0, 0.1]), times[:2]), path, model)
    assert [notice.key for notice in found.notices] == ["ground-control-contradicts"]
    assert found.applied(path) is path
    found = correction(control(CORNERS), seen_at(np.full(5, 38.2), times), path, model)
    assert [notice.key for notice in found.notices] == ["ground-control-contradicts.far"]
    assert found.applied(path) is path
    assert found.contradicts_m is not None
    assert found.contradicts_m[2] == pytest.approx(-38.2, abs=0.01)


def test_nothing_seen__corrects_nothing() -> None:
    path = drive()
    model = error_model(path, CORNERS, held=True)
    found = correction(control(CORNERS), [SeenPoint(why_not=Unseen.NO_RETURNS)] * 5, path, model)
    assert found.applied(path) is path
    assert [notice.code for notice in found.notices] == ["ground-control-unseen"]
    assert found.result.plain()["corrected"] == [False, False, False]


@pytest.mark.parametrize("heading_deg", [0.0, 30.0, 90.0])
@pytest.mark.parametrize("in_plan", [False, True])
def test_attitude__is_never_known_better_than_the_frame_or_worse_than_before(heading_deg: float, in_plan: bool) -> None:
    """Poses of a drive differ: roll is less certain than pitch, and some poses are far more certain than most."""
    path = drive()
    path = trajectory_from_attitude(path.t_s, path.xyz_m, 0.0, 0.0, heading_deg, max_gap_s=1.0)
    sigma = np.column_stack([np.full((len(path), 3), 0.02), np.tile([0.2, 0.1, 0.05], (len(path), 1))])
    sigma[::3, 3:] = 0.01
    path = replace(path, sigma=sigma)
    model = error_model(path, CORNERS, held=True)
    times = T0_S + np.arange(5) * 12.0
    seen = seen_at(np.zeros(5), times)
    if in_plan:
        targets = (SeenTarget((0.0, 0.0, 0.0), (0.003,) * 3, np.array([t]), np.ones(1)) for t in times)
        seen = [SeenPoint(target=target) for target in targets]
    found = correction(control(CORNERS), seen, path, model)
    assert found.error is not None
    after = np.degrees(np.sqrt(found.error.turn_rad[1]))
    corrected = found.applied(path).sigma[:, 3:]
    assert (corrected <= sigma[:, 3:] * (1.0 + 1e-12)).all()
    assert (corrected >= np.minimum(sigma[:, 3:], after.min()) * (1.0 - 1e-12)).all()
    improved = corrected < sigma[:, 3:] - 1e-9
    assert improved[1::3, :2].all(), "heights show roll and pitch"
    assert improved[1::3, 2].all() == in_plan, "targets alone show the heading"


def test_tilt__of_the_frame_is_as_uncertain_about_each_axis_as_roll_and_pitch_let_it_be() -> None:
    """To the north, roll is a turn about north, pitch one about east."""
    apart = replace(drive(sigma_h_m=10.0), sigma=np.tile([0.01, 0.01, 10.0, 0.2, 0.1, 0.05], (len(drive()), 1)))
    for heading_deg, expected_deg in ((0.0, (0.1, 0.2)), (90.0, (0.2, 0.1)), (45.0, (0.1581, 0.1581))):
        path = trajectory_from_attitude(apart.t_s, apart.xyz_m, 0.0, 0.0, heading_deg, max_gap_s=1.0)
        model = error_model(replace(path, sigma=apart.sigma), CORNERS, held=True)
        np.testing.assert_allclose(np.degrees(model.turn_sigma_rad[:2]), expected_deg, rtol=0.01)
