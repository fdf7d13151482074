"""A simulated recording with its truth."""

from dataclasses import replace
from pathlib import Path

from furrowmap.core.runtime.errors import RefusedError
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.simulator import simulate as simulator
from furrowmap.core.simulator.scenario import PACKAGED, demo_scenario, load_scenario
from furrowmap.exporters.files.staging import recover, staged_folder


def simulate(
    scenario: str | Path, out: str | Path, *, overwrite: bool = False, progress: Progress = silent
) -> simulator.Simulated:
    """Write the recording of a tractor or an aircraft in a scenario, and the truth beside it.

    The files appear together when all of them are whole.

    Args:
        scenario: a TOML file, or "demo" (a tractor in a field), "road" or "flight".
        out: folder for the recording, GNSS log, IMU log, session file, boundary and truth.

    Raises:
        InputError: if the scenario cannot be read, has a value out of its range, or the folder cannot be written to.
        RefusedError: if the folder is not empty, or another process is writing to it.
        Cancelled: if `progress` asks to stop; nothing is left behind.
    """
    folder = Path(out)
    recover(folder)
    if not overwrite and folder.is_dir() and any(folder.iterdir()):
        raise RefusedError("exists.folder-not-empty", folder=folder)
    described = demo_scenario(str(scenario)) if str(scenario) in PACKAGED else load_scenario(Path(scenario))
    with staged_folder(folder) as staging:
        made = simulator.simulate(described, staging, progress)
    session = folder / made.session.name
    recording = folder / made.recording.name
    return replace(made, folder=folder, session=session, recording=recording)
