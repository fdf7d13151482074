"""A short straight drive over stubble, simulated once, with its truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.readers.reader import GivesPoses, ReadOptions, open_recording
from furrowmap.core.session.opened import OpenSession, open_session
from furrowmap.core.simulator.scenario import Scenario, ScenarioDrive, ScenarioField, load_scenario
from furrowmap.core.simulator.simulate import simulate
from furrowmap.core.trajectory.from_poses import trajectory_from_poses
from furrowmap.core.trajectory.located import Located, locate
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import Session
from furrowmap.core.values.trajectory import Trajectory

STRAIGHT = Scenario(
    name="straight",
    title="One pass, ten seconds",
    seed=11,
    field=ScenarioField(margin_m=10.0),
    drive=ScenarioDrive(passes=1, pass_m=(6.0,), stand_start_s=1.0, stand_end_s=0.5, lead_in_m=0.5, wander_m=0.05),
)


@dataclass(frozen=True)
class Recording:
    """A simulated recording, as a run sees it, and its truth."""

    session: Session
    located: Located
    opened: OpenSession
    truth: Trajectory
    scenario: Scenario
    surface: dict[str, NDArray[np.float64]]

    def scans(self) -> Iterator[Scan]:
        yield from self.opened.lidar(self.truth.span_s[0]).scans()


@pytest.fixture(scope="session")
def straight(made_once: Callable[[str, Callable[[Path], object]], Path]) -> Recording:
    folder = made_once("straight", lambda folder: simulate(STRAIGHT, folder / "drive")) / "drive"
    opened = open_session(folder / "session.toml")
    session, frame = opened.session, opened.frame
    located = locate(opened.positions(), session, frame)
    poses = open_recording([folder / "truth" / "trajectory.csv"], ReadOptions())
    assert isinstance(poses, GivesPoses)
    with np.load(folder / "truth" / "surface.npz") as stored:
        surface = {name: stored[name] for name in stored.files}
    truth = trajectory_from_poses(poses.poses(), frame)
    return Recording(session, located, opened, truth, load_scenario(folder / "scenario.toml"), surface)
