"""`furrowmap crs`: what will happen to a session's coordinates."""

from __future__ import annotations

from pathlib import Path

import click

from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, common_options
from furrowmap.cli.words import table
from furrowmap.core.values.errors import printable


@click.command(
    short_help="Say what will happen to a session's coordinates.",
    epilog="\b\nExample:\n  furrowmap crs session.toml",
)
@click.argument("session", type=FILE)
@common_options
def crs(console: Console, session: Path) -> None:
    """Say what a run of SESSION will do to its coordinates, with figures at the site; nothing is written.

    Frame and epoch, how far and where to positions are moved, the geoid's height, easting and northing, grid
    convergence and scale, and areas in the map's plane and on the ellipsoid.
    """
    from furrowmap.core.session.site_coordinates import site_coordinates

    with console.work() as progress:
        progress("reading positions", 0.0)
        site = site_coordinates(session)
    for notice in site.brought.notices:
        console.warn(notice)
    console.answer(site.plain(), table((subject, printable(said)) for subject, said in site.sentences))
