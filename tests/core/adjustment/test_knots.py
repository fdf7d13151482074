"""Knots in time, and points placed between them, against rotations of scipy and the way in which clouds are placed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.knots import (
    GNSS_DRIFT,
    KNOT_STEP_S,
    MAX_CHAINS,
    MAX_SCAN_PAUSE_S,
    State,
    knots_over,
    place,
    start_from,
    turns,
)
from furrowmap.core.pointclouds.placed_scans import Placer
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.trajectory import Trajectory, trajectory_from_attitude

T0_S = 1.75e9


def swaying(t_s: NDArray[np.float64], max_gap_s: float = 1.0) -> Trajectory:
    """A curve with half a degree of roll and pitch at 2 Hz."""
    s = t_s - T0_S
    return trajectory_from_attitude(
        t_s,
        np.column_stack([20 * np.sin(0.06 * s), -20 * np.cos(0.06 * s), 0.02 * np.sin(5 * s)]),
        0.5 * np.sin(12 * s),
        0.5 * np.cos(11 * s) - 1,
        350 + 15 * s,
        max_gap_s=max_gap_s,
    )


def scan_of(t_s: NDArray[np.float64], xyz_m: NDArray[np.float32]) -> Scan:
    byte = np.zeros(len(t_s), np.uint8)
    return Scan(0, t_s, xyz_m, byte, byte, np.zeros(len(t_s), np.uint16), byte, byte)


def test_place__agrees_with_the_placing_of_clouds() -> None:
    random = np.random.default_rng(1)
    t = np.sort(T0_S + random.uniform(0, 8, 4000))
    points = random.uniform((-12, -12, -0.5), (12, 12, 0.5), (4000, 3)).astype(np.float32)
    knots = knots_over(t)
    trajectory = swaying(knots.t_s)
    state = start_from(trajectory, knots, np.zeros(3))
    chain = knots.chains[0]
    turn = turns(state.rotation)
    found = place(t, points, chain.first, chain.begin_s, KNOT_STEP_S, state.xyz_m, state.rotation, turn)
    expected, known = Placer(trajectory, Mounting(), (0.0, 0.0, 0.0)).place(scan_of(t, points))
    assert known.all()
    # Turns from knot to knot are taken to first order: what is left out is half their square.
    bound = 0.5 * np.linalg.norm(turn, axis=1).max() ** 2 * np.linalg.norm(points, axis=1).max()
    assert bound < 5e-4
    assert np.abs(found - expected).max() < 1.01 * bound


@given(st.lists(st.tuples(*[st.floats(-1.2, 1.2)] * 3), min_size=2, max_size=8))
def test_turns__are_rotation_vectors_in_the_earlier_frame(vectors: list[tuple[float, float, float]]) -> None:
    rotation = Rotation.from_rotvec(vectors)
    found = turns(rotation.as_matrix())
    np.testing.assert_allclose(found[:-1], (rotation[:-1].inv() * rotation[1:]).as_rotvec(), atol=1e-7)
    assert not found[-1].any()


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-9, 1e-7, 1e-5, 1e-3])
def test_turns__keep_their_digits_when_small(angle: float) -> None:
    rotation = Rotation.from_rotvec([[0.3, -0.2, 2.0], [0.3, -0.2, 2.0]])
    axis = np.array([0.6, -0.48, 0.64])
    found = turns((rotation * Rotation.from_rotvec([0 * axis, angle * axis])).as_matrix())
    np.testing.assert_allclose(found[0], angle * axis, rtol=1e-6, atol=1e-15)


@given(st.lists(st.floats(0.0, 2.5 * MAX_SCAN_PAUSE_S), min_size=1, max_size=12))
def test_knots__cover_all_times_and_no_pause(steps: list[float]) -> None:
    t = T0_S + np.cumsum(steps)
    knots = knots_over(t)
    k, share, inside = knots.at(t)
    assert inside.all()
    np.testing.assert_allclose(knots.t_s[k] + share * KNOT_STEP_S, t, atol=1e-6)
    assert np.isin(k, knots.linked).all()
    pauses = np.flatnonzero(np.diff(t) > MAX_SCAN_PAUSE_S)
    assert len(knots.chains) == 1 + len(pauses)
    for before, after in zip(t[pauses], t[pauses + 1], strict=True):
        assert not knots.at(np.array([0.5 * (before + after)]))[2].any()
    ends = np.cumsum([c.count for c in knots.chains])
    assert set(range(len(knots))) - set(knots.linked.tolist()) == set((ends - 1).tolist())
    assert len(knots.inner) == len(knots) - 2 * len(knots.chains)


def test_of_very_many_pauses_the_longest_part_chains() -> None:
    long = np.random.default_rng(3).permutation(np.arange(400) < 100)
    begins = T0_S + np.cumsum(np.where(long, 60.0, MAX_SCAN_PAUSE_S + 1.0))
    t = (begins[:, None] + np.linspace(0.0, 0.3, 5)).ravel()
    knots = knots_over(t)
    assert len(knots.chains) == MAX_CHAINS
    assert knots.at(t)[2].all()
    parted = {round(chain.begin_s + 0.5 * KNOT_STEP_S, 6) for chain in knots.chains}
    assert parted >= set(np.round(begins[1:][long[1:]], 6).tolist())


def test_the_start_is_the_trajectory_held_at_its_ends_and_straight_across_its_gaps() -> None:
    t = np.concatenate([np.arange(0, 2, 0.1), np.arange(4, 6, 0.1)]) + T0_S
    trajectory = swaying(t)
    knots = knots_over(np.arange(-1.0, 7.0, 0.01) + T0_S)
    origin = np.array([3.0, -20.0, 1.0])
    state = start_from(trajectory, knots, origin)
    poses = trajectory.at(knots.t_s)
    known = np.isfinite(poses.xyz_m[:, 0])
    assert 150 < known.sum() < 170
    np.testing.assert_allclose(state.xyz_m[known] + origin, poses.xyz_m[known], atol=1e-6)
    expected = Rotation.from_quat(poses.quaternion[known], scalar_first=True).as_matrix()
    np.testing.assert_allclose(state.rotation[known], expected, atol=1e-6)
    early, gap = knots.t_s < t[0], (knots.t_s > t[19]) & (knots.t_s < t[20])
    assert np.abs(state.xyz_m[early] + origin - trajectory.xyz_m[0]).max() < 1e-6
    assert np.abs(np.diff(state.xyz_m[gap], 2, axis=0)).max() < 1e-6
    assert not state[GNSS_DRIFT].any()


def test_the_start_is_straight_across_a_gap_behind_a_speed_that_is_not_known() -> None:
    """As that of one position before an outage; a cubic needs the speeds at both ends."""
    t_s = T0_S + np.array([0.0, 8.0, 8.1, 8.2])
    along = np.array([0.0, 16.0, 16.2, 16.4])
    trajectory = trajectory_from_attitude(
        t_s,
        np.column_stack([along, 0.5 * along, 0.0 * along]),
        0.0,
        0.0,
        np.full(4, 90.0),
        max_gap_s=1.0,
        speed_mps=np.array([np.nan, 2.0, 2.0, 2.0]),
        motion=np.ones(4, np.int8),
    )
    knots = knots_over(np.arange(T0_S + 0.5, T0_S + 8.0, 0.1))
    start = start_from(trajectory, knots, np.zeros(3))
    np.testing.assert_allclose(start.xyz_m[:, 0], np.interp(knots.t_s, t_s, along), atol=1e-9)
    np.testing.assert_allclose(start.xyz_m[:, 1], 0.5 * start.xyz_m[:, 0], atol=1e-9)
    np.testing.assert_allclose(start.rotation, np.broadcast_to(np.eye(3), start.rotation.shape), atol=1e-12)


def test_a_step_turns_about_the_axes_of_the_map() -> None:
    rotation = Rotation.from_euler("ZYX", [[70.0, 2.0, -1.0]], degrees=True)
    state = State(np.zeros((1, 3)), rotation.as_matrix(), np.zeros((1, 3)))
    moved = state.moved(np.array([[1.0, 2.0, 3.0, 0.0, 0.0, 0.1, 4.0, 5.0, 6.0]]))
    np.testing.assert_allclose(moved.xyz_m, [[1, 2, 3]])
    np.testing.assert_allclose(moved[GNSS_DRIFT], [[4, 5, 6]])
    expected = rotation.as_euler("ZYX") + np.array([[0.1, 0, 0]])
    np.testing.assert_allclose(Rotation.from_matrix(moved.rotation).as_euler("ZYX"), expected, atol=1e-12)
