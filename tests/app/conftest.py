"""A small simulated recording and its result, made once for the tests of the Python API."""

from __future__ import annotations

from pathlib import Path

import pytest

import furrowmap

SCENARIO = """title = "One pass"
seed = 5
t0 = "2026-06-11T14:59:58.000+00:00"  # midnight in Japan follows
posts = [[9.0, 4.0, 0.15, 2.0]]
[field]
size_e_m = 20.0
size_n_m = 16.0
[drive]
passes = 1
pass_m = [3.2]
speed_work_mps = 1.3
accel_mps2 = 1.5
stand_start_s = 0.4
stand_end_s = 0.3
lead_in_m = 0.4
"""


@pytest.fixture(scope="session")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> furrowmap.Simulated:
    """One pass of five seconds."""
    folder: Path = tmp_path_factory.mktemp("simulated")
    (folder / "scenario.toml").write_text(SCENARIO)
    return furrowmap.simulate(folder / "scenario.toml", folder / "drive")


@pytest.fixture(scope="session")
def result(simulated: furrowmap.Simulated) -> furrowmap.Result:
    """Its result."""
    return furrowmap.run(simulated.session, simulated.folder.parent / "result")
