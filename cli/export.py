"""`furrowmap export`: the results of a run in other formats."""

from __future__ import annotations

from pathlib import Path

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, common_options
from furrowmap.core.runtime.errors import printable

FORMATS = (
    "gpkg",
    "geoparquet",
    "flatgeobuf",
    "geojson",
    "shapefile",
    "kml",
    "csv",
    "sbet",
    "tum",
    "poses",
    "glb",
    "isoxml",
    "stac",
)
"""As in `furrowmap.workflows.share.export`, which `--help` must not wait for."""


@click.command(
    short_help="Export results: GeoParquet, GeoJSON, KML, ISO 11783, STAC…",
    epilog="\b\nExample:\n  furrowmap export result --to geoparquet\n"
    "  furrowmap export result --to geojson --layer passes --layer misses -o for_the_web",
)
@click.argument("results", metavar="DIR...", nargs=-1, required=True, type=FILE)
@click.option("--to", "to", type=click.Choice(FORMATS), default="gpkg", show_default=True, help="Output format.")
@click.option(
    "-o", "--output", type=FILE, metavar="TARGET", help="Output file or folder [default: DIR_FORMAT beside DIR]."
)
@click.option("--layer", "layers", multiple=True, metavar="NAME", help="Only this layer of field.gpkg. Repeatable.")
@click.option("--dst-crs", metavar="CRS", help="CRS of the vector layers, such as EPSG:4326 [default: the session's].")
@click.option("--overwrite", is_flag=True, help="Replace an existing TARGET.")
@common_options
def export(
    console: Console,
    results: tuple[Path, ...],
    to: str,
    output: Path | None,
    layers: tuple[str, ...],
    dst_crs: str | None,
    *,
    overwrite: bool,
) -> None:
    """Convert the results of `furrowmap run` in DIR to another format.

    Formats with one layer per file write a folder. isoxml writes ISO 11783-10 task data for farm software and
    terminals, as a folder or, if TARGET ends in .zip, a ZIP archive. stac takes several DIRs and writes a catalogue of
    them. GeoJSON and KML are always in WGS 84. sbet, tum and poses (CSV) are the trajectory alone, for other software.
    glb is the surface with its orthophoto as a textured mesh, for 3D viewers.
    """
    with console.work() as progress:
        done = furrowmap.export(results, to, output, layers=layers, crs=dst_crs, overwrite=overwrite, progress=progress)
    for notice in done.notices:
        console.warn(notice)
    console.answer(
        {"target": done.target, "files": done.files, "warnings": done.notices},
        "\n".join(printable(str(path)) for path in done.files),
    )
