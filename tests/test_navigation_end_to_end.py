"""IMU and GNSS without a scanner: the trajectory of a simulated flight, its sigmas, biases, and SBET."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import furrowmap
from furrowmap.core.readers.poses.sbet import Sbet
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.simulator.scenario import scenario_from
from furrowmap.core.simulator.simulate import simulate

FLIGHT = """
seed = 12
t0 = "2026-05-23T09:59:40.000+00:00"
[place]
lon_lat_deg = [11.3885, 55.328]
height_m = 70.0
geoid_m = 36.6
crs = "EPSG:25832"
[field]
size_e_m = 20.0
size_n_m = 20.0
[antenna]
xyz_m = [-0.3, 0.2, 0.4]
[gnss.rtk]
white_m = 0.008
white_h_m = 0.015
gm_m = 0.005
gm_h_m = 0.005
[lidar]
start_s = 1e6
[imu]
rpy_deg = [180.0, 0.0, 90.0]
[flight]
strips = 3
strip_m = 30.0
"""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, furrowmap.Result]:
    folder = tmp_path_factory.mktemp("navigation") / "flight"
    session = simulate(scenario_from(FLIGHT, "flight"), folder).session
    text = session.read_text(encoding="utf-8").replace('lidar = ["recording.pcap"]\n', "")
    session.write_text(text, encoding="utf-8")
    return folder, furrowmap.run(session, folder.parent / "result")


def test_trajectory__is_within_its_sigmas(flown: tuple[Path, furrowmap.Result]) -> None:
    folder, result = flown
    truth = np.loadtxt(folder / "truth" / "trajectory.csv", delimiter=",", skiprows=1)
    truth[:, 6] = np.degrees(np.unwrap(np.radians(truth[:, 6])))
    poses = result.trajectory
    assert len(poses) > 190 * 40
    true = np.column_stack([np.interp(poses["t_s"], truth[:, 0], truth[:, k]) for k in range(1, 7)])
    error = poses[["roll_deg", "pitch_deg", "heading_deg"]].to_numpy() - true[:, 3:]
    error[:, 2] = (error[:, 2] + 180.0) % 360.0 - 180.0
    error = np.column_stack([poses.geometry.get_coordinates(include_z=True).to_numpy() - true[:, :3], error])
    names = ("e_m", "n_m", "h_m", "roll_deg", "pitch_deg", "heading_deg")
    sigma = np.column_stack([poses[f"sigma_{name}"] for name in names])
    ratio = np.sqrt(np.mean((error / sigma) ** 2, axis=0))
    assert (ratio < 2.5).all()  # of one flight, whose positions and headings are off by nearly a constant
    assert 0.5 < np.sqrt(np.mean(ratio**2)) < 1.6
    assert np.sqrt(np.mean(error[:, 3:5] ** 2, axis=0)).max() < 0.01


@pytest.mark.parametrize(
    ("language", "words"),
    [("en", "The trajectory is computed."), ("de", "Die Trajektorie ist berechnet."), ("ja", "軌跡を計算しました。")],
)
def test_report__of_an_aircraft_without_a_scanner_claims_neither_ground_nor_tool(
    flown: tuple[Path, furrowmap.Result], tmp_path: Path, language: str, words: str
) -> None:
    _, result = flown
    page = furrowmap.write_report_page(result.path, tmp_path / "page.html", language=language).read_text(
        encoding="utf-8"
    )
    assert words in page
    assert "The ground is mapped" not in page
    assert "state of the tool unknown" not in page


def test_biases__are_within_their_sigmas(flown: tuple[Path, furrowmap.Result]) -> None:
    folder, result = flown
    true = np.loadtxt(folder / "truth" / "imu_bias.csv", delimiter=",", skiprows=1)[:, 1:].mean(axis=0)
    inertial = result.report["inertial"]
    found = np.array([*inertial["rate_bias_dps"], *inertial["force_bias_mps2"]])
    sigma = np.array([*inertial["rate_bias_sigma_dps"], *inertial["force_bias_sigma_mps2"]])
    assert (np.abs(found - true) < 4.0 * sigma).all()


def test_sbet__comes_back_at_the_same_place(flown: tuple[Path, furrowmap.Result], tmp_path: Path) -> None:
    _, result = flown
    done = furrowmap.export([result.path], "sbet", tmp_path / "flight.sbet")
    poses = result.trajectory
    near = float(poses["t_s"].iloc[0])
    back = Sbet([done.target], ReadOptions(near_s=near)).poses()
    assert back.t_s == pytest.approx(poses["t_s"].to_numpy(), abs=1e-5)
    assert back.true_north
    grid = back.heading_deg - poses["heading_deg"].to_numpy()
    assert (grid + 180.0) % 360.0 - 180.0 == pytest.approx(1.9647, abs=0.01)  # of the sample uav_wheat, beside
