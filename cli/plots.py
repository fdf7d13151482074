"""`furrowmap plots`: the plots of a trial as a grid."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import command, numbers, option, output, overwrite, settings_options
from furrowmap.core.runtime.errors import UsageError, printable
from furrowmap.core.values.plot_grid import PlotGrid


@command(
    "Lay out the plots of a trial as a grid.",
    "furrowmap plots -o plots.gpkg --crs EPSG:25832 --corner 651010.2,6132601.5 \\\n"
    "  --azimuth 86 --rows 5 --columns 4 --length 10 --width 2.5 --alley 1 --path 0.5 --blocks columns",
)
@output("FILE", "Plots, as .gpkg or .geojson.", "Plots", required=True)
@option("--crs", "CRS", "Projected CRS of the plots, such as EPSG:25832.", required=True, label="CRS of the output")
@option(
    "--corner",
    "X,Y",
    "Outer corner of the first plot, where the base line begins.",
    required=True,
    label="First corner",
)
@option("--corner-crs", "CRS", "CRS of --corner, if it differs.")
@option(
    "--end",
    "X,Y",
    "Other end of the base line: the outer corner of the first row's last plot.",
    label="End of the first row",
)
@option("--end-crs", "CRS", "CRS of --end, if it differs.")
@option("--azimuth", "DEGREES", "Instead of --end: direction of the base line from north.")
@settings_options(PlotGrid, "grid")
@overwrite("Replace an existing FILE.")
def plots(
    console: Console,
    output: Path,
    crs: str,
    corner: str,
    corner_crs: str | None,
    end: str | None,
    end_crs: str | None,
    azimuth: float | None,
    grid: PlotGrid,
    *,
    overwrite: bool,
) -> None:
    """Lay out the plots of a trial as a grid of rectangles with identifiers and blocks.

    The base line begins at --corner and runs along the first row of plots. Plots follow each other along it in columns,
    and beside each other in rows.
    """
    found = furrowmap.plots(
        grid,
        output,
        crs,
        _place("--corner", corner, corner_crs),
        end=_place("--end", end, end_crs) if end is not None else None,
        azimuth_deg=azimuth,
        overwrite=overwrite,
    )
    console.warn_all(found.warnings)
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
    place = numbers(text)
    if len(place) != 2:
        raise UsageError("usage.place", option=option, text=text)
    return furrowmap.Place(place[0], place[1], crs)
