"""`furrowmap crs`: the coordinate transformations of a session."""

from __future__ import annotations

from pathlib import Path

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, command
from furrowmap.cli.tables import table
from furrowmap.core.runtime.errors import printable


@command("Show the coordinate transformations of a session.", "furrowmap crs session.toml")
@click.argument("session", type=FILE)
def crs(console: Console, session: Path) -> None:
    """Show how `furrowmap run` will transform the coordinates of SESSION, with values at the site. Writes no files.

    Frame and epoch, displacement of the positions, geoid height, easting and northing, grid convergence and scale, and
    areas on the map and on the ellipsoid.
    """
    with console.work() as progress:
        progress("reading positions", 0.0)
        site = furrowmap.site_coordinates(session)
    console.warn_all(site.transform.notices)
    console.answer(site.plain(), table((subject, printable(sentence)) for subject, sentence in site.sentences))
