"""Poses of a camera along a trajectory, against the geometry written out."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.images.image_frames import frame_poses
from furrowmap.core.images.pinhole import project
from furrowmap.core.values.camera import Camera
from furrowmap.core.values.trajectory import trajectory_from_attitude

NADIR = Camera(800, 600, 600.0, 600.0, 400.0, 300.0, xyz_m=(1.0, 0.0, -0.5), rpy_deg=(180.0, 0.0, -90.0))


def test_camera_that_looks_down__sees_the_ground_ahead_above() -> None:
    """Level, heading east at 10 m: the camera hangs 1 m ahead, and what lies east of it is high in the image."""
    times = np.array([0.0, 10.0])
    path = np.array([[100.0, 200.0, 60.0], [120.0, 200.0, 60.0]])
    trajectory = trajectory_from_attitude(times, path, 0.0, 0.0, 90.0, max_gap_s=20.0)
    delayed = Camera(**{**vars(NADIR), "shutter_delay_s": 0.5})
    poses = frame_poses(trajectory, delayed, np.array([4.5, 9.0, 9.8, -3.0]))
    assert poses.known.tolist() == [True, True, False, False]
    assert poses.xyz_m[0] == pytest.approx([111.0, 200.0, 59.5])
    ground = np.array([[111.0, 200.0, 49.5], [112.0, 200.0, 49.5], [111.0, 199.0, 49.5]])
    assert project(delayed, poses.in_frame(0, ground)) == pytest.approx(
        np.array([[400.0, 300.0], [400.0, 240.0], [460.0, 300.0]])
    )


def test_scale__stretches_what_is_a_metre_on_the_ground() -> None:
    trajectory = trajectory_from_attitude(
        np.array([0.0, 1.0]), np.array([[0.0, 0.0, 10.5]] * 2), 0.0, 0.0, 90.0, max_gap_s=2.0
    )
    poses = frame_poses(trajectory, NADIR, np.array([0.5]), scale=0.9996)
    assert poses.xyz_m[0] == pytest.approx([0.9996, 0.0, 10.0])
    at = np.array([[0.9996 * 3.0, 0.0, 0.0]])
    assert poses.in_frame(0, at)[0] == pytest.approx([0.0, -2.0, 10.0])
