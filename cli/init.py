"""`furrowmap init`: a session file proposed from recordings."""

from __future__ import annotations

from pathlib import Path

import click

from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, common_options
from furrowmap.core.values.errors import RefusedError, printable


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
@click.option("--overwrite", is_flag=True, help="Replace an existing session file.")
@common_options
def init(console: Console, recordings: tuple[Path, ...], output: Path | None, *, overwrite: bool) -> None:
    """Examine each RECORDING (LiDAR, GNSS, trajectory) and write a commented session file.

    What the recordings do not show, such as the mounting of the sensors, is listed, and left in the file as comments to
    fill in.
    """
    from furrowmap.core.session.examination import Examined
    from furrowmap.core.session.proposal import common_folder, propose_session
    from furrowmap.exporters.files.atomic import atomic_output

    session_file = output or common_folder(recordings) / "session.toml"
    if session_file.exists() and not overwrite:
        raise RefusedError(
            f"{session_file} already exists.",
            "It may hold measured values, so it was not replaced.",
            "Give another file with -o, or replace it with --overwrite.",
            code="exists",
        )
    examined = []
    with console.work(passing=True) as progress:
        for path in recordings:
            progress(f"Reading {printable(path.name)}", 0.0)
            examined.append(Examined.of(path))
        proposal = propose_session(examined, session_file.parent)
    with atomic_output(session_file) as unfinished:
        unfinished.write_text(proposal.text, encoding="utf-8")
    words = [f"Wrote {printable(str(session_file))}"]
    words += [f"  {printable(notice.text)}" for notice in proposal.found]
    words += ["Not found in the recordings; fill in what you know:"]
    words += [f"  {printable(notice.text)}" for notice in proposal.missing]
    console.answer(
        {"session": session_file, "found": proposal.found, "missing": proposal.missing},
        "\n".join(words),
    )
