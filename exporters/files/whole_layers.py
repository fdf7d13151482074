"""Whole layers into vector files, and into tables of geopandas."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from furrowmap.core.geodesy.longitudes import cut_at_antimeridian
from furrowmap.core.readers.vector_file import VectorLayer
from furrowmap.core.runtime.errors import MissingExtraError
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.exporters.files.vector_layers import UTC_OFFSET, write_arrays

if TYPE_CHECKING:
    import geopandas

_ONE_KIND_A_LAYER: Final = ("GPKG", "FlatGeobuf")
"""Drivers of formats whose layers hold either polygons or multipolygons: of both, all become multipolygons."""


def write_vector_layer(
    target: Path | io.BytesIO,
    layer: VectorLayer,
    name: str,
    driver: str,
    metadata: Mapping[str, str] | None = None,
    **options: Any,
) -> None:
    """Write a layer into a new file, or a new layer of a GeoPackage; `driver` is GDAL's name of the format.

    In a geographic CRS, geometries that cross the antimeridian are cut there.
    """
    shapes = _in_one_world(layer)
    times = [column for column, values in layer.columns.items() if values.dtype == "datetime64[ms]"]
    write_arrays(
        target,
        shapely.to_wkb(shapes),
        list(layer.columns.values()),
        list(layer.columns),
        layer=name,
        driver=driver,
        geometry_type=_geometry_type(shapes, driver),
        crs=_crs_text(layer.crs) if layer.crs is not None else None,
        gdal_tz_offsets={column: np.full(len(layer), UTC_OFFSET, np.int8) for column in times},
        dataset_metadata=metadata,
        **options,
    )


def _in_one_world(layer: VectorLayer) -> NDArray[np.object_]:
    """The geometries, cut at the antimeridian where they are in degrees."""
    in_degrees = layer.crs is not None and CRS(layer.crs).is_geographic
    return cut_at_antimeridian(layer.shapes) if in_degrees else layer.shapes


def _geometry_type(shapes: NDArray[np.object_], driver: str) -> str:
    """The type of geometry of a layer, as OGR calls it."""
    known = shapes[~(shapely.is_missing(shapes) | shapely.is_empty(shapes))]
    kinds = {shape.geom_type for shape in shapes if shape is not None}
    single = {kind.removeprefix("Multi") for kind in kinds}
    if len(single) != 1 or (len(kinds) > 1 and driver not in _ONE_KIND_A_LAYER):
        return "Unknown"
    kind = max(kinds, key=len)
    return f"{kind} Z" if shapely.has_z(known).any() else kind


def _crs_text(crs: CRS) -> str:
    """A CRS as all formats take it."""
    code = crs.to_epsg()
    return f"EPSG:{code}" if code else crs.to_wkt("WKT1_GDAL")


def geodataframe(layer: VectorLayer) -> geopandas.GeoDataFrame:
    """The layer as a table of geopandas, times in UTC."""
    try:
        import geopandas
    except ImportError:
        raise MissingExtraError(
            "geopandas", "notebooks", Text("Tables of layers and figures are made by it.")
        ) from None
    table = geopandas.GeoDataFrame(layer.columns, geometry=_in_one_world(layer), crs=layer.crs)
    times: dict[str, Any] = {
        name: table[name].dt.tz_localize("UTC") for name, v in layer.columns.items() if v.dtype == "datetime64[ms]"
    }
    return table.assign(**times)
