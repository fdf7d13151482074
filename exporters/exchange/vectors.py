"""The layers of `field.gpkg` in vector formats of other programs."""

from __future__ import annotations

import errno
import io
import os
import struct
import unicodedata
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final
from zoneinfo import ZoneInfo

import numpy as np
from pyproj import CRS

from furrowmap.core.geodesy.crs_change import crs_change
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import FurrowmapError, InputError, Notice
from furrowmap.core.runtime.file_names import inside
from furrowmap.exporters.exchange.kml import write_kml
from furrowmap.exporters.files.atomic import atomic_output, name_failed_file
from furrowmap.exporters.files.csv_cells import cell
from furrowmap.exporters.files.ogr import pyogrio
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import FIELD
from furrowmap.exporters.files.staging import staged_folder
from furrowmap.exporters.vectors.geopackage import write_styles
from furrowmap.exporters.vectors.qgis_styles import StyleClock

if TYPE_CHECKING:
    import geopandas as gpd

UTC: Final = ZoneInfo("UTC")
WGS84_CRS: Final = CRS("EPSG:4326")
DIGITS_DEG: Final = 9
"""Decimals of degrees in texts: a tenth of a millimetre."""
_SHAPEFILE_NAME_BYTES: Final = 10
"""Maximum length of a field's name in a Shapefile."""

Layers = Mapping[str, "gpd.GeoDataFrame"]


@dataclass(frozen=True)
class VectorFormat:
    """A format of vector files.

    Attributes:
        write_all: writes all layers into one file, and returns what could not be kept; None for a file a layer.
        notices: of what a format with a file a layer cannot keep.
        crs: the only CRS of the format; None for any.
    """

    suffix: str
    write_all: Callable[[Path, Layers, Origin, ZoneInfo], list[Notice]] | None = None
    write_one: Callable[[Path, gpd.GeoDataFrame], None] | None = None
    notices: Callable[[Layers], list[Notice]] = lambda _: []
    crs: CRS | None = None


def write_vectors(
    chosen: VectorFormat, target: Path, layers: Layers, origin: Origin, zone: ZoneInfo = UTC
) -> tuple[list[Path], list[Notice]]:
    """Write layers into one file, or a folder with a file a layer and provenance; the files, and what is lost."""
    if chosen.write_all is not None:
        with atomic_output(target) as unfinished:
            return [target], chosen.write_all(unfinished, layers, origin, zone)
    assert chosen.write_one is not None
    with staged_folder(target) as staging, name_failed_file(target):
        for path, layer in zip(_layer_files(staging, list(layers), chosen.suffix), layers.values(), strict=True):
            chosen.write_one(path, layer)
        origin.write_beside(staging)
        names = sorted(path.name for path in staging.iterdir())
    return [target / name for name in names], chosen.notices(layers)


def _layer_files(folder: Path, names: Sequence[str], suffix: str) -> list[Path]:
    """A file in `folder` for each layer."""
    source = Path(FIELD)
    paths = [inside(folder, f"{name}{suffix}", source) for name in names]
    same = Counter(unicodedata.normalize("NFKC", path.name).casefold() for path in paths)
    if len(same) < len(paths):
        twins = [
            n for n, p in zip(names, paths, strict=True) if same[unicodedata.normalize("NFKC", p.name).casefold()] > 1
        ]
        raise InputError("layer-names-equal", source=source, twins=", ".join(twins))
    return paths


def changed_crs(layers: Layers, target: CRS | None) -> tuple[dict[str, gpd.GeoDataFrame], list[Notice]]:
    """The layers in another CRS (None keeps theirs); heights and area fields are unchanged."""
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


def _write_geopackage(path: Path, layers: Layers, origin: Origin, zone: ZoneInfo) -> list[Notice]:
    """One GeoPackage with its styles."""
    for name, layer in layers.items():
        metadata = None if path.exists() else origin.metadata
        layer.to_file(path, layer=name, driver="GPKG", engine="pyogrio", dataset_metadata=metadata)
    times = [layer[name].dropna() for layer in layers.values() for name in ("start", "end", "time") if name in layer]
    seconds = [moment.timestamp() for part in times if len(part) for moment in (part.min(), part.max())]
    write_styles(path, list(layers), StyleClock(zone, min(seconds), max(seconds)) if seconds else None)
    return []


def _write_geoparquet(path: Path, layer: gpd.GeoDataFrame) -> None:
    """GeoParquet 1.1, compressed by zstandard, with the bounding box of each row."""
    try:
        layer.to_parquet(path, index=False, compression="zstd", schema_version="1.1.0", write_covering_bbox=True)
    except ImportError:
        raise FurrowmapError("extra-missing.write-geoparquet") from None


def _write_through_memory(path: Path, layer: gpd.GeoDataFrame, driver: str, **options: object) -> None:
    """One file, which GDAL lays out in memory: on a disk that is full it reports no error of the last bytes."""
    content = io.BytesIO()
    layer.to_file(content, driver=driver, layer=path.stem, engine="pyogrio", **options)
    path.write_bytes(content.getbuffer())


def _write_shapefile(path: Path, layer: gpd.GeoDataFrame) -> None:
    """Shapefile with shortened names of fields, and times as text: the format has dates only."""
    table = _with_texts(layer).rename(columns=_short_names(layer))
    table.to_file(path, driver="ESRI Shapefile", engine="pyogrio", ENCODING="UTF-8")
    # GDAL reports no error of the last bytes on a full disk, nor of the header that it completes at the end.
    info = pyogrio.read_info(path, force_feature_count=True)
    with path.with_suffix(".dbf").open("rb") as file:
        rows, header, row = struct.unpack("<4xIHH", file.read(12))
        whole = header + rows * row < file.seek(0, os.SEEK_END)
    if not whole or rows != len(layer) or (info["features"], len(info["fields"])) != (rows, len(layer.columns) - 1):
        raise OSError(errno.EIO, "differs from what was written", str(path))


def _shortened(layers: Layers) -> list[Notice]:
    cut = {long: short for layer in layers.values() for long, short in _short_names(layer).items() if long != short}
    if not cut:
        return []
    pairs = ", ".join(f"{long} is {short}" for long, short in sorted(cut.items()))
    return [Notice("shapefile-names", pairs=pairs)]


def _write_csv(path: Path, layer: gpd.GeoDataFrame) -> None:
    """CSV: points by their coordinates, other geometries as WKT, times as ISO 8601, no text that is evaluated."""
    geometry = layer.geometry
    table = _with_texts(layer).drop(columns=geometry.name)
    texts = table.select_dtypes(exclude="number").columns
    table = table.assign(**{name: table[name].map(cell, na_action="ignore") for name in texts}).rename(columns=cell)
    if set(geometry.geom_type.dropna()) <= {"Point"}:
        names = ("lon_deg", "lat_deg") if geometry.crs.is_geographic else ("e_m", "n_m")
        table[names[0]], table[names[1]] = geometry.x.round(DIGITS_DEG), geometry.y.round(DIGITS_DEG)
        if geometry.has_z.any():
            table["h_m"] = geometry.z.round(4)
    else:
        table["wkt"] = geometry.to_wkt(rounding_precision=DIGITS_DEG if geometry.crs.is_geographic else 4)
    table.to_csv(path, index=False, lineterminator="\n")


FORMATS: Final[Mapping[str, VectorFormat]] = {
    "gpkg": VectorFormat(".gpkg", write_all=_write_geopackage),
    "geoparquet": VectorFormat(".parquet", write_one=_write_geoparquet),
    "flatgeobuf": VectorFormat(".fgb", write_one=partial(_write_through_memory, driver="FlatGeobuf")),
    "geojson": VectorFormat(
        ".geojson",
        write_one=partial(
            _write_through_memory,
            driver="GeoJSON",
            RFC7946="YES",
            COORDINATE_PRECISION=DIGITS_DEG,
            WRITE_NAME="YES",
        ),
        crs=WGS84_CRS,
    ),
    "shapefile": VectorFormat(".shp", write_one=_write_shapefile, notices=_shortened),
    "kml": VectorFormat(".kml", write_all=write_kml, crs=WGS84_CRS),
    "csv": VectorFormat(".csv", write_one=_write_csv),
}


def _with_texts(layer: gpd.GeoDataFrame) -> gpd.GeoDataFrame:
    """The layer with its times as ISO 8601 UTC with milliseconds."""
    texts = {}
    for name, dtype in layer.dtypes.items():
        if getattr(dtype, "kind", "") == "M":
            times = layer[name]
            if times.dt.tz is not None:  # GDAL gives a layer without rows no zone
                times = times.dt.tz_convert("UTC")
            text = times.dt.strftime("%Y-%m-%dT%H:%M:%S.%f").str[:-3] + "Z"
            texts[str(name)] = text.where(times.notna(), None)
    return layer.assign(**texts)


def _short_names(layer: gpd.GeoDataFrame) -> dict[str, str]:
    """Names of at most ten bytes that differ in more than case: the words before the unit are cut to one length."""
    short: dict[str, str] = {}
    taken: set[str] = set()
    for name in (str(column) for column in layer.columns if column != layer.geometry.name):
        words = name.split("_")
        room = _SHAPEFILE_NAME_BYTES
        while room > 1 and len("_".join(word[:room] for word in words).encode()) > _SHAPEFILE_NAME_BYTES:
            room -= 1
        whole, number = "_".join(word[:room] for word in words), 1
        cut = _cut(whole, _SHAPEFILE_NAME_BYTES)
        while cut.casefold() in taken:
            number += 1
            cut = f"{_cut(whole, _SHAPEFILE_NAME_BYTES - len(str(number)))}{number}"
        short[name] = cut
        taken.add(cut.casefold())
    return short


def _cut(text: str, size: int) -> str:
    """The beginning of a text that takes at most `size` bytes."""
    return text.encode()[:size].decode(errors="ignore")
