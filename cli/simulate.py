"""`furrowmap simulate`: a simulated recording with its ground truth."""

from __future__ import annotations

from pathlib import Path

import click

from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, common_options
from furrowmap.cli.words import figures, table
from furrowmap.core.values.errors import RefusedError, printable


@click.command(
    short_help="Simulate a recording with its ground truth.",
    epilog="\b\nExample:\n  furrowmap simulate demo -o demo\n  furrowmap simulate my_mount.toml -o my_mount",
)
@click.argument("scenario", type=FILE)
@click.option("-o", "--output", type=FILE, metavar="DIR", required=True, help="Output folder.")
@click.option("--overwrite", is_flag=True, help="Replace files in DIR.")
@common_options
def simulate(console: Console, scenario: Path, output: Path, *, overwrite: bool) -> None:
    """Simulate the recording of a tractor in SCENARIO, a TOML file or "demo".

    Writes the LiDAR recording, the GNSS log, a session file, the field boundary, and the ground truth in truth/.
    """
    from furrowmap.core.simulator.scenario_file import demo_scenario, load_scenario
    from furrowmap.core.simulator.simulate import simulate as write_recording

    if not overwrite and output.is_dir() and any(output.iterdir()):
        raise RefusedError(
            f"{output} is not empty.",
            "A simulation would replace files in it.",
            "Give another folder with -o, or replace them with --overwrite.",
            code="exists",
        )
    described = demo_scenario() if str(scenario) == "demo" else load_scenario(scenario)
    with console.work() as progress:
        simulated = write_recording(described, output, progress)
    session = printable(str(simulated.session))
    shown = {name: value for name, value in simulated.figures.items() if not isinstance(value, dict)}
    words = f"{table(figures(shown))}\nWrote {session} and its files. Next: furrowmap run {session}"
    console.answer({"folder": simulated.folder, "session": simulated.session, "figures": simulated.figures}, words)
