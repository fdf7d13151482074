"""`furrowmap init`: a first session file from recordings."""

from __future__ import annotations

from pathlib import Path

import click

from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, common_options
from furrowmap.core.values.errors import RefusedError, printable


@click.command(
    short_help="Write a session file from recordings.",
    epilog="\b\nExample:\n  furrowmap init recording.pcap.gz gnss.nmea",
)
@click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True, type=FILE)
@click.option(
    "-o", "--output", type=FILE, metavar="FILE", help="Session file to write [default: session.toml beside them]."
)
@click.option("--overwrite", is_flag=True, help="Replace the session file if it is there.")
@common_options
def init(console: Console, recordings: tuple[Path, ...], output: Path | None, *, overwrite: bool) -> None:
    """Look at each RECORDING (LiDAR, GNSS, trajectory) and write a commented session file with what it could find out.

    What it could not find out, such as how the sensor is mounted, stands in the file as a comment, and is told.
    """
    from furrowmap.core.session.examination import Examined
    from furrowmap.core.session.proposal import common_folder, propose_session
    from furrowmap.exporters.files.atomic import atomic_output

    session_file = output or common_folder(recordings) / "session.toml"
    if session_file.exists() and not overwrite:
        raise RefusedError(
            f"{session_file} is there already.",
            "It may hold what somebody has measured, so it is left as it is.",
            "Give another name with -o, or --overwrite if it may be replaced.",
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
    words += ["Not known from the recordings; fill in what you can:"]
    words += [f"  {printable(notice.text)}" for notice in proposal.missing]
    console.answer(
        {"session": session_file, "found": proposal.found, "missing": proposal.missing},
        "\n".join(words),
    )
