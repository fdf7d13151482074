"""`furrowmap cloud`: clean, classify, thin and merge point clouds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, common_options
from furrowmap.cli.point_options import (
    bbox_crs_option,
    bbox_option,
    box_of,
    classes_of,
    crs_option,
    dst_crs_option,
    every_option,
    within_option,
)
from furrowmap.cli.tables import figures, file_size, table
from furrowmap.core.runtime.errors import printable


@click.command(
    short_help="Clean, classify, thin and merge point clouds into one COPC.",
    epilog=(
        "\b\nExample:\n  furrowmap cloud field_a.laz field_b.laz -o field.copc.laz --outliers statistical --ground smrf"
    ),
)
@click.argument("clouds", metavar="CLOUD...", nargs=-1, required=True, type=FILE)
@click.option("-o", "--output", type=FILE, metavar="OUT.copc.laz", required=True, help="Output file.")
@click.option(
    "--outliers",
    type=click.Choice(["none", "radius", "statistical"]),
    default="none",
    show_default=True,
    help="Outlier detection method; outliers become noise (class 7).",
)
@click.option("--drop-noise", is_flag=True, help="Leave out outliers and the noise classes 7 and 18 of the input.")
@click.option(
    "--ground",
    type=click.Choice(["none", "smrf", "csf"]),
    default="none",
    show_default=True,
    help="Ground classification method: ground becomes class 2, the rest class 1, except noise and the machine in "
    "furrowmap's own clouds. none keeps the classes.",
)
@click.option(
    "--without-class", metavar="N,N", help="Leave out these classes; 64,65 are the machine in furrowmap's own clouds."
)
@every_option
@click.option(
    "--voxel",
    type=click.FloatRange(0.001, 10),
    metavar="METRES",
    help="Voxel size; keep the point nearest to the centre of each voxel.",
)
@bbox_option
@bbox_crs_option
@within_option
@crs_option
@dst_crs_option
@click.option("--overwrite", is_flag=True, help="Replace an existing output file.")
@common_options
def cloud(
    console: Console,
    clouds: tuple[Path, ...],
    output: Path,
    outliers: Any,
    ground: Any,
    without_class: str | None,
    every: int,
    voxel: float | None,
    bbox: str | None,
    bbox_crs: str | None,
    within: Path | None,
    crs: str | None,
    dst_crs: str | None,
    *,
    drop_noise: bool,
    overwrite: bool,
) -> None:
    """Merge CLOUDs (LAS, LAZ or COPC from any software) into one COPC.

    Coordinates, time, intensity, returns, class, source and colour of the points are kept. Order of the steps: box and
    classes, every N-th point, outliers, ground, voxels. False statements in a file header are reported as warnings.
    """
    box, without = box_of(bbox), classes_of(without_class, "--without-class")
    cleaning = furrowmap.Cleaning(box, without or frozenset(), every, outliers, drop_noise, ground, voxel)
    settings = furrowmap.CleanSettings(cleaning, bbox_crs, crs, dst_crs, within)
    with console.work() as progress:
        account = furrowmap.clean(clouds, output, settings, overwrite=overwrite, progress=progress)
    console.warn_of(account)
    words = table([*figures(account["figures"]), ("crs", account["crs"])])
    console.answer({"output": output, **account}, f"{words}\n{printable(str(output))}: {file_size(output)}")
