"""The layers of `field.gpkg` in vector formats of other programs."""

import csv
import errno
import io
import os
import struct
import unicodedata
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final
from zoneinfo import ZoneInfo

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from furrowmap.core.geodesy.crs_change import crs_change
from furrowmap.core.readers.vector_layer import VectorLayer
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
from furrowmap.exporters.files.vector_layers import geodataframe, write_vector_layer
from furrowmap.exporters.vectors.geopackage import write_styles
from furrowmap.exporters.vectors.qgis_styles import StyleClock

UTC: Final = ZoneInfo("UTC")
WGS84_CRS: Final = CRS("EPSG:4326")
DIGITS_DEG: Final = 9
"""Decimals of degrees in texts: a tenth of a millimetre."""
_SHAPEFILE_NAME_BYTES: Final = 10
"""Maximum length of a field's name in a Shapefile."""

Layers = Mapping[str, VectorLayer]


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
    write_one: Callable[[Path, VectorLayer], None] | None = None
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


def changed_crs(layers: Layers, target: CRS | None) -> tuple[dict[str, VectorLayer], list[Notice]]:
    """The layers in another CRS (None keeps theirs); heights and area fields are unchanged."""
    filled = [layer for layer in layers.values() if len(layer)]
    if target is None or not filled:
        return dict(layers), []
    whole = [float(v) for v in shapely.total_bounds([shapely.box(*layer.bounds) for layer in filled])]
    change = crs_change(CRS(filled[0].crs), target, (whole[0], whole[1], whole[2], whole[3]))

    def moved(xyz: FloatArray) -> FloatArray:
        return np.column_stack([change.points(xyz[:, :2]), xyz[:, 2:]])

    return {
        name: VectorLayer(
            shapely.transform(layer.shapes, moved, include_z=bool(shapely.has_z(layer.shapes).any())),
            layer.columns,
            target,
        )
        for name, layer in layers.items()
    }, list(change.notices)


def _write_geopackage(path: Path, layers: Layers, origin: Origin, zone: ZoneInfo) -> list[Notice]:
    """One GeoPackage with its styles."""
    for name, layer in layers.items():
        metadata = None if path.exists() else origin.metadata
        write_vector_layer(path, layer, name, "GPKG", metadata)
    times = [layer.columns[k] for layer in layers.values() for k in ("start", "end", "time") if k in layer.columns]
    known = [part[~np.isnat(part)].astype("datetime64[ms]").astype(np.int64) / 1000.0 for part in times]
    seconds = [float(edge) for part in known if len(part) for edge in (part.min(), part.max())]
    clock = StyleClock(zone, min(seconds), max(seconds)) if seconds else None
    tools = [name for name, layer in layers.items() if "tool" in layer.columns]
    write_styles(path, list(layers), clock, several_tools=tools)
    return []


def _write_geoparquet(path: Path, layer: VectorLayer) -> None:
    """GeoParquet 1.1, compressed by zstandard, with the bounding box of each row."""
    try:
        geodataframe(layer).to_parquet(
            path, index=False, compression="zstd", schema_version="1.1.0", write_covering_bbox=True
        )
    except ImportError:
        raise FurrowmapError("extra-missing.write-geoparquet") from None


def _write_through_memory(path: Path, layer: VectorLayer, driver: str, **options: Any) -> None:
    """One file, which GDAL lays out in memory: on a disk that is full it reports no error of the last bytes."""
    content = io.BytesIO()
    write_vector_layer(content, layer, path.stem, driver, **options)
    path.write_bytes(content.getbuffer())


def _write_shapefile(path: Path, layer: VectorLayer) -> None:
    """Shapefile with shortened names of fields, and times as text: the format has dates only."""
    short = _short_names(layer)
    table = replace(layer, columns={short[name]: values for name, values in _with_texts(layer).items()})
    write_vector_layer(path, table, path.stem, "ESRI Shapefile", ENCODING="UTF-8")
    # GDAL reports no error of the last bytes on a full disk, nor of the header that it completes at the end.
    info = pyogrio.read_info(path, force_feature_count=True)
    with path.with_suffix(".dbf").open("rb") as file:
        rows, header, row = struct.unpack("<4xIHH", file.read(12))
        whole = header + rows * row < file.seek(0, os.SEEK_END)
    if not whole or rows != len(layer) or (info["features"], len(info["fields"])) != (rows, len(layer.columns)):
        raise OSError(errno.EIO, "differs from what was written", str(path))


def _shortened(layers: Layers) -> list[Notice]:
    cut = {long: short for layer in layers.values() for long, short in _short_names(layer).items() if long != short}
    if not cut:
        return []
    pairs = ", ".join(f"{long} is {short}" for long, short in sorted(cut.items()))
    return [Notice("shapefile-names", pairs=pairs)]


def _write_csv(path: Path, layer: VectorLayer) -> None:
    """CSV: points by their coordinates, other geometries as WKT, times as ISO 8601, no text that is evaluated."""
    geographic = CRS(layer.crs).is_geographic
    table = _with_texts(layer)
    if {shape.geom_type for shape in layer.shapes if shape is not None} <= {"Point"}:
        x, y, z = layer.coordinates.T
        names = ("lon_deg", "lat_deg") if geographic else ("e_m", "n_m")
        table |= {names[0]: x.round(DIGITS_DEG), names[1]: y.round(DIGITS_DEG)}
        if shapely.has_z(layer.shapes).any():
            table["h_m"] = z.round(4)
    else:
        table["wkt"] = shapely.to_wkt(layer.shapes, rounding_precision=DIGITS_DEG if geographic else 4)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(map(cell, table))
        writer.writerows(zip(*(_cells(values) for values in table.values()), strict=True))


def _cells(values: NDArray[Any]) -> list[object]:
    """A column as cells of a CSV; empty ones where nothing is known."""
    if values.dtype.kind == "f":
        return ["" if np.isnan(value) else str(value) for value in values]
    return ["" if value is None else cell(value) for value in values]


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


def _with_texts(layer: VectorLayer) -> dict[str, NDArray[Any]]:
    """The fields of a layer, times as ISO 8601 UTC with milliseconds."""
    fields = dict(layer.columns)
    for name, values in layer.columns.items():
        if values.dtype.kind == "M":
            texts = np.datetime_as_string(values, "ms", timezone="UTC").astype(object)
            texts[np.isnat(values)] = None
            fields[name] = texts
    return fields


def _short_names(layer: VectorLayer) -> dict[str, str]:
    """Names of at most ten bytes that differ in more than case: the words before the unit are cut to one length."""
    short: dict[str, str] = {}
    taken: set[str] = set()
    for name in layer.columns:
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
