# SPDX-License-Identifier: GPL-2.0-or-later
"""The products of a run as QGIS layers: styled, in a group of the session, with their time span."""

from functools import partial
from pathlib import Path

from qgis.core import (
    Qgis,
    QgsDateTimeRange,
    QgsLayerTreeLayer,
    QgsPointCloudLayer,
    QgsProject,
    QgsProviderRegistry,
    QgsRasterLayer,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QCoreApplication, QDateTime, Qt

from .legends import label_band, name_node, translate_categories
from .previews import remove_previews
from .products import product, read_object
from .styles import hatch, set_terrain, show_as_change, show_as_surface, show_by_class

tr = partial(QCoreApplication.translate, "Results")

REPORT = "report.json"
FIELD_LAYERS = "field.gpkg"
CLOUD = "cloud.copc.laz"
SURFACES = (
    *("change.tif", "swaths.tif", "height_above_ground.tif", "strip_overlap.tif", "density.tif"),
    *("orthophoto.tif", "dsm.tif", "dsm_before.tif", "dtm.tif"),
)
PICTURE = "orthophoto"
COLOURED = ("change", "swaths", "height_above_ground", "strip_overlap", "density")
"""Rasters in colours, which lie above the hillshade."""
SHOWN = (
    *("events", "misses", "unworked", "boundary", "overlaps", "tool_path", "coverage", "passes", "zones"),
    *("plants", "lines", "planes", "trajectory", "change", "orthophoto", "dsm"),
)
"""Layers that are visible at first."""
MEASURED = ("trajectory", "events", "tool_path")
"""Layers with measured heights, which profiles and 3D views use as they are."""
TRAJECTORY_MIN_SCALE = 2000.0
"""At smaller scales the trajectory's points hide the passes and draw slowly; `tool_path` shows the path."""
FOLDER_PROPERTY = "furrowmap/folder"
"""Property of a group in the layer tree: the folder of the run whose layers it has."""


class NoResultsError(Exception):
    """The folder has no products that QGIS can read."""


def open_results(folder, project=None):
    """Open the products in `folder` as a group of a project, the current one by default.

    Layers of the same folder that are open already are replaced.

    Returns:
        The layers, topmost first: the field's vectors above the surfaces above the cloud.

    Raises:
        NoResultsError: if there is nothing to open.
    """
    steps = opening(folder, project)
    while True:
        try:
            next(steps)
        except StopIteration as done:
            return done.value


def opening(folder, project=None):
    """As :func:`open_results`, in steps that are short enough for the main thread.

    A generator that yields None and returns the layers. The project does not change before all files are open.
    """
    folder = Path(folder)
    project = QgsProject.instance() if project is None else project
    layers = []
    for layer in _files_opened(folder):
        if layer.isValid():
            layers.append(layer)
        yield
    if any(layer.name() == "change" for layer in layers):
        for layer in layers:
            if layer.name() == "passes":
                hatch(layer)
    if not layers:
        raise NoResultsError(
            tr("{folder} has no {products} that QGIS can open. Choose the folder of a run.").format(
                products=f"{FIELD_LAYERS}, {', '.join(SURFACES)} or {CLOUD}", folder=folder
            )
        )
    report = read_report(folder)
    empty = all(layer.customProperty("furrowmap/basemap") for layer in project.mapLayers().values())
    if empty:  # a project with layers keeps its CRS
        project.setCrs(layers[0].crs())
    for old in groups_of(project, folder):
        project.removeMapLayers(old.findLayerIds())
        project.layerTreeRoot().removeChildNode(old)
    remove_previews(project, report)
    yield
    group = project.layerTreeRoot().insertGroup(0, session_name(report, folder))
    group.setCustomProperty(FOLDER_PROPERTY, str(folder))
    for layer in layers:
        project.addMapLayer(layer, addToLegend=False)
        node = QgsLayerTreeLayer(layer)
        label_band(node)
        name_node(node)
        group.addChildNode(node)
        node.setItemVisibilityChecked(layer.name() in SHOWN)
        node.setExpanded(False)
        yield
    set_terrain(project, layers)
    set_time_range(project, report)
    return layers


def groups_of(project, folder=None):
    """The groups in the layer tree with the layers of a run: of that folder, or of any."""
    groups = project.layerTreeRoot().findGroups()
    opened = [(group, group.customProperty(FOLDER_PROPERTY)) for group in groups]
    return [group for group, of in opened if of and (folder is None or of == str(folder))]


def _files_opened(folder):
    yield from field_layers(folder)
    yield from surface_layers(folder)
    yield from cloud_layers(folder)


def field_layers(folder):
    """The vector layers of a run's GeoPackage one by one, each in the style stored with it."""
    path = product(folder, FIELD_LAYERS)
    found = QgsProviderRegistry.instance().querySublayers(str(path)) if path.is_file() else []
    for details in found:
        if details.name() == "layer_styles":
            continue
        layer = QgsVectorLayer(details.uri(), details.name(), details.providerKey())
        layer.loadDefaultStyle()  # again: a new layer takes the symbols of its style, but not the temporal settings
        translate_categories(layer)
        if layer.name() in MEASURED:
            layer.elevationProperties().setClamping(Qgis.AltitudeClamping.Absolute)
        if layer.name() == "trajectory" and "tool_path" in {other.name() for other in found}:
            layer.setMinimumScale(TRAJECTORY_MIN_SCALE)
            layer.setScaleBasedVisibility(True)
        yield layer


def surface_layers(folder):
    """The surfaces of a run one by one: the change in colours, above the hillshade of the DSM."""
    for name in SURFACES:
        path = product(folder, name)
        if not path.is_file():
            continue
        layer = QgsRasterLayer(str(path), path.stem, "gdal")
        if layer.isValid():
            styled = path.with_suffix(".qml").is_file()  # QGIS has loaded that style already
            if path.stem != PICTURE:
                (show_as_change if path.stem in COLOURED else show_as_surface)(layer, styled=styled)
        yield layer


def cloud_layers(folder):
    """The point cloud of a run, if there is one, coloured by class, in 3D as well."""
    path = product(folder, CLOUD)
    if path.is_file():
        layer = QgsPointCloudLayer(str(path), "cloud", "copc")
        if layer.isValid():
            show_by_class(layer)
        yield layer


def read_report(folder):
    """The content of `report.json`; empty if it cannot be read."""
    return read_object(product(folder, REPORT))


def session_name(report, folder):
    """The session's name, else the folder's."""
    session = report.get("session")
    return (session.get("name") if isinstance(session, dict) else None) or Path(folder).name


def set_time_range(project, report):
    """Extend the project's time range to the session's, for the temporal controller."""
    span = time_span(report)
    if span is None:
        return
    start, end = span
    known = project.timeSettings().temporalRange()
    if known.begin().isValid() and known.end().isValid():
        start, end = min(start, known.begin()), max(end, known.end())
    project.timeSettings().setTemporalRange(QgsDateTimeRange(start, end))


def time_span(report):
    """Start and end of the drive; None if the report has none."""
    figures = report.get("figures")
    texts = [str(figures.get(key)) for key in ("start", "end")] if isinstance(figures, dict) else []
    times = [QDateTime.fromString(text, Qt.DateFormat.ISODateWithMs) for text in texts]
    return times if times and all(time.isValid() for time in times) else None
