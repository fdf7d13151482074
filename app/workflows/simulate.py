"""A simulated recording with its truth."""

from __future__ import annotations

from pathlib import Path

from furrowmap.core.simulator import simulate as simulator
from furrowmap.core.simulator.scenario_file import PACKAGED, demo_scenario, load_scenario
from furrowmap.core.values.errors import RefusedError
from furrowmap.core.values.progress import Progress, silent


def simulate(
    scenario: str | Path, out: str | Path, *, overwrite: bool = False, progress: Progress = silent
) -> simulator.Simulated:
    """Write the recording of a tractor or an aircraft in a scenario, and the truth beside it.

    Args:
        scenario: a TOML file, or "demo" (a tractor) or "flight".
        out: folder for the recording, GNSS log, IMU log, session file, boundary and truth.
        overwrite: replace files in the folder.
        progress: is called with each stage.

    Raises:
        InputError: if the scenario cannot be read, or has a value out of its range.
        RefusedError: if the folder is not empty.
    """
    folder = Path(out)
    if not overwrite and folder.is_dir() and any(folder.iterdir()):
        raise RefusedError(
            f"{folder} is not empty.",
            "A simulation would replace files in it, so nothing was done.",
            "Give another folder with -o, or replace the files with --overwrite.",
            code="exists",
        )
    described = demo_scenario(str(scenario)) if str(scenario) in PACKAGED else load_scenario(Path(scenario))
    return simulator.simulate(described, folder, progress)
