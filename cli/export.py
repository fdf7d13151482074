"""`furrowmap export`: the results of a run in other formats."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import command, files, option, output, overwrite
from furrowmap.core.runtime.errors import printable

FORMAT_CHOICES = (
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
@option("--layer", "NAME", "Only this layer of field.gpkg. Repeatable.", "layers", multiple=True, label="Layers")
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
    them. GeoJSON and KML are always in WGS 84. sbet, tum and poses (CSV) are the trajectory alone, for other software.
    glb is the surface with its orthophoto as a textured mesh, for 3D viewers.
    """
    with console.work() as progress:
        done = furrowmap.export(results, to, output, **options, progress=progress)
    console.warn_all(done.notices)
    console.answer(
        {"target": done.target, "files": done.files, "warnings": done.notices},
        "\n".join(printable(str(path)) for path in done.files),
    )
