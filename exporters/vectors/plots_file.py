"""The gross parcels of a trial as a vector file: GeoPackage or GeoJSON."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from pyproj import CRS

from furrowmap.core.runtime.errors import UsageError
from furrowmap.core.values.parcel import Parcel
from furrowmap.exporters.files.atomic import atomic_output

_PLOT_SUFFIXES: Final = (".gpkg", ".geojson")
_LAYER: Final = "plots"
_CORNER_DIGITS: Final = 10
"""A hundredth of a millimetre: net parcels are computed from these corners."""


def expect_suffix(path: Path) -> None:
    """Raises UsageError if a file's name states neither GeoPackage nor GeoJSON."""
    if path.suffix.lower() not in _PLOT_SUFFIXES:
        raise UsageError("plots-format", path=path, suffixes=" or ".join(_PLOT_SUFFIXES))


def write_parcels(path: Path, parcels: Sequence[Parcel], crs: CRS) -> None:
    """Write the gross parcels with id, block and attributes; GeoJSON in longitude and latitude of the CRS's own datum.

    Raises:
        UsageError: if the file's name states another format.
    """
    import geopandas as gpd

    expect_suffix(path)
    rows = [{"id": each.id, "block": each.block, **each.attributes} for each in parcels]
    table = gpd.GeoDataFrame(rows, geometry=[each.gross for each in parcels], crs=crs)
    for name in ("row", "column"):
        if name in table:
            table[name] = table[name].astype(int)
    with atomic_output(path) as unfinished:
        if path.suffix.lower() == ".gpkg":
            table.to_file(unfinished, layer=_LAYER, driver="GPKG", engine="pyogrio")
            return
        base = crs.geodetic_crs or crs
        degrees = table.to_crs(base.to_2d()).set_crs("EPSG:4326", allow_override=True)
        content = io.BytesIO()
        degrees.to_file(content, driver="GeoJSON", layer=_LAYER, engine="pyogrio", COORDINATE_PRECISION=_CORNER_DIGITS)
        unfinished.write_bytes(content.getbuffer())
