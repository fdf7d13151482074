"""The machine stands on its wheels."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from furrowmap.core.simulator.drive import DRIVE_RATE_HZ, SimulatedTrack
from furrowmap.core.simulator.machine_motion import mount_rotation, stand_on, tyre_height, vehicle_rotation
from furrowmap.core.simulator.scenario import Scenario, ScenarioDrive, ScenarioField, ScenarioSoil, Sway, Tractor
from furrowmap.core.simulator.soil_over_time import Ground, make_ground

ANGLE = st.floats(-1.4, 1.4)
STILL = Sway(sway_deg=0.0, heave_m=0.0, vibration_deg=0.0)


@given(roll=ANGLE, pitch=ANGLE, yaw=st.floats(-7.0, 7.0))
def test_vehicle_rotation__is_the_one_of_the_frames(roll: float, pitch: float, yaw: float) -> None:
    ours = vehicle_rotation(np.array([roll]), np.array([pitch]), np.array([yaw]))[0]
    assert np.allclose(ours, Rotation.from_euler("ZYX", [yaw, -pitch, roll]).as_matrix(), atol=1e-12)
    assert ours[2, 0] == pytest.approx(np.sin(pitch))  # nose up lifts the x axis
    assert ours[2, 1] == pytest.approx(np.sin(roll) * np.cos(pitch))  # right side down lifts the y axis


@given(roll=ANGLE, pitch=ANGLE, yaw=ANGLE)
def test_mount_rotation__is_the_one_of_the_frames(roll: float, pitch: float, yaw: float) -> None:
    degrees = tuple(np.degrees([roll, pitch, yaw]))
    assert np.allclose(mount_rotation(degrees), Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix(), atol=1e-12)


def ground_of(soil: ScenarioSoil) -> Ground:
    return make_ground(
        Scenario(
            field=ScenarioField(size_e_m=24.0, size_n_m=24.0), drive=ScenarioDrive(start_xy_m=(5.0, 5.0)), soil=soil
        ),
        [],
    )


def rolling(yaw_rad: float, speed_mps: float, seconds: float = 6.0) -> SimulatedTrack:
    t = np.arange(0.0, seconds, 1.0 / DRIVE_RATE_HZ)
    n = len(t)
    e, north = (12.0 + (t - 0.5 * seconds) * speed_mps * f(yaw_rad) for f in (np.cos, np.sin))
    return SimulatedTrack(
        t, e, north, np.full(n, yaw_rad), np.full(n, speed_mps), np.zeros(n), np.zeros(n, bool), duration_s=seconds
    )


@pytest.mark.parametrize("heading_deg", [0.0, 30.0, 120.0, 250.0])
def test_stand_on__a_plane_tilts_the_machine_with_it(heading_deg: float) -> None:
    smooth = ScenarioSoil(
        slope_percent=5.0, slope_towards_deg=90.0, undulation_m=0.0, clod_sigma_m=0.0, row_amplitude_m=0.0
    )
    yaw = np.radians(90.0 - heading_deg)
    motion = stand_on(ground_of(smooth), rolling(yaw, 1.0), Tractor(), STILL, np.random.default_rng(0))
    # uphill to the east: nose up by the slope along the heading, right side down by that to the left
    assert np.tan(motion.pitch_rad) == pytest.approx(0.05 * np.cos(yaw), abs=1e-6)
    assert np.tan(motion.roll_rad) == pytest.approx(-0.05 * np.sin(yaw), abs=1e-6)
    assert motion.xyz_m[:, 2] == pytest.approx(0.05 * motion.xyz_m[:, 0], abs=1e-6)


def test_stand_on__wheels_touch_the_ground() -> None:
    ground, track, tractor = ground_of(ScenarioSoil()), rolling(0.4, 1.2), Tractor()
    motion = stand_on(ground, track, tractor, STILL, np.random.default_rng(0))
    half = 0.5 * tractor.track_rear_m
    for side in (1.0, -1.0):
        wheel = motion.of_point(motion.t_s, (0.0, side * half, 0.0))
        assert np.abs(wheel[:, 2] - tyre_height(ground, track, 0.0, side * half, tractor.tyre_m)).max() < 1e-3
    front = 0.5 * sum(
        tyre_height(ground, track, tractor.wheelbase_m, side * 0.5 * tractor.track_front_m, tractor.tyre_m)
        for side in (1.0, -1.0)
    )
    axle = motion.of_point(motion.t_s, (tractor.wheelbase_m, 0.0, 0.0))
    assert np.abs(axle[:, 2] - front).max() < 1e-3
    assert np.degrees(motion.roll_rad).std() > 0.2


def test_stand_on__sways_while_driving_and_hardly_at_a_stand() -> None:
    flat = ground_of(ScenarioSoil(slope_percent=0.0, undulation_m=0.0, clod_sigma_m=0.0, row_amplitude_m=0.0))
    sway = Sway(sway_deg=0.25, heave_m=0.004, vibration_deg=0.0)
    moving = stand_on(flat, rolling(0.0, 1.0), Tractor(), sway, np.random.default_rng(0))
    still = stand_on(flat, rolling(0.0, 0.0), Tractor(), sway, np.random.default_rng(0))
    assert np.degrees(moving.pitch_rad).std() == pytest.approx(0.25, rel=0.25)
    assert moving.xyz_m[:, 2].std() == pytest.approx(0.004, rel=0.25)
    assert np.abs(still.pitch_rad).max() == 0.0
    spectrum = np.abs(np.fft.rfft(moving.roll_rad)) ** 2
    frequency = np.fft.rfftfreq(len(moving.t_s), 1.0 / DRIVE_RATE_HZ)
    assert spectrum[(frequency > 0.5) & (frequency < 3.5)].sum() > 0.95 * spectrum[1:].sum()
