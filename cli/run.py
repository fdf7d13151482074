"""`furrowmap run`: from a session to its products."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, common_options
from furrowmap.cli.words import figures, file_size, table
from furrowmap.core.values.errors import printable


@click.command(
    short_help="Make the cloud, the ground worked and the report of a session.",
    epilog="\b\nExample:\n  furrowmap run session.toml -o result",
)
@click.argument("session", type=FILE)
@click.option(
    "-o",
    "--output",
    type=FILE,
    metavar="DIR",
    help="Folder for the products [default: SESSION_result beside SESSION; SESSION_preview with --preview].",
)
@click.option("--overwrite", is_flag=True, help="Replace the products of another session in that folder.")
@click.option(
    "--preview",
    is_flag=True,
    help="Only a look, in seconds: the track and a coarse surface of few scans, neither matched nor searched for the "
    "implement. Replaces an earlier preview, never a run's products.",
)
@common_options
def run(console: Console, session: Path, output: Path | None, *, overwrite: bool, preview: bool) -> None:
    """Compute the georeferenced cloud of the recording that SESSION describes, and the ground its implement worked.

    The folder then holds cloud.copc.laz, field.gpkg with trajectory and ground worked, report.html to read, report.json
    and session.toml as it was understood.
    """
    if preview:
        _preview(console, session, output or session.resolve().parent / f"{session.stem}_preview")
        return
    from furrowmap.workflows.run import write_products

    folder = output or session.resolve().parent / f"{session.stem}_result"
    with console.work() as progress:
        report = write_products(session, folder, overwrite=overwrite, progress=progress)
    console.warn_of(report)
    console.answer({"folder": folder, **report}, _words(report, folder))


def _preview(console: Console, session: Path, folder: Path) -> None:
    from furrowmap.workflows.preview import write_preview

    with console.work() as progress:
        account = write_preview(session, folder, progress)
    console.warn_of(account)
    console.answer({"folder": folder, **account}, _words(account, folder))


def _words(report: dict[str, Any], folder: Path) -> str:
    files = [(printable(name), file_size(folder / name)) for name in report["products"]]
    return f"{table(figures(report['figures']))}\n{printable(str(folder))}:\n{table(files)}"
