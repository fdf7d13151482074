"""A short drive, simulated once for all tests that look at what was written."""

from __future__ import annotations

from pathlib import Path

import pytest

from furrowmap.core.simulator.scenario import (
    Gnss,
    Receiver,
    Scenario,
    ScenarioClock,
    ScenarioDrive,
    ScenarioField,
    ScenarioLidar,
)
from furrowmap.core.simulator.simulate import Simulated, simulate

SHORT = Scenario(
    name="short",
    title='A short "drive"',
    seed=5,
    t0="2025-12-31T23:59:56.250+00:00",
    posts=((9.0, 4.0, 0.15, 2.0),),
    field=ScenarioField(size_e_m=20.0, size_n_m=16.0),
    drive=ScenarioDrive(
        passes=1, pass_m=(3.2,), speed_work_mps=1.3, accel_mps2=1.5, stand_start_s=0.4, stand_end_s=0.3, lead_in_m=0.4
    ),
    clock=ScenarioClock(jitter_s=0.001),
    gnss=Gnss(clas=Receiver(outage_s=((3.0, 3.5),), float_s=((4.0, 4.6),))),
    lidar=ScenarioLidar(start_s=0.3),
)
"""Five seconds, one pass, across the end of an hour, a day and a year."""


@pytest.fixture(scope="session")
def short_drive(tmp_path_factory: pytest.TempPathFactory) -> Simulated:
    """The short drive as files."""
    folder: Path = tmp_path_factory.mktemp("simulated") / "short"
    return simulate(SHORT, folder)
