"""`furrowmap canopy`: stands that are no plots."""

from __future__ import annotations

from pathlib import Path

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import Paths, command, files, output, overwrite, settings_options
from furrowmap.cli.tables import surveyed
from furrowmap.settings import CanopySettings


@command(
    "Describe stands by cell or polygon: heights, gaps, profile.", "furrowmap canopy orchard.laz -o canopy --cell 5"
)
@files("clouds", "CLOUD...")
@output("DIR", "Output folder.", "Output folder", required=True)
@settings_options(CanopySettings)
@overwrite("Replace existing products in DIR.")
def canopy(console: Console, clouds: Paths, output: Path, settings: CanopySettings, *, overwrite: bool) -> None:
    """Describe trees, orchards and other stands in CLOUDs (LAS, LAZ or COPC) by cell or polygon.

    Writes canopy_height.tif (the highest return of each pixel above the ground), canopy.gpkg and canopy.csv (height
    percentiles, gap fraction and more of each area), canopy_profile.csv (share of returns by height) and canopy.json.
    """
    with console.work() as progress:
        account = furrowmap.canopy(clouds, output, settings, overwrite=overwrite, progress=progress, warn=console.warn)
    console.answer({"folder": output, **account}, surveyed(account, output))
