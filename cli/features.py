"""`furrowmap features`: ground, planes, lines and plants in any point cloud."""

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
    crs_option,
    dst_crs_option,
    every_option,
    within_option,
)
from furrowmap.cli.tables import figures, file_size, table
from furrowmap.core.runtime.errors import printable


@click.command(
    short_help="Find ground, walls, roofs, poles, wires and plants in point clouds.",
    epilog="\b\nExample:\n  furrowmap features yard.laz -o features",
)
@click.argument("clouds", metavar="CLOUD...", nargs=-1, required=True, type=FILE)
@click.option("-o", "--output", type=FILE, metavar="DIR", required=True, help="Output folder.")
@click.option(
    "--ground-method",
    type=click.Choice(["auto", "class", "smrf", "csf"]),
    default="auto",
    show_default=True,
    help="Ground classification method; auto uses the ground class of the input if there is one, else smrf.",
)
@click.option(
    "--voxel",
    type=click.FloatRange(0.02, 2.0),
    metavar="METRES",
    help="Voxel size, the smallest detail [default: the point spacing, 0.05 to 0.4].",
)
@every_option
@bbox_option
@bbox_crs_option
@within_option
@crs_option
@dst_crs_option
@click.option("--overwrite", is_flag=True, help="Replace existing features in DIR.")
@common_options
def features(
    console: Console,
    clouds: tuple[Path, ...],
    output: Path,
    ground_method: Any,
    voxel: float | None,
    every: int,
    bbox: str | None,
    bbox_crs: str | None,
    within: Path | None,
    crs: str | None,
    dst_crs: str | None,
    *,
    overwrite: bool,
) -> None:
    """Classify CLOUDs (LAS, LAZ or COPC from any software) by the shape and colour around each point.

    Writes cloud.copc.laz with the classes ground, horizontal plane, vertical plane, line and vegetation; features.gpkg
    with the layers planes, lines and plants; and features.json.
    """
    box = box_of(bbox)
    settings = furrowmap.FeatureSettings(ground_method, voxel, every, box, bbox_crs, crs, dst_crs, within)
    with console.work() as progress:
        account = furrowmap.features(clouds, output, settings, overwrite=overwrite, progress=progress)
    console.warn_of(account)
    console.answer({"folder": output, **account}, _words(account, output))


def _words(account: dict[str, Any], folder: Path) -> str:
    files = [(printable(name), file_size(folder / name)) for name in account["products"]]
    shown = {**account["figures"], "crs": account["crs"], "ground": account["parameters"]["ground"]}
    return f"{table(figures(shown))}\n{printable(str(folder))}:\n{table(files)}"
