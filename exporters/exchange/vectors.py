"""The layers of `field.gpkg` in vector formats of other programs, KML for Google Earth among them."""

import datetime as dt
import errno
import io
import os
import struct
import unicodedata
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree as ET
from zoneinfo import ZoneInfo

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry, BaseMultipartGeometry

from furrowmap.core.geodesy.crs_change import crs_change
from furrowmap.core.geodesy.longitudes import cut_at_antimeridian
from furrowmap.core.readers.ogr_layers import layer_info
from furrowmap.core.readers.vector_file import VectorLayer
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import FurrowmapError, InputError, MissingExtraError, Notice, printable
from furrowmap.core.runtime.file_names import inside
from furrowmap.core.runtime.languages.texts import Text, texts_of
from furrowmap.core.runtime.settings import language_of_user
from furrowmap.core.runtime.write_errors import writing
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.csv_cells import write_csv
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import FIELD, TRAJECTORY
from furrowmap.exporters.files.staging import staged_folder
from furrowmap.exporters.files.whole_layers import geodataframe, write_vector_layer
from furrowmap.exporters.share.symbols import PLAIN_SYMBOL, Symbol, layer_style
from furrowmap.exporters.vectors.geopackage import write_styles
from furrowmap.exporters.vectors.labels import COLUMN_LABELS, LAYER_NAMES, VALUES
from furrowmap.exporters.vectors.qgis_styles import StyleClock

_NAMESPACE: Final = "http://www.opengis.net/kml/2.2"
_TITLES: Final = ("pass", "kind", "zone", "implement", "scan")
"""The first of these fields that a feature has is its name."""
_PASSES: Final = "passes"
"""The layer whose colours follow the number of the pass."""
_NO_COLOUR: Final = "rgba(255,255,255,0)"
_Styles = tuple[str, Mapping[str, tuple[str, str]]]


def write_kml(path: Path, layers: Mapping[str, VectorLayer], origin: Origin, zone: ZoneInfo) -> list[Notice]:
    """Write one KML file with a folder a layer; the trajectory becomes a line for each quality of its positions.

    Layers are in WGS 84; heights are left out, as viewers relate them to their own terrain model.
    """
    root = ET.Element("kml", xmlns=_NAMESPACE)
    document = ET.SubElement(root, "Document")
    _text(document, "name", origin.title)
    _text(document, "description", "; ".join(f"{name} {text}" for name, text in origin.metadata.items()))
    styles = {name: _colours_by_value(name, layer) for name, layer in layers.items()}
    for name, (_, colours) in styles.items():
        for value, (mark, fill) in colours.items():
            style = ET.SubElement(document, "Style", id=_style_name(name, value))
            _text(ET.SubElement(style, "IconStyle"), "color", mark)
            stroke = ET.SubElement(style, "LineStyle")
            _text(stroke, "color", mark)
            _text(stroke, "width", "2")
            _text(ET.SubElement(style, "PolyStyle"), "color", fill)
    notices = []
    for name, layer in reversed(list(layers.items())):  # KML draws later folders on top
        folder = ET.SubElement(document, "Folder")
        _text(folder, "name", _in_words(LAYER_NAMES.get(name, name.replace("_", " "))))
        if name == TRAJECTORY:
            _add_lines(folder, layer, styles[name])
            notices.append(Notice("kml-trajectory"))
        else:
            for shape, row in zip(cut_at_antimeridian(layer.shapes), layer.rows(), strict=True):
                if shape is not None and not shape.is_empty:
                    _add_placemark(folder, name, shape, row, styles[name], zone)
    ET.indent(root)
    ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    return notices


def _colours_by_value(name: str, layer: VectorLayer) -> tuple[str, dict[str, tuple[str, str]]]:
    """The field that decides on the style of a layer ("" for none), and colours by its text; "" for other values."""
    style = layer_style(name, layer.columns)
    found = {"": _colours(style.default)} | {value: _colours(symbol) for value, symbol in style.by_value.items()}
    if name != _PASSES or style.ramp is None:
        return style.attribute, found
    # A damaged layer may have something else in place of numbers.
    passes = [row.get("pass") for row in layer.rows()]
    numbers = [value for value in passes if isinstance(value, int | float) and np.isfinite(value)]
    ramp = {str(int(n)): (found[""][0], _abgr(style.ramp.colour(n, style.opacity))) for n in numbers}
    return style.ramp.attribute, {"": found[""]} | ramp


def _colours(symbol: Symbol) -> tuple[str, str]:
    """Colours of points, lines and outlines, and of areas: alpha, blue, green and red in hexadecimal."""
    mark = symbol.fill if symbol.size_mm and symbol is not PLAIN_SYMBOL else symbol.stroke
    return _abgr(mark or symbol.fill or _NO_COLOUR), _abgr(symbol.fill or _NO_COLOUR)


def _abgr(css: str) -> str:
    """A colour as CSS has it: "rgba(red,green,blue,opacity)"."""
    red, green, blue, opacity = css.removeprefix("rgba(").removesuffix(")").split(",")
    return f"{round(255 * float(opacity)):02x}{int(blue):02x}{int(green):02x}{int(red):02x}"


def _style_of(layer: str, fields: Mapping[str, str], styles: _Styles) -> str:
    """Name of the style of a feature with these fields."""
    attribute, colours = styles
    value = fields.get(attribute, "")
    return _style_name(layer, value if value in colours else "")


def _style_name(layer: str, value: str) -> str:
    """Name of a style, which is an XML name."""
    return "-".join([layer, *value.split()])


def _add_lines(folder: ET.Element, trajectory: VectorLayer, styles: _Styles) -> None:
    """The trajectory in parts of one quality of the positions; each begins where the one before ends."""
    if len(trajectory) < 2:
        return
    xy = trajectory.coordinates
    fix = np.array([_field_text(row.get("fix")) or "" for row in trajectory.rows()], object)
    edges = np.flatnonzero(fix[1:] != fix[:-1]) + 1
    for begin, end in pairwise([0, *edges.tolist(), len(xy)]):
        part = xy[max(begin - 1, 0) : end]
        if len(part) > 1:
            mark = ET.SubElement(folder, "Placemark")
            value = str(fix[begin])
            _text(mark, "name", _in_words(VALUES["fix"].get(value, "trajectory")))
            _text(mark, "styleUrl", f"#{_style_of(TRAJECTORY, {'fix': value}, styles)}")
            _text(ET.SubElement(mark, "LineString"), "coordinates", _coordinates(part))


def _add_placemark(
    folder: ET.Element, layer: str, shape: BaseGeometry, row: dict[str, Any], styles: _Styles, zone: ZoneInfo
) -> None:
    """A feature with its fields; times are in a zone."""
    for name, value in row.items():
        if isinstance(value, dt.datetime):
            row[name] = value.astimezone(zone)
    fields = {name: text for name, value in row.items() if (text := _field_text(value)) is not None}
    mark = ET.SubElement(folder, "Placemark")
    key = next((key for key in _TITLES if key in fields), None)
    name = layer if key is None else f"{key} {fields[key]}" if key == "pass" else fields[key]
    _text(mark, "name", f"{fields['tool']}, {name}" if "tool" in fields else name)
    if "start" in fields:  # for the time slider of viewers
        span = ET.SubElement(mark, "TimeSpan")
        _text(span, "begin", fields["start"])
        if "end" in fields:
            _text(span, "end", fields["end"])
    elif "time" in fields:
        _text(ET.SubElement(mark, "TimeStamp"), "when", fields["time"])
    _text(mark, "styleUrl", f"#{_style_of(layer, fields, styles)}")
    data = ET.SubElement(mark, "ExtendedData")
    for name, text in fields.items():
        field = ET.SubElement(data, "Data", name=name)
        if name in COLUMN_LABELS:
            _text(field, "displayName", _in_words(COLUMN_LABELS[name]).replace("UTC", zone.key))
        _text(field, "value", text)
    _add_shape(mark, shape)


def _add_shape(parent: ET.Element, shape: BaseGeometry) -> None:
    if isinstance(shape, BaseMultipartGeometry):
        several = ET.SubElement(parent, "MultiGeometry")
        for part in shape.geoms:
            _add_shape(several, part)
    elif isinstance(shape, Polygon):
        polygon = ET.SubElement(parent, "Polygon")
        for edge, ring in [("outerBoundaryIs", shape.exterior), *(("innerBoundaryIs", r) for r in shape.interiors)]:
            linear = ET.SubElement(ET.SubElement(polygon, edge), "LinearRing")
            _text(linear, "coordinates", _coordinates(np.asarray(ring.coords)))
    else:
        _text(ET.SubElement(parent, shape.geom_type), "coordinates", _coordinates(np.asarray(shape.coords)))


def _coordinates(xy: Any) -> str:
    return " ".join(f"{x:.9f},{y:.9f}" for x, y in xy[:, :2].tolist())


def _field_text(value: Any) -> str | None:
    """A field's value as text; None for NULL."""
    if value is None:
        return None
    if isinstance(value, dt.datetime):
        return value.isoformat(timespec="milliseconds").replace("+00:00", "Z")
    return f"{value:.4f}".rstrip("0").rstrip(".") if isinstance(value, float) else str(value)


def _in_words(label: str) -> str:
    return texts_of(language_of_user()).get(label, label)


def _text(parent: ET.Element, tag: str, text: str) -> None:
    ET.SubElement(parent, tag).text = printable(text)


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

    `write_all` writes all layers into one file, and returns what could not be kept; None for a file a layer, with
    `notices` of what cannot be kept; `crs` is the only one of the format, None for any.
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
    with staged_folder(target) as staging:
        for path, layer in zip(_layer_files(staging, list(layers), chosen.suffix), layers.values(), strict=True):
            with writing(target / path.name):
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
    write_styles(path, {name: layer.columns for name, layer in layers.items()}, clock)
    return []


def _write_geoparquet(path: Path, layer: VectorLayer) -> None:
    """GeoParquet 1.1, compressed by zstandard, with the bounding box of each row."""
    try:
        geodataframe(layer).to_parquet(
            path, index=False, compression="zstd", schema_version="1.1.0", write_covering_bbox=True
        )
    except ImportError:
        raise MissingExtraError("pyarrow", "parquet", Text("GeoParquet is written by it.")) from None


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
    try:
        is_whole = _is_whole_shapefile(path, len(layer), len(layer.columns))
    except (FurrowmapError, OSError):
        raise
    except Exception:  # noqa: BLE001 (those of GDAL have no family of their own)
        is_whole = False
    if not is_whole:
        raise OSError(errno.EIO, "differs from what was written", str(path))


def _is_whole_shapefile(path: Path, features: int, fields: int) -> bool:
    """Whether a Shapefile has so many features and fields, and its table all rows; any error if it is cut."""
    info = layer_info(path)
    with path.with_suffix(".dbf").open("rb") as file:
        rows, header, row = struct.unpack("<4xIHH", file.read(12))
        has_all_rows = header + rows * row < file.seek(0, os.SEEK_END)
    return has_all_rows and (rows, info["features"], len(info["fields"])) == (features, features, fields)


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
    write_csv(path, table, zip(*table.values(), strict=True))


FORMATS: Final[Mapping[str, VectorFormat]] = {
    "gpkg": VectorFormat(".gpkg", write_all=_write_geopackage),
    "geoparquet": VectorFormat(".parquet", write_one=_write_geoparquet),
    "flatgeobuf": VectorFormat(".fgb", write_one=partial(_write_through_memory, driver="FlatGeobuf")),
    "geojson": VectorFormat(
        ".geojson",
        write_one=partial(
            _write_through_memory, driver="GeoJSON", RFC7946="YES", COORDINATE_PRECISION=DIGITS_DEG, WRITE_NAME="YES"
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
        whole = "_".join(word[:room] for word in words)
        number = 1
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
