"""The first guess of a machine with an IMU whose motion shows no heading to accelerometers."""

from __future__ import annotations

from functools import reduce
from operator import xor
from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.session.opened import OpenSession, open_session
from furrowmap.core.trajectory.located import Companions, Located, locate
from furrowmap.core.values.errors import RefusedError

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


def straight_drive(folder: Path, tables: str) -> OpenSession:
    """Half a minute to the east at 1.5 m/s, without any change of speed or direction."""
    lines = []
    for k in range(300):
        seconds, minutes = 9 * 3600 + 41 * 60 + 12 + 0.1 * k, 30.0 + 1.5 * 0.1 * k / 1113.19 / np.cos(np.radians(55.0))
        clock = f"{int(seconds) // 3600:02d}{int(seconds) // 60 % 60:02d}{seconds % 60:05.2f}"
        place = f"5500.000000,N,011{minutes:09.6f},E"
        bodies = (
            f"GPGGA,{clock},{place},4,12,0.8,60.000,M,40.000,M,1.0,0001",
            f"GPRMC,{clock},A,{place},2.9,90.0,230526,,,R",
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


def test_a_machine_on_wheels_starts_from_its_course_and_keeps_its_gyroscopes(tmp_path: Path) -> None:
    found = located(straight_drive(tmp_path, IMPLEMENT))
    assert found.source == "gnss"
    assert "imu-not-aligned" in {notice.code for notice in found.notices}
    assert found.aid is not None
    assert found.aid.trajectory is None
    heading = found.trajectory.attitude_deg()[2]
    # Grid north lies (11.5° - 9°) · sin 55° = 2.05° clockwise of true north.
    assert np.abs(heading - (90.0 - 2.05)).max() < 0.5


def test_an_aircraft_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RefusedError) as caught:
        located(straight_drive(tmp_path, ""))
    assert caught.value.code == "heading-unknown"
