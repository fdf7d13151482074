"""`furrowmap features`: ground, planes, lines and plants in any point cloud."""

from __future__ import annotations

from pathlib import Path

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import Paths, command, files, output, overwrite, settings_options
from furrowmap.cli.tables import surveyed
from furrowmap.settings import FeatureSettings


@command(
    "Find ground, walls, roofs, poles, wires and plants in point clouds.", "furrowmap features yard.laz -o features"
)
@files("clouds", "CLOUD...")
@output("DIR", "Output folder.", "Output folder", required=True)
@settings_options(FeatureSettings)
@overwrite("Replace existing features in DIR.")
def features(console: Console, clouds: Paths, output: Path, settings: FeatureSettings, *, overwrite: bool) -> None:
    """Classify CLOUDs (LAS, LAZ, COPC, PCD, PLY or E57 from any software) by the shape and colour around each point.

    Writes cloud.copc.laz with the classes ground, horizontal plane, vertical plane, line and vegetation; features.gpkg
    with the layers planes, lines and plants; and features.json.
    """
    with console.work() as progress:
        account = furrowmap.features(clouds, output, settings, overwrite=overwrite, progress=progress)
    console.warn_of(account)
    console.answer({"folder": output, **account}, surveyed(account, output))
