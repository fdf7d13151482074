"""`furrowmap notebooks`: the example notebooks that are bundled with furrowmap."""

from __future__ import annotations

from pathlib import Path

import click

from furrowmap.cli.console import Console
from furrowmap.cli.options import command
from furrowmap.core.runtime.errors import printable


@command("Write the example notebooks.", "furrowmap notebooks examples")
@click.argument("folder", metavar="DIR", type=click.Path(file_okay=False, path_type=Path))
def notebooks(console: Console, folder: Path) -> None:
    """Write the example notebooks to DIR. They run on simulated recordings and need the extra "notebooks"."""
    from furrowmap.workflows.share.notebooks import write_notebooks

    written = write_notebooks(folder)
    console.answer({"notebooks": written}, "\n".join(f"Wrote {printable(str(path))}" for path in written))
