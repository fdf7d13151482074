"""A small simulated recording and its result, made once for the tests of the Python API."""

from __future__ import annotations

from pathlib import Path

import pytest

import furrowmap
from tests.app.told_progress import Told

SCENARIO = (Path(__file__).parent / "one_pass.toml").read_text(encoding="utf-8")


@pytest.fixture(scope="session")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> furrowmap.Simulated:
    """One pass of five seconds."""
    folder: Path = tmp_path_factory.mktemp("simulated")
    (folder / "scenario.toml").write_text(SCENARIO)
    return furrowmap.simulate(folder / "scenario.toml", folder / "drive", progress=Told())


@pytest.fixture(scope="session")
def result(simulated: furrowmap.Simulated) -> furrowmap.Result:
    """Its result."""
    return furrowmap.run(simulated.session, simulated.folder.parent / "result", progress=Told())
