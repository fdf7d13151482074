"""`furrowmap share`: a result for people without a GIS."""

from __future__ import annotations

from pathlib import Path

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, command, flag, output, overwrite
from furrowmap.core.runtime.errors import printable


@command(
    "Share a result as a web page, or as a project for QField.",
    "furrowmap share result",
    "furrowmap share result --qfield --lang ja -o for_the_phone",
)
@click.argument("result", metavar="RESULT", type=FILE)
@output("DIR", "Output folder [default: beside RESULT].", "Output folder")
@flag(
    "--qfield",
    "Write a QGIS project for QField instead of a web page.",
    label="A project for QField instead of a web page",
)
@overwrite("Replace an earlier page or project in DIR.")
def share(console: Console, result: Path, output: Path | None, *, qfield: bool, overwrite: bool) -> None:
    """Write the RESULT of `furrowmap run` as a folder for people without a GIS.

    The web page has the map with its layers, the figures, the point cloud in three dimensions, and measures distances
    and areas. Open index.html from disk, or put the folder on any web server; it needs no network. With --qfield, copy
    the folder to a phone and open field.qgs in QField; --lang is its language. A page has English and Japanese.
    """
    with console.work() as progress:
        done = furrowmap.share(result, output, qfield=qfield, overwrite=overwrite, progress=progress)
    console.answer(done, f"{printable(str(done.start))}  {done.size_bytes / 1e6:.1f} MB")
