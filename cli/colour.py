"""`furrowmap colour`: any point cloud in the colours of a session's images."""

from __future__ import annotations

from pathlib import Path

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, command, output, overwrite
from furrowmap.cli.tables import figures, file_size, table
from furrowmap.core.runtime.errors import printable


@command(
    "Colour a point cloud by the images of a session.", "furrowmap colour cloud.laz session.toml -o coloured.copc.laz"
)
@click.argument("cloud", type=FILE)
@click.argument("session", type=FILE)
@output("FILE", "COPC file to write.", "Coloured point cloud", required=True)
@overwrite("Replace an existing file.")
def colour(console: Console, cloud: Path, session: Path, output: Path, *, overwrite: bool) -> None:
    """Write CLOUD (LAS, LAZ or COPC from any software) in the colours of the images that SESSION names under [camera].

    Each point takes the colour of the best image that sees it; points that no image sees are black. The poses of the
    images come from the trajectory of SESSION; its scans are not read.
    """
    with console.work() as progress:
        account = furrowmap.colour(cloud, session, output, overwrite=overwrite, progress=progress)
    console.warn_of(account)
    words = f"{table(figures(account['figures']))}\n{printable(str(output))}: {file_size(output)}"
    console.answer({"output": output, **account}, words)
