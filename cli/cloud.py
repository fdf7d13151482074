"""`furrowmap cloud`: clean, classify, thin and merge point clouds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import Paths, command, files, output, overwrite, settings_options
from furrowmap.cli.tables import figures, file_size, table
from furrowmap.core.runtime.errors import printable
from furrowmap.settings import Cleaning, CleanSettings


@command(
    "Clean, classify, thin and merge point clouds into one COPC.",
    "furrowmap cloud field_a.laz field_b.laz -o field.copc.laz --outliers statistical --ground smrf",
)
@files("clouds", "CLOUD...")
@output("OUT.copc.laz", "Output file.", "Clean point cloud", required=True)
@settings_options(Cleaning, "cleaning")
@settings_options(CleanSettings)
@overwrite("Replace an existing output file.")
def cloud(
    console: Console, clouds: Paths, output: Path, cleaning: Cleaning, settings: CleanSettings, *, overwrite: bool
) -> None:
    """Merge CLOUDs (LAS, LAZ, COPC, PCD, PLY or E57 from any software) into one COPC.

    Coordinates, time, intensity, returns, class, source and colour of the points are kept. Order of the steps: box and
    classes, every N-th point, outliers, ground, voxels. False statements in a file header are reported as warnings.
    """
    settings = replace(settings, cleaning=cleaning)
    with console.work() as progress:
        account = furrowmap.clean(clouds, output, settings, overwrite=overwrite, progress=progress)
    console.warn_of(account)
    words = table([*figures(account["figures"]), ("crs", account["crs"])])
    console.answer({"output": output, **account}, f"{words}\n{printable(str(output))}: {file_size(output)}")
