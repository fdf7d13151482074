"""`furrowmap frames`: the frames of a session."""

from __future__ import annotations

from pathlib import Path

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, command, option
from furrowmap.core.runtime.errors import printable


@command("Show the frames of a session as a tree.", "furrowmap frames session.toml --svg frames.svg")
@click.argument("session", type=FILE)
@option("--svg", "FILE", "Draw the frames from the side and from above.", label="Drawing")
def frames(console: Console, session: Path, svg: Path | None) -> None:
    """Show the frames of SESSION as a tree: earth, map, vehicle, and each sensor with its translation and rotation.

    Names and axes are those of REP-103 and REP-105; angles are roll, pitch, yaw of the sensor's axes in the vehicle
    frame. The recordings are not read.
    """
    tree = furrowmap.frames(session, svg)
    words = "\n".join(map(printable_line, tree.text.splitlines()))
    console.answer({**tree.plain(), "svg": svg}, words)


def printable_line(line: str) -> str:
    """A line of the tree; its indentation is kept."""
    content = line.lstrip(" │├└─")
    return line[: len(line) - len(content)] + printable(content)
