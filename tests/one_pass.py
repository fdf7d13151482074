"""A simulated pass of five seconds and its result, which one process makes for all."""

from __future__ import annotations

import pickle
from pathlib import Path

import furrowmap
from tests.app.told_progress import Told

SCENARIO = (Path(__file__).parent / "app" / "one_pass.toml").read_text(encoding="utf-8")


def make_one_pass(folder: Path) -> None:
    """Write the scenario, its drive, and the result of a run into a folder."""
    (folder / "scenario.toml").write_text(SCENARIO)
    simulated = furrowmap.simulate(folder / "scenario.toml", folder / "drive", progress=Told())
    furrowmap.run(simulated.session, folder / "result", progress=Told())
    (folder / "simulated.pickle").write_bytes(pickle.dumps(simulated))
