"""Bundle adjustment of a simulated block: images over soil, poses with errors that go together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from furrowmap.core.images.block_adjustment import ImageBlock, Known, adjust_block, adjusted_poses
from furrowmap.core.images.image_frames import FramePoses, frame_poses
from furrowmap.core.images.pinhole import inside, project
from furrowmap.core.images.ties import Ties
from furrowmap.core.trajectory.pose_errors import PoseErrors, without_errors
from furrowmap.core.values.camera import Camera
from furrowmap.core.values.trajectory import Trajectory, trajectory_from_attitude

TRUE_TURN = np.radians([0.4, -0.3, 0.5])
DELAY_S = 0.02
STATED = Camera(
    800, 600, 660.0, 661.0, 402.0, 297.0, k1=-0.08, k2=0.01, xyz_m=(-0.05, 0.0, -0.4), rpy_deg=(180.0, 0.0, -90.0)
)
T_S = np.arange(1.0, 25.0, 1.0)
NODES_S = np.arange(0.0, 26.5, 1.0)
TOGETHER = np.array([0.3, 0.3, 0.3, *np.radians([0.02, 0.02, 0.5])])
APART = np.array([0.004, 0.004, 0.004, *np.radians([0.01, 0.01, 0.01])])
SCALE = 0.9998
NOISE_PX = 0.15


def flown() -> Trajectory:
    """Two lines of 20 m and the way between them, swaying."""
    t_s = np.arange(0.0, 26.01, 0.01)
    e = 2.0 * np.minimum(t_s, 10.0) - 2.0 * np.clip(t_s - 16.0, 0.0, 10.0)
    n = 0.8 * np.clip(t_s - 10.0, 0.0, 6.0)
    xyz = np.column_stack([500.0 + e, 800.0 + n, 66.0 + 0.2 * np.sin(t_s)])
    roll, pitch = 4.0 * np.sin(2.1 * t_s), 4.0 * np.cos(1.7 * t_s)
    heading = 90.0 + 180.0 * np.clip((t_s - 10.0) / 6.0, 0.0, 1.0)
    return trajectory_from_attitude(t_s, xyz, roll, pitch, heading, max_gap_s=0.1)


def true_camera() -> Camera:
    turned = Rotation.from_rotvec(TRUE_TURN).as_matrix() @ STATED.mounting.rotation
    yaw, pitch, roll = Rotation.from_matrix(turned).as_euler("ZYX", degrees=True)
    return replace(STATED, rpy_deg=(roll, pitch, yaw), shutter_delay_s=DELAY_S)


def seen(poses: FramePoses, xyz_m: np.ndarray, rng: np.random.Generator) -> Ties:
    """What images show of points, those seen once left out."""
    rows = []
    for k in range(len(poses)):
        pixel = project(true_camera(), poses.in_frame(k, xyz_m))
        rows += [(p, k, *pixel[p]) for p in np.flatnonzero(inside(STATED, pixel))]
    table = np.array(sorted(rows))
    pixel = table[:, 2:] + rng.normal(0.0, NOISE_PX, (len(table), 2))
    ties = Ties(table[:, 1].astype(np.int64), table[:, 0].astype(np.int64), pixel, np.full(len(table), 0.3))
    assert ties.points == len(xyz_m)
    return ties


class Flight:
    """A block, what its images show of some places of soil, and the truth."""

    def __init__(self, seed: int, control: int = 0, places: int = 900) -> None:
        rng = np.random.default_rng(seed)
        self.truth = flown()
        poses = frame_poses(self.truth, true_camera(), T_S, SCALE)
        east, north = rng.uniform(498, 522, places), rng.uniform(798, 807, places)
        soil = np.column_stack([east, north, rng.normal(60, 0.2, places)])
        views = np.zeros(len(soil), int)
        for k in range(len(poses)):
            views += inside(STATED, np.nan_to_num(project(true_camera(), poses.in_frame(k, soil)), nan=-1.0))
        self.soil = soil[views >= 2]
        self.ties = seen(poses, self.soil, rng)
        nodes = len(NODES_S)
        common = np.kron(np.ones((nodes, nodes)), np.diag(TOGETHER**2))
        # An error of heading turns the way, too: about the middle of the flight.
        way = self.truth.at(np.clip(NODES_S, *self.truth.span_s)).xyz_m - self.truth.xyz_m.mean(axis=0)
        turned = np.column_stack([-way[:, 1], way[:, 0], np.zeros((nodes, 3)), np.ones(nodes)]).ravel()
        tilts = np.diag([0.09, 0.09, 0.09, *TOGETHER[3:5] ** 2, 0.0])
        common = np.kron(np.ones((nodes, nodes)), tilts) + TOGETHER[5] ** 2 * np.outer(turned, turned)
        self.covariance = common + np.kron(np.eye(nodes), np.diag(APART**2))
        drawn = rng.multivariate_normal(np.zeros(len(common)), self.covariance, method="eigh").reshape(nodes, 6)
        wrong = PoseErrors(NODES_S, -drawn, self.covariance)
        zero = PoseErrors(NODES_S, np.zeros((nodes, 6)), self.covariance)
        believed = without_errors(replace(self.truth, sigma=np.ones((len(self.truth), 6))), zero, wrong)
        self.block = ImageBlock(believed, zero, STATED, T_S, SCALE)
        points = np.arange(control) * (len(self.soil) // max(control, 1))
        names = tuple(map(str, points.tolist()))
        self.known = Known(points, self.soil[points], np.full((control, 3), 0.003), names)


@pytest.mark.parametrize("seed", [1, 2])
def test_boresight_delay_and_shape__are_found_within_their_sigmas(seed: int) -> None:
    flight = Flight(seed)
    found = adjust_block(flight.block, flight.ties)
    off_deg = np.array(found.correction_deg) - np.degrees(TRUE_TURN)
    assert (np.abs(off_deg) < 4.0 * np.array(found.sigma_deg) + 0.003).all()
    assert abs(found.camera.shutter_delay_s - DELAY_S) < 4.0 * found.delay_sigma_s < 0.001
    assert found.sigma_px == pytest.approx(NOISE_PX, rel=0.2)
    assert 0.6 < found.tension < 1.5
    off = adjusted_poses(flight.block, found).xyz_m - frame_poses(flight.truth, true_camera(), T_S, SCALE).xyz_m
    shift_sigma = np.sqrt(np.diag(found.found.covariance)[60:63])
    assert (np.abs(off.mean(axis=0)) < 4.0 * shift_sigma).all()
    assert (shift_sigma > 0.2).all()


def test_control_points__place_the_block() -> None:
    flight = Flight(3, control=4)
    found = adjust_block(flight.block, flight.ties, flight.known)
    off = adjusted_poses(flight.block, found).xyz_m - frame_poses(flight.truth, true_camera(), T_S, SCALE).xyz_m
    assert np.sqrt((off**2).mean(axis=0)).max() < 0.012
    sigma = np.sqrt(np.diag(found.found.covariance)).reshape(-1, 6)[1:-1, :3]
    assert sigma.max() < 0.02
    assert (np.sqrt((off**2).mean(axis=0)) < 3.0 * np.median(sigma, axis=0)).all()


def test_wrong_matches__are_left_out() -> None:
    flight = Flight(4)
    pixel = flight.ties.pixel.copy()
    wrong = np.arange(0, len(pixel), 40)
    pixel[wrong] += 60.0
    found = adjust_block(flight.block, replace(flight.ties, pixel=pixel))
    assert not found.used[wrong].any()
    assert found.used.mean() > 0.9
    assert (np.abs(np.array(found.correction_deg) - np.degrees(TRUE_TURN)) < 5.0 * np.array(found.sigma_deg)).all()
