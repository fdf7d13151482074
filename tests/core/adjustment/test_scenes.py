"""Right sessions on ground that shows little keep their mounting; places are as good as their sigmas say."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from furrowmap.core.adjustment.session_match import match_session
from furrowmap.core.readers.reader import GivesPoses, ReadOptions, open_recording
from furrowmap.core.session.opened import open_session
from furrowmap.core.simulator.scenario import Drive, Field, Noise, Scenario, Soil
from furrowmap.core.simulator.simulate import simulate
from furrowmap.core.trajectory.from_poses import trajectory_from_poses
from furrowmap.core.trajectory.located import locate

DRIVE = Drive(passes=1, pass_m=(5.0,), stand_start_s=0.5, stand_end_s=0.5, lead_in_m=0.5, start_xy_m=(12.0, 14.0))
YARD = ((20.0, 27.0, 5.0, 18.0, 4.0, 4.0, 6.0), (33.0, 14.0, 80.0, 9.0, 4.0, 3.5, 7.0))
SCENES: dict[str, dict[str, Any]] = {
    "concrete": {"soil": Soil(kind="asphalt", clod_sigma_m=0.0, undulation_m=0.0, worked="same")},
    "yard": {"soil": Soil(kind="asphalt", undulation_m=0.01, worked="same"), "walls": YARD},
    "lawn": {"soil": Soil(kind="lawn", worked="same")},
    "snow": {"soil": Soil(kind="snow", worked="same"), "noise": Noise(range_m=0.02, dropout=0.15)},
}


@pytest.mark.parametrize("name", SCENES)
def test_promise_15__a_right_session_is_neither_turned_nor_doubted(name: str, tmp_path: Path) -> None:
    field = Field(size_e_m=38.0, size_n_m=32.0)
    made = simulate(Scenario(seed=5, field=field, drive=DRIVE, **SCENES[name]), tmp_path / name)
    opened = open_session(made.session)
    located = locate(opened.positions(), opened.session, opened.frame)
    poses = open_recording([made.folder / "truth" / "trajectory.csv"], ReadOptions())
    assert isinstance(poses, GivesPoses)
    truth = trajectory_from_poses(poses.poses(), opened.frame)
    matched, _ = match_session(located, opened.lidar(truth.span_s[0]), opened.session)
    assert matched is not None
    assert matched.mounting == opened.session.lidar.mounting
    assert {notice.code for notice in matched.notices} <= {"facing-assumed"}
    trajectory = matched.trajectory
    inside = (trajectory.t_s > truth.span_s[0] + 0.1) & (trajectory.t_s < truth.span_s[1] - 0.1)
    t_s, sigma = trajectory.t_s[inside], trajectory.sigma[inside]
    place = np.abs(trajectory.at(t_s).xyz_m - truth.at(t_s).xyz_m)
    assert np.median(place / sigma[:, :3], axis=0).max() < 3.0
