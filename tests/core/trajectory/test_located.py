"""The first guess of a machine with an IMU whose motion shows no heading to accelerometers."""

from __future__ import annotations

from dataclasses import replace
from functools import reduce
from operator import xor
from pathlib import Path

import msgspec
import numpy as np
import pytest

from furrowmap.core.pipeline.solution import companions
from furrowmap.core.runtime.errors import InputError, RefusedError
from furrowmap.core.session.opened import OpenSession, open_session
from furrowmap.core.trajectory.located import Companions, Located, locate

BEGIN_S = 1_779_529_272.0
SESSION = """\
furrowmap = 1

[recording]
gnss = ["gnss.nmea"]

[crs]
map = "EPSG:25832"
heights = "ellipsoidal"

[antenna]
xyz_m = [1.2, 0.0, 2.0]

[imu]
files = ["imu.csv"]
xyz_m = [0.0, 0.0, 1.0]
rpy_deg = [180.0, 0.0, 0.0]
class = "consumer"
"""
IMPLEMENT = '\n[implement]\nkind = "tiller"\nwidth_m = 2.0\nxy_m = [-1.5, 0.0]\n'


def straight_drive(folder: Path, tables: str, sentence: str = "") -> OpenSession:
    """Half a minute to the east at 1.5 m/s, without any change of speed or direction; `sentence` follows each epoch."""
    lines = []
    for k in range(300):
        seconds, minutes = 9 * 3600 + 41 * 60 + 12 + 0.1 * k, 30.0 + 1.5 * 0.1 * k / 1113.19 / np.cos(np.radians(55.0))
        clock = f"{int(seconds) // 3600:02d}{int(seconds) // 60 % 60:02d}{seconds % 60:05.2f}"
        place = f"5500.000000,N,011{minutes:09.6f},E"
        bodies = (
            f"GPGGA,{clock},{place},4,12,0.8,60.000,M,40.000,M,1.0,0001",
            f"GPRMC,{clock},A,{place},2.9,90.0,230526,,,R",
            *([sentence] if sentence else []),
        )
        lines += [f"${body}*{reduce(xor, body.encode()):02X}\r\n" for body in bodies]
    (folder / "gnss.nmea").write_text("".join(lines), newline="")
    rows = ["time_unix_s,gyro_x_dps,gyro_y_dps,gyro_z_dps,force_x_mps2,force_y_mps2,force_z_mps2"]
    rows += [f"{BEGIN_S + 0.01 * k:.2f},0.0,0.0,0.0,0.0,0.0,-9.815" for k in range(3000)]
    (folder / "imu.csv").write_text("\n".join(rows) + "\n")
    (folder / "session.toml").write_text(SESSION + tables)
    return open_session(folder / "session.toml")


def located(opened: OpenSession) -> Located:
    return locate(opened.positions(), opened.session, opened.frame, Companions(opened.inertial))


def grid_east_deg() -> float:
    """Grid heading of true east: grid north lies (11.5° - 9°) · sin 55° = 2.05° clockwise of true north."""
    return 90.0 - 2.05


@pytest.mark.parametrize("tables", [IMPLEMENT, "on_wheels = true\n"])
def test_a_machine_on_wheels_has_the_heading_of_its_course(tmp_path: Path, tables: str) -> None:
    found = located(straight_drive(tmp_path, tables))
    assert found.source == "imu"
    assert found.inertial is not None
    heading, sigma = found.trajectory.attitude_deg()[2], found.trajectory.sigma[:, 5]
    assert np.abs(heading - grid_east_deg()).max() < 0.5
    assert 5.0 < np.median(sigma) < 6.0, "a straight drive does not show the yaw of the mounting, 5° by its prior"


def test_a_machine_whose_scans_are_matched_keeps_its_gyroscopes(tmp_path: Path) -> None:
    (tmp_path / "recording.pcap").write_bytes(b"")
    opened = straight_drive(tmp_path, IMPLEMENT)
    recording = msgspec.structs.replace(opened.session.recording, lidar=("recording.pcap",))
    found = located(replace(opened, session=msgspec.structs.replace(opened.session, recording=recording)))
    assert found.source == "gnss"
    assert "imu-not-aligned" in {notice.code for notice in found.notices}
    assert found.aid is not None
    assert found.aid.trajectory is None
    assert np.abs(found.trajectory.attitude_deg()[2] - grid_east_deg()).max() < 0.5


def attitude_log(opened: OpenSession, header: str, *values: float) -> None:
    rows = [",".join(map(str, (f"{BEGIN_S + 0.1 * k:.1f}", *values))) for k in range(300)]
    (opened.file.parent / "compass.csv").write_text("\n".join([f"time_unix_s,{header}", *rows, ""]))


COMPASS = """heading = "attitude"

[attitude]
roll_pitch = "compass.csv"
heading = "compass.csv"
north = "magnetic"
declination_deg = 4.0
heading_sigma_deg = 3.0
"""


def test_a_compass_shows_the_heading_where_it_is_asked_for(tmp_path: Path) -> None:
    (tmp_path / "compass.csv").write_text("")
    opened = straight_drive(tmp_path, COMPASS)
    attitude_log(opened, "roll_deg,pitch_deg,heading_deg", 0.0, 0.0, 87.0)
    found = locate(opened.positions(), opened.session, opened.frame, companions(opened))
    assert np.abs(found.trajectory.attitude_deg()[2] - (grid_east_deg() + 1.0)).max() < 0.1
    assert 3.0 < np.median(found.trajectory.sigma[:, 5]) < 5.0
    attitude_log(opened, "roll_deg,pitch_deg", 0.0, 0.0)
    with pytest.raises(InputError) as caught:
        locate(opened.positions(), opened.session, opened.frame, companions(opened))
    assert caught.value.code == "heading-missing"


def test_a_compass_without_a_log_is_no_session(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="needs \\[attitude\\]"):
        straight_drive(tmp_path, 'heading = "attitude"\n')


def test_two_antennas_show_the_heading_where_they_are_asked_for(tmp_path: Path) -> None:
    asked = 'heading = "antennas"\n'
    session = SESSION.replace("2.0]\n", "2.0]\nbaseline_yaw_deg = 90.0\nheading_sigma_deg = 0.2\n")
    opened = straight_drive(tmp_path, asked, "GPHDT,0.5,T")  # the second antenna is to the left: the nose is at 90.5°
    (tmp_path / "session.toml").write_text(session + asked)
    opened = open_session(tmp_path / "session.toml")
    found = located(opened)
    assert np.abs(found.trajectory.attitude_deg()[2] - (grid_east_deg() + 0.5)).max() < 0.05
    assert 0.05 < np.median(found.trajectory.sigma[:, 5]) < 0.3
    with pytest.raises(RefusedError, match="gives no heading") as refused:
        located(straight_drive(tmp_path, "", "GPHDT,0.5,T"))
    assert 'write `heading = "antennas"`' in refused.value.remedy
    with pytest.raises(InputError, match="without headings of two antennas") as caught:
        located(straight_drive(tmp_path, asked))
    assert caught.value.code == "heading-missing"


def test_an_aircraft_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RefusedError, match="gives no heading") as caught:
        located(straight_drive(tmp_path, ""))
    assert caught.value.code == "heading-unknown"
    assert "on_wheels = true" in caught.value.remedy
    assert "antennas" not in caught.value.remedy
