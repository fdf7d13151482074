"""`furrowmap init`: a session file proposed from recordings."""

from __future__ import annotations

from pathlib import Path

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, common_options
from furrowmap.core.runtime.errors import printable


@click.command(
    short_help="Write a session file for a recording.",
    epilog="\b\nExample:\n  furrowmap init recording.pcap.gz gnss.nmea",
)
@click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True, type=FILE)
@click.option(
    "-o",
    "--output",
    type=FILE,
    metavar="FILE",
    help="Session file to write [default: session.toml beside RECORDING].",
)
@click.option(
    "--machine",
    metavar="NAME|FILE",
    help="Machine whose sensors' places are copied: the name of a saved one, or its profile.",
)
@click.option("--overwrite", is_flag=True, help="Replace an existing session file.")
@common_options
def init(
    console: Console, recordings: tuple[Path, ...], output: Path | None, machine: str | None, *, overwrite: bool
) -> None:
    """Examine each RECORDING (LiDAR, GNSS, trajectory) and write a commented session file.

    What the recordings do not show, such as the mounting of the sensors, is listed, and left in the file as comments to
    fill in.
    """
    with console.work(passing=True) as progress:
        proposal = furrowmap.propose_session(
            recordings, output, machine=machine, overwrite=overwrite, progress=progress
        )
    words = [f"Wrote {printable(str(proposal.path))}"]
    words += [f"  {printable(notice.text)}" for notice in proposal.found]
    if proposal.missing:
        words += ["Not found in the recordings; fill in what you know:"]
        words += [f"  {printable(notice.text)}" for notice in proposal.missing]
    console.answer(
        {"session": proposal.path, "found": proposal.found, "missing": proposal.missing},
        "\n".join(words),
    )
