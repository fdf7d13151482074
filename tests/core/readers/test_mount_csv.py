"""The attitude of a mount from CSV."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from furrowmap.core.readers.mount_csv import read_mount
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.pose_track import MountMotion

T0 = 1_781_172_000.0
HEAD = "time_unix_s,roll_deg,pitch_deg,yaw_deg"


def read(folder: Path, *rows: str, head: str = HEAD) -> MountMotion:
    (folder / "mount.csv").write_text("\n".join([head, *rows, ""]))
    return read_mount(folder / "mount.csv", T0)[0]


def refusal(folder: Path, *rows: str) -> str:
    with pytest.raises(InputError) as refused:
        read(folder, *rows)
    return refused.value.code


def test_angles__turn_about_z_then_y_then_x(tmp_path: Path) -> None:
    """The nose of a body (x forward, y left, z up) turns by yaw to the left, by pitch down, by roll to the right."""
    found = read(tmp_path, f"{T0},10,20,30", f"{T0 + 1},0,0,90", f"{T0 + 2},0,90,0", f"{T0 + 3},90,0,0")
    turns = Rotation.from_quat(found.quaternion, scalar_first=True)
    x, y, z = np.eye(3)
    np.testing.assert_allclose(turns[1].apply(x), y, atol=1e-12)
    np.testing.assert_allclose(turns[2].apply(x), -z, atol=1e-12)
    np.testing.assert_allclose(turns[3].apply(y), z, atol=1e-12)
    expected = Rotation.from_rotvec(np.radians(30) * z) * Rotation.from_rotvec(np.radians(20) * y)
    np.testing.assert_allclose(
        turns[0].as_matrix(), (expected * Rotation.from_rotvec(np.radians(10) * x)).as_matrix(), atol=1e-12
    )
    assert found.t_s.tolist() == [T0, T0 + 1, T0 + 2, T0 + 3]


@pytest.mark.parametrize("column", [1, 2, 3])
@pytest.mark.parametrize("sign", [1, -1])
def test_angles__up_to_two_turns(column: int, sign: int, tmp_path: Path) -> None:
    cells = [f"{T0 + 1}", "0", "0", "0"]
    cells[column] = str(720 * sign)
    found = read(tmp_path, f"{T0},0,0,0", ",".join(cells))
    np.testing.assert_allclose(np.abs(found.quaternion), [[1, 0, 0, 0]] * 2, atol=1e-12)
    cells[column] = str(720.001 * sign)
    assert refusal(tmp_path, f"{T0},0,0,0", ",".join(cells)) == "value-out-of-range"


@pytest.mark.parametrize("times", [[0.0], [], [0.0, 0.0], [0.0, 1.0, 0.5]])
def test_times__increase_from_row_to_row_of_two_at_least(times: list[float], tmp_path: Path) -> None:
    assert refusal(tmp_path, *(f"{T0 + t},0,0,0" for t in times)) == "time-disorder"


def test_times__of_gps_are_those_of_the_week_of_the_recording(tmp_path: Path) -> None:
    second = T0 - 315_964_800.0 - 2422 * 604_800.0 + 18.0
    found = read(tmp_path, f"{second},0,0,0", f"{second + 1},0,0,0", head=HEAD.replace("unix", "gps"))
    np.testing.assert_allclose(found.t_s, [T0, T0 + 1], atol=1e-6)
