"""Units of an IMU other than those of its format: found by gravity and motion, stated by a session for any source."""

from collections.abc import Callable
from pathlib import Path
from typing import Final, get_args, get_type_hints

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from furrowmap.core.readers.imu_csv import ImuCsv
from furrowmap.core.readers.inertial_rows import inertial_facts
from furrowmap.core.readers.reader import ReadOptions, open_recording
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.session.examination import Examined
from furrowmap.core.session.opened import open_session
from furrowmap.core.session.proposal import propose_session
from furrowmap.core.values.inertial import FORCE_UNITS, RATE_UNITS, InertialTrack, StatedUnits
from furrowmap.core.values.session import Imu
from tests.core.readers.inertial_bags import imu
from tests.core.readers.small_bags import ROS1, T0_NS, nav_sat_fix, write_bag1, write_bag2

STEP_S: Final = 0.02
T_S: Final = np.arange(0.0, 8.0, STEP_S)
FOREIGN: Final = Path("foreign") / "13-imu-bag-in-g"


def moved(roll_deg: float, yaw_deg: float) -> tuple[FloatArray, FloatArray]:
    """Angular rates (n, 3) in rad/s and specific forces (n, 3) in m/s² of an IMU that rocks and turns in its place."""

    def turn(t_s: FloatArray) -> Rotation:
        angles = np.column_stack([yaw_deg * np.sin(0.9 * t_s), 0.0 * t_s, roll_deg * np.sin(1.3 * t_s)])
        return Rotation.from_euler("ZYX", angles, degrees=True)

    rate_radps = (turn(T_S - 1e-4).inv() * turn(T_S + 1e-4)).as_rotvec() / 2e-4
    return rate_radps, turn(T_S).inv().apply([0.0, 0.0, 9.80665])


HELD: Final = moved(40.0, 60.0)
ON_A_TRACTOR: Final = moved(2.0, 30.0)


def bag1(folder: Path, rate: FloatArray, force: FloatArray) -> Path:
    stamps = (T0_NS + 1e9 * T_S).astype(np.int64).tolist()
    messages = [("/imu", at, imu(at, w, f, store=ROS1)) for at, w, f in zip(stamps, rate, force, strict=True)]
    return write_bag1(folder / "imu.bag", messages)


def bag2(folder: Path, rate: FloatArray, force: FloatArray) -> Path:
    stamps = (T0_NS + 1e9 * T_S).astype(np.int64).tolist()
    messages = [("/imu", at, imu(at, w, f)) for at, w, f in zip(stamps, rate, force, strict=True)]
    return write_bag2(folder / "bag", messages)


def csv(folder: Path, rate: FloatArray, force: FloatArray) -> Path:
    names = [f"{kind}_{axis}_{unit}" for kind, unit in (("gyro", "radps"), ("force", "mps2")) for axis in "xyz"]
    rows = np.column_stack([T0_NS * 1e-9 + T_S, rate, force])
    lines = [",".join(f"{value:.9f}" for value in row) for row in rows]
    path = folder / "imu.csv"
    path.write_text("\n".join([",".join(["time_unix_s", *names]), *lines, ""]), encoding="utf-8")
    return path


Written = Callable[[Path, FloatArray, FloatArray], Path]


@pytest.mark.parametrize("write", [bag1, bag2, csv])
@pytest.mark.parametrize(("rate_unit", "force_unit"), [("rad/s", "g"), ("deg/s", "g"), ("deg/s", "m/s2")])
def test_units__are_shown_proposed_and_read(tmp_path: Path, write: Written, rate_unit: str, force_unit: str) -> None:
    rate_radps, force_mps2 = HELD
    source = write(tmp_path, rate_radps / RATE_UNITS[rate_unit], force_mps2 / FORCE_UNITS[force_unit])
    fixes = [("/fix", T0_NS + 10**8 * k, nav_sat_fix(T0_NS + 10**8 * k, lat_deg=43.0 + 1e-6 * k)) for k in range(5)]
    gnss = write_bag2(tmp_path / "gnss", fixes)
    examined = Examined.read(source)
    shown = {"rate_unit": rate_unit, "force_unit": force_unit}
    expected = {key: unit for key, unit in shown.items() if unit not in ("rad/s", "m/s2")}
    facts = examined.inspection.facts.get("imu", examined.inspection.facts)
    assert {key: facts[key] for key in shown if key in facts} == expected
    told = " ".join(notice.text for notice in examined.inspection.notices)
    assert all(f'`{key} = "{unit}"` under `[imu]`' in told for key, unit in expected.items())
    path = tmp_path / "session.toml"
    path.write_text(propose_session([examined, Examined.read(gnss)], tmp_path).text, encoding="utf-8")
    track = open_session(path).inertial(T0_NS * 1e-9).inertial()
    np.testing.assert_allclose(track.rate_radps, rate_radps, atol=1e-6)
    np.testing.assert_allclose(track.force_mps2, force_mps2, atol=1e-6)


@pytest.mark.parametrize("write", [bag1, bag2, csv])
def test_turns_that_no_imu_measures__are_in_degrees(tmp_path: Path, write: Written) -> None:
    rate_radps, force_mps2 = moved(20.0, 150.0)  # up to 135 °/s, which would be 135 rad/s
    source = write(tmp_path, np.degrees(rate_radps), force_mps2)
    facts = Examined.read(source).inspection.facts
    assert facts.get("imu", facts)["rate_unit"] == "deg/s"
    with pytest.raises(InputError, match="rate_unit") as caught:
        open_recording([source], ReadOptions()).inertial()  # type: ignore[attr-defined]
    assert caught.value.code == "value-out-of-range"


@pytest.mark.parametrize("motion", [HELD, ON_A_TRACTOR, moved(0.0, 0.0), moved(0.0, 60.0)])
def test_sound_measurements__show_no_other_unit(motion: tuple[FloatArray, FloatArray]) -> None:
    noise = np.random.default_rng(5).normal(size=(2, len(T_S), 3))
    bias_radps = np.radians(0.5)
    track = InertialTrack(T_S, motion[0] + bias_radps + 0.003 * noise[0], motion[1] + 0.3 * noise[1])
    assert {"rate_unit", "force_unit"}.isdisjoint(inertial_facts(track))


def test_multirotor__whose_gravity_hides_behind_its_thrust_shows_no_other_unit() -> None:
    rate_radps, _ = moved(25.0, 60.0)
    force = np.tile([0.0, 0.0, 9.9], (len(T_S), 1))
    assert "rate_unit" not in inertial_facts(InertialTrack(T_S, rate_radps, force))


def test_forces_without_gravity__of_about_one_are_not_taken_for_g() -> None:
    turning = np.column_stack([np.cos(3.0 * T_S), np.sin(3.0 * T_S), 0.0 * T_S])
    assert "force_unit" not in inertial_facts(InertialTrack(T_S, 0.0 * turning, turning))


@pytest.mark.parametrize(("folder", "units"), [("imu_g", (None, "g")), ("imu_g_deg", ("deg/s", "g"))])
def test_bags_of_livox_and_hesai(shared_data: Path, folder: str, units: tuple[str | None, str]) -> None:
    facts = Examined.read(shared_data / FOREIGN / folder).inspection.facts["imu"]
    assert (facts.get("rate_unit"), facts["force_unit"]) == units


def test_units_of_a_session__are_those_of_the_readers() -> None:
    hints = get_type_hints(Imu)
    assert {*get_args(get_args(hints["rate_unit"])[0])} == {*RATE_UNITS}
    assert {*get_args(get_args(hints["force_unit"])[0])} == {*FORCE_UNITS}


def test_scales__are_factors(tmp_path: Path) -> None:
    source = csv(tmp_path, *ON_A_TRACTOR)
    options = ReadOptions(units=StatedUnits(rate_scale=2.0, force_scale=0.5))
    track = ImuCsv([source], options).inertial()
    np.testing.assert_allclose(track.rate_radps, 2.0 * ON_A_TRACTOR[0], atol=1e-6)
    np.testing.assert_allclose(track.force_mps2, 0.5 * ON_A_TRACTOR[1], atol=1e-6)


def test_units_beside_columns__are_refused(tmp_path: Path) -> None:
    text = 'furrowmap = 1\n[recording]\ngnss = ["gnss.nmea"]\n[crs]\nmap = "EPSG:25832"\n[imu]\nfiles = ["dji.csv"]\n'
    column = '[imu.columns]\ngyroX = { quantity = "gyro_x", unit = "deg/s" }\n'
    path = tmp_path / "session.toml"
    (tmp_path / "gnss.nmea").write_text("\n", encoding="utf-8")
    (tmp_path / "dji.csv").write_text("gyroX\n1.0\n", encoding="utf-8")
    for line in ('force_unit = "g"\n', 'rate_unit = "deg/s"\n', "rate_scale = 2.0\n", "force_scale = 2.0\n"):
        path.write_text(f"{text}{line}{column}", encoding="utf-8")
        with pytest.raises(InputError, match=r"imu\.columns"):
            open_session(path).inertial(0.0).inertial()
