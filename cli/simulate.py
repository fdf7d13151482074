"""`furrowmap simulate`: a recording with its truth, from a scenario."""

from __future__ import annotations

from pathlib import Path

import click

from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, common_options
from furrowmap.cli.words import figures, table
from furrowmap.core.values.errors import RefusedError, printable


@click.command(
    short_help="Write a recording with its truth.",
    epilog="\b\nExample:\n  furrowmap simulate demo -o demo\n  furrowmap simulate my_mount.toml -o my_mount",
)
@click.argument("scenario", type=FILE)
@click.option("-o", "--output", type=FILE, metavar="DIR", required=True, help="Folder for the recording.")
@click.option("--overwrite", is_flag=True, help="Replace what is in that folder.")
@common_options
def simulate(console: Console, scenario: Path, output: Path, *, overwrite: bool) -> None:
    """Write what a tractor's recorder would have written in SCENARIO, a TOML file or "demo", and the truth beside it.

    The folder then holds the recording, the GNSS log, a session file, the field's boundary, and truth/.
    """
    from furrowmap.core.simulator.scenario_file import demo_scenario, load_scenario
    from furrowmap.core.simulator.simulate import simulate as write_recording

    if not overwrite and output.is_dir() and any(output.iterdir()):
        raise RefusedError(
            f"{output} is not empty.",
            "A simulation would replace files in it, so nothing was done.",
            "Give another folder with -o, or --overwrite if they may be replaced.",
            code="exists",
        )
    described = demo_scenario() if str(scenario) == "demo" else load_scenario(scenario)
    with console.work() as progress:
        simulated = write_recording(described, output, progress)
    session = printable(str(simulated.session))
    told = {name: value for name, value in simulated.figures.items() if not isinstance(value, dict)}
    words = f"{table(figures(told))}\nWrote {session} and what it names; next: furrowmap run {session}"
    console.answer({"folder": simulated.folder, "session": simulated.session, "figures": simulated.figures}, words)
