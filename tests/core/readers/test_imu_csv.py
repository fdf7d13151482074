"""Inertial measurements in CSV."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.readers.imu_csv import ImuCsv
from furrowmap.core.readers.reader import ReadOptions, Recognised
from furrowmap.core.readers.source import look
from furrowmap.core.runtime.errors import InputError

HEAD = "time_unix_s,gyro_x_dps,gyro_y_dps,gyro_z_dps,force_x_mps2,force_y_mps2,force_z_mps2"
ROWS = [f"{1779529271.8 + 0.005 * k:.3f},{k},0.5,-1,0.1,0.2,9.{k}" for k in range(8)]


def read(tmp_path: Path, text: str) -> tuple[ImuCsv, Path]:
    path = tmp_path / "imu.csv"
    path.write_text(text, encoding="utf-8")
    return ImuCsv([path], ReadOptions()), path


def test_columns__are_turned_into_radians_and_metres(tmp_path: Path) -> None:
    reader, path = read(tmp_path, "\n".join([HEAD, *ROWS, ""]))
    track = reader.inertial()
    assert Recognised.by_content(path).reader is ImuCsv
    assert track.t_s == pytest.approx(1779529271.8 + 0.005 * np.arange(8))
    assert track.rate_radps[3] == pytest.approx(np.radians([3.0, 0.5, -1.0]))
    assert track.force_mps2[3] == pytest.approx([0.1, 0.2, 9.3])
    assert reader.notices == []


@pytest.mark.parametrize(
    ("name", "factor"),
    [("gyro_x_dps", np.pi / 180), ("rate_x_deg_s", np.pi / 180), ("gyr_x_radps", 1.0), ("gyro_x_rad_s", 1.0)],
)
def test_units_of_rates__are_in_the_names(tmp_path: Path, name: str, factor: float) -> None:
    head = HEAD.replace("gyro_x_dps", name)
    assert read(tmp_path, "\n".join([head, *ROWS, ""]))[0].inertial().rate_radps[4, 0] == pytest.approx(4 * factor)


@pytest.mark.parametrize(
    ("name", "factor"), [("accel_z_m_s2", 1.0), ("acc_z_g", 9.80665), ("force_z_mg", 9.80665e-3), ("accel_z_mps2", 1.0)]
)
def test_units_of_forces__are_in_the_names(tmp_path: Path, name: str, factor: float) -> None:
    head = HEAD.replace("force_z_mps2", name)
    assert read(tmp_path, "\n".join([head, *ROWS, ""]))[0].inertial().force_mps2[4, 2] == pytest.approx(9.4 * factor)


def test_gps_time__is_turned_into_utc(tmp_path: Path) -> None:
    text = "\n".join(
        [HEAD.replace("time_unix_s", "time_gps_s"), *(f"{1463564472.0 + k},0,0,0,0,0,9.8" for k in range(3))]
    )
    assert read(tmp_path, text + "\n")[0].inertial().t_s[0] == pytest.approx(1463564472.0 + 315964800.0 - 18.0)


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ((",gyro_y_dps", ",gyro_y"), "missing-column"),
        (("time_unix_s", "t"), "missing-column"),
        ((",force_x_mps2", ",force_x_lsb"), "missing-column"),
        ((",0.5,", ",x,"), "not-a-number"),
        ((",9.3", ",9999.0"), "value-out-of-range"),
    ],
)
def test_faults__are_errors(tmp_path: Path, change: tuple[str, str], code: str) -> None:
    reader, _ = read(tmp_path, "\n".join([HEAD, *ROWS, ""]).replace(*change))
    with pytest.raises(InputError) as caught:
        reader.inertial()
    assert caught.value.code == code


def test_rows_out_of_order__are_dropped_with_a_notice_or_an_error(tmp_path: Path) -> None:
    many = [f"{1779529271.8 + 0.005 * k:.3f},0,0,0,0,0,9.8" for k in range(400)]
    few = [*many[:200], many[100], *many[200:]]
    reader, _ = read(tmp_path, "\n".join([HEAD, *few, ""]))
    assert len(reader.inertial()) == 400
    assert [notice.code for notice in reader.notices] == ["time-runs-back"]
    reader, _ = read(tmp_path, "\n".join([HEAD, *reversed(many), ""]))
    with pytest.raises(InputError) as caught:
        reader.inertial()
    assert caught.value.code == "time-disorder"


def test_empty_fields__are_dropped_with_a_notice(tmp_path: Path) -> None:
    reader, _ = read(tmp_path, "\n".join([HEAD, *ROWS, ""]).replace(",0.5,", ",,", 1))
    assert len(reader.inertial()) == 7
    assert [notice.code for notice in reader.notices] == ["rows-incomplete"]


def test_sample__is_inspected(shared_data: Path) -> None:
    inspection = Recognised.by_content(shared_data / "uav_wheat" / "imu.csv").inspect()
    assert inspection.format == "imu-csv"
    assert inspection.facts["measurements"] == 22_196
    assert inspection.facts["rate_hz"] == pytest.approx(200.0, abs=0.1)
    assert np.linalg.norm(inspection.facts["mean_force_mps2"]) == pytest.approx(9.8, abs=0.2)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("axis", "xyz")
@pytest.mark.parametrize(("kind", "unit", "largest"), [("gyro", "radps", 100.0), ("force", "mps2", 1000.0)])
def test_values__at_the_limit_of_imus_are_read_and_beyond_it_are_refused(
    kind: str, unit: str, largest: float, axis: str, sign: float, tmp_path: Path
) -> None:
    head = HEAD.replace("dps", "radps").split(",")
    at = head.index(f"{kind}_{axis}_{unit}")

    def with_value(value: float) -> ImuCsv:
        rows = [row.split(",") for row in ROWS]
        rows[5][at] = repr(value)
        return read(tmp_path, "\n".join([",".join(head), *(",".join(row) for row in rows), ""]))[0]

    assert len(with_value(sign * largest).inertial()) == 8
    with pytest.raises(InputError, match=head[at][:4]) as refused:
        with_value(sign * largest * (1.0 + 1e-9)).inertial()
    assert refused.value.code == "value-out-of-range"


@pytest.mark.parametrize(("late", "is_read"), [(2, True), (3, False)])
def test_rows__one_in_a_hundred_may_run_back(late: int, is_read: bool, tmp_path: Path) -> None:
    many = [f"{1779529271.8 + 0.005 * k:.3f},0,0,0,0,0,9.8" for k in range(200 - late)]
    reader, _ = read(tmp_path, "\n".join([HEAD, *many[:100], *many[50 : 50 + late], *many[100:], ""]))
    if is_read:
        assert len(reader.inertial()) == 200 - late
    else:
        with pytest.raises(InputError, match=f"{late} of 200"):
            reader.inertial()


@pytest.mark.parametrize(("count", "is_read"), [(1, False), (2, True)])
def test_rows__two_at_least(count: int, is_read: bool, tmp_path: Path) -> None:
    reader, _ = read(tmp_path, "\n".join([HEAD, *ROWS[:count], ""]))
    if is_read:
        assert len(reader.inertial()) == 2
    else:
        with pytest.raises(InputError):
            reader.inertial()


def test_recognise__by_the_columns_of_three_axes_and_a_time(tmp_path: Path) -> None:
    names = HEAD.split(",")
    certainty = [
        ImuCsv.recognise(look(read(tmp_path, ",".join(names[:count]) + "\n1,2\n")[1])) for count in range(1, 8)
    ]
    assert certainty[:3] == [0.0] * 3
    assert 0.0 < certainty[3] == certainty[4] == certainty[5] < certainty[6] == 1.0
    assert ImuCsv.recognise(look(read(tmp_path, ",".join(names[1:]) + "\n1,2\n")[1])) == 0.0
