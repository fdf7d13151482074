"""The scanner's plane in the drawing, against the mounting that the computation uses."""

from __future__ import annotations

from types import ModuleType

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

ANGLE = st.floats(-180, 180)


@given(roll=ANGLE, pitch=ANGLE, yaw=ANGLE)
def test_spin_axis__is_the_scanners_z(scan_plane: ModuleType, roll: float, pitch: float, yaw: float) -> None:
    turned = Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(scan_plane.spin_axis((roll, pitch, yaw)), turned, atol=1e-12)


@given(roll=ANGLE, pitch=ANGLE, yaw=ANGLE)
def test_scan_direction__lies_in_both_planes(scan_plane: ModuleType, roll: float, pitch: float, yaw: float) -> None:
    axis = scan_plane.spin_axis((roll, pitch, yaw))
    direction = scan_plane.scan_direction(axis, (0.0, 1.0, 0.0))
    if direction is not None:
        assert abs(np.dot(direction, axis)) < 1e-9
        assert abs(direction[1]) < 1e-12
        assert abs(np.linalg.norm(direction) - 1.0) < 1e-12


def test_scan_direction__of_a_scanner_tilted_down_backwards(scan_plane: ModuleType) -> None:
    x, _, z = scan_plane.scan_direction(scan_plane.spin_axis((0.0, 40.0, 180.0)), (0.0, 1.0, 0.0))
    assert x * z > 0  # down at the back, up at the front
