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
    QgsMapLayer,
    QgsPointCloudLayer,
    QgsProject,
    QgsProviderRegistry,
    QgsRasterLayer,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QCoreApplication, QDateTime, Qt

from .legends import label_band, name_node, translate_colours
from .previews import remove_previews
from .processing.loading import FARM_LAYERS, sources
from .products import product, read_object
from .styles import fill_worked, load_style_of_language, set_terrain, show_as_change, show_as_surface, show_by_class

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
_ALWAYS = ("boundary", "trajectory", "plants", "lines", "planes", "orthophoto", "dsm")
THEMES = {
    "work": (*_ALWAYS, "misses", "unworked", "overlaps", "coverage"),
    "passes": (*_ALWAYS, "events", "overlaps", "passes"),
    "crops": (*_ALWAYS, "parcels", "crop_height"),
    "surface": (*_ALWAYS, "change", "zones", "tool_path"),
    "quality": ("trajectory", "boundary", "strip_differences", "swaths", "dsm"),
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
    if all(layer.customProperty("furrowmap/basemap") for layer in project.mapLayers().values()):
        project.setCrs(layers[0].crs())  # a project with other layers keeps its own
    _remove_groups(project, FOLDER_PROPERTY, folder)
    remove_previews(project, report)
    yield
    worked = any(layer.name() in WORKED_LAYERS for layer in layers)
    group = project.layerTreeRoot().insertGroup(0, session_name(report, folder))
    group.setCustomProperty(FOLDER_PROPERTY, str(folder))
    for layer in layers:
        project.addMapLayer(layer, addToLegend=False)
        node = QgsLayerTreeLayer(layer)
        label_band(node, worked=worked)
        name_node(node, worked=worked)
        group.addChildNode(node)
        node.setExpanded(False)
        yield
    show_theme(group, next(iter(themes_of(group))))
    set_terrain(project, layers)
    set_time_range(project, report)
    for layer in layers:
        if layer.name() in KNOWN_AT_THE_END:
            show_from_end(layer, report)
    return layers


def themes_of(group: QgsLayerTreeGroup) -> list[str]:
    """The themes for which a run has layers of their own, the first of them shown at first; at least one."""
    names = {node.layer().name() for node in group.findLayers()}
    return [name for name, layers in THEMES.items() if names & set(layers) - set(_ALWAYS)] or ["surface"]


def show_theme(group: QgsLayerTreeGroup, theme: str) -> None:
    """Show the layers of one of :data:`THEMES` in a run's group, and hide its others."""
    for node in group.findLayers():
        node.setItemVisibilityChecked(node.layer().name() in THEMES[theme])


def groups_of(project: QgsProject, folder: Path | None = None) -> list[QgsLayerTreeGroup]:
    """The groups in the layer tree with the layers of a run: of that folder, or of any."""
    groups = project.layerTreeRoot().findGroups()
    opened = [(group, group.customProperty(FOLDER_PROPERTY)) for group in groups]
    return [group for group, of in opened if of and (folder is None or of == str(folder))]


def _remove_groups(project: QgsProject, key: str, value: str | Path) -> None:
    """Remove the groups with this value of a property, and their layers."""
    root = project.layerTreeRoot()
    for group in root.findGroups():
        if group.customProperty(key) == str(value):
            project.removeMapLayers(group.findLayerIds())
            root.removeChildNode(group)


def open_farm_map(path: str | Path) -> list[QgsMapLayer]:
    """Open the layers of a farm map in their styles, as the topmost group; an open group of it is replaced."""
    project = QgsProject.instance()
    _remove_groups(project, FARM_PROPERTY, path)
    group = project.layerTreeRoot().insertGroup(0, Path(path).stem)
    group.setCustomProperty(FARM_PROPERTY, str(path))
    layers = [QgsVectorLayer(source, name, "ogr") for source, name in sources(path)]
    for layer in layers:
        layer.loadDefaultStyle()
        project.addMapLayer(layer, addToLegend=False)
        node = QgsLayerTreeLayer(layer)
        name_node(node)
        group.addChildNode(node)
        node.setItemVisibilityChecked(layer.name() in FARM_LAYERS)
        node.setExpanded(False)
    return layers


def field_layers(folder: Path) -> Iterator[QgsVectorLayer]:
    """The vector layers of a run's GeoPackage one by one, each in the style stored with it."""
    path = product(folder, FIELD_FILE)
    found = QgsProviderRegistry.instance().querySublayers(str(path)) if path.is_file() else []
    for details in found:
        if details.name() == "layer_styles":
            continue
        layer = QgsVectorLayer(details.uri(), details.name(), details.providerKey())
        layer.loadDefaultStyle()  # again: a new layer takes the symbols of its style, but not the temporal settings
        load_style_of_language(layer)
        if layer.name() == "coverage":
            fill_worked(layer)
        if layer.name() in MEASURED_LAYERS:
            layer.elevationProperties().setClamping(Qgis.AltitudeClamping.Absolute)
        if layer.name() == "trajectory" and "tool_path" in {other.name() for other in found}:
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
