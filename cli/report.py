"""`furrowmap report`: the report of a result in another language or unit, or as PDF."""

from __future__ import annotations

from pathlib import Path

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, common_options
from furrowmap.core.runtime.errors import printable


@click.command(
    short_help="Show the report of a result in another language or unit, or as PDF.",
    epilog="\b\nExample:\n  furrowmap report result --lang ja --units 10a --pdf",
)
@click.argument("result", metavar="DIR", type=FILE)
@click.option(
    "-o",
    "--output",
    type=FILE,
    metavar="FILE",
    help="Page or PDF to write [default: report.html or report.pdf in DIR].",
)
@click.option(
    "--units",
    type=click.Choice(("ha", "10a", "acre")),
    help="Unit of areas; 10a: areas in ares, work rates per 10 a [default: as the report has it].",
)
@click.option("--pdf", is_flag=True, help="Write a PDF for printing, by an installed Chromium, Chrome or Edge.")
@common_options
def report(console: Console, result: Path, output: Path | None, units: str | None, *, pdf: bool) -> None:
    """Write the report page of the result in DIR again, with --lang in another language, or print it to a PDF.

    Without -o, the page replaces report.html. No figures are computed again.
    """
    written = furrowmap.write_report_page(result, output, area_unit=units, pdf=pdf)
    console.answer({"output": written}, printable(str(written)))
