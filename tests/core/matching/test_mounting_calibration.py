"""How a vehicle stands, on ground and a drive in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.banded import NormalEquations
from furrowmap.core.adjustment.knots import VEHICLE, Knots, State, knots_over, normal_equations
from furrowmap.core.adjustment.vehicle import wheeled_vehicle
from furrowmap.core.matching.gauss_newton import crab_equations
from furrowmap.core.matching.height_grid import HeightGrid, add_returns, empty_surface, heights, tiles_over
from furrowmap.core.matching.matched import mounting_notices
from furrowmap.core.matching.mounting_calibration import MountingCalibration, mounting_calibration
from furrowmap.core.matching.yaw_ambiguity import Facing
from furrowmap.core.runtime.arrays import three
from furrowmap.core.values.gnss import Positions
from furrowmap.core.values.rotation import Mounting

SIZE = VEHICLE.size
CELL_M = 0.1


def rough(east_m: np.ndarray, north_m: np.ndarray) -> np.ndarray:
    """Heights of a field with waves from half a metre to six long, none of which repeats along a lane."""
    waves = [(0.03, 6.1, 0.4), (0.02, 2.3, 1.9), (0.015, 1.1, 2.7), (0.01, 0.55, 0.8)]
    return sum(  # type: ignore[return-value]
        size * np.sin(2 * np.pi * (np.cos(at) * east_m + np.sin(at) * north_m) / length + length)
        for size, length, at in waves
    )


def ground(begin_m: float, end_m: float) -> HeightGrid:
    """The field from west to east, both halves with a return at each node."""
    n = round((end_m - begin_m) / CELL_M)
    east, north = np.meshgrid(begin_m + CELL_M * np.arange(n), CELL_M * np.arange(-30, 31), indexing="ij")
    points = np.column_stack([east.ravel(), north.ravel(), rough(east, north).ravel()])
    surface = empty_surface(tiles_over(points, CELL_M))
    for half in range(2):
        count = len(points)
        add_returns(
            surface, points, np.zeros(count, np.int8), np.full(count, half, np.uint8), np.full(count, 255, np.uint8)
        )
    return surface


FIELD = ground(-3.0, 40.0)


def on_wheels(half_track_m: float, wheelbase_m: float, sway_deg: float, turn: Rotation) -> tuple[Knots, State]:
    """Half a minute eastwards on four wheels that sways, seen by a scanner that sits on it turned by `turn`."""
    knots = knots_over(np.arange(0.0, 30.0, 0.02))
    t = knots.t_s
    east = 1.1 * t

    def wheel(forward: float, left: float) -> np.ndarray:
        return rough(east + forward, np.full(len(t), left))

    rear = [wheel(0.0, half_track_m), wheel(0.0, -half_track_m)]
    front = [wheel(wheelbase_m, half_track_m), wheel(wheelbase_m, -half_track_m)]
    roll = np.arctan2(rear[0] - rear[1], 2 * half_track_m)
    pitch = np.arctan2(0.5 * (sum(front) - sum(rear)), wheelbase_m)
    sway = np.radians(sway_deg) * np.sqrt(2.0)
    roll += sway * np.sin(2 * np.pi * 1.7 * t)
    pitch += sway * np.sin(2 * np.pi * 1.3 * t + 1.0)
    stands = Rotation.from_euler("ZYX", np.column_stack([np.zeros(len(t)), -pitch, roll]))
    xyz = np.column_stack([east, np.zeros(len(t)), 0.5 * (rear[0] + rear[1])])
    return knots, State(xyz, (stands * turn).as_matrix(), np.zeros((len(t), 3)))


@settings(max_examples=8)
@given(
    half_track_m=st.floats(0.5, 0.95),
    wheelbase_m=st.floats(1.6, 2.8),
    roll_deg=st.floats(-1.0, 1.0),
    pitch_deg=st.floats(-1.0, 1.0),
)
def test_a_mounting_shows_in_how_the_vehicle_stands_on_its_wheels(
    half_track_m: float, wheelbase_m: float, roll_deg: float, pitch_deg: float
) -> None:
    off = Rotation.from_euler("ZYX", [0.0, -pitch_deg, roll_deg], degrees=True)
    knots, state = on_wheels(half_track_m, wheelbase_m, 0.3, off)
    found = mounting_calibration(knots, state, FIELD, None, 0.3, (0.0, np.inf))
    assert abs(found.roll_deg - roll_deg) < min(3.0 * found.sigma_deg[0], 0.15)
    assert abs(found.pitch_deg - pitch_deg) < min(3.0 * found.sigma_deg[1], 0.15)
    assert abs(found.height_m) < 3.0 * found.sigma_height_m
    assert not np.isfinite(found.sigma_deg[2])


def test_a_scanner_that_is_stated_too_high_is_reported_and_nothing_turned() -> None:
    knots, state = on_wheels(0.7, 2.0, 0.3, Rotation.identity())
    stated = Mounting((-0.6, 0.0, 2.4))
    said = []
    for off_m in (0.0, 0.2):
        raised = replace(state, xyz_m=state.xyz_m + np.array([0.0, 0.0, off_m]))
        found = mounting_calibration(knots, raised, FIELD, None, 0.3, (0.0, np.inf))
        assert abs(found.height_m - off_m) < 3.0 * found.sigma_height_m
        said.append(mounting_notices(found, Facing(0.0, shown=True), stated, stated))
    assert said[0] == []
    assert [notice.code for notice in said[1]] == ["mounting-height"]
    assert "+0.2" in said[1][0].text


def test_a_vehicle_on_ground_that_was_not_seen_says_nothing() -> None:
    knots, state = on_wheels(0.7, 2.0, 0.3, Rotation.identity())
    found = mounting_calibration(knots, state, ground(100.0, 110.0), None, 0.3, (0.0, np.inf))
    assert not np.isfinite(found.sigma_deg).any()
    assert not found.turn_deg.any()
    assert (found.left_deg < 0.11).all()


@pytest.mark.parametrize(
    ("angles_deg", "sigma_deg", "height_m", "turned_deg"),
    [
        ((0.0, 0.5, 0.0), (0.06, 0.06, 0.06), 0.0, (0.0, 0.478, 0.0)),
        ((0.06, -0.05, 0.05), (0.06, 0.06, 0.06), 0.0, (0.0, 0.0, 0.0)),
        ((0.5, 0.1, 0.4), (0.05, np.inf, 0.3), 0.0, (0.495, 0.0, 0.291)),
        ((0.0, 0.5, 0.0), (0.06, 0.06, 0.06), 0.4, (0.0, 0.0, 0.0)),
        ((0.3, 0.3, 0.3), (np.inf, np.inf, np.inf), 0.0, (0.0, 0.0, 0.0)),
    ],
)
def test_a_mounting_that_is_off_is_turned_by_the_weighted_mean_and_one_that_is_right_is_not(
    angles_deg: tuple[float, float, float],
    sigma_deg: tuple[float, float, float],
    height_m: float,
    turned_deg: tuple[float, float, float],
) -> None:
    found = MountingCalibration(*angles_deg, height_m, sigma_deg, 0.01)
    np.testing.assert_allclose(found.turn_deg, turned_deg, atol=0.006)


def _less(one: MountingCalibration) -> dict[str, float]:
    """What is seen after the mounting was turned."""
    angles = np.array([one.roll_deg, one.pitch_deg, one.yaw_deg]) - one.turn_deg
    return dict(zip(("roll_deg", "pitch_deg", "yaw_deg"), angles.tolist(), strict=True))


def test_what_is_left_of_a_mounting_is_as_large_as_stated_where_half_of_all_are_off() -> None:
    rng = np.random.default_rng(3)
    sigma = (0.05, 0.08, 0.2)
    size = rng.choice([0.15, 0.3, 0.6, 1.2, 2.4], 4000) * (rng.random(4000) < 0.5)
    off = rng.normal(0.0, size[:, None], (4000, 3))
    seen = off + rng.normal(0.0, sigma, off.shape)
    found = [MountingCalibration(*angles, 0.0, sigma, 0.01) for angles in seen.tolist()]
    error = np.array([one.turn_deg for one in found]) - off
    as_it_is = np.array([one.left_deg for one in found])
    turned = np.array([replace(one, corrected_deg=three(one.turn_deg), **_less(one)).left_deg for one in found])
    np.testing.assert_allclose((off**2).mean(axis=0), (as_it_is**2).mean(axis=0), rtol=0.06)
    np.testing.assert_allclose((error**2).mean(axis=0), (turned**2).mean(axis=0), rtol=0.1)
    # Better than the mounting as stated, and than what is seen.
    assert ((error**2).mean(axis=0) < (off**2).mean(axis=0)).all()
    assert ((error**2).mean(axis=0) < ((seen - off) ** 2).mean(axis=0)).all()


def test_of_a_yaw_that_is_known_to_be_wrong_only_the_scans_tell() -> None:
    found = MountingCalibration(0.02, 0.0, 0.05, 0.0, (0.06, 0.06, 0.08), 0.01, (0.0, 0.0, 0.0), yaw_off=True)
    assert found.turn_deg[2] == pytest.approx(0.05, rel=0.01)
    assert found.left_deg[2] == pytest.approx(np.hypot(0.08, 0.05), rel=0.01)
    assert abs(found.turn_deg[:2]).max() < 0.002


def test_heights_are_those_of_the_plane_through_the_returns() -> None:
    rng = np.random.default_rng(5)
    points = rng.uniform(0.0, 4.0, (40_000, 2))
    level = np.column_stack([points, 0.2 * points[:, 0] - 0.1 * points[:, 1] + 3.0])
    surface = empty_surface(tiles_over(level, CELL_M))
    count = len(level)
    add_returns(
        surface, level, np.zeros(count, np.int8), (np.arange(count) % 2).astype(np.uint8), np.full(count, 255, np.uint8)
    )
    where = rng.uniform(0.5, 3.5, (500, 2))
    found = heights(surface, where, np.zeros(500, np.int8))
    np.testing.assert_allclose(found, 0.2 * where[:, 0] - 0.1 * where[:, 1] + 3.0, atol=0.012)
    assert np.isnan(heights(surface, where, np.ones(500, np.int8))).all()
    assert np.isnan(heights(surface, where + 50.0, np.zeros(500, np.int8))).all()
    assert np.isnan(heights(surface, where, np.full(500, -1, np.int8))).all()


@pytest.mark.parametrize("crab_deg", [-0.7, 0.0, 0.4])
def test_a_vehicle_that_goes_crab_shows_it_though_its_wheels_hold_the_heading(crab_deg: float) -> None:
    """The way is held by positions, the heading by something as strong as the wheels, which share what is off."""
    knots = knots_over(np.arange(0.0, 5.0, 0.02))
    t = knots.t_s
    angle = np.radians(crab_deg)
    xyz = np.column_stack([1.2 * t * np.cos(angle), 1.2 * t * np.sin(angle), np.zeros(len(t))])
    state = State(xyz, np.tile(np.eye(3), (len(t), 1, 1)), np.zeros((len(t), 3)))
    at = np.arange(0.0, 5.0, 0.1)
    there = np.column_stack([np.interp(at, t, xyz[:, a]) for a in range(3)])
    small = np.full((len(at), 3), 0.001)
    positions = Positions(
        at, there, small, small, np.zeros(len(at), np.intp), np.full(len(at), 4, np.int8), np.full(len(at), np.nan)
    )
    equations = normal_equations(wheeled_vehicle(positions, np.zeros(3), np.zeros(3)), knots, state)
    equations.add(np.arange(len(t)) * SIZE + 5, np.ones((len(t), 1)), np.zeros(len(t)), np.full(len(t), 0.06))
    by_knots, own, right = crab_equations(knots, state)
    solution = equations.solve()
    link = by_knots.ravel()
    information = own - link @ solution.by(link)
    found = (right - link @ solution.values) / information
    # Without that unknown the wheels turn the vehicle a good part of the way.
    if crab_deg:
        assert abs(np.degrees(np.median(solution.values.reshape(-1, SIZE)[:, 5]))) > 0.2 * abs(crab_deg)
    assert np.degrees(found) == pytest.approx(crab_deg, abs=0.02)
    bordered = bordered_solution(equations, link, own, right)
    assert found == pytest.approx(bordered[-1], abs=1e-9)


def bordered_solution(equations: NormalEquations, link: np.ndarray, own: float, right: float) -> np.ndarray:
    """The solution with one unknown more, by the whole matrix."""
    whole = np.block([[equations.dense(), link[:, None]], [link, np.array([[own]])]])
    return np.asarray(np.linalg.solve(whole, np.append(equations.right, right)))
