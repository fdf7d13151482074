"""Gaps between positions: where they are, what is withheld, and how both sides are joined."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.knots import Knots, State, knots_over
from furrowmap.core.matching.bridging import (
    MAX_MISCLOSURE_M,
    MAX_MISCLOSURE_RAD,
    apart,
    continued,
    gaps_between,
    join_in_gap,
    part_of,
    with_carried,
)
from furrowmap.core.matching.portions import Gap, in_gaps, outside
from furrowmap.core.matching.problem import outages
from furrowmap.core.values.gnss import Fix, Positions
from furrowmap.core.values.trajectory import Trajectory, trajectory_from_attitude

GAP = Gap(8.0, 14.0, 0)

FloatArray = NDArray[np.float64]


def drive() -> tuple[Knots, State]:
    """Twenty seconds round a bend, leaning."""
    knots = knots_over(np.arange(0.0, 20.0, 0.02))
    t = knots.t_s
    yaw = 0.1 * t
    xyz = np.column_stack([12.0 * np.sin(yaw), 12.0 * (1.0 - np.cos(yaw)), 0.02 * t])
    rotation = Rotation.from_euler("ZYX", np.column_stack([yaw, 0.05 * np.sin(t), 0.03 * np.cos(t)]))
    return knots, State(xyz, rotation.as_matrix(), np.zeros((len(t), 3)))


def positions_at(t_s: np.ndarray) -> Positions:
    n = len(t_s)
    small = np.full((n, 3), 0.01)
    return Positions(
        t_s, np.zeros((n, 3)), small, small, np.zeros(n, np.intp), np.full(n, Fix.FIXED, np.int8), np.full(n, np.nan)
    )


def start_of(sigma_deg: float = 1.0) -> Trajectory:
    """A first guess of a drive of a minute, with headings of a standard deviation."""
    n = 61
    start = trajectory_from_attitude(np.arange(n, dtype=float), np.zeros((n, 3)), 0.0, 0.0, np.zeros(n), max_gap_s=1.0)
    return replace(start, sigma=np.full((n, 6), sigma_deg))


def test_gaps_are_those_in_which_scans_go_on() -> None:
    knots = knots_over(np.concatenate([np.arange(0.0, 20.0, 0.02), np.arange(40.0, 60.0, 0.02)]))

    def gaps(t_s: FloatArray) -> tuple[Gap, ...]:
        return gaps_between(outages(t_s, start_of()), knots)

    at = np.concatenate([np.arange(0.0, 8.05, 0.1), np.arange(14.0, 18.0, 0.1), np.arange(50.0, 60.0, 0.1)])
    # From 18 to 50 s the scans pause as well, and shorter than a second is no gap.
    assert gaps(at) == (Gap(at[80], at[81], 0),)
    assert gaps(np.arange(0.0, 60.0, 0.9)) == ()
    # At one position a second, with the jitter of a clock, one missing is none yet, five in a row are one.
    slow = np.arange(0.0, 20.0) + 0.001 * np.sin(np.arange(20.0))
    assert gaps(np.delete(slow, 9)) == ()
    assert len(gaps(np.delete(slow, range(9, 14)))) == 1
    assert gaps(slow[:1]) == ()
    # Nothing can be carried into a gap at whose ends no scans are.
    assert gaps(np.array([0.1, 0.2, 0.3, 12.0, 12.1])) == ()
    assert gaps(np.array([7.9, 8.0, 8.1, 19.9, 20.0])) == ()
    np.testing.assert_array_equal(
        in_gaps(np.array([7.0, 8.0, 8.1, 13.9, 14.0]), [GAP]), [False, False, True, True, False]
    )


@pytest.mark.parametrize(
    ("between", "sigma_deg", "parted"),
    [
        (np.array([15.0]), 1.0, False),
        (np.array([14.0, 18.0]), 1.0, False),
        (np.arange(14.0, 17.7, 0.8), 1.0, True),
        (np.arange(14.0, 16.9, 0.1), 1.0, False),
        (np.arange(14.0, 17.2, 0.1), 7.9, True),
        (np.arange(14.0, 17.2, 0.1), 8.1, False),
        (np.arange(14.0, 17.2, 0.1), np.nan, True),
    ],
)
def test_positions_between_two_gaps__part_them_where_they_show_the_heading(
    between: FloatArray, sigma_deg: float, parted: bool
) -> None:
    at = np.concatenate([np.arange(0.0, 10.05, 0.1), between, np.arange(24.0, 40.0, 0.1)])
    both = (pytest.approx((10.0, between[0])), pytest.approx((between[-1], 24.0)))
    assert outages(at, start_of(sigma_deg)) == (both if parted else (pytest.approx((10.0, 24.0)),))


@settings(max_examples=60)
@given(st.lists(st.tuples(st.integers(0, 100), st.integers(1, 40)), min_size=1, max_size=4), st.integers(1, 4))
def test_outside_a_gap_every_return_stays_and_in_it_none(windows: list[tuple[int, int]], thin: int) -> None:
    t_s = 0.25 * np.arange(101)
    parts = outside([slice(a, min(a + n, 101), thin) for a, n in windows], t_s, [GAP, Gap(20.0, 21.0, 0)])
    free = ~((t_s >= 8.0) & (t_s < 14.0) | (t_s >= 20.0) & (t_s < 21.0))
    taken = {i for part in parts for i in range(101)[part]}
    assert all(free[i] for i in taken)
    if thin == 1:
        assert taken == {i for a, n in windows for i in range(101)[a : a + n] if free[i]}


def test_both_sides_that_agree_are_taken_as_they_are() -> None:
    knots, state = drive()
    wrong = State(state.xyz_m + 5.0, state.rotation[::-1].copy(), state.added)
    found = join_in_gap(knots, wrong, GAP, state, state, int(np.searchsorted(knots.t_s, 10.0)))
    inside = (knots.t_s >= GAP.begin_s) & (knots.t_s < GAP.end_s)
    np.testing.assert_allclose(found.xyz_m[inside], state.xyz_m[inside], atol=1e-12)
    np.testing.assert_allclose(found.rotation[inside], state.rotation[inside], atol=1e-12)
    np.testing.assert_array_equal(found.xyz_m[~inside], wrong.xyz_m[~inside])


@settings(max_examples=25)
@given(
    st.lists(st.floats(-0.5, 0.5), min_size=3, max_size=3),
    st.lists(st.floats(-0.2, 0.2), min_size=3, max_size=3),
    st.floats(8.1, 13.9),
)
def test_what_adds_up_evenly_from_either_end_is_taken_out(
    shift_m: list[float], turn_rad: list[float], meet_s: float
) -> None:
    """Sides that drift from the truth in proportion to the time since the end they come from."""
    knots, truth = drive()

    def drifted(since: np.ndarray) -> State:
        share = since / (GAP.end_s - GAP.begin_s)
        turn = Rotation.from_rotvec(share[:, None] * np.array(turn_rad))
        return State(
            truth.xyz_m + share[:, None] * np.array(shift_m),
            (turn * Rotation.from_matrix(truth.rotation)).as_matrix(),
            truth.added,
        )

    meet = int(np.searchsorted(knots.t_s, meet_s))
    found = join_in_gap(knots, truth, GAP, drifted(knots.t_s - GAP.begin_s), drifted(knots.t_s - GAP.end_s), meet)
    np.testing.assert_allclose(found.xyz_m, truth.xyz_m, atol=1e-9)
    np.testing.assert_allclose(found.rotation, truth.rotation, atol=1e-9)


@settings(max_examples=25)
@given(
    st.lists(st.floats(-0.5, 0.5), min_size=3, max_size=3),
    st.lists(st.floats(-0.3, 0.3), min_size=3, max_size=3),
)
def test_poses_that_were_moved_all_together_are_brought_back(shift_m: list[float], turn_rad: list[float]) -> None:
    knots, truth = drive()
    turn = Rotation.from_rotvec(turn_rad)
    moved = State(turn.apply(truth.xyz_m) + shift_m, turn.as_matrix() @ truth.rotation, truth.added)
    found = continued(knots, truth, moved, GAP.begin_s - 1.0, GAP.begin_s)
    np.testing.assert_allclose(found.xyz_m, truth.xyz_m, atol=1e-9)
    np.testing.assert_allclose(found.rotation, truth.rotation, atol=1e-9)


def test_states_are_as_far_apart_as_the_worse_of_way_and_turn() -> None:
    _, state = drive()
    turn = Rotation.from_rotvec([0.0, 0.0, 3.0 * MAX_MISCLOSURE_RAD])
    other = State(
        state.xyz_m + np.array([0.0, 2.0 * MAX_MISCLOSURE_M, 0.0]),
        (turn * Rotation.from_matrix(state.rotation)).as_matrix(),
        state.added,
    )
    np.testing.assert_allclose(apart(state, other), 3.0, rtol=1e-9)
    np.testing.assert_allclose(apart(state, state), 0.0, atol=1e-6)


def test_a_part_is_a_chain_of_the_same_times() -> None:
    knots, _ = drive()
    part, own = part_of(knots, 0, 6.01, 9.2)
    np.testing.assert_array_equal(own.t_s, knots.t_s[part])
    assert own.t_s[0] <= 6.01 < own.t_s[0] + 0.026
    assert own.chains[0].begin_s == pytest.approx(own.t_s[0])
    assert own.chains[0].count == len(own)


def test_poses_at_rest_stand_for_positions_in_the_order_of_time() -> None:
    knots, state = drive()
    lever = np.array([1.0, 0.2, 2.0])
    known = positions_at(np.concatenate([np.arange(0.0, 8.05, 0.1), np.arange(14.0, 20.0, 0.1)]))
    found = with_carried(known, knots, state, (np.array([100.0, 200.0, 30.0]), lever), 8.0, 11.0)
    assert (np.diff(found.t_s) > 0).all()
    added = ~np.isin(found.t_s, known.t_s)
    assert added.sum() == len(found.t_s) - len(known.t_s) > 20
    k = np.searchsorted(knots.t_s, found.t_s[added])
    antenna = state.xyz_m[k] + state.rotation[k] @ lever + [100.0, 200.0, 30.0]
    np.testing.assert_allclose(found.xyz_m[added], antenna, atol=1e-9)
    runs = [set(found.run[mask]) for mask in (found.t_s <= 8.0, added, found.t_s > 13.9)]
    assert sum(len(run) for run in runs) == len(set.union(*runs))
    assert with_carried(known, knots, state, (np.zeros(3), lever), 8.0, 7.0) is known
