"""The benchmarks' judge: known errors put in come out as what they are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.trajectory_error import Poses, Positions, Simulation, judge, load_simulation

FloatArray = NDArray[np.float64]

LEVER_M = np.array([1.8, -0.4, 2.0])
SIGMAS = np.full(6, 0.5)


def drive() -> Simulation:
    """Forty seconds on a circle, then a stand of ten; heights roll and pitch with the ground; exact positions."""
    t_s = 1e9 + np.arange(0.0, 50.0, 0.01)
    way = np.minimum(t_s - t_s[0], 40.0)
    turn = way / 8.0
    xyz_m = np.column_stack([500.0 + 8.0 * np.sin(turn), 300.0 - 8.0 * np.cos(turn), 90.0 + 0.1 * np.sin(way)])
    rph_deg = np.column_stack([np.sin(way), 2.0 * np.cos(way), 90.0 - np.degrees(turn)])
    truth = Poses(t_s, xyz_m, rph_deg)
    told = truth.at(t_s[::10])
    positions = Positions(told.t_s, told.antenna_m(LEVER_M), np.full(len(told.t_s), 4))
    return Simulation(t_s[0], truth, np.where(t_s < t_s[0] + 40.0, 1.0, 0.0), positions, LEVER_M, 50.0, 0)


def said(simulation: Simulation) -> Poses:
    return simulation.truth.at(simulation.truth.t_s[5:-5:10])


def stated(poses: Poses) -> FloatArray:
    return np.tile(SIGMAS, (len(poses.t_s), 1))


def attitude(rotation: Rotation) -> FloatArray:
    yaw, pitch, roll = rotation.as_euler("ZYX", degrees=True).T
    return np.column_stack([roll, -pitch, 90.0 - yaw])


def test_judge__truth_has_no_error() -> None:
    simulation = drive()
    poses = said(simulation)
    errors, over_sigma = judge(poses, stated(poses), simulation)
    figures = [errors.x_rmse_m, errors.height_rmse_m, errors.shape_roll_rms_deg, errors.heading_moving_rms_deg]
    assert figures == pytest.approx([0.0] * 4, abs=1e-6)
    assert (errors.oracle.offset_m, errors.oracle.tilt_deg) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert all(np.abs(ratio).max() < 1e-5 for ratio in over_sigma.values())


def test_judge__a_tilted_and_lifted_world_is_absolute_and_has_no_shape() -> None:
    simulation = drive()
    poses = said(simulation)
    roll, pitch, heading = poses.rph_deg.T
    body = Rotation.from_euler("ZYX", np.column_stack([90.0 - heading, -pitch, roll]), degrees=True)
    middle = np.array([*simulation.positions.xyz_m[:, :2].mean(axis=0), 92.0])
    world = Rotation.from_rotvec([np.radians(0.2), np.radians(-0.1), 0.0])
    tilted = Poses(poses.t_s, world.apply(poses.xyz_m - middle) + middle + [0, 0, 0.03], attitude(world * body))
    errors, _ = judge(tilted, stated(poses), simulation)
    assert errors.absolute.tilt_deg == pytest.approx(np.hypot(0.2, 0.1), rel=0.02)
    assert errors.absolute.offset_m == pytest.approx(0.03, abs=0.002)
    assert errors.roll_rms_deg > 0.1
    assert errors.shape_roll_rms_deg < 0.002
    assert errors.shape_pitch_rms_deg < 0.002
    assert errors.shape_antenna_height_rms_m < 0.001


def test_judge__headings_count_apart_while_standing_and_across_north() -> None:
    simulation = drive()
    poses = said(simulation)
    moving = poses.t_s < simulation.t0_s + 40.0
    off = poses.rph_deg.copy()
    off[:, 2] = (off[:, 2] + np.where(moving, 1.0, 20.0)) % 360.0
    errors, over_sigma = judge(replace(poses, rph_deg=off), stated(poses), simulation)
    assert errors.heading_moving_rms_deg == pytest.approx(1.0, abs=1e-6)
    assert np.median(over_sigma["heading_deg"]) == pytest.approx(1.0 / 0.5)
    assert errors.heading_standing_rms_deg == pytest.approx(20.0, abs=1e-6)


def test_judge__outages_and_floats_are_told_apart() -> None:
    simulation = drive()
    told = simulation.positions
    since = told.t_s - simulation.t0_s
    kept = (since < 10.0) | (since >= 15.0)
    quality = np.where((since > 20.0) & (since < 24.0), 5, 4)
    holed = replace(simulation, positions=Positions(told.t_s[kept], told.xyz_m[kept], quality[kept]))
    poses = said(simulation)
    shifted = poses.xyz_m + np.where((poses.t_s - simulation.t0_s < 18.0)[:, None], [0.3, 0.4, 0.0], 0.0)
    errors, _ = judge(replace(poses, xyz_m=shifted), stated(poses), holed)
    (outage,), (floating,) = errors.outages, errors.floats
    assert (outage.from_s, outage.to_s) == pytest.approx((9.9, 15.0))
    assert outage.horizontal_rmse_m == pytest.approx(0.5)
    assert floating.horizontal_rmse_m == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("name", "offset_m", "tilt_deg"), [("tractor_loop", 0.009, 0.15), ("tractor_fishtail", 0.029, 0.07)]
)
def test_judge__finds_the_oracle_that_the_samples_state(
    shared_data: Path, name: str, offset_m: float, tilt_deg: float
) -> None:
    simulation = load_simulation(shared_data / name)
    errors, _ = judge(said(simulation), stated(said(simulation)), simulation)
    assert abs(errors.oracle.offset_m) == pytest.approx(offset_m, abs=0.001)
    assert errors.oracle.tilt_deg == pytest.approx(tilt_deg, abs=0.006)
    assert errors.heading_moving_rms_deg == pytest.approx(0.0, abs=1e-6)
