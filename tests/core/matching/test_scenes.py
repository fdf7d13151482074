"""Right sessions on ground that shows little keep their mounting; places are as good as their sigmas say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from furrowmap.core.matching.consistency import Cause
from furrowmap.core.matching.session_match import match_session
from furrowmap.core.readers.reader import GivesPoses, ReadOptions, open_recording
from furrowmap.core.session.opened import OpenSession, open_session
from furrowmap.core.simulator.scenario import Noise, Scenario, ScenarioDrive, ScenarioField, ScenarioSoil
from furrowmap.core.simulator.simulate import simulate
from furrowmap.core.trajectory.from_poses import trajectory_from_poses
from furrowmap.core.trajectory.located import locate
from furrowmap.core.values.trajectory import Trajectory

DRIVE = ScenarioDrive(
    passes=1, pass_m=(5.0,), stand_start_s=0.5, stand_end_s=0.5, lead_in_m=0.5, start_xy_m=(12.0, 14.0)
)
YARD = ((20.0, 27.0, 5.0, 18.0, 4.0, 4.0, 6.0), (33.0, 14.0, 80.0, 9.0, 4.0, 3.5, 7.0))
SCENES: dict[str, dict[str, Any]] = {
    "concrete": {"soil": ScenarioSoil(kind="asphalt", clod_sigma_m=0.0, undulation_m=0.0, worked="same")},
    "yard": {"soil": ScenarioSoil(kind="asphalt", undulation_m=0.01, worked="same"), "walls": YARD},
    "lawn": {"soil": ScenarioSoil(kind="lawn", worked="same")},
    "snow": {"soil": ScenarioSoil(kind="snow", worked="same"), "noise": Noise(range_m=0.02, dropout=0.15)},
}


def opened_scene(scene: dict[str, Any], folder: Path) -> tuple[OpenSession, Trajectory]:
    """A scene's recording and its truth."""
    made = simulate(
        Scenario(seed=5, field=ScenarioField(size_e_m=38.0, size_n_m=32.0), **({"drive": DRIVE} | scene)), folder
    )
    opened = open_session(made.session)
    poses = open_recording([made.folder / "truth" / "trajectory.csv"], ReadOptions())
    assert isinstance(poses, GivesPoses)
    return opened, trajectory_from_poses(poses.poses(), opened.frame)


def errors_over_sigmas(trajectory: Trajectory, truth: Trajectory) -> np.ndarray:
    """(n, 4) errors of easting, northing, height and heading in their stated standard deviations."""
    t_s = trajectory.t_s
    inside = (t_s > truth.span_s[0] + 0.1) & (t_s < truth.span_s[1] - 0.1)
    ours, true = trajectory.at(t_s[inside]), truth.at(t_s[inside])
    turned = (ours.attitude_deg()[2] - true.attitude_deg()[2] + 180.0) % 360.0 - 180.0
    return np.abs(np.column_stack([ours.xyz_m - true.xyz_m, turned])) / trajectory.sigma[inside][:, [0, 1, 2, 5]]


@pytest.fixture(scope="module")
def concrete(tmp_path_factory: pytest.TempPathFactory) -> tuple[OpenSession, Trajectory]:
    return opened_scene(SCENES["concrete"], tmp_path_factory.mktemp("concrete") / "concrete")


@pytest.mark.parametrize("name", SCENES)
def test_promise_15__a_right_session_is_neither_turned_nor_doubted(
    name: str, concrete: tuple[OpenSession, Trajectory], tmp_path: Path
) -> None:
    opened, truth = concrete if name == "concrete" else opened_scene(SCENES[name], tmp_path / name)
    located = locate(opened.positions(), opened.session, opened.frame)
    matched = match_session(located, opened.lidar(truth.span_s[0]), opened.session).matched
    assert matched is not None
    assert matched.mounting == opened.session.lidar.mounting
    codes = {notice.code for notice in matched.notices}
    assert codes == ({"facing-assumed", "slow-errors-assumed"} if not matched.facing_shown else set())
    over = errors_over_sigmas(matched.trajectory, truth)
    assert np.median(over, axis=0).max() < 3.0
    assert over[:, 3].max() < 5.0


def test_promise_12__without_relief_the_sway_shows_a_lever_arm_that_is_wrong(
    concrete: tuple[OpenSession, Trajectory],
) -> None:
    opened, truth = concrete
    assert opened.session.antenna is not None
    x, y, z = opened.session.antenna.xyz_m
    back = msgspec.structs.replace(opened.session.antenna, xyz_m=(-x, y, z))
    session = msgspec.structs.replace(opened.session, antenna=back)
    located = locate(opened.positions(), session, opened.frame)
    matched = match_session(located, opened.lidar(truth.span_s[0]), session).matched
    assert matched is not None
    assert matched.notices[0].code == "contradiction"
    assert matched.seen.cause is Cause.LEVER_ARM
    assert matched.seen.sway.lever_m[0] == pytest.approx(2.0 * x, abs=4.0 * matched.seen.sway.sigma_m[0])
    assert np.median(errors_over_sigmas(matched.trajectory, truth), axis=0).max() < 3.0


def test_promise_13__without_relief_the_sway_shows_clocks_that_are_apart(
    concrete: tuple[OpenSession, Trajectory],
) -> None:
    opened, truth = concrete
    apart = msgspec.structs.replace(opened.session.recording, lidar_minus_gnss_s=0.3)
    session = msgspec.structs.replace(opened.session, recording=apart)
    located = locate(opened.positions(), session, opened.frame)
    lidar = replace(opened, session=session).lidar(truth.span_s[0])
    matched = match_session(located, lidar, session).matched
    assert matched is not None
    assert matched.clock_used_s == pytest.approx(-0.3, abs=0.03)
    assert "clock-offset" in {notice.code for notice in matched.notices}


def test_promise_15__among_standing_crop_what_nothing_shows_is_said_to_be_assumed(tmp_path: Path) -> None:
    scene = {"soil": ScenarioSoil(kind="maize", worked="same"), "drive": msgspec.structs.replace(DRIVE, pass_m=(9.0,))}
    opened, truth = opened_scene(scene, tmp_path / "maize")
    located = locate(opened.positions(), opened.session, opened.frame)
    placed = match_session(located, opened.lidar(truth.span_s[0]), opened.session)
    assert placed.matched is None
    assert {notice.code for notice in placed.notices} >= {"lever-assumed", "slow-errors-assumed"}
    assert "contradiction" not in {notice.code for notice in placed.notices}
    assert np.median(errors_over_sigmas(placed.trajectory, truth), axis=0).max() < 3.0

    # Plants show a scanner that faces backwards.
    roll, pitch, yaw = opened.session.lidar.rpy_deg
    turned = msgspec.structs.replace(opened.session.lidar, rpy_deg=(roll, pitch, yaw + 180.0))
    session = msgspec.structs.replace(opened.session, lidar=turned)
    found = match_session(located, replace(opened, session=session).lidar(truth.span_s[0]), session).matched
    assert found is not None  # as the scanner sees more ground ahead of a vehicle whose body lies there
    assert found.mounting.rotation == pytest.approx(opened.session.lidar.mounting.rotation, abs=0.03)
    assert "mounting-off" in {notice.code for notice in found.notices}
