"""Rasters of arrays as files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pyproj import CRS

from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters.cog import Band, Bands, cog_output


def write_cog(path: Path, grid: Grid, crs: CRS, bands: Sequence[Band], arrays: Bands, origin: Origin) -> None:
    """Write a raster from arrays."""
    with cog_output(path, grid, crs, bands, origin) as write:
        write(grid, arrays)
