"""What stands: which returns are of walls, and what they say about poses, against numerical derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.banded import NormalEquations
from furrowmap.core.adjustment.coarse import CoarseGrid, CoarseKnots, coarse_equations
from furrowmap.core.adjustment.knots import KNOT_STEP_S, VEHICLE, Chain, Knots, State
from furrowmap.core.adjustment.registered_returns import Patches, SliceSums, free_patches
from furrowmap.core.matching.ground_registration import ChainPoses
from furrowmap.core.matching.walls import (
    MAX_WALL_RANGE_M,
    MIN_WALL_SIGMA_M,
    WALL_PATCH_M,
    Lines,
    PlacedUpright,
    Scatter,
    add_upright,
    columns_over,
    lines,
    register_walls,
    select_upright,
)

FloatArray = NDArray[np.float64]
SIZE = VEHICLE.size
KNOTS = 41
CHAIN = Chain(0, KNOTS, 0.0)


def wall(
    middle_m: tuple[float, float], direction_deg: float, length_m: float, count: int, seed: int, noise_m: float = 0.01
) -> FloatArray:
    """Points (count, 3) on a wall two metres high."""
    random = np.random.default_rng(seed)
    along = np.array([np.cos(np.radians(direction_deg)), np.sin(np.radians(direction_deg))])
    across = np.array([-along[1], along[0]])
    en = (
        np.array(middle_m)
        + random.uniform(-0.5 * length_m, 0.5 * length_m, (count, 1)) * along
        + noise_m * random.standard_normal((count, 1)) * across
    )
    return np.column_stack([en, random.uniform(0.4, 2.0, count)])


def halves(xyz_m: FloatArray) -> NDArray[np.uint8]:
    return (np.arange(len(xyz_m)) % 2).astype(np.uint8)


def standing(*parts: FloatArray) -> Lines:
    xyz = np.concatenate(parts)
    return lines(add_upright(columns_over(xyz), xyz, np.concatenate([halves(part) for part in parts])))


def test_a_wall_is_a_line_of_its_direction() -> None:
    for direction_deg in (0.0, 17.0, 63.0, 90.0, 141.0):
        found = standing(wall((3.1, -7.2), direction_deg, 12.0, 6000, 1))
        known = np.isfinite(found.line[:, :, 4])
        assert found.whole > 12
        normal = found.line[known][:, 2:4]
        off = normal @ [np.cos(np.radians(direction_deg)), np.sin(np.radians(direction_deg))]
        assert np.sqrt(np.mean(off**2)) < 0.02
        assert np.sqrt(np.median(found.line[known][:, 4])) == pytest.approx(np.hypot(0.01, MIN_WALL_SIGMA_M), rel=0.15)


def test_a_wall_on_the_border_of_columns_is_left_out() -> None:
    assert standing(wall((3.0, -7.0), 0.0, 12.0, 6000, 1)).whole == 0


def test_what_is_no_wall_is_none() -> None:
    random = np.random.default_rng(3)
    crown = random.uniform([-2.0, -2.0, 1.0], [2.0, 2.0, 4.0], (20_000, 3))
    roof = np.column_stack([random.uniform(-3.0, 3.0, (20_000, 2)), np.zeros(20_000)])
    roof[:, 2] = 2.0 + 0.6 * roof[:, 0]
    curb = wall((0.0, 0.0), 30.0, 8.0, 4000, 4) * [1.0, 1.0, 0.1]
    few = wall((0.0, 0.0), 30.0, 8.0, 100, 4)
    moving = wall((0.0, 0.0), 30.0, 3.0, 4000, 5)
    moving[:, :2] += np.linspace(0.0, 1.5, 4000)[:, None] * [0.5, -0.9]
    for what in (crown, roof, curb, few, moving):
        assert standing(what).whole == 0


def poses(shift: FloatArray, turn: FloatArray) -> State:
    """The vehicle at 2 m/s to the east, moved as a whole: turned about its place half-way, and shifted."""
    t = KNOT_STEP_S * np.arange(KNOTS)
    xyz = np.column_stack([2.0 * t, 0.0 * t, 0.3 + 0.0 * t])
    middle = xyz[KNOTS // 2]
    rotation = Rotation.from_rotvec(turn).as_matrix()
    return State(
        middle + (xyz - middle) @ rotation.T + shift, np.broadcast_to(rotation, (KNOTS, 3, 3)).copy(), 0.0 * xyz
    )


def scene(noise_m: float = 0.01) -> tuple[FloatArray, FloatArray, Lines]:
    """Times and vehicle coordinates of returns of two walls, and the walls."""
    here, there = ((2.0, 9.0), 4.0, 16.0), ((-9.0, 2.0), 95.0, 10.0)
    xyz = np.concatenate([wall(*here, 8000, 11, noise_m), wall(*there, 5000, 12, noise_m)])
    t = np.sort(np.random.default_rng(5).uniform(0.0, KNOT_STEP_S * (KNOTS - 1), len(xyz)))
    order = np.random.default_rng(6).permutation(len(xyz))
    xyz = xyz[order]
    vehicle = xyz - np.column_stack([2.0 * t, 0.0 * t, 0.3 + 0.0 * t])
    return t, vehicle, standing(wall(*here, 30_000, 21, noise_m), wall(*there, 20_000, 22, noise_m))


def agreed(
    t_s: FloatArray, vehicle_m: FloatArray, walls: Lines, state: State, coarse: CoarseGrid, correlated: float = 10.0
) -> tuple[SliceSums, Patches, Scatter]:
    k = np.minimum((t_s / KNOT_STEP_S).astype(int), KNOTS - 2)
    share = (t_s / KNOT_STEP_S - k)[:, None]
    origin = state.xyz_m[k] + share * (state.xyz_m[k + 1] - state.xyz_m[k])
    placed = origin + np.einsum("nij,nj->ni", state.rotation[k], vehicle_m)
    sums = SliceSums.empty(KNOTS)
    of_all = PlacedUpright(t_s, placed, halves(placed))
    patches, scatter = register_walls(of_all, walls, ChainPoses.of(CHAIN, state.xyz_m, coarse), correlated, 1.0, sums)
    return sums, patches, scatter


def whole(sums: SliceSums, state: State) -> tuple[FloatArray, FloatArray]:
    """Normal matrix and right-hand side of a shift and a turn of all about the place half-way."""
    middle = state.xyz_m[KNOTS // 2]
    normal, right = np.zeros((6, 6)), np.zeros(6)
    row, column = np.triu_indices(6)
    for k in range(KNOTS - 1):
        square = np.zeros((6, 6))
        square[row, column] = square[column, row] = sums.normal[k]
        x, y, z = 0.5 * (state.xyz_m[k] + state.xyz_m[k + 1]) - middle
        design = np.eye(6)
        design[:3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
        normal += design.T @ square @ design
        right += design.T @ sums.right[k]
    return normal, right


def test_walls_bring_place_and_heading_back() -> None:
    t, vehicle, walls = scene()
    shift, turn = np.array([0.03, -0.04, 0.0]), np.array([0.0, 0.0, np.radians(0.25)])
    state = poses(shift, turn)
    sums, _, _ = agreed(t, vehicle, walls, state, CoarseGrid(0, 0, 1.0))
    normal, right = whole(sums, state)
    step = np.linalg.lstsq(normal[np.ix_([0, 1, 5], [0, 1, 5])], right[[0, 1, 5]], rcond=None)[0]
    np.testing.assert_allclose(step[:2], -shift[:2], atol=0.004)
    assert step[2] == pytest.approx(-turn[2], abs=np.radians(0.02))
    assert normal[2, 2] == 0.0


def test_equations_are_the_derivatives_of_the_residuals() -> None:
    """A movement's effect on the right-hand side is what the normal matrix says, for all six unknowns."""
    t, vehicle, walls = scene(noise_m=0.0)
    still = CoarseGrid(0, 0, 1.0)
    start = poses(np.zeros(3), np.zeros(3))
    normal, before = whole(agreed(t, vehicle, walls, start, still)[0], start)
    for unknown in range(6):
        move = np.zeros(6)
        move[unknown] = 1e-5
        moved = poses(move[:3], move[3:])
        after = whole(agreed(t, vehicle, walls, moved, still)[0], start)[1]
        np.testing.assert_allclose((after - before) / 1e-5, -normal[:, unknown], atol=2e-3 * np.abs(normal).max())


def test_a_wall_of_one_direction_does_not_hold_the_way_along_it() -> None:
    t, vehicle, _ = scene()
    one = standing(wall((2.0, 9.0), 4.0, 16.0, 30_000, 21))
    state = poses(np.zeros(3), np.zeros(3))
    normal, _ = whole(agreed(t, vehicle, one, state, CoarseGrid(0, 0, 1.0))[0], state)
    along = np.array([np.cos(np.radians(4.0)), np.sin(np.radians(4.0))])
    across = np.array([-along[1], along[0]])
    assert along @ normal[:2, :2] @ along < 1e-3 * (across @ normal[:2, :2] @ across)


def of_slices(sums: SliceSums) -> NormalEquations:
    """Equations of the knots; a slice's pose is the mean of those of its two knots."""
    equations = NormalEquations(KNOTS * SIZE, 3 * SIZE)
    row, column = np.triu_indices(6)
    for k in range(KNOTS - 1):
        square = np.zeros((6, 6))
        square[row, column] = square[column, row] = sums.normal[k]
        size, axes = np.linalg.eigh(square)
        for weight, axis in zip(size, axes.T, strict=True):
            design = np.zeros((1, 2 * SIZE))
            design[0, :6] = design[0, SIZE : SIZE + 6] = 0.5 * np.sqrt(max(weight, 0.0)) * axis
            equations.add(np.array([k * SIZE]), design, np.zeros(1), np.ones(1))
    return equations


def test_walls_that_move_along_cost_a_movement_of_all_nothing() -> None:
    t, vehicle, walls = scene()
    state = poses(np.array([0.02, 0.01, 0.0]), np.array([0.0, 0.0, np.radians(0.1)]))
    knots = Knots((CHAIN,), KNOT_STEP_S * np.arange(KNOTS))
    coarse = CoarseKnots.over(knots, 20, WALL_PATCH_M)
    centre = coarse.centres(knots, state)
    sums, patches, _ = agreed(t, vehicle, walls, state, coarse.grids[0])
    equations = coarse_equations(of_slices(sums), coarse, centre, state, coarse.count)
    firm = equations.dense()
    free_patches(equations, [patches], WALL_PATCH_M, centre)
    left = equations.dense()
    twist = np.array([0.3, -0.2, 0.1, 0.01, -0.02, 0.05])
    step = np.zeros((coarse.count, SIZE))
    for c in range(coarse.count):
        step[c, :3] = twist[:3] + np.cross(twist[3:], centre[c])
        step[c, 3:6] = twist[3:]
    step = step.reshape(-1)
    assert step @ firm @ step > 0
    assert abs(step @ left @ step) < 1e-6 * (step @ firm @ step)


def test_scatter_tells_returns_that_share_an_error_from_those_that_do_not() -> None:
    t, vehicle, walls = scene()
    state = poses(np.zeros(3), np.zeros(3))
    apart = agreed(t, vehicle, walls, state, CoarseGrid(0, 0, 1.0))[2]
    assert apart.groups > 50
    assert apart.correlated == pytest.approx(4.0)
    random = np.random.default_rng(9)
    column = np.floor(vehicle[:, :2] + np.column_stack([2.0 * t, 0.0 * t])).astype(int)
    common = 0.02 * random.standard_normal((200, 200))[column[:, 0], column[:, 1]]
    dented = vehicle + np.where(np.abs(vehicle[:, 1:2]) > 5.0, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]]) * common[:, None]
    together = agreed(t, dented, walls, state, CoarseGrid(0, 0, 1.0))[2]
    assert together.correlated > 10.0


def test_scatter_counts_groups_of_one_half_one_column_and_one_second() -> None:
    """A column's error that lasts for four seconds is shared by its returns of each second, not by all of them."""
    knots, spot = 161, ((2.0, 9.0), 4.0, 16.0)
    walls, xyz = standing(wall(*spot, 30_000, 21)), wall(*spot, 8000, 11)
    random = np.random.default_rng(4)
    t = np.sort(random.uniform(0.0, KNOT_STEP_S * (knots - 1), len(xyz)))
    half = random.integers(0, 2, len(xyz), np.uint8)
    column = np.floor(xyz[:, :2] / 0.5).astype(int)
    xyz[:, 1] += 0.02 * random.standard_normal((100, 100))[column[:, 0], column[:, 1]]
    poses = ChainPoses.of(Chain(0, knots, 0.0), np.zeros((knots, 3)), CoarseGrid(0, 0, 1.0))
    scatter = register_walls(PlacedUpright(t, xyz, half), walls, poses, 10.0, 1.0, SliceSums.empty(knots))[1]
    _, size = np.unique(np.column_stack([column, half, np.floor(t)]), axis=0, return_counts=True)
    assert scatter.groups == pytest.approx(np.sum(size > 10), rel=0.3)  # columns at the ends of the wall show no line
    shared = size[size > 10].mean()
    assert 0.5 * shared < scatter.correlated < 1.3 * shared


def test_only_what_stands_near_is_selected() -> None:
    random = np.random.default_rng(2)
    xyz = random.uniform([-50.0, -50.0, -2.5], [50.0, 50.0, 3.0], (50_000, 3)).astype(np.float32)
    rotation = Rotation.from_euler("ZYX", [0.4, 0.3, 0.1]).as_matrix()
    lever = np.array([0.5, -0.2, 2.0])
    column = (np.arange(len(xyz)) // 16).astype(np.uint16)
    number, laser = np.arange(len(xyz), dtype=np.float64), (np.arange(len(xyz)) % 16).astype(np.uint8)
    (index, vehicle, lasers), count = select_upright(number, xyz, column, laser, rotation, lever, 0.1, 1)
    expected = xyz @ rotation.T + lever
    distance, height = np.hypot(expected[:, 0], expected[:, 1]), expected[:, 2] - 0.1
    wanted = (distance > 1.5) & (distance < MAX_WALL_RANGE_M) & (height > np.minimum(0.35 + 0.05 * distance, 1.0))
    assert count == len(index) == wanted.sum()
    np.testing.assert_array_equal(index, np.flatnonzero(wanted))
    np.testing.assert_allclose(vehicle, expected[wanted], atol=1e-5)
    np.testing.assert_array_equal(lasers, laser[wanted])
    (fewer, _, _), again = select_upright(number, xyz, column, laser, rotation, lever, 0.1, 5)
    assert again == count
    assert (column[fewer.astype(int)] % 5 == 0).all()
    assert 0.1 < len(fewer) / count < 0.3
