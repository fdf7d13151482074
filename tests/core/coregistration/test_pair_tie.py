"""Ties of two dates against surfaces that were moved, bent and worked by a known amount."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from furrowmap.core.coregistration.pair_tie import LEVEL_TERMS, PLACE_TERMS, GroundPair, PairTie, tie_pair, tie_points
from furrowmap.core.coregistration.tie_network import adjust_network, interpolate_left_error
from furrowmap.core.crops.bare_soil import HeightCovariance, SoilCells
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.moved_surface import move_surface

CELL_M, SIDE = 0.05, 240
MIDDLE_M = np.array([0.5 * CELL_M * SIDE, 0.5 * CELL_M * SIDE])
PLACE_SIGMA = np.array([0.03, 0.03, 0.005])
GRID = Grid(CELL_M, 0, SIDE, (SIDE, SIDE))
FloatArray = NDArray[np.float64]


def ground(rng: np.random.Generator, sigma_m: float = 0.01) -> FloatArray:
    """Clods of 4 cm, on cells of 1.25 cm."""
    relief = gaussian_filter(rng.standard_normal((SIDE * 4, SIDE * 4)), 3.0, mode="wrap")
    return np.asarray(relief * sigma_m / relief.std(), np.float64)


def measured(
    relief: FloatArray, move: FloatArray, rng: np.random.Generator, bend_m: float = 0.0
) -> NDArray[np.float32]:
    """What a receiver that is off by the inverse of `move` makes of the ground."""
    x, y = (values.reshape(GRID.shape) for values in GRID.positions_m().T)
    east, north = x - MIDDLE_M[0], y - MIDDLE_M[1]
    e, n = x + move[0] - move[5] * north, y + move[1] + move[5] * east
    fine = CELL_M / 4
    height = map_coordinates(relief, [(SIDE * CELL_M - n) / fine - 0.5, e / fine - 0.5], order=1, mode="nearest")
    height += 0.003 * rng.standard_normal(GRID.shape) - move[2] - move[3] * east - move[4] * north
    if bend_m:
        waves = gaussian_filter(rng.standard_normal(GRID.shape), 50.0, mode="wrap")
        height += waves * bend_m / waves.std()
    return np.asarray(height, np.float32)


def of(one: NDArray[np.float32], other: NDArray[np.float32]) -> list[GroundPair]:
    return [GroundPair(0.0, SIDE * CELL_M, CELL_M, one, other)]


def test_pair_tie__finds_what_moved_a_surface_whatever_was_worked() -> None:
    rng = np.random.default_rng(1)
    relief, move = ground(rng), np.array([0.031, -0.042, 0.04, 5e-3, -3e-3, 2e-3])
    one, other = measured(relief, np.zeros(6), rng), measured(relief, move, rng)
    other[100:140] += 0.05  # worked, and not told
    other[:, 20:50] = np.nan  # worked, and told
    tie = tie_pair(of(one, other), MIDDLE_M, PLACE_SIGMA)
    assert tie is not None
    assert tie.move[:2] == pytest.approx(move[:2], abs=2e-3)
    assert tie.move[5] == pytest.approx(move[5], abs=2e-4)
    assert tie.move[2] == pytest.approx(move[2], abs=1e-3)
    assert tie.move[3:5] == pytest.approx(move[3:5], abs=np.radians(0.01))
    again = move_surface(other, GRID, GRID, tie.move, MIDDLE_M)
    assert abs(np.nanmedian(again[150:, 60:] - one[150:, 60:])) < 1e-3


def test_pair_tie__standard_deviations_hold_where_surfaces_bend() -> None:
    ratios = []
    for seed in range(12):
        rng = np.random.default_rng(100 + seed)
        relief = ground(rng)
        one, other = measured(relief, np.zeros(6), rng, 0.002), measured(relief, np.zeros(6), rng, 0.002)
        tie = tie_pair(of(one[::1], other), MIDDLE_M, PLACE_SIGMA)
        assert tie is not None
        covariance = np.linalg.inv(tie.information[np.ix_(LEVEL_TERMS, LEVEL_TERMS)])
        ratios.append(tie.move[LEVEL_TERMS] / np.sqrt(np.diag(covariance)))
    assert 0.5 < float(np.sqrt(np.mean(np.square(ratios)))) < 1.7


def test_pair_tie__is_none_without_common_ground() -> None:
    one = np.full(GRID.shape, np.nan, np.float32)
    other = one.copy()
    one[:, : SIDE // 2], other[:, SIDE // 2 :] = 0.0, 0.0
    assert tie_pair(of(one, other), MIDDLE_M, PLACE_SIGMA) is None
    assert tie_pair([], MIDDLE_M, PLACE_SIGMA) is None


def test_pair_tie__of_smooth_ground_leaves_the_place_to_the_positions() -> None:
    rng = np.random.default_rng(2)
    one, other = (0.003 * rng.standard_normal((2, *GRID.shape))).astype(np.float32)
    tie = tie_pair(of(one, other + np.float32(0.02)), MIDDLE_M, PLACE_SIGMA)
    assert tie is not None
    assert tie.move[2] == pytest.approx(-0.02, abs=1e-3)
    assert np.linalg.matrix_rank(tie.information[np.ix_(PLACE_TERMS, PLACE_TERMS)]) < 3
    assert np.abs(tie.move[:2]).max() < 3 * 0.03


@pytest.mark.parametrize(("side_m", "farthest_m"), [((4, 5), 2.5), ((3, 4), 1.8)])
def test_pair_tie__a_dozen_patches_of_one_relief_show_a_shift(side_m: tuple[int, int], farthest_m: float) -> None:
    """Sums of like patches are √n times those of chance: 3.5 times for 12 patches, where three suffice."""
    cell_m = 0.05
    steps = [np.arange(round(side / cell_m)) for side in side_m]
    north, east = np.meshgrid(-cell_m * steps[0], cell_m * steps[1], indexing="ij")

    def waves(east_m: FloatArray, north_m: FloatArray) -> NDArray[np.float32]:
        return (0.01 * (np.sin(2 * np.pi * east_m) + np.sin(2 * np.pi * north_m))).astype(np.float32)

    pair = GroundPair(0.0, side_m[0], cell_m, waves(east, north), waves(east + 0.02, north - 0.03))
    tie = tie_pair([pair], np.array([0.5 * side_m[1], 0.5 * side_m[0]]), np.array([0.5, 0.5, 0.05]))
    assert tie is not None
    assert tie.patches == side_m[0] * side_m[1]
    assert tie.move[PLACE_TERMS] == pytest.approx([0.02, -0.03, 0.0], abs=1e-3)
    # What is left are the cells: a millimetre in place, and as much at the farthest patch for the turn.
    sigma = np.sqrt(np.diag(np.linalg.inv(tie.information[np.ix_(PLACE_TERMS, PLACE_TERMS)])))
    assert sigma == pytest.approx([1e-3, 1e-3, 1e-3 / farthest_m], rel=0.05)


def known(move: FloatArray, sigma: float) -> PairTie:
    none = SoilCells(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    return PairTie(move, np.eye(6) / sigma**2, 100, 10, none, HeightCovariance(0.0, 1.0, 0.0), 0.01)


def test_network__of_all_pairs_of_dates_is_their_common_adjustment() -> None:
    rng = np.random.default_rng(3)
    own = 0.002 * rng.standard_normal((4, 6))  # errors of each date
    ties = {(i, j): known(own[j] - own[i], 0.002 * 2**0.5) for i in range(4) for j in range(i + 1, 4)}
    net = adjust_network(ties, np.full((4, 6), 0.5))
    move, covariance = net.between(0, 3)
    assert move == pytest.approx(own[3] - own[0], abs=1e-6)
    # four dates of one ground do not make the difference of two of them better than the errors of these
    assert np.sqrt(np.diag(covariance)) == pytest.approx(0.002 * 2**0.5, rel=0.01)
    assert max(net.tension.values()) < 1e-3
    assert net.moves.mean(axis=0) == pytest.approx(0.0, abs=1e-9)  # the mean of their positions


def test_network__tells_groups_apart_and_keeps_a_contradiction_small() -> None:
    ties = {(0, 1): known(np.full(6, 0.01), 0.001), (3, 4): known(np.zeros(6), 0.001)}
    net = adjust_network(ties, np.full((5, 6), 0.5))
    assert len(set(net.group.tolist())) == 3
    assert net.group[0] == net.group[1] != net.group[2] != net.group[3] == net.group[4]
    loop = {
        (0, 1): known(np.zeros(6), 0.001),
        (1, 2): known(np.zeros(6), 0.001),
        (0, 2): known(np.full(6, 0.05), 0.001),
    }
    assert max(adjust_network(loop, np.full((3, 6), 0.5)).tension.values()) > 3.0


def test_points_tie__gives_height_by_one_point_and_tilt_by_three() -> None:
    xy = np.array([[0.0, 0.0], [12.0, 0.0], [0.0, 12.0], [12.0, 12.0]])
    above = 0.03 + 1e-3 * (xy[:, 0] - MIDDLE_M[0])
    tie = tie_points(xy, above, np.full(4, 0.01), MIDDLE_M)
    assert tie is not None
    assert tie.move[LEVEL_TERMS] == pytest.approx([-0.03, -1e-3, 0.0], abs=1e-9)
    one = tie_points(xy[:1], above[:1], np.full(1, 0.01), MIDDLE_M)
    assert one is not None
    net = adjust_network({(0, 1): one}, np.array([np.full(6, 1e-4), [0.01, 0.01, 0.04, 1e-4, 1e-4, 1e-3]]))
    assert net.moves[1, 2] == pytest.approx(-above[0], abs=0.003)
    assert tie_points(xy[:0], above[:0], np.zeros(0), MIDDLE_M) is None


def test_left_under__is_what_the_ground_around_departs() -> None:
    rng = np.random.default_rng(4)
    places = rng.uniform(0.0, 12.0, (200, 2))
    beside = places[np.abs(places[:, 1] - 6.0) > 1.5]
    relief = HeightCovariance(0.003, 3.0, 0.0005)
    off = 0.003 * np.sin(beside[:, 0] / 4.0)
    cells = SoilCells(beside, off, np.full(len(beside), 2e-4))
    tie = PairTie(np.zeros(6), np.eye(6), 1000, 10, cells, relief, 0.01)
    inside = np.column_stack([np.linspace(1.0, 5.0, 40), np.full(40, 6.0)])
    left, sigma = interpolate_left_error(inside, MIDDLE_M, np.zeros(6), np.zeros((6, 6)), tie)
    assert left == pytest.approx(0.003 * np.sin(inside[:, 0] / 4.0).mean(), abs=3 * sigma)
    assert 0.0 < sigma < 0.002
    only = interpolate_left_error(inside, MIDDLE_M, np.zeros(6), np.diag(np.full(6, 1e-6)), None)
    assert only[0] == 0.0
    assert only[1] >= 1e-3
