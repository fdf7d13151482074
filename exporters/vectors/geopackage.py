"""Writing and reading layers of a GeoPackage, and `field.gpkg` with its styles."""

import sqlite3
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any, Final
from zoneinfo import ZoneInfo

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from furrowmap.core.coverage.field_work import FieldWork
from furrowmap.core.readers.ogr_layers import read_layer_arrays
from furrowmap.core.runtime.languages.texts import LANGUAGES, texts_of
from furrowmap.core.runtime.settings import language_of_user
from furrowmap.core.values.trajectory import ScanPoses
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import FIELD, packaged_style, packaged_styles
from furrowmap.exporters.files.vector_layers import UTC_OFFSET, unflushed, write_arrays
from furrowmap.exporters.vectors.field_layers import Columns, Layer, field_layers, geometry_array
from furrowmap.exporters.vectors.labels import LAYER_NAMES
from furrowmap.exporters.vectors.qgis_styles import StyleClock, field_extremes, finished_style, with_words

PAGE_BYTES: Final = 1024
"""Page size of the file: a few rows of `trajectory`."""
INDEXED_FROM: Final = 1000
"""With fewer features a spatial index takes more room than it saves time."""
GEOMETRY: Final = "geom"
_NO_WORK: Final = FieldWork()


def write_field(
    path: Path,
    poses: ScanPoses,
    crs: CRS | str,
    work: FieldWork = _NO_WORK,
    words: str = "",
    origin: Origin | None = None,
    more: Sequence[Layer] = (),
    zone: ZoneInfo | None = None,
) -> None:
    """Write `field.gpkg` with its layers and their styles.

    Args:
        poses: the rows of the layer `trajectory`.
        crs: of all coordinates; WKT 2 may include their epoch.
        work: states of the implement and worked ground.
        words: on the coordinates, added to each layer's description.
        more: other layers, below these.
        zone: time zone of the times in map tips; None for UTC.

    Names of layers and fields that people read are in the language of
    :func:`~furrowmap.core.runtime.settings.using`.
    """
    language = language_of_user()
    layers = [
        replace(layer, description=f"{_named(layer, language)}. {words}" if words else _named(layer, language))
        for layer in (*field_layers(poses, work), *more)
    ]
    with atomic_output(path) as unfinished:
        clock = StyleClock(zone, float(poses.t_s[0]), float(poses.t_s[-1])) if zone is not None else None
        write_styled_layers(unfinished, layers, crs, origin, clock, of_run=path.name == FIELD)
        with closing(sqlite3.connect(unfinished)) as database:
            database.execute("PRAGMA synchronous=OFF")
            database.execute(f"PRAGMA page_size={PAGE_BYTES}")  # outlines and empty tables leave less of it unused
            database.execute("VACUUM")
        _check(unfinished, {layer.name: len(layer.shapes) for layer in layers})


def _named(layer: Layer, language: str) -> str:
    """The description of a layer, beginning with its name for people, by which QGIS's browser finds it."""
    name = LAYER_NAMES.get(layer.name)
    return f"{texts_of(language).get(name, name)}: {layer.description}" if name else layer.description


@unflushed()
def write_styled_layers(
    path: Path,
    layers: Sequence[Layer],
    crs: CRS | str,
    origin: Origin | None = None,
    clock: StyleClock | None = None,
    *,
    of_run: bool = False,
) -> None:
    """Write layers into a new GeoPackage, the topmost of a map first, and their styles as :func:`write_styles` does.

    The file is to be flushed by the caller, as a whole.
    """
    for layer in layers:
        first = None if path.exists() else origin
        write_layer(path, layer, crs, indexed=len(layer.shapes) > INDEXED_FROM, origin=first)
    write_styles(path, {layer.name: layer.columns for layer in layers}, clock, of_run=of_run)


def write_layer(
    path: Path,
    layer: Layer,
    crs: CRS | str | None,
    *,
    indexed: bool,
    append: bool = False,
    origin: Origin | None = None,
) -> None:
    """Write a layer to a GeoPackage, created where missing, or append its features to the layer of that name."""
    columns = layer.columns
    times = [name for name, values in columns.items() if values.dtype == "datetime64[ms]"]
    with_height = layer.kind.startswith("2.5D")
    options = {"DESCRIPTION": layer.description}
    if layer.kind:
        options |= {"GEOMETRY_NAME": GEOMETRY, "SPATIAL_INDEX": "YES" if indexed else "NO"}
    write_arrays(
        path,
        shapely.to_wkb(layer.shapes, output_dimension=3 if with_height else 2) if layer.kind else None,
        [np.ma.getdata(values) for values in columns.values()],
        list(columns),
        field_mask=[np.ma.getmaskarray(values) if np.ma.isMA(values) else None for values in columns.values()],
        layer=layer.name,
        driver="GPKG",
        geometry_type=layer.kind or None,
        crs=(crs.to_wkt() if isinstance(crs, CRS) else crs) if layer.kind else None,
        append=append,
        gdal_tz_offsets={name: np.full(len(layer.shapes), UTC_OFFSET, np.int8) for name in times},
        layer_options={} if append else options,
        dataset_metadata=origin.metadata if origin is not None else None,
    )


def read_layer(path: Path, name: str) -> Layer:
    """A layer of a GeoPackage as :func:`write_layer` takes it; ValueError if it is damaged."""
    meta, wkb, data = read_layer_arrays(path, name)
    rows = len(data[0]) if len(data) else 0
    shapes = geometry_array(shapely.from_wkb(wkb) if wkb is not None else [None] * rows)
    if not np.isfinite(shapely.get_coordinates(shapes)).all():
        raise ValueError(f"layer '{name}' has coordinates that are not finite")
    kind = str(meta["geometry_type"] or "")
    kind = f"2.5D {kind.removesuffix(' Z')}" if kind.endswith(" Z") else kind
    description = (meta["layer_metadata"] or {}).get("DESCRIPTION", "")
    fields = zip(meta["fields"], meta["dtypes"], data, strict=True)
    columns = {str(field): _typed(values, str(dtype)) for field, dtype, values in fields}
    return Layer(name, kind, str(description), shapes, columns)


def _typed(values: NDArray[Any], dtype: str) -> NDArray[Any]:
    """A column in its type in the file: pyogrio reads integers as floats where some are NULL."""
    if dtype.startswith("int") and values.dtype.kind == "f":
        missing = np.isnan(values)
        return np.ma.MaskedArray(np.where(missing, 0, values).astype(dtype), missing)
    return values


def write_styles(
    path: Path, columns: Mapping[str, Columns], clock: StyleClock | None = None, *, of_run: bool = False
) -> None:
    """Store the packaged style of each layer for QGIS: the default one in the language of the user, and the others.

    Args:
        columns: of each layer; one of several tools is named by the field `tool`.
        clock: of the times in map tips; None for UTC.
        of_run: add words and actions for the tables of a run's layers.
    """
    own = language_of_user()
    packaged = packaged_styles()
    clocks = [clock] if clock is not None else []
    extremes = {name: field_extremes(values) for name, values in columns.items() if f"{name}.qml" in packaged}
    for language in (own, *(other for other in LANGUAGES if other != own)):
        styles = {
            name: finished_style(
                packaged_style(f"{name}.qml"), language, clocks, of_layer, tools="tool" in columns[name]
            )
            for name, of_layer in extremes.items()
        }
        if of_run:
            styles = {
                name: with_words(style, list(columns[name]), language, report=True) for name, style in styles.items()
            }
        store_styles(path, styles, append=language != own, language="" if language == own else language)


def store_styles(path: Path, styles: Mapping[str, str], *, append: bool = False, language: str = "") -> None:
    """Store styles (QML by the name of the layer) for QGIS: as the default styles of their layers.

    Those of another `language` are not the default, and have it in their names: "passes (ja)".
    """
    n = len(styles)
    empty = np.full(n, "", dtype=object)
    names = np.array(list(styles), dtype=object)
    titles = [f"{name} ({language})" if language else name for name in styles]
    columns: dict[str, NDArray[Any]] = {
        "f_table_catalog": empty,
        "f_table_schema": empty,
        "f_table_name": names,
        "f_geometry_column": np.full(n, GEOMETRY, dtype=object),
        "styleName": np.array(titles, dtype=object),
        "styleQML": np.array(list(styles.values()), dtype=object),
        "styleSLD": empty,
        "useAsDefault": np.full(n, not language),
        "description": np.full(n, "furrowmap's own", dtype=object),
        "owner": empty,
        "ui": np.full(n, None, dtype=object),
        "update_time": np.full(n, np.datetime64("now", "ms")),
    }
    write_arrays(
        path,
        None,
        list(columns.values()),
        list(columns),
        layer="layer_styles",
        driver="GPKG",
        append=append,
        layer_options={} if append else {"FID": "id"},
        gdal_tz_offsets={"update_time": np.full(n, UTC_OFFSET, np.int8)},
    )


def _check(path: Path, counts: Mapping[str, int]) -> None:
    """Check the file and its number of features."""
    with closing(sqlite3.connect(path)) as database:
        verdict = database.execute("PRAGMA integrity_check").fetchone()[0]
        found = {name: database.execute(f'SELECT count(*) FROM "{name}"').fetchone()[0] for name in counts}  # noqa: S608
        journal = database.execute("PRAGMA journal_mode").fetchone()[0]
    if verdict != "ok" or found != counts or journal != "delete":
        raise OSError(f"{path} differs from what was written ({verdict}; {found} features, journal {journal})")
