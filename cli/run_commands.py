"""`furrowmap run`: from a session file to point cloud, maps and report."""

from pathlib import Path

import click

import furrowmap
from furrowmap.cli.command_options import FILE, command, flag, option, output
from furrowmap.cli.console import Console, put_error
from furrowmap.cli.result_tables import figures, table, written
from furrowmap.core.runtime.errors import RefusedError, printable
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.settings import language_of_user


@command("Process a session: point cloud, surfaces, worked ground, report.", "furrowmap run session.toml -o result")
@click.argument("session", type=FILE)
@output(
    "DIR", "Output folder [default: SESSION_result beside SESSION, or SESSION_preview with --preview].", "Output folder"
)
@flag(
    "--overwrite",
    "Replace the products of another recording in DIR.",
    label="Replace the products of another recording",
)
@flag(
    "--resume",
    "Continue an interrupted run into DIR. Its scan matching is reused if session and recordings have not changed.",
)
@flag(
    "--preview",
    "Quick look within seconds: the track and a coarse surface from a few scans, without scan matching or "
    "implement detection. Replaces an earlier preview, never the products of a run.",
    label="Preview only",
)
@flag("--strict", "Exit with status 4 if the results contradict each other. They are written nevertheless.")
@option(
    "--within",
    "POLYGONS",
    "Map only the ground in these polygons: a vector file or task data. Overrides [field] within.",
    label="Within polygons",
)
def run(
    console: Console,
    session: Path,
    output: Path | None,
    within: Path | None,
    *,
    preview: bool,
    strict: bool,
    **options: bool,
) -> None:
    """Compute the georeferenced point cloud, the surfaces and the worked ground of the recording described by SESSION.

    SESSION may be the folder of a session.toml. Writes cloud.copc.laz, field.gpkg with the trajectory and the worked
    ground, rasters, report.html, report.json and session.toml as it was interpreted.
    """
    if (session / "session.toml").is_file():
        session /= "session.toml"
    # They import numpy, which --help must not wait for.
    from furrowmap.workflows.run.steps import planned_steps
    from furrowmap.workflows.run.words import run_words

    with console.work(steps=() if preview else planned_steps(session)) as progress:
        if preview:
            folder = output or resolved(session).parent / f"{session.stem}_preview"
            report = furrowmap.preview(session, folder, within=within, progress=progress)
        else:
            result = furrowmap.run(session, output, within=within, **options, progress=progress)
            folder = result.path
            report = result.report
    console.warn_of(report)
    if preview:
        words = f"{table(figures(report['figures']))}\n{written(report, folder)}"
    else:
        words = run_words(report, folder, language_of_user())
    console.answer({"folder": folder, **report}, words)
    if strict and report.get("verdict", {}).get("text"):
        put_error(RefusedError("contradiction", folder=printable(str(folder))))
        click.get_current_context().exit(RefusedError.exit_status)
