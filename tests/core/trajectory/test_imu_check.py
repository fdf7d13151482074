"""The checks of an IMU: each fault is named with what mends it, and a sound one passes."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import furrowmap
from furrowmap.core.readers.imu_csv import ImuCsv
from furrowmap.core.readers.inertial_rows import imu_notices, without_frozen
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.trajectory.from_inertial import trajectory_from_inertial
from furrowmap.core.trajectory.inertial_checks import turned_mounting
from furrowmap.core.trajectory.inertial_start import MountedImu
from furrowmap.core.values.inertial import InertialTrack
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.trajectory import Trajectory, trajectory_from_attitude
from tests.core.trajectory.flights import INDUSTRIAL, LEVER_M, MOUNTING, Flight, Forward, frame

FLIGHT = Flight(60.0, 4)
SOUND = FLIGHT.noisy_imu(rate_hz=100.0)


def by_hand() -> InertialTrack:
    """An IMU that is turned about all axes without being moved: gravity in its axes, and its angular rate."""
    t = np.arange(0.0, 40.0, 0.01)

    def turn(at: Any) -> Rotation:
        angles = [60 * np.sin(0.5 * at), 40 * np.sin(0.9 * at + 1.0), 50 * np.sin(0.7 * at + 2.0)]
        return Rotation.from_euler("ZYX", np.column_stack(angles), degrees=True)

    rate = (turn(t - 1e-4).inv() * turn(t + 1e-4)).as_rotvec() / 2e-4
    noise = np.random.default_rng(1).normal(0.0, 0.05, (len(t), 3))
    return InertialTrack(1_779_529_272.0 + t, rate + 0.02 * noise, turn(t).inv().apply([0.0, 0.0, 9.81]) + noise)


TURNED = by_hand()


def found(track: InertialTrack) -> dict[str, str]:
    return {notice.code: notice.text for notice in imu_notices(track)}


def test_sound_imus__pass(shared_data: Path) -> None:
    assert found(SOUND) == found(TURNED) == {}
    assert found(ImuCsv([shared_data / "uav_wheat" / "imu.csv"], ReadOptions()).inertial()) == {}


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1 / 9.80665, "in g, not in m/s2"),
        (9.80665, "in m/s2, not in g"),
        (1.3, "multiply `force_scale` under"),
    ],
)
def test_gravity__of_another_size_names_the_unit(factor: float, words: str) -> None:
    assert words in found(replace(SOUND, force_mps2=SOUND.force_mps2 * factor))["imu-gravity"]


def test_gravity__that_was_removed_is_named() -> None:
    force = SOUND.force_mps2 - SOUND.force_mps2.mean(axis=0)
    assert "Gravity was removed" in found(replace(SOUND, force_mps2=force))["imu-gravity"]


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        (-np.eye(3), "had the other sign"),
        (np.eye(3)[[1, 0, 2]], "y, x, z"),
        (np.eye(3)[[1, 2, 0]], "z, x, y"),
        (np.diag([1.0, -1.0, 1.0]), "x, −y, z"),
    ],
)
def test_rates__of_other_units_and_axes_are_named(matrix: Any, words: str) -> None:
    assert words in found(replace(TURNED, rate_radps=TURNED.rate_radps @ matrix.T))["imu-axes"]


@pytest.mark.parametrize(("factor", "unit"), [(180 / np.pi, "deg/s"), (np.pi / 180, "rad/s")])
def test_rates__of_another_unit_are_named(factor: float, unit: str) -> None:
    assert f'`rate_unit = "{unit}"`' in found(replace(TURNED, rate_radps=TURNED.rate_radps * factor))["imu-rate-unit"]


def test_times__of_arrival_and_pauses_are_told() -> None:
    k = np.arange(len(SOUND))
    bursts = SOUND.t_s[0] + 0.04 * (k // 4) + 1e-4 * (k % 4)
    assert "imu-times-of-arrival" in found(replace(SOUND, t_s=bursts))
    kept = np.ones(len(SOUND), bool)
    kept[1000:1100] = False
    cut = InertialTrack(SOUND.t_s[kept], SOUND.rate_radps[kept], SOUND.force_mps2[kept])
    assert "1 pause, 1.01 s in all" in found(cut)["imu-pauses"]


def test_axis_that_freezes__is_left_out_for_that_time() -> None:
    rate = SOUND.rate_radps.copy()
    rate[1000:1500, 2] = rate[1000, 2]
    kept, notices = without_frozen(replace(SOUND, rate_radps=rate))
    assert len(kept) == len(SOUND) - 500
    assert [notice.text for notice in notices] == [
        "flight: angular rate z repeats one value for 5.0 s while the other axes go on. The measurements of that "
        "time are left out; there are no poses then."
    ]
    # At rest, values of a coarse resolution repeat, of all axes.
    still = InertialTrack(SOUND.t_s, np.zeros_like(rate), np.round(SOUND.force_mps2 * 0.0 + 9.8, 1))
    assert without_frozen(still) == (still, [])
    assert without_frozen(SOUND) == (SOUND, [])


def turned_by(*rpy_deg: float) -> Mounting:
    """The mounting as a user would state it who takes the vehicle for turned so."""
    turn = Rotation.from_euler("ZYX", rpy_deg[::-1], degrees=True).as_matrix()
    return Mounting.from_rotation(MOUNTING.xyz_m, turn @ MOUNTING.rotation)


FORWARD = Forward(40.0, 4)


def run(mounting: Mounting) -> Any:
    """A run over exact measurements, which others use too."""
    imu = MountedImu(FORWARD.imu(100.0), mounting, INDUSTRIAL)
    return trajectory_from_inertial(FORWARD.track(), imu, frame(), LEVER_M, None)


def test_right_mounting__is_not_doubted() -> None:
    assert "imu-turned" not in {notice.code for notice in run(MOUNTING).notices}


def right_words() -> str:
    return f"[{', '.join(f'{angle:.1f}' for angle in MOUNTING.rpy_deg)}]"


@pytest.mark.parametrize("yaw_deg", [90.0, 180.0])
def test_yaw_off_by_quarters__is_named_with_the_right_one(yaw_deg: float) -> None:
    texts = {notice.code: notice.text for notice in run(turned_by(0.0, 0.0, yaw_deg)).notices}
    assert right_words() in texts["imu-turned"]


@pytest.mark.parametrize(("off_deg", "on_wheels", "told"), [(90, False, False), (90, True, True), (0, True, False)])
def test_drone_that_flies_sideways__is_not_taken_for_turned(off_deg: float, on_wheels: bool, told: bool) -> None:
    found = turned_mounting(driven(off_deg, lasts_s=30.0), MOUNTING, "imu.csv", on_wheels=on_wheels)
    assert (found is not None) == told


def driven(
    nose_deg: float, *, speed_mps: float = 2.0, lasts_s: float = 20.0, turn_deg: float = 0.0, roll_deg: float = 0.0
) -> Trajectory:
    """An arc by an angle in steps of 0.1 s, with the nose at an angle to the course all the time."""
    count = round(lasts_s / 0.1) + 1
    t_s = 0.1 * np.arange(count)
    course_deg = 30.0 + np.linspace(0.0, turn_deg, count)
    middle = np.radians(0.5 * (course_deg[1:] + course_deg[:-1]))
    steps = 0.1 * speed_mps * np.column_stack([np.sin(middle), np.cos(middle)])
    en = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    return trajectory_from_attitude(
        t_s, np.column_stack([en, 0.0 * t_s]), roll_deg, 0.0, course_deg + nose_deg, max_gap_s=1.0
    )


@pytest.mark.parametrize(
    ("motion", "told"),
    [
        ({"speed_mps": 0.51}, True),
        ({"speed_mps": 0.49}, False),
        ({"lasts_s": 5.2}, True),
        ({"lasts_s": 4.8}, False),
        ({"turn_deg": 300.0}, True),
    ],
)
@pytest.mark.parametrize("nose_deg", [90.0, 180.0, -90.0])
def test_turned_imu__is_told_after_five_seconds_above_half_a_metre_a_second(
    nose_deg: float, motion: dict[str, float], told: bool
) -> None:
    found = turned_mounting(driven(nose_deg, **motion), MOUNTING, "imu.csv", on_wheels=True)
    assert (found is not None) == told
    if found is not None:
        assert found.yaw_deg == pytest.approx(abs(nose_deg))
        notice = found.notice("imu.csv")
        assert f"moves at {abs(nose_deg):.0f}° to its own x axis" in notice.text
        right = Rotation.from_euler("z", -nose_deg, degrees=True).as_matrix() @ MOUNTING.rotation
        angles = [float(word) for word in notice.text.partition("`rpy_deg = [")[2].partition("]")[0].split(",")]
        stated = Rotation.from_euler("ZYX", angles[::-1], degrees=True).as_matrix()
        np.testing.assert_allclose(Rotation.from_matrix(stated.T @ right).magnitude(), 0.0, atol=0.01)


@pytest.mark.parametrize(("off_deg", "told"), [(0.0, True), (24.0, True), (26.0, False), (-24.0, True), (-26.0, False)])
@pytest.mark.parametrize("quarter_deg", [90.0, 180.0])
def test_turned_imu__is_within_25_degrees_of_a_quarter_turn(quarter_deg: float, off_deg: float, told: bool) -> None:
    found = turned_mounting(driven(quarter_deg + off_deg), MOUNTING, "imu.csv", on_wheels=True)
    assert (found is not None) is told
    assert turned_mounting(driven(off_deg), MOUNTING, "imu.csv", on_wheels=True) is None


@pytest.mark.parametrize(("turn_deg", "told"), [(86.0, False), (94.0, True)])
def test_drone__is_told_where_its_course_turns_by_a_right_angle(turn_deg: float, told: bool) -> None:
    """The mean of the course over an arc by θ has the length 2 sin(θ/2) / θ, 0.9 at 90°."""
    found = turned_mounting(driven(90.0, turn_deg=turn_deg), MOUNTING, "imu.csv", on_wheels=False)
    assert (found is not None) is told


@pytest.mark.parametrize("lasts_s", [3.0, 20.0])
@pytest.mark.parametrize(("roll_deg", "upright"), [(0.0, True), (40.0, True), (90.0, False), (-90.0, False)])
def test_tilt__is_judged_with_and_without_a_course(lasts_s: float, roll_deg: float, upright: bool) -> None:
    trajectory = driven(0.0, lasts_s=lasts_s, roll_deg=roll_deg)
    if upright:
        assert turned_mounting(trajectory, MOUNTING, "imu.csv", on_wheels=True) is None
        return
    with pytest.raises(InputError, match="on its side or upside down") as caught:
        turned_mounting(trajectory, MOUNTING, "imu.csv", on_wheels=True)
    assert ("its yaw is not known" in caught.value.remedy) == (lasts_s < 5.0)


@pytest.mark.parametrize("rpy_deg", [(180.0, 0.0, 0.0), (90.0, 0.0, 0.0), (90.0, 0.0, 90.0)])
def test_overturned__is_an_error_with_the_right_one(rpy_deg: tuple[float, float, float]) -> None:
    with pytest.raises(InputError) as caught:
        run(turned_by(*rpy_deg))
    assert caught.value.code == "imu-turned"
    assert right_words() in caught.value.remedy


def test_left_handed_axes__are_named_by_the_positions() -> None:
    imu = FORWARD.imu(100.0)
    wrong = replace(imu, rate_radps=-imu.rate_radps, force_mps2=-imu.force_mps2)
    with pytest.raises(InputError, match="left-handed") as caught:
        trajectory_from_inertial(FORWARD.track(), MountedImu(wrong, MOUNTING, INDUSTRIAL), frame(), LEVER_M, None)
    assert caught.value.code == "imu-contradicts"


def test_clock_off_by_hours__is_named() -> None:
    late = replace(SOUND, t_s=SOUND.t_s + 7200.0)
    with pytest.raises(InputError, match="minus_gnss_s = 7200") as caught:
        trajectory_from_inertial(FLIGHT.track(), MountedImu(late, MOUNTING, INDUSTRIAL), frame(), LEVER_M, None)
    assert caught.value.code == "imu-no-overlap"


def test_inspect_and_run__report_and_mend(tmp_path: Path, shared_data: Path) -> None:
    for name in ("gnss.nmea", "imu.csv"):
        shutil.copyfile(shared_data / "uav_wheat" / name, tmp_path / name)
    lines = (tmp_path / "imu.csv").read_text(encoding="utf-8").splitlines()
    late = [lines[0], *(f"{float(r.split(',')[0]) + 30.0:.4f},{r.split(',', 1)[1]}" for r in lines[1:])]
    (tmp_path / "imu.csv").write_text("\n".join([*late, ""]), encoding="utf-8")
    (tmp_path / "session.toml").write_text(
        'furrowmap = 1\n[recording]\ngnss = ["gnss.nmea"]\n[crs]\nmap = "EPSG:25832"\n[imu]\nfiles = ["imu.csv"]\n'
        "xyz_m = [-0.039, -0.008, -0.294]\nrpy_deg = [180.0, 0.0, 0.0]\nminus_gnss_s = 30.0\n",
        encoding="utf-8",
    )
    result = furrowmap.run(tmp_path / "session.toml", tmp_path / "result")
    assert result.report["inertial"]["position_rms_m"][0] < 0.02
    in_g = lines[0].replace("_mps2", "_g")
    (tmp_path / "imu.csv").write_text("\n".join([in_g, *lines[1:], ""]), encoding="utf-8")
    assert "imu-gravity" in {notice.code for notice in furrowmap.inspect(tmp_path / "imu.csv").inspection.notices}
