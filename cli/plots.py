"""`furrowmap plots`: the plots of a trial as a grid."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, common_options
from furrowmap.core.runtime.errors import UsageError, printable


@click.command(
    short_help="Lay out the plots of a trial as a grid.",
    epilog="\b\nExample:\n  furrowmap plots -o plots.gpkg --crs EPSG:25832 --corner 651010.2,6132601.5 \\\n"
    "    --azimuth 86 --rows 5 --columns 4 --length 10 --width 2.5 --alley 1 --path 0.5 --blocks columns",
)
@click.option("-o", "--output", type=FILE, metavar="FILE", required=True, help="Plots, as .gpkg or .geojson.")
@click.option("--crs", metavar="CRS", required=True, help="Projected CRS of the plots, such as EPSG:25832.")
@click.option(
    "--corner", metavar="X,Y", required=True, help="Outer corner of the first plot, where the base line begins."
)
@click.option("--corner-crs", metavar="CRS", help="CRS of --corner, if it differs.")
@click.option("--end", metavar="X,Y", help="Other end of the base line: the outer corner of the first row's last plot.")
@click.option("--end-crs", metavar="CRS", help="CRS of --end, if it differs.")
@click.option(
    "--azimuth", type=float, metavar="DEGREES", help="Instead of --end: direction of the base line from north."
)
@click.option("--columns", type=click.IntRange(1), required=True, metavar="N", help="Plots along the base line.")
@click.option("--rows", type=click.IntRange(1), required=True, metavar="N", help="Plots beside each other.")
@click.option(
    "--length",
    type=click.FloatRange(0, min_open=True),
    metavar="METRES",
    help="Length of a plot along the base line [default: what the two corners leave].",
)
@click.option(
    "--width",
    type=click.FloatRange(0, min_open=True),
    required=True,
    metavar="METRES",
    help="Width of a plot across the base line.",
)
@click.option("--alley", type=click.FloatRange(0), default=0.0, metavar="METRES", help="Between columns.")
@click.option("--path", "between", type=click.FloatRange(0), default=0.0, metavar="METRES", help="Between rows.")
@click.option(
    "--side",
    type=click.Choice(["left", "right"]),
    default="left",
    show_default=True,
    help="Side of the base line on which the rows lie, looking along it.",
)
@click.option(
    "--numbering",
    type=click.Choice(["serpentine", "straight"]),
    default="serpentine",
    show_default=True,
    help="Whether every second run of numbers goes back.",
)
@click.option(
    "--along",
    type=click.Choice(["rows", "columns"]),
    default="rows",
    show_default=True,
    help="Whether numbers run along rows (from column to column) or along columns.",
)
@click.option("--first", type=int, default=1, show_default=True, metavar="N", help="First number.")
@click.option(
    "--blocks",
    type=click.Choice(["none", "rows", "columns"]),
    default="none",
    show_default=True,
    help="Whether rows or columns are blocks (replicates).",
)
@click.option("--block-size", type=click.IntRange(1), default=1, show_default=True, metavar="N", help="Of a block.")
@click.option("--by-block", is_flag=True, help="Number the plots of each block anew: 101, 102, … 201.")
@click.option("--overwrite", is_flag=True, help="Replace an existing FILE.")
@common_options
def plots(console: Console, output: Path, crs: str, **given: Any) -> None:
    """Lay out the plots of a trial as a grid of rectangles with identifiers and blocks.

    The base line begins at --corner and runs along the first row of plots. Plots follow each other along it in columns,
    and beside each other in rows.
    """
    grid = furrowmap.PlotGrid(
        rows=given["rows"],
        columns=given["columns"],
        length_m=given["length"],
        width_m=given["width"],
        alley_m=given["alley"],
        path_m=given["between"],
        side=given["side"],
        along=given["along"],
        serpentine=given["numbering"] == "serpentine",
        first=given["first"],
        block=None if given["blocks"] == "none" else given["blocks"],
        block_size=given["block_size"],
        by_block=given["by_block"],
    )
    end = given["end"]
    found = furrowmap.plots(
        grid,
        output,
        crs,
        _place("--corner", given["corner"], given["corner_crs"]),
        end=_place("--end", end, given["end_crs"]) if end is not None else None,
        azimuth_deg=given["azimuth"],
        overwrite=given["overwrite"],
    )
    for notice in found.warnings:
        console.warn(notice)
    blocks = len({each.block for each in found.parcels} - {None})
    answer = {
        "output": output,
        "crs": found.crs,
        "plots": len(found.parcels),
        "blocks": blocks,
        "first": found.parcels[0].id,
        "last": found.parcels[-1].id,
        "warnings": found.warnings,
    }
    words = f"{len(found.parcels)} plots, {found.parcels[0].id} to {found.parcels[-1].id}"
    console.answer(answer, f"{words}{f', in {blocks} blocks' if blocks else ''}: {printable(str(output))}")


def _place(option: str, text: str, crs: str | None) -> Any:
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise UsageError("usage.place", option=option, text=text) from None
    return furrowmap.Place(x, y, crs)
