"""Flights against closed forms: gravity and the earth's rotation, dead reckoning, placing of points."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray
from pyproj import Transformer
from scipy.spatial.transform import Rotation

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.simulator.machine_motion import SimulatedMotion, mount_rotation
from furrowmap.core.simulator.noise import random_for
from furrowmap.core.simulator.rays import Firings, Met, cast, make_optics, make_scene
from furrowmap.core.simulator.recording import VLP16
from furrowmap.core.simulator.scenario import Scenario, as_toml, demo_scenario, scenario_from
from furrowmap.core.simulator.simulate import simulate
from furrowmap.core.simulator.simulate_flight import (
    duration_s,
    exact,
    fly,
    lay_out_flight,
    make_crop,
    measure,
    waypoints,
)
from furrowmap.core.simulator.site import SimulatedSite, find_site
from furrowmap.core.simulator.soil_over_time import make_ground

FloatArray = NDArray[np.float64]
DOWN = """
seed = 5
t0 = "2026-05-23T09:59:57.000+00:00"
[place]
lon_lat_deg = [11.3885, 55.328]
height_m = 70.0
crs = "EPSG:25832"
[field]
size_e_m = 24.0
size_n_m = 24.0
[soil]
kind = "rolled"
slope_percent = 0.0
undulation_m = 0.0
clod_sigma_m = 0.0
row_amplitude_m = 0.0
[noise]
range_m = 0.0
dropout = 0.0
[antenna]
xyz_m = [0.3, -0.2, 0.4]
[lidar]
xyz_m = [0.1, 0.05, -0.3]
rpy_deg = [-90.0, 20.0, -90.0]
laser_bias_m = 0.0
start_s = 0.5
[flight]
strips = 2
strip_m = 8.0
spacing_m = 4.0
cross_strips = 1
speed_mps = 4.0
height_m = 12.0
hover_start_s = 1.0
hover_end_s = 0.5
body_boxes_m = []
"""


def flown(text: str = DOWN) -> tuple[Scenario, SimulatedSite, SimulatedMotion]:
    scenario = scenario_from(text, "test")
    assert scenario.flight is not None
    scenario = lay_out_flight(scenario, scenario.flight)
    assert scenario.flight is not None
    site = find_site(scenario)
    motion = fly(scenario, scenario.flight, site.map_scale(np.zeros(3)), random_for(1, "flight"))
    return scenario, site, motion


def test_exact__hovering_shows_gravity_and_the_rotation_of_the_earth() -> None:
    _, site, motion = flown()
    n = len(motion.t_s)
    still = np.zeros(n)
    hover = SimulatedMotion(motion.t_s, np.tile([5.0, 5.0, 3.0], (n, 1)), still, still, still + np.pi / 2, still, still)
    rate, force = exact(hover, site, np.array([1.0, 2.0]), np.zeros(3))
    assert force[0] == pytest.approx([0.0, 0.0, 9.815118], abs=3e-4)  # of the sample uav_wheat, at the same place
    lat, convergence = np.radians(55.328), np.radians(1.9647)
    north = 7.292115e-5 * np.cos(lat)
    # ahead is grid north, clockwise of true north; left is grid west
    expected = [north * np.cos(convergence), north * np.sin(convergence), 7.292115e-5 * np.sin(lat)]
    assert rate[0] == pytest.approx(expected, abs=2e-8)


def test_exact__dead_reckoning_follows_the_flight() -> None:
    """Strapdown in earth-centred axes (Groves 2013, section 5.2) from the true state, over six seconds."""
    _, site, motion = flown()
    arm, step = np.array([0.4, -0.3, 0.2]), 0.005
    t = np.arange(0.5, 6.5, step)
    rate, force = exact(motion, site, t, arm)
    spin = np.array([0.0, 0.0, 7.292115e-5])

    def true(k: int) -> tuple[FloatArray, FloatArray]:
        xyz, axes = motion.at(t[k : k + 1])
        turn = site.earth_axes(xyz)[0] @ (axes[0] / [[motion.scale], [motion.scale], [1.0]])
        return site.earth_m(xyz)[0] + turn @ arm, turn

    place, turn = true(0)
    velocity = (true(1)[0] - place) / step - 0.5 * step * _acceleration(turn @ force[0], place, np.zeros(3), spin)
    for k in range(len(t) - 1):
        middle = turn @ Rotation.from_rotvec(0.25 * step * (rate[k] + rate[k + 1])).as_matrix()
        middle = Rotation.from_rotvec(-0.5 * step * spin).as_matrix() @ middle
        gained = step * _acceleration(middle @ (0.5 * (force[k] + force[k + 1])), place, velocity, spin)
        place, velocity = place + step * (velocity + 0.5 * gained), velocity + gained
        turn = Rotation.from_rotvec(-step * spin).as_matrix() @ turn
        turn = turn @ Rotation.from_rotvec(0.5 * step * (rate[k] + rate[k + 1])).as_matrix()
    end, end_turn = true(len(t) - 1)
    assert np.linalg.norm(place - end) < 0.01
    assert np.degrees(np.linalg.norm(Rotation.from_matrix(turn.T @ end_turn).as_rotvec())) < 0.002


def _acceleration(force: FloatArray, place: FloatArray, velocity: FloatArray, spin: FloatArray) -> FloatArray:
    lon, lat, height = Transformer.from_crs("EPSG:4936", "EPSG:4937", always_xy=True).transform(*place)
    up = np.array([np.cos(np.radians(lat)) * np.cos(np.radians(lon)), 0.0, np.sin(np.radians(lat))])
    up[1] = np.cos(np.radians(lat)) * np.sin(np.radians(lon))
    sine2 = np.sin(np.radians(lat)) ** 2
    gravity = 9.7803267715 * (1 + 0.001931851353 * sine2) / np.sqrt(1 - 0.0066943800229 * sine2) - 3.0847e-6 * height
    out: FloatArray = force - 2.0 * np.cross(spin, velocity) - gravity * up
    return out


def test_measure__errors_are_those_of_the_table_in_the_axes_of_the_imu() -> None:
    scenario, site, motion = flown(DOWN + "[imu]\nrpy_deg = [180.0, 0.0, 90.0]\ngyro_bias_deg_s = 0.2\n")
    assert scenario.imu is not None
    log = measure(scenario.imu, motion, site, 8.0, 3)
    rate, force = exact(motion, site, log.t_s, np.array(scenario.imu.xyz_m))
    turn = mount_rotation(scenario.imu.rpy_deg)
    off = np.concatenate([log.rate_dps - np.degrees(rate @ turn), log.force_mps2 - force @ turn], axis=1) - log.bias
    white = np.repeat([0.0035 * np.sqrt(200.0), 0.14 * 9.80665e-3 * np.sqrt(200.0)], 3)
    assert off.std(axis=0) == pytest.approx(white, rel=0.1)
    assert np.abs(log.bias[0, :3]).max() < 4 * 0.2
    assert log.force_mps2[:, 2].mean() < -9.0  # its z axis points down


def test_fly__follows_the_path_and_tilts_as_its_thrust() -> None:
    scenario, _, motion = flown()
    flight = scenario.flight
    assert flight is not None
    assert waypoints(flight).tolist() == [[0, 0], [8, 0], [8, 4], [0, 4], [4, 6], [4, -2]]
    assert motion.t_s[-1] > duration_s(flight)
    start = motion.xyz_m[motion.t_s < 0.0, :2].mean(axis=0)
    assert start == pytest.approx(flight.start_xy_m, abs=1.0)
    assert motion.xyz_m[:, 2] == pytest.approx(12.0, abs=0.3)
    calm = msgspec.structs.replace(flight, gust_deg=0.0, yaw_wander_deg=0.0, wander_m=0.0, drag_per_s=0.0)
    still = fly(msgspec.structs.replace(scenario, flight=calm), calm, 1.0, random_for(1, "flight"))
    acceleration = np.gradient(np.gradient(still.xyz_m, 0.005, axis=0), 0.005, axis=0)[50:-50]
    _, axes = still.at(still.t_s[50:-50])
    sideways = acceleration - np.array([0.0, 0.0, 1.0]) * acceleration[:, 2:]
    thrust = axes[:, :, 2] * 9.81 / axes[:, 2:, 2]
    assert np.abs(sideways - thrust * [1.0, 1.0, 0.0]).max() < 0.15


def test_crop__stops_beams_at_exponential_depth() -> None:
    scenario, _, _ = flown(DOWN + "plots_m = [[12.0, 12.0, 0.0, 20.0, 20.0, 3.0]]\nextinction_per_m = 4.0\n")
    assert scenario.flight is not None
    ground = make_ground(scenario, [])
    found = make_crop(scenario, scenario.flight, ground)
    assert found is not None
    crop = np.where(found[0] > 0, np.float32(3.0), found[0])  # level, with its gaps
    n = 3000
    place = np.column_stack([*np.random.default_rng(1).uniform(8.0, 16.0, (2, n)), np.full(n, 12.0)])
    straight = mount_rotation((0.0, 90.0, 0.0))
    still = np.zeros(n)
    firings = Firings(0, still, still, still, place, np.tile(np.eye(3), (n, 1, 1)), still, still)
    optics = make_optics(scenario, VLP16.beams, straight)._replace(lasers=np.array([[1.0, *np.zeros(5)]]))
    returns = cast(make_scene(scenario, ground, crop), optics, firings)
    met = returns.met[0, :, 0]
    top = place[:, 2] + np.asarray(scenario.lidar.xyz_m)[2] - 3.0
    depth = (returns.ticks[0, :, 0] * 0.002 - top)[met == Met.STRAW]
    assert np.mean(met == Met.STRAW) > 0.95
    assert depth.min() > -0.003
    assert depth.mean() == pytest.approx(0.25, rel=0.06)
    assert np.quantile(depth, 0.9) == pytest.approx(0.25 * np.log(10.0), rel=0.08)


@pytest.mark.parametrize("scanner", ["[line]\nrate_hz = 10.0\nbeams = 61\n", ""])
def test_simulate__points_placed_by_the_truth_lie_on_the_ground(tmp_path: Path, scanner: str) -> None:
    """With the attitude in mount.csv about the origin of the scanner."""
    true = "true_rpy_deg = [-89.0, 21.0, -91.0]\n"
    text = DOWN.replace("rpy_deg = [-90.0, 20.0, -90.0]\n", "rpy_deg = [-90.0, 20.0, -90.0]\n" + true)
    mount = "[mount]\n[imu]\n"
    simulated = simulate(scenario_from(text + mount + scanner, "test"), tmp_path / "flight")
    folder = simulated.folder
    session = tomllib.loads(simulated.session.read_text(encoding="utf-8"))
    assert session["mount"]["attitude"] == "mount.csv"
    assert session["imu"]["noise"]["gyro_deg_s_rthz"] == 0.0035
    figures = json.loads((folder / "truth" / "figures.json").read_text(encoding="utf-8"))
    assert figures["lidar"]["points"] > 1000
    truth = np.loadtxt(folder / "truth" / "trajectory.csv", delimiter=",", skiprows=1)
    assert tomllib.loads((folder / "truth" / "mounting_truth.toml").read_text())["lidar"]["rpy_deg"][0] == -89.0
    if not scanner:
        assert simulated.recording.name == "recording.pcap"
        return
    assert "model" not in session["lidar"]
    scans = np.loadtxt(folder / "scans.csv", delimiter=",", skiprows=1)
    mounted = np.loadtxt(folder / "mount.csv", delimiter=",", skiprows=1)
    t_s, angle, range_m = scans[:, 0], np.radians(scans[:, 1]), scans[:, 2]
    turned = Rotation.from_euler(
        "ZYX", np.column_stack([np.interp(t_s, mounted[:, 0], mounted[:, k]) for k in (3, 2, 1)]), degrees=True
    )
    rigid = Rotation.from_euler("ZYX", [-91.0, 21.0, -89.0], degrees=True)
    beam = np.column_stack([range_m * np.cos(angle), range_m * np.sin(angle), 0.0 * angle])
    arm = (turned * rigid).apply(beam) + np.array([0.1, 0.05, -0.3])
    roll, pitch = (np.interp(t_s, truth[:, 0], truth[:, k]) for k in (4, 5))
    heading = np.interp(t_s, truth[:, 0], np.degrees(np.unwrap(np.radians(truth[:, 6]))))
    body = Rotation.from_euler("ZYX", np.column_stack([90.0 - heading, -pitch, roll]), degrees=True)
    height = np.interp(t_s, truth[:, 0], truth[:, 3]) + body.apply(arm)[:, 2]
    assert len(height) > 1000
    assert np.abs(height - 70.0).max() < 0.004
    checks = np.loadtxt(folder / "truth" / "check_points.csv", delimiter=",", skiprows=1, usecols=3)
    assert checks == pytest.approx(70.0, abs=1e-3)


def test_scenario__of_a_flight_is_written_whole_and_checked() -> None:
    packaged = demo_scenario("flight")
    assert scenario_from(as_toml(packaged), "again") == packaged
    assert packaged.flight is not None
    assert packaged.imu is not None
    with pytest.raises(InputError, match=r"unknown key `flight\.spead_mps`.*") as error:
        scenario_from("[flight]\nspead_mps = 3.0\n", "bad")
    assert "speed_mps" in str(error.value.remedy)
    with pytest.raises(InputError, match="`line` needs a `flight`"):
        scenario_from("[line]\n", "bad")
    with pytest.raises(InputError, match="too large"):
        huge = scenario_from("[flight]\nstrip_m = 4000.0\n", "big")
        assert huge.flight is not None
        lay_out_flight(huge, huge.flight)
