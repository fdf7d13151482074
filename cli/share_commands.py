"""The commands that pass results on: `share`, `export` and `report`."""

from pathlib import Path
from typing import Any, Final

import click

import furrowmap
from furrowmap.cli.command_options import FILE, command, files, flag, option, output, overwrite, results_among
from furrowmap.cli.console import Console
from furrowmap.core.runtime.errors import printable


@command(
    "Share a result as a web page, or as a project for QField.",
    "furrowmap share result",
    "furrowmap share result --qfield --lang ja -o for_the_phone",
)
@click.argument("result", metavar="RESULT", type=FILE)
@output("DIR", "Output folder [default: beside RESULT].", "Output folder")
@flag(
    "--qfield",
    "Write a QGIS project for QField instead of a web page.",
    label="A project for QField instead of a web page",
)
@overwrite("Replace an earlier page or project in DIR.")
def share(console: Console, result: Path, output: Path | None, *, qfield: bool, overwrite: bool) -> None:
    """Write the RESULT of `furrowmap run` as a folder for people without a GIS.

    The web page has the map with its layers, the figures, the point cloud in three dimensions, and measures distances
    and areas. Open index.html from disk, or put the folder on any web server; it needs no network. With --qfield, copy
    the folder to a phone and open field.qgs in QField; --lang is its language. The web page has all languages.
    """
    with console.work() as progress:
        done = furrowmap.share(result, output, qfield=qfield, overwrite=overwrite, progress=progress)
    console.answer(done, f"{printable(str(done.start))}  {done.size_bytes / 1e6:.1f} MB")


FORMAT_CHOICES: Final = (
    "gpkg", "geoparquet", "flatgeobuf", "geojson", "shapefile", "kml", "csv", "sbet", "tum", "poses", "glb", "isoxml",
    "stac",
)  # fmt: skip
"""As in `furrowmap.workflows.share.export`, which `--help` must not wait for."""


@command(
    "Export results: GeoParquet, GeoJSON, KML, ISO 11783, STAC…",
    "furrowmap export result --to geoparquet",
    "furrowmap export result --to geojson --layer passes --layer misses -o for_the_web",
)
@files("results", "DIR...")
@option("--to", "", "Output format.", default="gpkg", choices=FORMAT_CHOICES, label="Format")
@output("TARGET", "Output file or folder [default: DIR_FORMAT beside DIR].", "Output file or folder")
@option(
    "--layer", "NAME", "Export only this layer of field.gpkg. May be repeated.", "layers", multiple=True, label="Layers"
)
@option(
    "--dst-crs",
    "CRS",
    "CRS of the vector layers, such as EPSG:4326 [default: the session's].",
    "crs",
    label="CRS of the vectors",
)
@overwrite("Replace an existing TARGET.")
def export(console: Console, results: tuple[Path, ...], to: str, output: Path | None, **options: Any) -> None:
    """Convert the results of `furrowmap run` in DIR to another format.

    Formats with one layer per file write a folder. isoxml writes ISO 11783-10 task data for farm software and
    terminals, as a folder or, if TARGET ends in .zip, a ZIP archive. stac takes several DIRs and writes a catalogue of
    them. GeoJSON and KML are always in WGS 84. sbet, tum and poses (CSV) contain only the trajectory, for other
    software. glb is the surface with its orthophoto as a textured mesh, for 3D viewers.
    """
    with console.work() as progress:
        done = furrowmap.export(results_among(console, results), to, output, **options, progress=progress)
    console.warn_all(done.notices)
    console.answer(
        {"target": done.target, "files": done.files, "warnings": done.notices},
        "\n".join(printable(str(path)) for path in done.files),
    )


@command(
    "Show the report of a result in another language or unit, or as PDF.",
    "furrowmap report result --lang ja --units 10a --pdf",
)
@click.argument("result", metavar="DIR", type=FILE)
@output("FILE", "Page or PDF to write [default: report.html or report.pdf in DIR].")
@option(
    "--units",
    "",
    "Unit of areas; 10a: areas in ares, work rates per 10 a [default: that of the report].",
    choices=("ha", "10a", "acre"),
)
@flag("--pdf", "Write a PDF with an installed Chromium, Chrome or Edge.")
def report(console: Console, result: Path, output: Path | None, units: str | None, *, pdf: bool) -> None:
    """Write the report page of the result in DIR again, with --lang in another language, or print it to a PDF.

    Without -o, the page replaces report.html. The figures do not change.
    """
    written = furrowmap.write_report_page(result, output, area_unit=units, pdf=pdf)
    console.answer({"output": written}, printable(str(written)))
