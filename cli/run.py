"""`furrowmap run`: from a session file to point cloud, maps and report."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

import furrowmap
from furrowmap.cli.console import Console, put_error
from furrowmap.cli.options import FILE, common_options
from furrowmap.cli.tables import figures, file_size, table
from furrowmap.core.runtime.errors import RefusedError, printable


@click.command(
    short_help="Process a session: point cloud, surfaces, worked ground, report.",
    epilog="\b\nExample:\n  furrowmap run session.toml -o result",
)
@click.argument("session", type=FILE)
@click.option(
    "-o",
    "--output",
    type=FILE,
    metavar="DIR",
    help="Output folder [default: SESSION_result beside SESSION, or SESSION_preview with --preview].",
)
@click.option("--overwrite", is_flag=True, help="Replace the products of another recording in DIR.")
@click.option(
    "--resume",
    is_flag=True,
    help="Continue a run into DIR that was killed or lost power: its scan matching is used again if session and "
    "recordings are unchanged.",
)
@click.option(
    "--preview",
    is_flag=True,
    help="Quick look within seconds: the track and a coarse surface from a few scans, without scan matching or "
    "implement detection. Replaces an earlier preview, never the products of a run.",
)
@click.option(
    "--strict",
    is_flag=True,
    help="Exit status 4 if the results contradict each other; they are written all the same.",
)
@click.option(
    "--within",
    type=FILE,
    metavar="POLYGONS",
    help="Map the ground in these polygons alone: a vector file, or task data; instead of [field] within.",
)
@common_options
def run(
    console: Console,
    session: Path,
    output: Path | None,
    within: Path | None,
    *,
    overwrite: bool,
    resume: bool,
    preview: bool,
    strict: bool,
) -> None:
    """Compute the georeferenced point cloud, the surfaces and the worked ground of the recording described by SESSION.

    Writes cloud.copc.laz, field.gpkg with the trajectory and the worked ground, rasters, report.html, report.json and
    session.toml as it was interpreted.
    """
    with console.work() as progress:
        if preview:
            folder = output or session.resolve().parent / f"{session.stem}_preview"
            report = furrowmap.preview(session, folder, progress=progress)
        else:
            options = {"overwrite": overwrite, "resume": resume}
            result = furrowmap.run(session, output, **options, within=within, progress=progress)
            folder, report = result.path, result.report
    console.warn_of(report)
    console.answer({"folder": folder, **report}, _words(report, folder))
    verdict = report.get("verdict", {})
    if strict and verdict.get("text"):
        put_error(RefusedError("contradiction", folder=printable(str(folder))))
        click.get_current_context().exit(RefusedError.exit_status)


def _words(report: dict[str, Any], folder: Path) -> str:
    files = [(printable(name), file_size(folder / name)) for name in report["products"]]
    return f"{table(figures(report['figures']))}\n{printable(str(folder))}:\n{table(files)}"
