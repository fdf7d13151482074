"""A flight over wheat: from packets, IMU and GNSS to a cloud and a mounting, against the truth."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import laspy
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import furrowmap
from furrowmap.core.values.mounting import Mounting
from furrowmap.core.values.point_classes import PointClass

TRUE_RPY_DEG = (-89.636241, 34.439461, -89.194280)


@pytest.fixture(scope="module")
def result(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> furrowmap.Result:
    folder = tmp_path_factory.mktemp("flight")
    for name in ("session.toml", "recording.pcap.gz", "imu.csv", "gnss.nmea"):
        shutil.copyfile(shared_data / "uav_wheat" / name, folder / name)
    return furrowmap.run(folder / "session.toml", folder / "out")


def test_mounting__is_found_within_its_sigma(result: furrowmap.Result) -> None:
    lidar = result.report["calibration"]["lidar"]
    found, true = (Mounting((0.0, 0.0, 0.0), rpy).rotation for rpy in (lidar["rpy_deg"], TRUE_RPY_DEG))
    off_deg = np.degrees(Rotation.from_matrix(found @ true.T).as_rotvec())
    assert (np.abs(off_deg) < (0.02, 0.02, 0.05)).all()
    assert (np.abs(off_deg) < 2.5 * np.array(lidar["sigma_deg"])).all()
    assert lidar["used"]
    assert abs(lidar["time_offset_s"][0]) < 2.5 * lidar["time_offset_s"][1]
    assert "boresight-off" in [warning["code"] for warning in result.report["warnings"]]


def test_soil__is_as_thin_as_with_true_poses(result: furrowmap.Result, shared_data: Path) -> None:
    truth = np.load(shared_data / "uav_wheat" / "truth" / "surface.npz")
    with laspy.open(result.path / "cloud.copc.laz") as file:
        points = file.read()
    cell, crop = float(truth["cell_m"]), truth["canopy_height"] > 0
    row = np.floor((np.asarray(points.y) - float(truth["n0"])) / cell).astype(int)
    column = np.floor((np.asarray(points.x) - float(truth["e0"])) / cell).astype(int)
    inside = (row >= 8) & (column >= 8) & (row < crop.shape[0] - 8) & (column < crop.shape[1] - 8)
    row, column, height = row[inside], column[inside], np.asarray(points.z)[inside]
    near = np.zeros_like(crop)
    for k in range(-8, 9):  # three decimetres from any crop
        near |= np.roll(crop, k, 0)
    for k in range(-8, 9):
        near |= np.roll(near, k, 1) if abs(k) else near
    off = height - truth["soil"][row, column] - float(truth["h0_m"])
    bare = ~near[row, column] & (np.abs(off) < 0.3)
    assert bare.sum() > 1e6
    assert abs(np.median(off[bare])) < 0.009
    assert 1.4826 * np.median(np.abs(off[bare] - np.median(off[bare]))) < 0.0125
    classes = np.bincount(np.asarray(points.classification), minlength=256)
    assert 0.04 < classes[PointClass.VEHICLE] / len(points) < 0.06  # skids and arms


def test_report__has_biases_and_no_advice_for_tractors(result: furrowmap.Result) -> None:
    inertial = result.report["inertial"]
    assert inertial["rate_bias_dps"] == pytest.approx([-0.056, -0.014, -0.083], abs=0.005)
    assert inertial["force_bias_mps2"] == pytest.approx([-0.097, 0.098, -0.119], abs=0.003)
    assert {warning["code"] for warning in result.report["warnings"]} == {"table-unused", "boresight-off"}
    assert set(result.trajectory["heading_from"]) == {"imu"}


def test_preview_and_positions_alone__work(result: furrowmap.Result, tmp_path: Path) -> None:
    session = result.path.parent / "session.toml"
    assert furrowmap.preview(session, tmp_path / "preview")["figures"]["points"] > 10_000
    text = session.read_text(encoding="utf-8").replace('lidar = ["recording.pcap.gz"]', "")
    (result.path.parent / "alone.toml").write_text(text, encoding="utf-8")
    alone = furrowmap.run(result.path.parent / "alone.toml", tmp_path / "alone")
    assert alone.report["figures"]["points"] == 0
    assert len(alone.trajectory) > 20_000
    assert json.dumps(alone.report["inertial"]) == json.dumps(result.report["inertial"])


def test_calibrate__writes_the_boresight(result: furrowmap.Result) -> None:
    session = result.path.parent / "calibrated.toml"
    shutil.copyfile(result.path.parent / "session.toml", session)
    found = furrowmap.calibrate(session, write=True)
    assert found.found.rpy_deg == pytest.approx(TRUE_RPY_DEG, abs=0.02)
    assert f"rpy_deg = [{', '.join(f'{angle:.3f}' for angle in found.found.rpy_deg)}]" in session.read_text("utf-8")
