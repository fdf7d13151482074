"""Angles and rotations against closed forms."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from furrowmap.core.values.rotation import (
    Mounting,
    attitude_to_quaternion,
    heading_deg,
    mounting_rotation,
    quaternion_to_attitude,
    quaternion_to_matrix,
    unwrap_deg,
    wrap_deg,
)

ANGLES = st.floats(-720, 720)


def about(axis: int, angle_deg: float) -> NDArray[np.float64]:
    """The textbook's rotation about x, y or z."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    i, j = ((1, 2), (2, 0), (0, 1))[axis]
    out = np.eye(3)
    out[i, i] = out[j, j] = c
    out[i, j], out[j, i] = -s, s
    return out


def vehicle_axes(roll: float, pitch: float, heading: float) -> NDArray[np.float64]:
    """Forward, left and up (rows) of a vehicle in east, north, up."""
    return quaternion_to_matrix(attitude_to_quaternion(roll, pitch, heading))[0].T


@given(ANGLES, ANGLES, ANGLES)
def test_mounting_rotation__is_yaw_pitch_roll(roll: float, pitch: float, yaw: float) -> None:
    expected = about(2, yaw) @ about(1, pitch) @ about(0, roll)
    np.testing.assert_allclose(mounting_rotation(roll, pitch, yaw), expected, atol=1e-12)


def test_mounting__at_the_back_looks_backwards_and_down() -> None:
    """The session of the sample recordings: azimuth 0 of the sensor looks 40° below the horizon, to the rear."""
    x, y, _ = Mounting(rpy_deg=(0.0, 40.0, 180.0)).rotation.T
    np.testing.assert_allclose(x, [-np.cos(np.radians(40)), 0, -np.sin(np.radians(40))], atol=1e-12)
    np.testing.assert_allclose(y, [0, -1, 0], atol=1e-12)


def test_attitude__heading_is_clockwise_from_north() -> None:
    for heading, forward in ((0, [0, 1, 0]), (90, [1, 0, 0]), (180, [0, -1, 0]), (270, [-1, 0, 0])):
        np.testing.assert_allclose(vehicle_axes(0, 0, heading)[0], forward, atol=1e-12)
        np.testing.assert_allclose(vehicle_axes(0, 0, heading)[2], [0, 0, 1], atol=1e-12)


@given(st.floats(-80, 80), st.floats(-80, 80), st.floats(0, 360))
def test_attitude__nose_up_and_right_side_down_are_positive(roll: float, pitch: float, heading: float) -> None:
    forward, left, up = vehicle_axes(roll, pitch, heading)
    np.testing.assert_allclose(forward[2], np.sin(np.radians(pitch)), atol=1e-12)
    np.testing.assert_allclose(left[2], np.cos(np.radians(pitch)) * np.sin(np.radians(roll)), atol=1e-12)
    course = np.degrees(np.arctan2(forward[0], forward[1]))
    np.testing.assert_allclose(wrap_deg(course - heading), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.cross(forward, left), up, atol=1e-12)


@given(st.floats(-179, 179), st.floats(-89, 89), st.floats(0, 359.999))
def test_attitude__comes_back(roll: float, pitch: float, heading: float) -> None:
    back = np.array(quaternion_to_attitude(attitude_to_quaternion(roll, pitch, heading)))[:, 0]
    np.testing.assert_allclose(wrap_deg(back - [roll, pitch, heading]), 0.0, atol=1e-7)
    assert 0.0 <= back[2] < 360.0


@given(st.floats(-1e4, 1e4))
def test_angles__are_brought_into_their_range(angle: float) -> None:
    wrapped, heading = float(wrap_deg(angle)), float(heading_deg(angle))
    assert -180.0 <= wrapped < 180.0
    assert 0.0 <= heading < 360.0
    for other in (wrapped, heading):
        np.testing.assert_allclose(np.exp(1j * np.radians(other)), np.exp(1j * np.radians(angle)), atol=1e-9)


def test_heading__a_hair_below_zero_is_zero_and_not_360() -> None:
    assert heading_deg(-1e-20) == 0.0


@given(st.lists(st.floats(-179, 179), min_size=1), st.floats(-180, 180))
def test_unwrap__leaves_no_jump(steps: list[float], start: float) -> None:
    course = start + np.cumsum(steps)
    unwrapped = unwrap_deg(wrap_deg(course))
    np.testing.assert_allclose(np.diff(unwrapped), np.diff(course), atol=1e-9)
