"""`furrowmap surface`: surfaces of any point cloud."""

from __future__ import annotations

from pathlib import Path

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import Paths, command, files, output, overwrite, settings_options
from furrowmap.cli.tables import surveyed
from furrowmap.settings import SurfaceSettings


@command(
    "Compute DSM, DTM and derived surfaces of point clouds.",
    "furrowmap surface field_a.laz field_b.laz -o surfaces --cell 0.1",
)
@files("clouds", "CLOUD...")
@output("DIR", "Output folder.", "Output folder", required=True)
@settings_options(SurfaceSettings)
@overwrite("Replace existing surfaces in DIR.")
def surface(console: Console, clouds: Paths, output: Path, settings: SurfaceSettings, *, overwrite: bool) -> None:
    """Compute surfaces of CLOUDs (LAS, LAZ, COPC, PCD, PLY or E57 from any software) together on one grid.

    Writes dsm.tif (all points), dtm.tif (ground), height_above_ground.tif, hillshade.tif, slope.tif, roughness.tif,
    low_spots.tif, low_spots.gpkg and surfaces.json. False statements in a file header are reported as warnings.
    """
    with console.work() as progress:
        account = furrowmap.surface(clouds, output, settings, overwrite=overwrite, progress=progress, warn=console.warn)
    console.answer({"folder": output, **account}, surveyed(account, output))
