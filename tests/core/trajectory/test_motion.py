"""Standing, forward and reverse against drives in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from furrowmap.core.trajectory.vehicle_motion import find_motion, local_velocity
from tests.core.trajectory.drives import FISHTAIL, drive


def sure(speed_mps: np.ndarray) -> np.ndarray:
    """Epochs at which nobody would argue about the motion."""
    return (np.abs(speed_mps) > 0.3) | (np.abs(speed_mps) < 1e-6)


@settings(max_examples=25)
@given(st.floats(-180, 180), st.floats(-0.5, 3.0), st.integers(0, 2**32 - 1))
def test_fishtail_turn_is_told_apart_at_any_course_and_antenna(yaw_deg: float, lever_m: float, seed: int) -> None:
    truth = drive(*FISHTAIL, yaw_deg=yaw_deg)
    noise = np.random.default_rng(seed).normal(0, 0.004, truth.en_m.shape)
    motions = find_motion(truth.t_s, truth.antenna(lever_m, 0.1) + noise, 0.004, 1.0)
    want = np.sign(np.round(truth.speed_mps, 6))
    judged = sure(truth.speed_mps)
    assert (motions.motion[judged] == want[judged]).mean() > 0.97
    assert not motions.doubtful


def test_a_reversal_without_a_stand_is_seen() -> None:
    truth = drive((6, 1.0, 0), (4, -1.0, 15), (6, 1.0, 0))
    motions = find_motion(truth.t_s, truth.antenna(1.0, 0.0), 0.003, 1.0)
    fast = np.abs(truth.speed_mps) > 0.3
    np.testing.assert_array_equal(motions.motion[fast], np.sign(truth.speed_mps[fast]))


def test_a_gap_in_a_steady_drive_keeps_the_direction() -> None:
    truth = drive((8, 1.0, 0), (3, -1.0, 10), (8, -1.0, 12))
    kept = (truth.t_s - truth.t_s[0] < 12) | (truth.t_s - truth.t_s[0] > 15)
    motions = find_motion(truth.t_s[kept], truth.antenna(1.0, 0.0)[kept], 0.003, 1.0)
    fast = np.abs(truth.speed_mps[kept]) > 0.3
    signs = motions.motion[fast] * np.sign(truth.speed_mps[kept][fast])
    assert len(np.unique(signs)) == 1


@settings(max_examples=40)
@given(st.floats(14.0, 30.0), st.floats(2.0, 8.0), st.integers(0, 2**32 - 1))
def test_a_gap_anywhere_in_a_turn_that_reverses_leaves_long_passes_forward(
    begin_s: float, gap_s: float, seed: int
) -> None:
    truth = drive((18, 1.2, 0), (1.5, 0.0, 0), (5, -0.9, 8), (1.5, 0.0, 0), (24, 1.2, 0))
    since_s = truth.t_s - truth.t_s[0]
    kept = (since_s < begin_s) | (since_s > begin_s + gap_s)
    antenna = truth.antenna(1.0, 0.3)[kept]
    noise = np.random.default_rng(seed).normal(0, 0.003, antenna.shape)
    motions = find_motion(truth.t_s[kept], antenna + noise, 0.003, 1.0)
    passes = (truth.speed_mps[kept] > 1.0) & ((since_s[kept] < 14) | (since_s[kept] > 38))
    assert (motions.motion[passes] == 1).all()


def test_a_single_drive_is_said_to_be_taken_as_forward() -> None:
    truth = drive((8, 1.0, 5))
    motions = find_motion(truth.t_s, truth.en_m, 0.003, 1.0)
    assert motions.motion.max() == 1
    assert motions.motion.min() >= 0
    assert len(motions.doubtful) == 1


def test_noise_at_a_stand_is_no_motion() -> None:
    rng = np.random.default_rng(4)
    t = 1.75e9 + np.arange(600) * 0.1
    motions = find_motion(t, rng.normal(0, 0.006, (600, 2)), 0.006, 1.0)
    assert not motions.motion.any()


@pytest.mark.parametrize("speed_mps", [0.0, 0.05, 1.3])
def test_velocity_of_a_straight_drive_is_its_speed(speed_mps: float) -> None:
    t = np.cumsum(np.random.default_rng(1).uniform(0.05, 0.2, 200)) + 1.7e9
    en = np.column_stack([speed_mps * (t - t[0]), -2 * speed_mps * (t - t[0])])
    velocity = local_velocity(t, en, np.zeros(200, np.intp), 0.5)
    np.testing.assert_allclose(velocity, np.tile([speed_mps, -2 * speed_mps], (200, 1)), atol=1e-6)


def test_velocity_does_not_reach_across_gaps() -> None:
    t = np.concatenate([np.arange(20), 40 + np.arange(20)]) * 0.1
    en = np.where(t[:, None] < 3, 0.0, 100.0) * np.ones(2)
    velocity = local_velocity(t, en, (t > 3).astype(np.intp), 5.0)
    np.testing.assert_allclose(velocity, 0.0, atol=1e-9)
