"""`furrowmap crs`: the coordinate transformations of a session."""

from __future__ import annotations

from pathlib import Path

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, common_options
from furrowmap.cli.tables import table
from furrowmap.core.runtime.errors import printable


@click.command(
    short_help="Show the coordinate transformations of a session.",
    epilog="\b\nExample:\n  furrowmap crs session.toml",
)
@click.argument("session", type=FILE)
@common_options
def crs(console: Console, session: Path) -> None:
    """Show how `furrowmap run` will transform the coordinates of SESSION, with values at the site. Writes no files.

    Frame and epoch, displacement of the positions, geoid height, easting and northing, grid convergence and scale, and
    areas on the map and on the ellipsoid.
    """
    with console.work() as progress:
        progress("reading positions", 0.0)
        site = furrowmap.site_coordinates(session)
    for notice in site.transform.notices:
        console.warn(notice)
    console.answer(site.plain(), table((subject, printable(sentence)) for subject, sentence in site.sentences))
