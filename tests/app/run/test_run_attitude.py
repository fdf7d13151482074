"""A run with attitude logs, and what it says where they are not used."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

import furrowmap

NAMES = ("gnss.nmea", "ahrs_imu.csv", "ahrs_aircraft.csv", "imu.csv")
SESSION = """\
furrowmap = 1
[recording]
gnss = ["gnss.nmea"]
[crs]
map = "EPSG:25832"
[antenna]
xyz_m = [0.0, 0.0, 0.0]
[attitude]
roll_pitch = "ahrs_imu.csv"
heading = "ahrs_aircraft.csv"
roll_pitch_sigma_deg = 0.35
"""


@pytest.fixture
def folder(tmp_path: Path, shared_data: Path) -> Path:
    for name in NAMES:
        shutil.copyfile(shared_data / "uav_wheat" / name, tmp_path / name)
    return tmp_path


def report(folder: Path, text: str) -> dict[str, object]:
    (folder / "session.toml").write_text(text, encoding="utf-8")
    furrowmap.run(folder / "session.toml", folder / "result")
    return dict(json.loads((folder / "result" / "report.json").read_text(encoding="utf-8")))


def test_attitude_logs__make_a_trajectory_with_their_sigmas(folder: Path) -> None:
    found = report(folder, SESSION)
    assert found["accuracy"]["sigma_roll_deg"]["median"] == 0.35  # type: ignore[index]
    assert found["accuracy"]["sigma_heading_deg"]["median"] is None  # type: ignore[index]
    assert found["observability"]["heading"] == {"attitude": 1.0}  # type: ignore[index]


def test_attitude_logs__beside_an_imu_are_reported_as_unused(folder: Path) -> None:
    imu = '[imu]\nfiles = ["imu.csv"]\nxyz_m = [-0.04, -0.01, -0.29]\nrpy_deg = [180.0, 0.0, 0.0]\n'
    found = report(folder, SESSION + imu)
    assert "attitude-unused" in {warning["code"] for warning in found["warnings"]}  # type: ignore[attr-defined]
