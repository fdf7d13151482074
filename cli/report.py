"""`furrowmap report`: the report of a result in another language or unit, or as PDF."""

from __future__ import annotations

from pathlib import Path

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, command, flag, option, output
from furrowmap.core.runtime.errors import printable


@command(
    "Show the report of a result in another language or unit, or as PDF.",
    "furrowmap report result --lang ja --units 10a --pdf",
)
@click.argument("result", metavar="DIR", type=FILE)
@output("FILE", "Page or PDF to write [default: report.html or report.pdf in DIR].")
@option(
    "--units",
    "",
    "Unit of areas; 10a: areas in ares, work rates per 10 a [default: as the report has it].",
    choices=("ha", "10a", "acre"),
)
@flag("--pdf", "Write a PDF for printing, by an installed Chromium, Chrome or Edge.")
def report(console: Console, result: Path, output: Path | None, units: str | None, *, pdf: bool) -> None:
    """Write the report page of the result in DIR again, with --lang in another language, or print it to a PDF.

    Without -o, the page replaces report.html. No figures are computed again.
    """
    written = furrowmap.write_report_page(result, output, area_unit=units, pdf=pdf)
    console.answer({"output": written}, printable(str(written)))
