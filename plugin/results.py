# SPDX-License-Identifier: GPL-2.0-or-later
"""The products of a run and farm maps as groups of styled layers."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from qgis.core import (
    Qgis,
    QgsDateTimeRange,
    QgsLayerTreeGroup,
    QgsLayerTreeLayer,
    QgsLayerTreeModel,
    QgsMapLayer,
    QgsMapThemeCollection,
    QgsPointCloudLayer,
    QgsProject,
    QgsProviderRegistry,
    QgsRasterLayer,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QCoreApplication, QDateTime, Qt

from .legends import label_band, title_of, translate_colours
from .own_layers import (
    THEMES_PROPERTY,
    emptied_group,
    folder_of_layers,
    groups_with,
    hide_others,
    is_in_tree,
    key_of,
    mark,
    nodes_by_key,
    only_own,
    own_vector,
)
from .previews import PREVIEW_PROPERTY, remove_previews
from .processing.loading import FARM_LAYERS, sources
from .products import product, read_object
from .styles import (
    fill_worked,
    load_style_of_language,
    set_terrain,
    show_as_change,
    show_as_surface,
    show_by_class,
    show_classes,
)

tr = partial(QCoreApplication.translate, "Results")

REPORT = "report.json"
FIELD_FILE = "field.gpkg"
CLOUD = "cloud.copc.laz"
SURFACES = (
    *("crop_height.tif", "change.tif", "swaths.tif", "height_above_ground.tif", "strip_overlap.tif", "density.tif"),
    *("orthophoto.tif", "dsm.tif", "dsm_before.tif", "dtm.tif"),
)
COLOURED_SURFACES = ("crop_height", "change", "swaths", "height_above_ground", "strip_overlap", "density")
"""Rasters in colours, which lie above the hillshade."""
_ALWAYS = ("boundary", "plants", "lines", "planes", "orthophoto", "dsm")
THEMES = {
    "work": (*_ALWAYS, "misses", "unworked", "overlaps", "coverage"),
    "passes": (*_ALWAYS, "trajectory", "events", "overlaps", "passes"),
    "crops": (*_ALWAYS, "parcels", "crop_height"),
    "surface": (*_ALWAYS, "trajectory", "change", "zones", "tool_path"),
    "quality": ("control_points", "trajectory", "boundary", "strip_differences", "swaths", "dsm"),
}
"""Layers of a run that are seen together."""
KNOWN_AT_THE_END = ("coverage", "misses", "unworked", "change")
"""Layers that hold from the end of the drive on."""
WORKED_LAYERS = ("coverage", "change", "dsm_before")
"""Layers of a tool's work: with them, the surface is that after the work."""
MEASURED_LAYERS = ("trajectory", "events", "tool_path")
"""Layers with measured heights, which profiles and 3D views use as they are."""
TRAJECTORY_MIN_SCALE = 2000.0
"""At smaller scales the trajectory's points hide the passes and draw slowly; `tool_path` shows the path."""
FOLDER_PROPERTY = "furrowmap/folder"
"""Property of a group in the layer tree: the folder of the run whose layers it has."""
FARM_PROPERTY = "furrowmap/farmMap"
"""Property of a group in the layer tree: the file of the farm map whose layers it has."""
THEME_PROPERTY = "furrowmap/theme"
"""Property of a group: the one of :data:`THEMES` that was chosen last."""
SHOWN_ALONE = (FOLDER_PROPERTY, FARM_PROPERTY, PREVIEW_PROPERTY)
"""Properties of groups of which one is seen at a time: two drives over each other are not legible."""
EXPLAINED = {
    "passes": ("events", "passes"),
    "crops": ("parcels", "crop_height"),
    "surface": ("change", "zones"),
    "quality": ("trajectory", "strip_differences", "swaths"),
}
"""Layers of a theme whose colours have to be read from a legend, which is open where the theme shows them."""


class NoResultsError(Exception):
    """The folder has no products that QGIS can read."""


def open_results(folder: str | Path, project: QgsProject | None = None) -> list[QgsMapLayer]:
    """Open the products in `folder` as a group of a project; its layers, topmost first.

    Open layers of the same folder are replaced. Raises NoResultsError if there is nothing to open.
    """
    steps = opening(folder, project)
    while True:
        try:
            next(steps)
        except StopIteration as done:
            return list(done.value)


def opening(folder: str | Path, project: QgsProject | None = None) -> Generator[None, None, list[QgsMapLayer]]:
    """As :func:`open_results`, in steps that are short enough for the main thread.

    A generator that yields None and returns the layers. The project does not change before all files are open.
    """
    folder = Path(folder)
    project = QgsProject.instance() if project is None else project
    layers = []
    for read_layers in (field_layers, surface_layers, cloud_layers):
        for layer in read_layers(folder):
            if layer.isValid():
                layers.append(layer)
            yield
    if not layers:
        raise NoResultsError(
            tr("{folder} has no {products} that QGIS can open. Choose the folder of a run.").format(
                products=f"{FIELD_FILE}, {', '.join(SURFACES)} or {CLOUD}", folder=folder
            )
        )
    report = read_report(folder)
    if only_own(project):
        project.setCrs(layers[0].crs())  # a project with layers of the user's keeps its own
    remove_previews(project, report)
    yield
    worked = any(key_of(layer) in WORKED_LAYERS for layer in layers)
    group, place = emptied_group(project, FOLDER_PROPERTY, str(folder), session_name(report, folder))
    hide_others(project, group, SHOWN_ALONE)
    for number, layer in enumerate(layers):
        if not is_in_tree(project, group):  # removed by hand since the last step
            raise NoResultsError(tr("The group of {folder} was removed while it was opened.").format(folder=folder))
        layer.setName(title_of(key_of(layer), worked=worked))
        project.addMapLayer(layer, addToLegend=False)
        node = QgsLayerTreeLayer(layer)
        label_band(node, worked=worked)
        group.insertChildNode(place + number, node)
        node.setExpanded(False)
        yield
    keep_themes(project, group)
    set_terrain(project, layers)
    set_time_range(project, report)
    for layer in layers:
        if key_of(layer) in KNOWN_AT_THE_END:
            show_from_end(layer, report)
    return layers


def themes_of(group: QgsLayerTreeGroup) -> list[str]:
    """The themes for which a run has layers of their own, the first of them shown at first; at least one."""
    keys = set(nodes_by_key(group))
    return [name for name, layers in THEMES.items() if keys & set(layers) - {*_ALWAYS, "trajectory"}] or ["surface"]


def show_theme(group: QgsLayerTreeGroup, theme: str) -> None:
    """Show the layers of one of :data:`THEMES` in a run's group, and hide its others; those of the user stay."""
    group.setCustomProperty(THEME_PROPERTY, theme)
    group.setItemVisibilityCheckedParentRecursive(True)
    for key, node in nodes_by_key(group).items():
        node.setItemVisibilityChecked(key in THEMES[theme])
        node.setExpanded(key in EXPLAINED.get(theme, ()))


def theme_of(group: QgsLayerTreeGroup) -> str:
    """The theme that was chosen last."""
    return str(group.customProperty(THEME_PROPERTY) or "")


def theme_words() -> dict[str, str]:
    """The names of the themes in the user's language."""
    return {
        "work": tr("Worked ground"),
        "passes": tr("Passes and events"),
        "crops": tr("Crops"),
        "surface": tr("Surface and change"),
        "quality": tr("Quality of the data"),
    }


def keep_themes(project: QgsProject, group: QgsLayerTreeGroup) -> None:
    """Store each theme of a run as a map theme of QGIS, and show the first; a theme of the user's is not replaced."""
    known = project.mapThemeCollection()
    root = project.layerTreeRoot()
    names = []
    for theme in reversed(themes_of(group)):
        show_theme(group, theme)
        name = f"{group.name()}: {theme_words()[theme]}"
        number = 2
        while known.hasMapTheme(name):
            name = f"{group.name()}: {theme_words()[theme]} ({number})"
            number += 1
        known.insert(name, QgsMapThemeCollection.createThemeFromCurrentState(root, QgsLayerTreeModel(root)))
        names.append(name)
    group.setCustomProperty(THEMES_PROPERTY, names)


def groups_of(project: QgsProject, folder: Path | None = None) -> list[QgsLayerTreeGroup]:
    """The groups in the layer tree with the layers of a run: of that folder, or of any."""
    return groups_with(project, FOLDER_PROPERTY, None if folder is None else str(folder))


def folder_of(group: QgsLayerTreeGroup) -> Path | None:
    """The folder of the run whose layers a group has, also where it was moved with its project; None if it is gone."""
    folder = Path(str(group.customProperty(FOLDER_PROPERTY) or ""))
    found = folder if folder.is_dir() and folder != Path() else folder_of_layers(group)
    if found is not None:
        group.setCustomProperty(FOLDER_PROPERTY, str(found))
    return found


def open_farm_map(path: str | Path) -> list[QgsMapLayer]:
    """Open the layers of a farm map in their styles, as the topmost group; an open group of it is replaced."""
    project = QgsProject.instance()
    group, place = emptied_group(project, FARM_PROPERTY, str(path), Path(path).stem)
    hide_others(project, group, SHOWN_ALONE)
    layers = []
    for number, (source, key) in enumerate(sources(path)):
        layer = own_vector(source, key, title_of(key))
        layer.loadDefaultStyle()
        project.addMapLayer(layer, addToLegend=False)
        node = group.insertLayer(place + number, layer)
        node.setItemVisibilityChecked(key in FARM_LAYERS)
        node.setExpanded(False)
        layers.append(layer)
    group.setItemVisibilityChecked(True)
    return layers


def field_layers(folder: Path) -> Iterator[QgsVectorLayer]:
    """The vector layers of a run's GeoPackage one by one, each in the style stored with it."""
    path = product(folder, FIELD_FILE)
    found = QgsProviderRegistry.instance().querySublayers(str(path)) if path.is_file() else []
    for details in found:
        if details.name() == "layer_styles":
            continue
        key = details.name()
        layer = own_vector(details.uri(), key, key, details.providerKey())
        layer.loadDefaultStyle()  # again: a new layer takes the symbols of its style, but not the temporal settings
        load_style_of_language(layer)
        if key == "coverage":
            fill_worked(layer)
        show_classes(layer, key)
        if key in MEASURED_LAYERS:
            layer.elevationProperties().setClamping(Qgis.AltitudeClamping.Absolute)
        if key == "trajectory" and "tool_path" in {other.name() for other in found}:
            layer.setMinimumScale(TRAJECTORY_MIN_SCALE)
            layer.setScaleBasedVisibility(True)
        yield layer


def surface_layers(folder: Path) -> Iterator[QgsRasterLayer]:
    """The surfaces of a run one by one: the change in colours, above the hillshade of the DSM."""
    for name in SURFACES:
        path = product(folder, name)
        if not path.is_file():
            continue
        layer = QgsRasterLayer(str(path), path.stem, "gdal")
        mark(layer, path.stem)
        if layer.isValid():
            styled = path.with_suffix(".qml").is_file()  # QGIS has loaded that style already
            if path.stem != "orthophoto":
                (show_as_change if path.stem in COLOURED_SURFACES else show_as_surface)(layer, styled=styled)
            translate_colours(layer)
        yield layer


def cloud_layers(folder: Path) -> Iterator[QgsPointCloudLayer]:
    """The point cloud of a run, if there is one, coloured by class, in 3D as well."""
    path = product(folder, CLOUD)
    if path.is_file():
        options = QgsPointCloudLayer.LayerOptions()
        options.skipStatisticsCalculation = True  # colours by class need none
        layer = QgsPointCloudLayer(str(path), "cloud", "copc", options)
        mark(layer, "cloud")
        if layer.isValid():
            show_by_class(layer)
        yield layer


def read_report(folder: str | Path) -> dict[str, Any]:
    """The content of `report.json`; empty if it cannot be read."""
    return read_object(product(folder, REPORT))


def session_name(report: dict[str, Any], folder: Path) -> str:
    """The session's name, else the folder's."""
    session = report.get("session")
    return (session.get("name") if isinstance(session, dict) else None) or folder.name


def set_time_range(project: QgsProject, report: dict[str, Any]) -> None:
    """Extend the project's time range to the session's, for the temporal controller."""
    span = time_span(report)
    if span is None:
        return
    start, end = span
    known = project.timeSettings().temporalRange()
    if known.begin().isValid() and known.end().isValid():
        start = min(start, known.begin())
        end = max(end, known.end())
    project.timeSettings().setTemporalRange(QgsDateTimeRange(start, end))


def show_from_end(layer: QgsVectorLayer | QgsRasterLayer, report: dict[str, Any]) -> None:
    """Have the temporal controller show a layer from the end of the drive on."""
    span = time_span(report)
    time = layer.temporalProperties()
    if span is not None:
        modes = Qgis.RasterTemporalMode if isinstance(layer, QgsRasterLayer) else Qgis.VectorTemporalMode
        time.setMode(modes.FixedTemporalRange)
        time.setFixedTemporalRange(QgsDateTimeRange(span[1], QDateTime()))
        time.setIsActive(True)


def time_span(report: dict[str, Any]) -> Sequence[QDateTime] | None:
    """Start and end of the drive; None if the report has none."""
    figures = report.get("figures")
    texts = [str(figures.get(key)) for key in ("start", "end")] if isinstance(figures, dict) else []
    times = [QDateTime.fromString(text, Qt.DateFormat.ISODateWithMs) for text in texts]
    return times if times and all(time.isValid() for time in times) else None
