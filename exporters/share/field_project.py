"""A result as a QGIS project that QField opens on a phone: relative paths, the GeoPackage, the rasters."""

import shutil
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET

import shapely
from pyproj import CRS

from furrowmap.core.readers.geotiff import open_geotiff
from furrowmap.core.readers.las.cloud import Box
from furrowmap.core.readers.ogr_layers import layer_info
from furrowmap.core.runtime.errors import printable
from furrowmap.core.runtime.languages.texts import SHARE, texts_of
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.files.qgis_project import (
    ProjectLayer,
    project_root,
    project_text,
    put_raster_layer,
    put_tree_layer,
    put_vector_layer,
    put_view,
)
from furrowmap.exporters.files.result_folder import (
    CHANGE,
    FIELD,
    HEIGHT_ABOVE_GROUND,
    ResultFolder,
    packaged_style,
    packaged_styles,
    unreadable,
)
from furrowmap.exporters.rasters.cog import Band, cog_output
from furrowmap.exporters.rasters.windows import window, windows
from furrowmap.exporters.share.page_features import moment_s
from furrowmap.exporters.share.shown_layers import (
    RELIEFS,
    raster_style,
    rasters_of,
    shown_at_first,
    title_of,
    vector_style,
)
from furrowmap.exporters.vectors.labels import SHARED_LAYERS
from furrowmap.exporters.vectors.qgis_styles import (
    StyleClock,
    extreme_fields,
    field_extremes,
    finished_style,
    in_language,
    with_words,
)

PROJECT_FILE: Final = "field.qgs"
FIELD_PRODUCTS: Final = (PROJECT_FILE, FIELD)
"""Names by which a folder is known to hold a project; its rasters come on top."""
PASSES: Final = "passes"
HATCHED: Final = 'name="style" type="QString" value="b_diagonal"'
"""Fill of areas above the change of the surface, which is seen between the lines."""
COPIED_HEIGHTS: Final = frozenset({*RELIEFS, HEIGHT_ABOVE_GROUND, CHANGE})


def write_field_project(staging: Path, result: ResultFolder, language: str, progress: Progress) -> list[str]:
    """Write the project and its data; names of layers and classes are in `language`, such as "en"."""
    crs, bounds = _place(result)
    root = project_root(printable(result.name), crs)
    tree = ET.SubElement(root, "layer-tree-group")
    within = ET.SubElement(root, "projectlayers")
    figures = result.report["figures"]
    clock = StyleClock(result.zone, moment_s(figures["start"]), moment_s(figures["end"]))
    names = (FIELD, *rasters_of(result))
    shown: dict[ProjectLayer, bool] = {}
    at_first = shown_at_first(result)
    for number, name in enumerate(names):
        progress("writing the project", number / len(names))
        _copy(result, name, staging)
    for name in result.layer_names:
        about = layer_info(result.folder / FIELD, name)
        kind = str(about["geometry_type"])
        source = f"./{FIELD}|layername={name}"
        title = _in(language, SHARED_LAYERS.get(name, name.replace("_", " ")))
        style = None
        fields = about["fields"].tolist()
        if f"{name}.qml" in packaged_styles():
            packaged = vector_style(name)
            extremes = field_extremes(result.layer(name).columns) if extreme_fields(packaged) else {}
            style = finished_style(packaged, language, [clock], extremes, tools="tool" in fields)
            style = with_words(style, fields, language, report=False)
        if name == PASSES and style is not None and (result.folder / CHANGE).is_file():
            style = style.replace('name="style" type="QString" value="solid"', HATCHED)
        layer = ProjectLayer(name, kind, source, "ogr", style, title, read_only=True)
        put_vector_layer(within, layer, crs)
        shown[layer] = name in at_first
    for name in rasters_of(result):
        title = _in(language, title_of(name, result))
        layer = ProjectLayer(
            Path(name).stem, "raster", f"./{name}", "gdal", _style(raster_style(name), language), title
        )
        put_raster_layer(within, layer, crs)
        shown[layer] = Path(name).stem in at_first
    for layer, checked in shown.items():
        put_tree_layer(tree, layer, checked=checked)
    put_view(root, crs, bounds)
    (staging / PROJECT_FILE).write_text(project_text(root), encoding="utf-8")
    progress("writing the project", 1.0)
    return sorted([PROJECT_FILE, *names])


def _copy(result: ResultFolder, name: str, staging: Path) -> None:
    """A file of the result; of a surface only the heights, which are all that the map draws."""
    source = result.folder / name
    if name not in COPIED_HEIGHTS:
        shutil.copyfile(source, staging / name)
        return
    with open_geotiff(source, lambda file, fault: unreadable(file, ValueError(fault)), with_heights=False) as raster:
        cell_m = raster.transform.a
        west = raster.transform.c
        north = raster.transform.f
        grid = Grid(cell_m, round(west / cell_m), round(north / cell_m), raster.shape)
        crs = CRS.from_wkt(raster.crs.to_wkt())
        with cog_output(staging / name, grid, crs, (Band(str(raster.descriptions[0])),), result.origin) as write:
            for part, _ in windows(grid, 0):
                write(part, [raster.read(1, window=window(part, grid))])


def _place(result: ResultFolder) -> tuple[CRS, Box]:
    """CRS and bounds of the layers."""
    layers = [result.layer(name) for name in result.layer_names]
    boxes = [layer.bounds for layer in layers if not shapely.is_missing(layer.shapes).all()]
    west, south = (min(box[axis] for box in boxes) for axis in (0, 1))
    east, north = (max(box[axis] for box in boxes) for axis in (2, 3))
    return CRS.from_user_input(layers[0].crs).to_2d(), (west, south, east, north)


def _style(name: str, language: str) -> str | None:
    """A packaged style in a language; None for no such style."""
    return in_language(packaged_style(name), language) if name in packaged_styles() else None


def _in(language: str, text: str) -> str:
    return texts_of(language, SHARE).get(text, text)
