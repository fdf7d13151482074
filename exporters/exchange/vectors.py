"""The layers of `field.gpkg` in the formats that other programs take."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from furrowmap.core.geodesy.crs_change import crs_change
from furrowmap.core.values.errors import FurrowmapError, Notice
from furrowmap.exporters.exchange.kml import write_kml
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.vectors.geopackage import write_styles

if TYPE_CHECKING:
    import geopandas as gpd

WGS84: Final = CRS("EPSG:4326")
DIGITS_DEG: Final = 9
"""Decimals of degrees in texts: a tenth of a millimetre."""
_NAME_BYTES: Final = 10
"""What a Shapefile has room for in the name of a field."""

FloatArray = NDArray[np.float64]
Layers = Mapping[str, "gpd.GeoDataFrame"]
Writer = Callable[[Path, Layers, Origin], list[Notice]]


@dataclass(frozen=True)
class VectorFormat:
    """A format of vector files.

    Attributes:
        title: for its users.
        suffix: of its files.
        write: writes the layers into one file, or a file each into a folder, with where they come from, and returns
            what could not be kept.
        single: whether one file holds all layers.
        crs: the only CRS that the format has; None where it takes any.
    """

    title: str
    suffix: str
    write: Writer
    single: bool = False
    crs: CRS | None = None


def changed_crs(layers: Layers, target: CRS | None) -> tuple[dict[str, gpd.GeoDataFrame], list[Notice]]:
    """The layers in another CRS; heights and area fields stay what they are.

    Args:
        layers: all in one CRS.
        target: None to leave them as they are.

    Raises:
        RefusedError: if there is no way that PROJ can vouch for.
    """
    import shapely

    filled = [layer for layer in layers.values() if len(layer)]
    if target is None or not filled:
        return dict(layers), []
    whole = [float(v) for v in shapely.total_bounds([shapely.box(*layer.total_bounds) for layer in filled])]
    change = crs_change(filled[0].crs, target, (whole[0], whole[1], whole[2], whole[3]))

    def moved(xyz: FloatArray) -> FloatArray:
        return np.column_stack([change.points(xyz[:, :2]), xyz[:, 2:]])

    return {
        name: layer.set_geometry(
            shapely.transform(layer.geometry.array, moved, include_z=bool(layer.has_z.any())), crs=target
        )
        for name, layer in layers.items()
    }, list(change.notices)


def write_geopackage(path: Path, layers: Layers, origin: Origin) -> list[Notice]:
    """One GeoPackage with its styles."""
    for name, layer in layers.items():
        told = None if path.exists() else origin.told
        layer.to_file(path, layer=name, driver="GPKG", engine="pyogrio", dataset_metadata=told)
    write_styles(path, list(layers))
    return []


def write_flatgeobuf(folder: Path, layers: Layers, origin: Origin) -> list[Notice]:
    """A FlatGeobuf a layer, with its spatial index."""
    for name, layer in layers.items():
        layer.to_file(folder / f"{name}.fgb", driver="FlatGeobuf", engine="pyogrio")
    origin.tell_beside(folder)
    return []


def write_geoparquet(folder: Path, layers: Layers, origin: Origin) -> list[Notice]:
    """A GeoParquet file (version 1.1) a layer, compressed by zstandard, with boxes of the rows' geometries.

    Raises:
        FurrowmapError: if pyarrow is not installed.
    """
    try:
        for name, layer in layers.items():
            layer.to_parquet(
                folder / f"{name}.parquet",
                index=False,
                compression="zstd",
                schema_version="1.1.0",
                write_covering_bbox=True,
            )
    except ImportError:
        raise FurrowmapError(
            "GeoParquet is written by pyarrow, which is not installed.",
            "Nothing was written.",
            'Install it: pip install "furrowmap[parquet]".',
            code="extra-missing",
        ) from None
    origin.tell_beside(folder)
    return []


def write_geojson(folder: Path, layers: Layers, origin: Origin) -> list[Notice]:
    """A GeoJSON file (RFC 7946) a layer."""
    for name, layer in layers.items():
        layer.to_file(
            folder / f"{name}.geojson",
            driver="GeoJSON",
            engine="pyogrio",
            RFC7946="YES",
            COORDINATE_PRECISION=DIGITS_DEG,
            WRITE_NAME="YES",
        )
    origin.tell_beside(folder)
    return []


def write_shapefiles(folder: Path, layers: Layers, origin: Origin) -> list[Notice]:
    """A Shapefile a layer: names of fields cut to what fits, times as text, for the format has dates only."""
    cut: dict[str, str] = {}
    for name, layer in layers.items():
        short = _short_names([str(column) for column in layer.columns if column != layer.geometry.name])
        cut |= {long: name for long, name in short.items() if long != name}
        _with_texts(layer).rename(columns=short).to_file(
            folder / f"{name}.shp", driver="ESRI Shapefile", engine="pyogrio", ENCODING="UTF-8"
        )
    origin.tell_beside(folder)
    if not cut:
        return []
    pairs = ", ".join(f"{long} is {short}" for long, short in sorted(cut.items()))
    return [Notice("shapefile-names", f"A Shapefile's fields have names of ten letters: {pairs}.")]


def write_csv(folder: Path, layers: Layers, origin: Origin) -> list[Notice]:
    """A CSV a layer: points by their coordinates, other geometries as WKT, times as ISO 8601."""
    for name, layer in layers.items():
        geometry = layer.geometry
        table = _with_texts(layer).drop(columns=geometry.name)
        if set(geometry.geom_type.dropna()) <= {"Point"}:
            names = ("lon_deg", "lat_deg") if geometry.crs.is_geographic else ("e_m", "n_m")
            table[names[0]], table[names[1]] = geometry.x.round(DIGITS_DEG), geometry.y.round(DIGITS_DEG)
            if geometry.has_z.any():
                table["h_m"] = geometry.z.round(4)
        else:
            table["wkt"] = geometry.to_wkt(rounding_precision=DIGITS_DEG if geometry.crs.is_geographic else 4)
        table.to_csv(folder / f"{name}.csv", index=False, lineterminator="\n")
    origin.tell_beside(folder)
    return []


FORMATS: Final[Mapping[str, VectorFormat]] = {
    "gpkg": VectorFormat("GeoPackage", ".gpkg", write_geopackage, single=True),
    "geoparquet": VectorFormat("GeoParquet", ".parquet", write_geoparquet),
    "flatgeobuf": VectorFormat("FlatGeobuf", ".fgb", write_flatgeobuf),
    "geojson": VectorFormat("GeoJSON", ".geojson", write_geojson, crs=WGS84),
    "shapefile": VectorFormat("Shapefile", ".shp", write_shapefiles),
    "kml": VectorFormat("KML", ".kml", write_kml, single=True, crs=WGS84),
    "csv": VectorFormat("CSV", ".csv", write_csv),
}


def _with_texts(layer: gpd.GeoDataFrame) -> gpd.GeoDataFrame:
    """The layer with its times as ISO 8601 UTC with milliseconds."""
    times = [name for name, dtype in layer.dtypes.items() if getattr(dtype, "kind", "") == "M"]
    return layer.assign(**{str(name): _iso(layer[name]) for name in times})


def _iso(times: Any) -> Any:
    texts = times.dt.tz_convert("UTC").dt.strftime("%Y-%m-%dT%H:%M:%S.%f").str[:-3] + "Z"
    return texts.where(times.notna(), None)


def _short_names(names: Sequence[str]) -> dict[str, str]:
    """Names of at most ten letters, all different: the unit is kept and the words before it are cut alike."""
    short: dict[str, str] = {}
    for name in names:
        words = name.split("_")
        room = _NAME_BYTES
        while len(name) > _NAME_BYTES and len("_".join(word[:room] for word in words)) > _NAME_BYTES:
            room -= 1
        cut, number = "_".join(word[:room] for word in words), 1
        while cut in short.values():
            number += 1
            cut = f"{cut[: _NAME_BYTES - len(str(number))]}{number}"
        short[name] = cut
    return short
