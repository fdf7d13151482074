"""Poses and ground moved together, against dense matrices made row by row, and the law that place itself is free."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.banded import NormalEquations
from furrowmap.core.adjustment.coarse import CoarseKnots, coarse_equations, fine_step
from furrowmap.core.adjustment.knots import KNOT_STEP_S, VEHICLE, Chain, Knots, State, knots_over, place, turns
from furrowmap.core.adjustment.registered_returns import Patches, PatchStore, free_patches
from furrowmap.core.matching.ground_registration import ChainPoses, GroundSums, PlacedReturns, Relief, register_ground
from furrowmap.core.matching.height_grid import add_returns, empty_surface, tiles_over

FloatArray = NDArray[np.float64]

SIZE = VEHICLE.size
PATCH_M = 1.0
EVERY = 8


def dense(equations: NormalEquations) -> FloatArray:
    """The whole matrix of a lower band."""
    size = equations.band.shape[1]
    out = np.zeros((size, size))
    for offset, diagonal in enumerate(equations.band[:size]):
        index = np.arange(size - offset)
        out[index + offset, index] = out[index, index + offset] = diagonal[: size - offset]
    return out


def curve(duration_s: float = 3.0) -> tuple[Knots, State]:
    """A turn of 25°/s with sway, on a slope."""
    knots = knots_over(np.array([100.0, 100.0 + duration_s]))
    s = knots.t_s - 100.0
    yaw = np.radians(25.0) * s
    xyz = np.column_stack([2.5 * np.sin(yaw), -2.5 * np.cos(yaw), 0.5 + 0.02 * np.sin(3 * s)])
    sway = np.radians(0.3) * np.column_stack([np.sin(11 * s), np.cos(9 * s)])
    rotation = Rotation.from_euler("ZYX", np.column_stack([yaw, sway])).as_matrix()
    return knots, State(xyz, rotation, np.zeros((len(knots), 3)))


def projection(coarse: CoarseKnots, centre: FloatArray, state: State) -> FloatArray:
    """The matrix that takes a step at the coarse knots to one at all knots."""
    ones = np.eye(coarse.count * SIZE)
    return np.column_stack([fine_step(coarse, centre, state, one).reshape(-1) for one in ones])


def rigid(translation: FloatArray, turn: FloatArray, centre: FloatArray) -> FloatArray:
    """The step at the coarse knots that moves everything as one body."""
    step = np.zeros((len(centre), SIZE))
    step[:, :3] = translation + np.cross(turn, centre)
    step[:, 3:6] = turn
    return step.reshape(-1)


SIX_TWISTS = [(np.eye(3)[k % 3] * (k < 3), np.eye(3)[k % 3] * (k >= 3)) for k in range(6)]


def test_fine_step__of_a_rigid_motion_is_that_motion() -> None:
    knots, state = curve()
    coarse = CoarseKnots.over(knots, EVERY, PATCH_M)
    centre = coarse.centres(knots, state)
    random = np.random.default_rng(2)
    translation, turn = random.normal(size=3), 1e-4 * random.normal(size=3)
    step = fine_step(coarse, centre, state, rigid(translation, turn, centre))
    np.testing.assert_allclose(step[:, :3], translation + np.cross(turn, state.xyz_m), atol=1e-12)
    np.testing.assert_allclose(step[:, 3:6], np.broadcast_to(turn, (len(knots), 3)), atol=1e-15)
    np.testing.assert_allclose(
        state.moved(step).xyz_m, Rotation.from_rotvec(turn).apply(state.xyz_m) + translation, atol=1e-7
    )


def test_coarse_knots_are_the_vehicle_s_places_in_even_steps() -> None:
    t = np.concatenate([np.arange(100.0, 102.0, 0.05), np.arange(120.0, 121.5, 0.05)])
    knots = knots_over(t)
    xyz = np.column_stack([knots.t_s, 2 * knots.t_s, np.sin(knots.t_s)])
    state = State(xyz, np.broadcast_to(np.eye(3), (len(xyz), 3, 3)), np.zeros_like(xyz))
    coarse = CoarseKnots.over(knots, EVERY, PATCH_M)
    centre = coarse.centres(knots, state)
    assert len(knots.chains) == 2
    assert len(centre) == coarse.count == coarse.before.max() + 2
    inner = centre[coarse.before] + coarse.share[:, None] * (centre[coarse.before + 1] - centre[coarse.before])
    last = np.zeros(len(knots), bool)
    for chain in knots.chains:  # beyond a chain's last knot its place is held
        last[chain.first + (chain.count - 2) // EVERY * EVERY : chain.first + chain.count] = True
    np.testing.assert_allclose(inner[~last, 0], knots.t_s[~last], atol=1e-6)
    np.testing.assert_allclose(inner[~last, 2], np.sin(knots.t_s[~last]), atol=0.01)


@pytest.mark.parametrize("count", [2, 3, EVERY, EVERY + 1, EVERY + 2, 2 * EVERY + 1, 5 * EVERY, 5 * EVERY + 1])
def test_every_coarse_knot_moves_some_knot(count: int) -> None:
    """One that moves none would make the equations singular."""
    chain = Chain(0, count, 100.0)
    t = 100.0 + KNOT_STEP_S * np.arange(count)
    state = State(np.zeros((count, 3)), np.broadcast_to(np.eye(3), (count, 3, 3)), np.zeros((count, 3)))
    knots = Knots((chain,), t)
    coarse = CoarseKnots.over(knots, EVERY, PATCH_M)
    moves = np.abs(projection(coarse, coarse.centres(knots, state), state)).max(axis=0)
    assert moves.min() >= 1 / EVERY
    assert coarse.before.min() == 0
    assert coarse.before.max() == coarse.count - 2
    assert (coarse.share >= 0).all()
    assert (coarse.share <= 1).all()


def test_coarse_equations__are_the_fine_ones_projected() -> None:
    knots, state = curve(1.5)
    n = len(knots) * SIZE
    random = np.random.default_rng(4)
    fine = NormalEquations(n, 3 * SIZE)
    for _ in range(6):
        for width in (SIZE, 2 * SIZE, 3 * SIZE):
            first = np.arange(0, n - width + 1, SIZE)
            fine.add(
                first, random.normal(size=(len(first), width)), random.normal(size=len(first)), np.ones(len(first))
            )
    coarse = CoarseKnots.over(knots, EVERY, PATCH_M)
    centre = coarse.centres(knots, state)
    found = coarse_equations(fine, coarse, centre, state, 2)
    p = projection(coarse, centre, state)
    expected = p.T @ dense(fine) @ p
    np.testing.assert_allclose(dense(found), expected, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(found.right, p.T @ fine.right, atol=1e-9 * np.abs(fine.right).max() * EVERY)


def test_free_patches__is_the_schur_complement_of_the_ground() -> None:
    """Rows of returns: the coarse knots' twists move the return, the patch's twist moves the ground under it."""
    random = np.random.default_rng(6)
    count, patches_of, returns = 5, 4, 400
    centre = random.uniform(-3, 3, (count, 3))
    places = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1], [-2, 3, 0]])
    which = random.integers(0, patches_of, returns)
    middle = np.column_stack([(places[which, :2] + 0.5) * PATCH_M, np.zeros(returns)])
    point = middle + random.uniform((-0.5, -0.5, -0.3), (0.5, 0.5, 0.3), (returns, 3))
    normal = np.column_stack([0.2 * random.normal(size=(returns, 2)), np.ones(returns)])
    interval = np.minimum(which % 2 + random.integers(0, 3, returns), count - 2)
    late = random.uniform(0, 1, returns)
    weight, residual = random.uniform(10, 100, returns), 0.01 * random.normal(size=returns)

    knots = np.zeros((returns, count, 6))
    for k, share in ((interval, 1 - late), (interval + 1, late)):
        arm = point - centre[k]
        knots[np.arange(returns), k] += share[:, None] * np.column_stack([normal, np.cross(arm, normal)])
    g = np.column_stack([normal, np.cross(point - middle, normal)])
    ground = np.zeros((returns, patches_of, 6))
    ground[np.arange(returns), which] = -g
    a, b = knots.reshape(returns, -1), ground.reshape(returns, -1)
    wb = weight[:, None] * b
    correction = (a.T @ wb) @ np.linalg.solve(b.T @ wb, b.T @ (weight[:, None] * a))
    pull = (a.T @ wb) @ np.linalg.solve(b.T @ wb, b.T @ (weight * residual))

    # The same returns as two parts of a recording tell them.
    upper = np.triu_indices(6)
    parts = []
    for part in (0, 1):
        keys = sorted({(w, i) for w, i, k in zip(which, interval, range(returns), strict=True) if k % 2 == part})
        rows: list[tuple[FloatArray, FloatArray, FloatArray]] = []
        for w, i in keys:
            mine = (which == w) & (interval == i) & (np.arange(returns) % 2 == part)
            early_w, late_w = weight * (1 - late), weight * late
            square = [(g[mine] * x[mine, None]).T @ g[mine] for x in (early_w, late_w)]
            rows.append((square[0][upper], square[1][upper], -g[mine].T @ (weight * residual)[mine]))
        early_sum, late_sum, right = (np.array(column) for column in zip(*rows, strict=True))
        place = places[[w for w, _ in keys]].astype(np.int64)
        parts.append(Patches(place, np.array([i for _, i in keys]), early_sum, late_sum, right))

    equations = NormalEquations(count * SIZE, count * SIZE)
    free_patches(equations, parts, PATCH_M, centre)
    poses = (np.arange(count)[:, None] * SIZE + np.arange(6)).reshape(-1)
    found = dense(equations)[np.ix_(poses, poses)]
    assert np.abs(found + correction).max() < 1e-6 * np.abs(correction).max()
    assert np.abs(equations.right[poses] - pull).max() < 1e-6 * np.abs(pull).max()
    drift = np.setdiff1d(np.arange(count * SIZE), poses)
    assert not dense(equations)[drift].any()


@dataclass(frozen=True)
class Turning:
    """A machine that turns over relief, and what the returns say about it."""

    knots: Knots
    state: State
    coarse: CoarseKnots
    centre: FloatArray
    held: FloatArray
    freed: FloatArray


@pytest.fixture(scope="module")
def turning() -> Turning:
    knots, state = curve()
    random = np.random.default_rng(8)
    n = 40_000
    t = np.sort(random.uniform(100.0, 103.0, n))
    reach = 5.0 * np.sqrt(random.uniform(0.05, 1, n))
    angle = random.uniform(0, 2 * np.pi, n)
    chain = knots.chains[0]

    def placed(height: FloatArray) -> FloatArray:
        vehicle = np.column_stack([reach * np.cos(angle), reach * np.sin(angle), height]).astype(np.float32)
        found: FloatArray = place(
            t, vehicle, chain.first, chain.begin_s, KNOT_STEP_S, state.xyz_m, state.rotation, turns(state.rotation)
        )
        return found

    def ground(xyz: FloatArray) -> FloatArray:
        return np.asarray(0.03 * np.sin(5 * xyz[:, 0]) * np.cos(4 * xyz[:, 1]) + 0.03 * xyz[:, 0])

    height = np.zeros(n)
    for _ in range(5):
        xyz = placed(height)
        height += ground(xyz) - xyz[:, 2]
    xyz = placed(height + 0.008 * random.standard_normal(n))
    layer, half, trust = np.zeros(n, np.int8), (np.arange(n) // 500 % 2).astype(np.uint8), np.full(n, 255, np.uint8)
    surface = empty_surface(tiles_over(xyz[:, :2], 0.15))
    add_returns(surface, xyz, layer, half, trust)
    coarse = CoarseKnots.over(knots, EVERY, PATCH_M)
    centre = coarse.centres(knots, state)
    sums = GroundSums.empty(len(knots))
    placed = PlacedReturns(t, xyz, layer, half, trust)
    patches = register_ground(placed, surface, ChainPoses.of(chain, state.xyz_m, coarse.grids[0]), Relief(), 1.0, sums)
    fine = NormalEquations(len(knots) * SIZE, 3 * SIZE)
    sums.slices.add_to(fine, knots, free=True)
    equations = coarse_equations(fine, coarse, centre, state, coarse.count)
    held = dense(equations)
    free_patches(equations, [patches], PATCH_M, centre)
    return Turning(knots, state, coarse, centre, held, dense(equations))


@pytest.mark.parametrize("twist", range(6))
def test_a_rigid_motion_of_poses_and_ground_costs_nothing(turning: Turning, twist: int) -> None:
    step = rigid(*SIX_TWISTS[twist], turning.centre)
    held, freed = step @ turning.held @ step, step @ turning.freed @ step
    assert held > 1e3
    # What is left is the price of holding smooth patches in their place.
    assert abs(freed) < 1e-5 * held
    size = 1 / np.sqrt(np.diag(turning.held) + 1e-9)
    assert np.linalg.norm(size * (turning.freed @ step)) < 1e-3 * np.linalg.norm(size * (turning.held @ step))


def test_other_motions_cost_something_and_none_gains(turning: Turning) -> None:
    poses = (np.arange(turning.coarse.count)[:, None] * SIZE + np.arange(6)).reshape(-1)
    scale = 1 / np.sqrt(np.diag(turning.held)[poses])
    freed = turning.freed[np.ix_(poses, poses)] * scale[:, None] * scale
    values = np.linalg.eigvalsh(freed)
    assert values[0] > -1e-6
    assert values[5] < 2e-5
    assert values[6] > 30 * values[5]
    # Rolling half-way through is told from the ground moved along.
    step = np.zeros((turning.coarse.count, SIZE))
    step[turning.coarse.count // 2, 3] = np.radians(0.1)
    whole = step.reshape(-1)
    assert whole @ turning.freed @ whole > 0.05 * (whole @ turning.held @ whole)


def test_stored__patches_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(4)
    parts = [
        Patches(*(rng.integers(0, 9, (n, 3)), rng.integers(0, 9, n)), *(rng.normal(size=(n, k)) for k in (21, 21, 6)))
        for n in (2, 0, 3, 1, 4, 2)
    ]
    monkeypatch.setattr("furrowmap.core.adjustment.registered_returns.MIN_STORED_ROWS", 5)
    store = PatchStore()
    for part in parts:
        store.add(part)
    found = store.all()
    assert found[0].early.base is found[2].early.base  # of the first five rows
    for one, same in zip(parts, found, strict=True):
        for name, column in one._asdict().items():
            assert np.array_equal(getattr(same, name), column)
            assert getattr(same, name).dtype == column.dtype
