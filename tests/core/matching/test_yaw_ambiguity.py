"""Which way a scanner faces, on made ground of which every height is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.knots import Knots, State, knots_over
from furrowmap.core.matching.returns import GroundReturns
from furrowmap.core.matching.walls import UprightReturns
from furrowmap.core.matching.yaw_ambiguity import Facing, facing

SPEED_MPS = 0.8
SENSOR_M = np.array([-0.5, 0.2, 1.8])
NODE_M = 0.05


def drive(relief_m: float, turned_deg: float, seed: int, trees: int = 0) -> tuple[GroundReturns, Knots, State]:
    """Half a minute along a curve over random ground, returns turned about the sensor by a wrong mounting."""
    random = np.random.default_rng(seed)
    ground = gaussian_filter(random.normal(size=(1200, 1200)), 4.0)
    ground *= relief_m / ground.std()
    t = np.sort(random.uniform(0.0, 30.0, 60_000))
    knots = knots_over(t)
    yaw = 0.02 * knots.t_s
    step = SPEED_MPS * np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)]) * np.gradient(knots.t_s)[:, None]
    rotation = Rotation.from_euler("z", yaw[:, None])
    state = State(np.cumsum(step, axis=0), rotation.as_matrix(), np.zeros((len(yaw), 3)))

    radius, angle = 6.0 * np.sqrt(random.uniform(size=len(t))), random.uniform(0.0, 2.0 * np.pi, len(t))
    vehicle = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(len(t))])
    k, share, _ = knots.at(t)
    place = state.xyz_m[k] + share[:, None] * (state.xyz_m[k + 1] - state.xyz_m[k])
    place += Rotation.from_euler("z", 0.02 * t[:, None]).apply(vehicle)
    node = (place[:, :2].T + 15.0) / NODE_M
    # The vehicle sways, which nobody knows of at the start.
    tilt = np.radians(0.5) * np.sin(2.0 * np.pi * 0.7 * t)
    noise = random.normal(scale=0.01, size=len(t))
    vehicle[:, 2] = map_coordinates(ground, node, order=1, mode="wrap") + tilt * vehicle[:, 1] + noise
    turned = Rotation.from_euler("z", -turned_deg, degrees=True).apply(vehicle - SENSOR_M) + SENSOR_M
    half = (np.floor(10.0 * t) % 2).astype(np.uint8)
    body: NDArray[np.bool_] = np.zeros((80, 80), np.bool_)

    # Every third return sees a tree instead, of which there are some round the way.
    seen = slice(None, None, 3)
    where = np.column_stack([random.uniform([-15.0, -25.0], [40.0, 25.0], (trees, 2)), np.full(trees, 2.0)])
    standing = where[random.integers(trees, size=len(t[seen]))] if trees else np.zeros((0, 3))
    known = slice(0, len(standing))
    standing += random.normal(scale=0.2, size=standing.shape)
    origin = (place - Rotation.from_euler("z", 0.02 * t[:, None]).apply(vehicle * [1.0, 1.0, 0.0]))[seen][known]
    beside = Rotation.from_euler("z", -0.02 * t[seen][known, None]).apply(standing - origin)
    upright = UprightReturns(
        t[seen][known],
        (Rotation.from_euler("z", -turned_deg, degrees=True).apply(beside - SENSOR_M) + SENSOR_M).astype(np.float32),
        half[seen][known],
        np.zeros(0, np.uint8),
    )
    return GroundReturns(t, turned.astype(np.float32), half, body, upright), knots, state


@pytest.mark.parametrize("turned_deg", [180.0, 90.0, -135.0, 37.0])
def test_facing__finds_the_angle_by_which_a_mounting_is_off(turned_deg: float) -> None:
    returns, knots, state = drive(0.02, turned_deg, seed=1)
    found = facing(returns, knots, state, SENSOR_M)
    assert found.shown
    assert abs((found.offset_deg - turned_deg + 180.0) % 360.0 - 180.0) < 3.0
    if turned_deg % 90.0 == 0.0:
        assert found.offset_deg == turned_deg


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("relief_m", [0.02, 0.0001])
def test_facing__leaves_a_right_mounting_alone(relief_m: float, seed: int) -> None:
    returns, knots, state = drive(relief_m, 0.0, seed)
    assert facing(returns, knots, state, SENSOR_M) == Facing(0.0, shown=relief_m > 0.01)


@pytest.mark.parametrize(("turned_deg", "biased"), [(0.0, False), (0.0, True), (90.0, True), (180.0, False)])
def test_promise_15__a_mounting_is_assumed_where_no_relief_shows_its_facing(turned_deg: float, *, biased: bool) -> None:
    returns, knots, state = drive(0.0005, turned_deg, seed=3)
    if biased:  # rings of lasers whose ranges are off: they repeat under a quarter turn
        ring = np.floor(np.hypot(*returns.xyz_m[:, :2].T) / 0.4).astype(int) % 5
        returns.xyz_m[:, 2] += np.array([0.004, -0.003, 0.0, 0.002, -0.004], np.float32)[ring]
    assert facing(returns, knots, state, SENSOR_M) == Facing(0.0, shown=False)


@pytest.mark.parametrize("turned_deg", [0.0, 180.0, 90.0, -135.0])
def test_facing__is_shown_by_trees_where_soil_is_smooth(turned_deg: float) -> None:
    returns, knots, state = drive(0.0001, turned_deg, seed=6, trees=25)
    found = facing(returns, knots, state, SENSOR_M)
    assert found.shown
    assert found.offset_deg == pytest.approx(turned_deg, abs=3.0)


def test_facing__leaves_small_angles_to_the_stance() -> None:
    returns, knots, state = drive(0.02, 6.0, seed=4)
    assert facing(returns, knots, state, SENSOR_M) == Facing(0.0, shown=True)


def test_facing__needs_some_way() -> None:
    returns, knots, state = drive(0.02, 180.0, seed=5)
    still = State(state.xyz_m * 0.1, state.rotation, state.added)
    assert not facing(returns, knots, still, SENSOR_M).shown
