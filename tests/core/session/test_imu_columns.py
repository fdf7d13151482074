"""`[imu.columns]`: a log with names of its own is read as one with ours; faults name what is allowed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.readers.imu_csv import ImuCsv
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.session.opened import open_session

HEAD = "tick,unixTime,gyroX,gyroY,gyroZ,accelX,accelY,accelZ,note"
COLUMNS = """
unixTime = { quantity = "time", unit = "unix_ms" }
gyroX = { quantity = "gyro_x", unit = "deg/s" }
gyroY = { quantity = "gyro_y", unit = "deg/s", scale = -1.0 }
gyroZ = { quantity = "gyro_z", unit = "mrad/s" }
accelX = { quantity = "force_x", unit = "g" }
accelY = { quantity = "force_y", unit = "mg" }
accelZ = { quantity = "force_z", unit = "m/s2", scale = -1.0 }
"""


def session(folder: Path, columns: str = COLUMNS) -> Path:
    rows = [f"{k},{1779529271800 + 5 * k},{k},2.0,3.0,0.1,{k},-9.8,text" for k in range(40)]
    (folder / "dji.csv").write_text("\n".join([HEAD, *rows, ""]), encoding="utf-8")
    (folder / "gnss.nmea").write_text("$GNGGA,,,,,,0,,,,,,,,*7B\n", encoding="utf-8")
    text = 'furrowmap = 1\n[recording]\ngnss = ["gnss.nmea"]\n[crs]\nmap = "EPSG:25832"\n[imu]\nfiles = ["dji.csv"]\n'
    (folder / "session.toml").write_text(f"{text}[imu.columns]{columns}", encoding="utf-8")
    return folder / "session.toml"


def test_columns__are_read_in_their_units(tmp_path: Path) -> None:
    track = open_session(session(tmp_path)).inertial(0.0).inertial()
    k = np.arange(40)
    assert track.t_s == pytest.approx(1779529271.8 + 0.005 * k, abs=1e-6)
    assert track.rate_radps == pytest.approx(np.column_stack([np.radians(k), 0 * k - np.radians(2), 0 * k + 0.003]))
    assert track.force_mps2 == pytest.approx(np.column_stack([0 * k + 0.980665, 9.80665e-3 * k, 0 * k + 9.8]))


def test_columns__give_what_names_with_units_give(tmp_path: Path) -> None:
    track = open_session(session(tmp_path)).inertial(0.0).inertial()
    rows = [f"{1779529271.8 + 0.005 * k:.3f},{k},-2.0,0.003,0.1,{k},9.8" for k in range(40)]
    head = "time_unix_s,gyro_x_dps,gyro_y_dps,gyro_z_radps,accel_x_g,accel_y_mg,accel_z_mps2"
    (tmp_path / "ours.csv").write_text("\n".join([head, *rows, ""]), encoding="utf-8")
    ours = ImuCsv([tmp_path / "ours.csv"], ReadOptions()).inertial()
    np.testing.assert_allclose(track.rate_radps, ours.rate_radps, rtol=1e-12)
    np.testing.assert_allclose(track.force_mps2, ours.force_mps2, rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("gyroX =", "giroX ="), "There are gyroX"),
        (('"gyro_x"', '"roll_rate"'), "Quantities are time, gyro_x"),
        (('"deg/s" }', '"deg/h" }'), "Units of it are rad/s, deg/s"),
        (('"gyro_x"', '"gyro_y"'), "State one"),
        (('gyroX = { quantity = "gyro_x", unit = "deg/s" }', ""), "State the column of each"),
    ],
)
def test_faults__are_three_lines_with_what_is_allowed(tmp_path: Path, change: tuple[str, str], words: str) -> None:
    opened = open_session(session(tmp_path, COLUMNS.replace(*change, 1)))
    with pytest.raises(InputError) as caught:
        opened.inertial(0.0).inertial()
    assert caught.value.code == "imu-columns"
    assert all(caught.value.lines)
    assert words in caught.value.remedy


def test_misspelt_keys__are_session_errors(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="imu"):
        open_session(session(tmp_path, COLUMNS.replace("unit =", "units =", 1)))


DJI = """
"Clock:offsetTime" = { quantity = "time", unit = "s" }
"GPS:dateTimeStamp" = { quantity = "utc", unit = "iso" }
"IMU_ATTI(0):gyroX" = { quantity = "gyro_x", unit = "deg/s" }
"IMU_ATTI(0):gyroY" = { quantity = "gyro_y", unit = "deg/s" }
"IMU_ATTI(0):gyroZ" = { quantity = "gyro_z", unit = "deg/s" }
"IMU_ATTI(0):accelX" = { quantity = "force_x", unit = "g" }
"IMU_ATTI(0):accelY" = { quantity = "force_y", unit = "g" }
"IMU_ATTI(0):accelZ" = { quantity = "force_z", unit = "g" }
"""
DJI_NAMES = [line.split('"')[1] for line in DJI.strip().splitlines()]


def dji(folder: Path, stamp: str = "2026-05-23 09:41:{:02d}Z", columns: str = DJI) -> Path:
    """A log of DatCon at 200 Hz: seconds since the start, and UTC once a second from 0.4 s on."""
    rows = [
        f"{0.005 * k:.3f},{stamp.format(12 + (k - 80) // 200) if k >= 80 else ''},1,2,3,0.1,0.2,-1.0"
        for k in range(800)
    ]
    session(folder, columns)
    (folder / "dji.csv").write_text("\n".join([",".join(DJI_NAMES), *rows, ""]), encoding="utf-8")
    return folder / "session.toml"


def test_clock_of_the_device__is_tied_to_utc(tmp_path: Path) -> None:
    reader = open_session(dji(tmp_path)).inertial(0.0)
    assert reader.inertial().t_s == pytest.approx(1779529272.0 - 0.4 + 0.005 * np.arange(800), abs=1e-6)
    assert [notice.code for notice in reader.notices] == ["imu-clock-tied"]


def test_iso_times__are_utc_or_have_a_zone(tmp_path: Path) -> None:
    rows = [f"0,2026-05-23 11:41:12.{5 * k:03d}+02:00,{k},2.0,3.0,0.1,{k},-9.8,text" for k in range(40)]
    opened = open_session(session(tmp_path, COLUMNS.replace("unix_ms", "iso")))
    for zone in ("+02:00", ""):
        text = "\n".join([HEAD, *rows, ""])
        text = text if zone else text.replace("11:41", "09:41").replace("+02:00", "")
        (tmp_path / "dji.csv").write_text(text, encoding="utf-8")
        assert opened.inertial(0.0).inertial().t_s == pytest.approx(1779529272.0 + 0.005 * np.arange(40), abs=1e-6)


@pytest.mark.parametrize(
    ("stamp", "columns", "code"),
    [
        ("noon {:02d}", DJI, "not-a-time"),
        ("2026-05-23 09:41:12", DJI, "not-a-time"),
        ("2026-05-23 09:41:{:02d}", DJI.replace('unit = "s"', 'unit = "unix_s"'), "imu-columns"),
        (
            "2026-05-23 09:41:{:02d}",
            DJI.replace('"GPS:dateTimeStamp" = { quantity = "utc", unit = "iso" }', ""),
            "imu-columns",
        ),
    ],
)
def test_faults_of_times__are_three_lines(tmp_path: Path, stamp: str, columns: str, code: str) -> None:
    with pytest.raises(InputError) as caught:
        open_session(dji(tmp_path, stamp, columns)).inertial(0.0).inertial()
    assert caught.value.code == code
    assert all(caught.value.lines)
