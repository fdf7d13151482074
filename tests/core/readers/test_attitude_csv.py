"""Attitude logs in CSV and in bags."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from furrowmap.core.readers.attitude_csv import AttitudeCsv
from furrowmap.core.readers.imu_csv import ImuCsv
from furrowmap.core.readers.poses.csv import PoseCsv
from furrowmap.core.readers.reader import ReadOptions, Recognised
from furrowmap.core.readers.rosbag.bags import RosBag2
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.session.examination import Examined
from furrowmap.core.session.proposal import propose_session
from furrowmap.core.session.session_file import parse_session
from tests.core.readers.inertial_bags import imu, turning_imu
from tests.core.readers.small_bags import T0_NS, write_bag2
from tests.core.readers.test_imu_csv import HEAD as IMU_HEAD
from tests.core.readers.test_imu_csv import ROWS as IMU_ROWS

HEAD = "time_unix_s,roll_deg,pitch_deg,heading_true_deg"
ROWS = [f"{1779529271.8 + 0.02 * k:.2f},{k},-0.5,{350 + 3 * k}" for k in range(8)]


def read(tmp_path: Path, head: str = HEAD, rows: list[str] = ROWS) -> AttitudeCsv:
    path = tmp_path / "ahrs.csv"
    path.write_text("\n".join([head, *rows, ""]), encoding="utf-8")
    return AttitudeCsv([path], ReadOptions())


def test_columns__are_read(tmp_path: Path) -> None:
    reader = read(tmp_path)
    track = reader.attitude()
    assert Recognised.by_content(tmp_path / "ahrs.csv").reader is AttitudeCsv
    assert track.north == "true"
    assert track.t_s == pytest.approx(1779529271.8 + 0.02 * np.arange(8))
    assert (track.roll_deg[3], track.pitch_deg[3], track.heading_deg[3]) == (3.0, -0.5, 359.0)
    assert reader.inspect().facts["north"] == "true"


@pytest.mark.parametrize(
    ("name", "north"), [("heading_deg", "grid"), ("heading_grid_deg", "grid"), ("heading_magnetic_deg", "magnetic")]
)
def test_north__is_in_the_name(tmp_path: Path, name: str, north: str) -> None:
    assert read(tmp_path, HEAD.replace("heading_true_deg", name)).attitude().north == north


def test_half_a_log__has_the_other_half_unknown(tmp_path: Path) -> None:
    level = read(tmp_path, HEAD.replace("heading_true_deg", "temperature"))
    assert np.isfinite([level.attitude().roll_deg, level.attitude().pitch_deg]).all()
    assert not level.attitude().has_heading
    assert level.inspect().facts["north"] == "no heading"
    heading = read(tmp_path, HEAD.replace("roll_deg", "a").replace("pitch_deg", "b")).attitude()
    assert np.isnan([heading.roll_deg, heading.pitch_deg]).all()
    assert heading.has_heading


def test_columns_beside_measurements__are_read_as_well(tmp_path: Path) -> None:
    path = tmp_path / "imu.csv"
    path.write_text("\n".join([f"{IMU_HEAD},roll_deg,pitch_deg", *(f"{row},1.5,-2" for row in IMU_ROWS), ""]))
    found = Recognised.by_content(path)
    assert found.reader is ImuCsv
    reader = ImuCsv([path], ReadOptions())
    assert set(reader.attitude().pitch_deg) == {-2.0}
    assert reader.inspect().facts["attitude"] == ["roll_deg", "pitch_deg"]


def test_trajectories__are_no_attitude_logs(tmp_path: Path) -> None:
    read(tmp_path, "time_unix_s,east,north,h_m,roll_deg,pitch_deg,heading_deg", ["1779529271.8,1,2,3,0,0,0"] * 2)
    assert Recognised.by_content(tmp_path / "ahrs.csv").reader is PoseCsv


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (("time_unix_s", "t"), "missing-column"),
        (("-0.5", "-95.5"), "value-out-of-range"),
        (("-0.5", "x"), "not-a-number"),
    ],
)
def test_faults__are_errors(tmp_path: Path, change: tuple[str, str], code: str) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path, HEAD.replace(*change), [row.replace(*change) for row in ROWS]).attitude()
    assert caught.value.code == code


def test_times_that_do_not_increase__are_an_error_or_a_notice(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path, rows=ROWS[::-1]).attitude()
    assert caught.value.code == "time-disorder"
    many = [f"{1779529271.8 + 0.02 * k:.2f},1,2,3" for k in range(300)]
    reader = read(tmp_path, rows=[*many[:100], many[50], *many[100:], ",1,2,3"])
    assert len(reader.attitude()) == 300
    assert [notice.code for notice in reader.notices] == ["rows-incomplete", "time-runs-back"]


def test_orientations_in_a_bag__are_those_of_rep_103(tmp_path: Path) -> None:
    """Roll 4°, nose 7° up, heading 30° by a rotation of the axes (x forward, y left, z up) against east, north, up."""
    turn = Rotation.from_euler("z", 60, degrees=True) * Rotation.from_euler("y", -7, degrees=True)
    turn *= Rotation.from_euler("x", 4, degrees=True)
    recorded = [
        ("/imu", T0_NS + 10**7 * k, imu(T0_NS + 10**7 * k, quaternion=turn.as_quat().tolist())) for k in range(3)
    ]
    track = RosBag2([write_bag2(tmp_path / "bag", recorded)], ReadOptions()).attitude()
    assert (track.roll_deg[1], track.pitch_deg[1], track.heading_deg[1]) == pytest.approx((4.0, 7.0, 30.0))
    assert track.north == ""
    none = write_bag2(tmp_path / "none", turning_imu(without="orientation"))
    with pytest.raises(InputError) as caught:
        RosBag2([none], ReadOptions()).attitude()
    assert caught.value.code == "no-orientation"


def test_init__names_two_logs(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("\n".join([HEAD.replace("heading_true_deg", "x_rate"), *ROWS, ""]))
    (tmp_path / "b.csv").write_text("\n".join([HEAD.replace("roll_deg", "q"), *ROWS, ""]))
    recordings = [Examined.read(tmp_path / name) for name in ("b.csv", "a.csv")]
    session = parse_session(propose_session(recordings, tmp_path).text)
    assert session.attitude is not None
    assert (session.attitude.roll_pitch, session.attitude.heading) == ("a.csv", "b.csv")


def test_magnetic_north__needs_a_declination_in_the_session() -> None:
    text = 'furrowmap = 1\n[recording]\ngnss = ["a"]\n[crs]\nmap = "EPSG:6677"\n[attitude]\nroll_pitch = "a"\n'
    text += 'heading = "a"\nnorth = "magnetic"\n'
    with pytest.raises(InputError, match="declination_deg"):
        parse_session(text)
    assert parse_session(f"{text}declination_deg = 4.2\n").attitude is not None


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("name", "largest"), [("roll_deg", 720.0), ("pitch_deg", 90.5), ("heading_true_deg", 720.0)])
def test_angles__at_their_limit_are_read_and_beyond_it_are_refused(
    name: str, largest: float, sign: float, tmp_path: Path
) -> None:
    names = HEAD.split(",")

    def with_value(value: float) -> list[str]:
        cells = [row.split(",") for row in ROWS]
        cells[4][names.index(name)] = repr(value)
        return [",".join(row) for row in cells]

    assert len(read(tmp_path, rows=with_value(sign * largest)).attitude()) == 8
    with pytest.raises(InputError, match=f"row 5: column `{name}`") as refused:
        read(tmp_path, rows=with_value(sign * largest * (1.0 + 1e-9))).attitude()
    assert refused.value.code == "value-out-of-range"
    assert f"-{largest:g} to {largest:g}" in refused.value.lines[1]


def test_times__one_in_a_hundred_may_run_back(tmp_path: Path) -> None:
    many = [f"{1779529271.8 + 0.02 * k:.2f},1,2,3" for k in range(198)]
    rows = [*many[:100], many[50], many[51], *many[100:]]
    assert len(read(tmp_path, rows=rows).attitude()) == 198
    with pytest.raises(InputError) as refused:
        read(tmp_path, rows=[*many[:100], many[50], many[51], many[52], *many[100:]]).attitude()
    assert refused.value.code == "time-disorder"


@pytest.mark.parametrize(("count", "is_log"), [(1, False), (2, True)])
def test_log__has_two_rows_at_least(count: int, is_log: bool, tmp_path: Path) -> None:
    reader = read(tmp_path, rows=ROWS[:count])
    if is_log:
        assert len(reader.attitude()) == 2
    else:
        with pytest.raises(InputError):
            reader.attitude()
