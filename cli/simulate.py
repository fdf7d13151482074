"""`furrowmap simulate`: a simulated recording with its ground truth."""

from __future__ import annotations

from pathlib import Path

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, command, output, overwrite
from furrowmap.cli.tables import figures, table
from furrowmap.core.runtime.errors import printable


@command(
    "Simulate a recording with its ground truth.",
    "furrowmap simulate demo -o demo",
    "furrowmap simulate my_mount.toml -o my_mount",
)
@click.argument("scenario", type=FILE)
@output("DIR", "Output folder.", "Output folder", required=True)
@overwrite("Replace files in DIR.")
def simulate(console: Console, scenario: Path, output: Path, *, overwrite: bool) -> None:
    """Simulate the recording of a tractor or an aircraft in SCENARIO: a TOML file, "demo", "road" or "flight".

    Writes the recordings of LiDAR, GNSS and IMU, a session file, the field boundary, and the ground truth in truth/.
    """
    with console.work() as progress:
        simulated = furrowmap.simulate(scenario, output, overwrite=overwrite, progress=progress)
    session = printable(str(simulated.session))
    shown = {name: value for name, value in simulated.figures.items() if not isinstance(value, dict)}
    words = f"{table(figures(shown))}\nWrote {session} and its files. Next: furrowmap run {session}"
    console.answer({"folder": simulated.folder, "session": simulated.session, "figures": simulated.figures}, words)
