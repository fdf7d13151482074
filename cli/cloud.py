"""`furrowmap cloud`: one clean cloud of any clouds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, common_options, named_crs
from furrowmap.cli.point_options import box_of, classes_of
from furrowmap.cli.words import figures, file_size, table
from furrowmap.core.values.errors import printable


@click.command(
    short_help="Clean, classify and thin clouds into one COPC.",
    epilog=(
        "\b\nExample:\n  furrowmap cloud field_a.laz field_b.laz -o field.copc.laz --outliers statistical --ground smrf"
    ),
)
@click.argument("clouds", metavar="CLOUD...", nargs=-1, required=True, type=FILE)
@click.option("-o", "--output", type=FILE, metavar="OUT.copc.laz", required=True, help="The cloud.")
@click.option(
    "--outliers",
    type=click.Choice(["none", "radius", "statistical"]),
    default="none",
    show_default=True,
    help="How points that are alone are told; they become noise, class 7.",
)
@click.option("--drop-noise", is_flag=True, help="Leave noise out, classes 7 and 18 of the clouds as well.")
@click.option(
    "--ground",
    type=click.Choice(["none", "smrf", "csf"]),
    default="none",
    show_default=True,
    help="How ground is told, class 2; all but noise and furrowmap's machine is then class 1. none: classes stay.",
)
@click.option(
    "--without-class", metavar="N,N", help="Leave points of these classes out; 64,65 is the machine in furrowmap's own."
)
@click.option("--every", type=click.IntRange(1), default=1, metavar="N", help="Take every N-th point only.")
@click.option(
    "--voxel",
    type=click.FloatRange(0.001, 10),
    metavar="METRES",
    help="Take one point of each cube of this side, the one nearest to its middle.",
)
@click.option("--bbox", metavar="W,S,E,N", help="Only points in this box, in the CRS of the cloud.")
@click.option("--bbox-crs", metavar="CRS", help="The CRS of the box, if it is another one.")
@click.option("--crs", metavar="CRS", help="The CRS of clouds that state none.")
@click.option("--dst-crs", metavar="CRS", help="The CRS of the cloud, in metres [default: that of the clouds].")
@click.option("--overwrite", is_flag=True, help="Replace the file.")
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
    crs: str | None,
    dst_crs: str | None,
    *,
    drop_noise: bool,
    overwrite: bool,
) -> None:
    """Make one COPC of CLOUDs: LAS, LAZ or COPC, from furrowmap or from anybody else.

    Place, time, intensity, returns, class, source and colour of the points are passed on. Done in this order: box and
    classes, every N-th point, outliers, ground, cubes. What a file says that is not so is told on standard error.
    """
    box, without = box_of(bbox), classes_of(without_class, "--without-class")
    from furrowmap.core.pointclouds.cleaning import Cleaning
    from furrowmap.workflows.clean import CleanSettings, write_clean_cloud

    cleaning = Cleaning(box, without or frozenset(), every, outliers, drop_noise, ground, voxel)
    settings = CleanSettings(cleaning, named_crs(bbox_crs), named_crs(crs), named_crs(dst_crs))
    with console.work() as progress:
        account = write_clean_cloud(clouds, output, settings, overwrite=overwrite, progress=progress)
    console.warn_of(account)
    words = table([*figures(account["figures"]), ("crs", account["crs"])])
    console.answer({"output": output, **account}, f"{words}\n{printable(str(output))}: {file_size(output)}")
