"""Trajectories: interpolation on the rotation group, gaps, and what is no trajectory."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from furrowmap.core.values.rotation import wrap_deg
from furrowmap.core.values.trajectory import Trajectory, same_hemisphere, trajectory_from_attitude


def trajectory(
    heading_deg: list[float], *, t_s: list[float] | None = None, max_gap_s: float = 1.0, tilt_deg: float = 0.0
) -> Trajectory:
    times = np.arange(float(len(heading_deg))) if t_s is None else np.array(t_s)
    xyz = np.column_stack([1e5 + 2 * times, 9e5 - times, 300 + 0.1 * times])
    return trajectory_from_attitude(times, xyz, tilt_deg, -tilt_deg, heading_deg, max_gap_s=max_gap_s)


@pytest.mark.parametrize(
    ("headings", "middle"), [([350, 10], 0), ([10, 350], 0), ([170, 190], 180), ([-175, 175], 180), ([80, 100], 90)]
)
def test_at__turns_the_short_way(headings: list[float], middle: float) -> None:
    _, _, heading = trajectory(headings).at([0.5]).attitude_deg()
    np.testing.assert_allclose(wrap_deg(heading - middle), 0.0, atol=1e-9)


def test_at__goes_straight_between_knots_in_large_coordinates() -> None:
    t_s = np.linspace(0, 3, 31)
    poses = trajectory([0, 5, 10, 15]).at(t_s)
    expected = np.column_stack([1e5 + 2 * t_s, 9e5 - t_s, 300 + 0.1 * t_s])
    np.testing.assert_allclose(poses.xyz_m, expected, rtol=0, atol=1e-9)


def test_at__turns_evenly() -> None:
    """A turn at constant rate is met exactly between its knots, over any number of full turns."""
    t_s = np.arange(0.0, 30.0)
    turning = trajectory_from_attitude(t_s, np.zeros((30, 3)), 0.0, 0.0, 355.0 + 50.0 * t_s, max_gap_s=1.0)
    asked = np.linspace(0, 29, 291)
    _, _, heading = turning.at(asked).attitude_deg()
    np.testing.assert_allclose(wrap_deg(heading - 355.0 - 50.0 * asked), 0.0, atol=1e-9)


@given(
    st.lists(st.tuples(st.floats(-180, 180), st.floats(-89, 89), st.floats(0, 360)), min_size=2, max_size=8),
    st.lists(st.floats(0, 1), min_size=1, max_size=20),
)
def test_at__agrees_with_slerp(attitudes: list[tuple[float, float, float]], shares: list[float]) -> None:
    """The geodesic of the rotation group is what spherical interpolation of quaternions gives."""
    roll, pitch, heading = np.array(attitudes).T
    t_s = np.arange(float(len(roll)))
    ours = trajectory_from_attitude(t_s, np.zeros((len(t_s), 3)), roll, pitch, heading, max_gap_s=1.0)
    asked = np.array(shares) * t_s[-1]
    expected = Slerp(t_s, Rotation.from_quat(ours.quaternion, scalar_first=True))(asked)
    found = Rotation.from_quat(ours.at(asked).quaternion, scalar_first=True)
    difference = (expected.inv() * found).magnitude()
    # Half a turn has no short way: there the two may choose different ones.
    half_turn = np.linalg.norm(ours.turn_rad, axis=1) > np.pi - 1e-3
    k, _, _ = ours.interval(asked)
    np.testing.assert_allclose(difference[~half_turn[k]], 0.0, atol=1e-7)


def test_at__there_is_no_pose_in_a_gap_nor_outside() -> None:
    way = trajectory([0, 0, 0, 0], t_s=[0, 1, 3, 4])
    asked = np.array([-0.001, 0, 0.5, 1, 1.001, 2.999, 3, 3.5, 4, 4.001])
    known = [False, True, True, True, False, False, True, True, True, False]
    poses = way.at(asked)
    assert np.isfinite(poses.xyz_m).all(axis=1).tolist() == known
    assert np.isfinite(poses.quaternion).all(axis=1).tolist() == known
    assert np.isfinite(np.array(poses.attitude_deg())).all(axis=0).tolist() == known


@pytest.mark.parametrize("count", [0, 1])
def test_at__too_few_knots_give_no_pose(count: int) -> None:
    assert np.isnan(trajectory([0.0] * count).at([0.0]).xyz_m).all()


def test_at__the_knots_are_met() -> None:
    way = trajectory([10, 200, 350, 0], tilt_deg=5.0)
    poses = way.at(way.t_s)
    np.testing.assert_allclose(poses.xyz_m, way.xyz_m)
    np.testing.assert_allclose(np.abs(np.sum(poses.quaternion * way.quaternion, axis=1)), 1.0)


@given(st.lists(st.tuples(*[st.floats(-1, 1)] * 4), min_size=1, max_size=20))
def test_same_hemisphere__turns_signs_and_nothing_else(rows: list[tuple[float, float, float, float]]) -> None:
    quaternion = np.array(rows)
    out = same_hemisphere(quaternion)
    np.testing.assert_array_equal(np.abs(out), np.abs(quaternion))
    assert np.all(np.sum(out[1:] * out[:-1], axis=1) >= -1e-12)


def test_trajectory__refuses_what_is_none() -> None:
    way = trajectory([0, 10, 20])
    for changed in (
        {"t_s": np.array([0.0, 1.0, 1.0])},
        {"t_s": np.array([0.0, 2.0, 1.0])},
        {"xyz_m": np.zeros((2, 3))},
        {"quaternion": np.zeros((3, 4))},
        {"fix": np.zeros(4, np.int8)},
    ):
        with pytest.raises(ValueError, match=next(iter(changed))):
            dataclasses.replace(way, **changed)
