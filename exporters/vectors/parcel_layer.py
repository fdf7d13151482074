"""Parcels as a vector layer: GeoPackage or GeoJSON."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from pyproj import CRS

from furrowmap.core.runtime.errors import UsageError
from furrowmap.core.values.parcel import Parcel
from furrowmap.exporters.files.atomic import atomic_output

if TYPE_CHECKING:
    import geopandas as gpd

SUFFIXES: Final = (".gpkg", ".geojson")
LAYER: Final = "plots"
_DIGITS_DEG: Final = 10
"""A hundredth of a millimetre: net parcels are computed from these corners."""


def expect_suffix(path: Path) -> None:
    """Raises UsageError if a file's name states neither GeoPackage nor GeoJSON."""
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError("plots-format", path=path, suffixes=" or ".join(SUFFIXES))


def parcel_layer(parcels: Sequence[Parcel], crs: CRS) -> gpd.GeoDataFrame:
    """The gross parcels with id, block and attributes."""
    import geopandas as gpd

    rows = [{"id": each.id, "block": each.block, **each.attributes} for each in parcels]
    table = gpd.GeoDataFrame(rows, geometry=[each.gross for each in parcels], crs=crs)
    for name in ("row", "column"):
        if name in table:
            table[name] = table[name].astype(int)
    return table


def write_parcels(path: Path, parcels: Sequence[Parcel], crs: CRS) -> None:
    """Write the gross parcels; GeoJSON in longitude and latitude of the CRS's own datum.

    Raises:
        UsageError: if the file's name states another format.
        OSError: if the file cannot be written.
    """
    expect_suffix(path)
    table = parcel_layer(parcels, crs)
    with atomic_output(path) as unfinished:
        if path.suffix.lower() == ".gpkg":
            table.to_file(unfinished, layer=LAYER, driver="GPKG", engine="pyogrio")
            return
        base = crs.geodetic_crs or crs
        degrees = table.to_crs(base.to_2d()).set_crs("EPSG:4326", allow_override=True)
        content = io.BytesIO()
        degrees.to_file(content, driver="GeoJSON", layer=LAYER, engine="pyogrio", COORDINATE_PRECISION=_DIGITS_DEG)
        unfinished.write_bytes(content.getbuffer())
