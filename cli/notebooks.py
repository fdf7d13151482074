"""`furrowmap notebooks`: the example notebooks that are bundled with furrowmap."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import click

from furrowmap.cli.console import Console
from furrowmap.cli.options import command
from furrowmap.core.runtime.errors import printable
from furrowmap.exporters.files.atomic import refuse_existing


@command("Write the example notebooks.", "furrowmap notebooks examples")
@click.argument("folder", metavar="DIR", type=click.Path(file_okay=False, path_type=Path))
def notebooks(console: Console, folder: Path) -> None:
    """Write the example notebooks to DIR. They run on simulated recordings and need the extra "notebooks"."""
    bundled = files("furrowmap").joinpath("notebooks")
    sources = [source for source in bundled.iterdir() if source.name.endswith(".ipynb")]
    written = sorted(folder / source.name for source in sources)
    for path in written:
        refuse_existing(path, overwrite=False)
    folder.mkdir(parents=True, exist_ok=True)
    for source in sources:
        (folder / source.name).write_bytes(source.read_bytes())
    console.answer({"notebooks": written}, "\n".join(f"Wrote {printable(str(path))}" for path in written))
