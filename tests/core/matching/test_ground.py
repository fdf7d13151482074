"""What returns say about poses, against numerical derivatives on a known ground; what relief is said to be worth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.coarse import CoarseGrid
from furrowmap.core.adjustment.knots import KNOT_STEP_S, Chain
from furrowmap.core.adjustment.registered_returns import Patches
from furrowmap.core.matching.ground_registration import (
    CORRELATED,
    NOISE_M,
    ChainPoses,
    GroundSums,
    PlacedReturns,
    Relief,
    register_ground,
)
from furrowmap.core.matching.height_grid import HeightGrid, add_returns, empty_surface, tiles_over

FloatArray = NDArray[np.float64]
Ground = Callable[[FloatArray], FloatArray]

CELL_M = 0.1
PATCH_M = 1.0
EXACT = Relief(variance=1e6, noise=1.0)
"""Slopes are taken as they are."""
WEIGHT = 1.0 / (NOISE_M**2 * (1.0 + 1.0 / 64.0) * CORRELATED)
"""Of a return over nodes that hold sixty-four others each."""
CHAIN = Chain(2, 9, 100.0)
KNOTS = 12


def waves(en: FloatArray) -> FloatArray:
    e, n = en[:, 0], en[:, 1]
    return np.asarray(0.07 * np.sin(1.1 * e + 0.4) + 0.05 * np.cos(0.9 * n - 0.5 * e) + 0.04 * n)


def dense_surface(ground: Ground, side_m: float, noise_m: float = 0.0, per_cell: int = 8) -> HeightGrid:
    """Both halves of old soil in a square about the origin, from independent evenly spread points."""
    one = (np.arange(-round(side_m / 2 / CELL_M) * per_cell, round(side_m / 2 / CELL_M) * per_cell) + 0.5) / per_cell
    en = np.stack(np.meshgrid(one, one), axis=-1).reshape(-1, 2) * CELL_M
    surface = empty_surface(tiles_over(en, CELL_M))
    random = np.random.default_rng(7)
    for half in (0, 1):
        xyz = np.column_stack([en, ground(en) + noise_m * random.standard_normal(len(en))])
        n = len(en)
        add_returns(surface, xyz, np.zeros(n, np.int8), np.full(n, half, np.uint8), np.full(n, 255, np.uint8))
    return surface


@dataclass(frozen=True)
class Found:
    sums: GroundSums
    patches: Patches
    trust: NDArray[np.uint8]


def agreed(
    xyz: FloatArray, t_s: FloatArray, surface: HeightGrid, position: FloatArray, relief: Relief = EXACT, every: int = 0
) -> Found:
    n = len(xyz)
    sums, trust = GroundSums.empty(len(position)), np.zeros(n, np.uint8)
    half = (np.arange(n) % 2).astype(np.uint8)
    grid = CoarseGrid(5, every, PATCH_M)
    placed = PlacedReturns(t_s, np.ascontiguousarray(xyz), np.zeros(n, np.int8), half, trust)
    patches = register_ground(placed, surface, ChainPoses.of(CHAIN, position, grid), relief, 1.0, sums)
    return Found(sums, patches, trust)


def symmetric(upper: FloatArray) -> FloatArray:
    out = np.zeros((6, 6))
    out[np.triu_indices(6)] = upper
    return out + out.T - np.diag(np.diag(out))


def moved(xyz: FloatArray, twist: FloatArray, centre: FloatArray) -> FloatArray:
    turned = Rotation.from_rotvec(twist[3:]).apply(xyz - centre)
    return np.asarray(turned + centre + twist[:3])


def derivative(ground: Ground, xyz: FloatArray, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Heights above the ground (n,), and their derivatives (n, 6) by a twist of the points about a centre."""

    def residual(twist: FloatArray) -> FloatArray:
        at = moved(xyz, twist, centre)
        return at[:, 2] - ground(at[:, :2])

    step = 1e-5
    columns = [(residual(step * one) - residual(-step * one)) / (2 * step) for one in np.eye(6)]
    return residual(np.zeros(6)), np.column_stack(columns)


@pytest.fixture(scope="module")
def matched() -> tuple[FloatArray, FloatArray, FloatArray, Found]:
    """Points of a vehicle that drives, some millimetres and hundredths of a degree off a smooth ground."""
    random = np.random.default_rng(5)
    surface = dense_surface(waves, 14.0)
    position = np.column_stack([0.03 * np.arange(KNOTS), np.zeros(KNOTS), 0.1 + 0.001 * np.arange(KNOTS)])
    t = np.sort(CHAIN.begin_s + random.uniform(0, (CHAIN.count - 1) * KNOT_STEP_S, 6000))
    en = random.uniform(-6, 6, (len(t), 2))
    xyz = np.column_stack([en, waves(en)])
    xyz = moved(xyz, np.array([0.004, -0.003, 0.008, 2e-4, -3e-4, 5e-4]), np.zeros(3))
    return t, xyz, position, agreed(xyz, t, surface, position, every=4)


def test_equations_are_those_of_a_numerical_derivative(
    matched: tuple[FloatArray, FloatArray, FloatArray, Found],
) -> None:
    t, xyz, position, found = matched
    local = ((t - CHAIN.begin_s) / KNOT_STEP_S).astype(int)
    for slot in range(CHAIN.count - 1):
        knot, mine = CHAIN.first + slot, local == slot
        residual, design = derivative(waves, xyz[mine], 0.5 * (position[knot] + position[knot + 1]))
        expected = WEIGHT * design.T @ design
        scale = np.sqrt(np.diag(expected))
        assert np.abs((symmetric(found.sums.slices.normal[knot]) - expected) / np.outer(scale, scale)).max() < 0.02
        for right in (found.sums.slices.right, found.sums.slices.right_free):
            size = scale * np.sqrt(WEIGHT * (residual**2).sum())
            assert np.abs((right[knot] + WEIGHT * design.T @ residual) / size).max() < 0.03
        assert found.sums.slices.returns[knot] == mine.sum()
    assert not found.sums.slices.normal[: CHAIN.first].any()
    assert not found.sums.slices.normal[CHAIN.first + CHAIN.count - 1 :].any()
    assert (found.trust == 255).all()


def test_patches_are_those_of_a_numerical_derivative_shared_between_coarse_knots(
    matched: tuple[FloatArray, FloatArray, FloatArray, Found],
) -> None:
    t, xyz, _, found = matched
    local = ((t - CHAIN.begin_s) / KNOT_STEP_S).astype(int)
    place = np.floor(xyz[:, :2] / PATCH_M).astype(int)
    patches = found.patches
    assert len(patches.place) == len(np.unique(np.column_stack([place, local // 4]), axis=0))
    for k in range(0, len(patches.place), 7):
        column, row, layer = patches.place[k]
        assert layer == 0
        mine = (place == (column, row)).all(axis=1) & (5 + local // 4 == patches.interval[k])
        centre = np.array([(column + 0.5) * PATCH_M, (row + 0.5) * PATCH_M, 0.0])
        residual, design = derivative(waves, xyz[mine], centre)
        late = (local[mine] % 4 + 0.5) / 4
        scale = np.sqrt(WEIGHT * mine.sum()) * np.array([0.07, 0.07, 1.0, 0.3, 0.3, 0.03])
        for shares, sums in ((1 - late, patches.early[k]), (late, patches.late[k])):
            expected = WEIGHT * (design * shares[:, None]).T @ design
            assert np.abs((symmetric(sums) - expected) / np.outer(scale, scale)).max() < 0.04
        size = scale * np.sqrt(WEIGHT * (residual**2).sum())
        assert np.abs((patches.right[k] + WEIGHT * design.T @ residual) / size).max() < 0.05


def test_what_is_far_off_the_ground_or_over_none_takes_no_part() -> None:
    surface = dense_surface(lambda en: 0.0 * en[:, 0], 4.0)
    xyz = np.array([[0.03, 0.04, 0.001], [0.53, 0.4, 0.3], [0.2, -0.6, 0.05], [8.0, 0.0, 0.0]])
    t = CHAIN.begin_s + 0.001 * np.arange(4.0)
    found = agreed(xyz, t, surface, np.zeros((KNOTS, 3)))
    assert found.sums.slices.returns.sum() == 2
    assert found.trust.tolist()[:2] == [255, 0]
    # Four standard deviations off: the weight of two and a half.
    assert found.trust[2] == pytest.approx(255 * 2.5 * NOISE_M / 0.05, rel=0.03)
    assert found.trust[3] == 255


@pytest.mark.parametrize("direction", [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1)])
def test_ground_goes_as_far_as_all_four_nodes_are_seen(direction: tuple[int, int]) -> None:
    surface = dense_surface(lambda en: 0.0 * en[:, 0], 4.0)
    edge_m = CELL_M * round(2.0 / CELL_M)
    along_m = np.array([edge_m - 0.9 * CELL_M, edge_m - 0.1 * CELL_M, edge_m + 0.1 * CELL_M])
    xyz = np.column_stack([np.outer(along_m, direction), np.zeros(3)])
    taken = [
        int(agreed(one[None], np.array([CHAIN.begin_s]), surface, np.zeros((KNOTS, 3))).sums.slices.returns.sum())
        for one in xyz
    ]
    assert taken == [1, 1, 0]


def test_noise_is_not_taken_for_relief() -> None:
    random = np.random.default_rng(9)
    en = random.uniform(-3, 3, (60 * 60 * 40, 2))
    surface = empty_surface(tiles_over(en, CELL_M))
    xyz = np.column_stack([en, NOISE_M * random.standard_normal(len(en))])
    n = len(en)
    half = (np.arange(n) % 2).astype(np.uint8)
    add_returns(surface, xyz, np.zeros(n, np.int8), half, np.full(n, 255, np.uint8))
    t = np.sort(CHAIN.begin_s + random.uniform(0, (CHAIN.count - 1) * KNOT_STEP_S, 20_000))
    probe = np.column_stack([random.uniform(-2.8, 2.8, (len(t), 2)), np.zeros(len(t))])
    relief = agreed(probe, t, surface, np.zeros((KNOTS, 3))).sums.relief()
    seen = (NOISE_M / CELL_M) ** 2 * 2 / 20  # what the noise of twenty returns a node makes of a slope between two
    assert relief.variance < 0.05 * seen
    # Nodes share returns with their neighbours, so that slopes between them are a little less noisy than that.
    assert 0.3 <= relief.noise < 1.3


@pytest.mark.parametrize("noise_m", [0.0, NOISE_M])
def test_relief_is_told_from_noise(noise_m: float) -> None:
    amplitude, number = 0.02, 2 * np.pi / 1.5

    def furrows(en: FloatArray) -> FloatArray:
        return np.asarray(amplitude * np.sin(number * en[:, 0]))

    surface = dense_surface(furrows, 7.0, noise_m, per_cell=4)
    random = np.random.default_rng(11)
    t = np.sort(CHAIN.begin_s + random.uniform(0, (CHAIN.count - 1) * KNOT_STEP_S, 30_000))
    en = np.column_stack([random.uniform(-3, 3, len(t)), random.uniform(-3, 3, len(t))])
    probe = np.column_stack([en, furrows(en)])
    relief = agreed(probe, t, surface, np.zeros((KNOTS, 3))).sums.relief()
    # The mean of both directions, of which only one has slopes.
    assert relief.variance == pytest.approx(0.5 * 0.5 * (amplitude * number) ** 2, rel=0.08)


def test_the_foot_of_a_fence_makes_no_relief_of_smooth_soil() -> None:
    def fence(en: FloatArray) -> FloatArray:
        return np.where(np.abs(en[:, 0]) < 0.05, 0.12, 0.0)

    surface = dense_surface(fence, 7.0, 0.005, per_cell=4)
    random = np.random.default_rng(14)
    t = np.sort(CHAIN.begin_s + random.uniform(0, (CHAIN.count - 1) * KNOT_STEP_S, 30_000))
    en = random.uniform(-3, 3, (len(t), 2))
    probe = np.column_stack([en, fence(en)])
    whole, trimmed = (
        agreed(probe, t, surface, np.zeros((KNOTS, 3)), Relief(variance=0.0004, trim=trim)).sums.relief()
        for trim in (np.inf, 3.0)
    )
    assert whole.variance > 0.05**2
    assert trimmed.variance < 0.01**2
    found = Relief()
    for _ in range(5):
        found = agreed(probe, t, surface, np.zeros((KNOTS, 3)), found).sums.relief()
    assert found.variance < 0.01**2


def test_slopes_are_taken_for_what_they_are_worth() -> None:
    """With slopes of which half the variance is noise, the pull sideways is halved and heights count as before."""
    surface = dense_surface(waves, 8.0)
    random = np.random.default_rng(13)
    t = np.sort(CHAIN.begin_s + random.uniform(0, (CHAIN.count - 1) * KNOT_STEP_S, 3000))
    en = random.uniform(-3, 3, (len(t), 2))
    xyz = np.column_stack([en, waves(en) + 0.002])
    whole = agreed(xyz, t, surface, np.zeros((KNOTS, 3)))
    variance = (NOISE_M / CELL_M) ** 2 * 2 / 64 * 2 / 3  # of a slope between nodes of 64 returns each, mean over a cell
    half = agreed(xyz, t, surface, np.zeros((KNOTS, 3)), Relief(variance, 1.0))
    np.testing.assert_allclose(half.sums.slices.right[:, 2], whole.sums.slices.right[:, 2], rtol=1e-9)
    for axis in (0, 1):
        share = half.sums.slices.right[:, axis].sum() / whole.sums.slices.right[:, axis].sum()
        assert share == pytest.approx(0.5, abs=0.06)
