# SPDX-License-Identifier: GPL-2.0-or-later
"""The products of a run as QGIS layers: styled, in a group of the session, in the time of the day they were made."""

import json
from pathlib import Path

from qgis.core import (
    QgsDateTimeRange,
    QgsPointCloudLayer,
    QgsProject,
    QgsProviderRegistry,
    QgsRasterLayer,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QCoreApplication, QDateTime, Qt

from .styles import (
    show_as_change,
    show_as_surface,
    show_by_class,
    stand_on_terrain,
)

REPORT = "report.json"
FIELD_LAYERS = "field.gpkg"
CLOUD = "cloud.copc.laz"
SURFACES = ("change.tif", "dsm.tif", "dsm_before.tif")
SHOWN = ("events", "misses", "overlaps", "tool_path", "coverage", "passes", "zones", "trajectory", "change", "dsm")
"""What a map shows at first; the rest is a click away."""


class NoResultsError(Exception):
    """A folder without anything that a run writes, or with products that QGIS cannot read."""


def open_results(folder, project=None):
    """Open the products in `folder` as a group of a project, the current one by default.

    Products of the same folder that are open already are replaced, so that a run done again shows its new result.

    Returns:
        The layers, topmost first: the field's vectors above the surfaces above the cloud.

    Raises:
        NoResultsError: if there is nothing to open.
    """
    folder = Path(folder)
    found = [*field_layers(folder), *surface_layers(folder), *cloud_layers(folder)]
    layers = [layer for layer in found if layer.isValid()]
    if not layers:
        raise NoResultsError(
            tr("No {products} that QGIS can open in {folder}. Choose the folder of a run.").format(
                products=f"{FIELD_LAYERS}, {', '.join(SURFACES)} or {CLOUD}", folder=folder
            )
        )
    project = QgsProject.instance() if project is None else project
    empty = not project.mapLayers()
    root = project.layerTreeRoot()
    for group in [group for group in root.findGroups() if group.customProperty("furrowmap/folder") == str(folder)]:
        project.removeMapLayers(group.findLayerIds())
        root.removeChildNode(group)
    report = read_report(folder)
    group = root.insertGroup(0, session_name(report, folder))
    group.setCustomProperty("furrowmap/folder", str(folder))
    for layer in layers:
        project.addMapLayer(layer, addToLegend=False)
        node = group.addLayer(layer)
        node.setItemVisibilityChecked(layer.name() in SHOWN)
        node.setExpanded(False)
    if empty:  # a project with layers has a CRS of its user's choice
        project.setCrs(layers[0].crs())
    stand_on_terrain(project, layers)
    play_day(project, report)
    return layers


def field_layers(folder):
    """The vector layers of a run's GeoPackage, each in the style stored with it."""
    path = Path(folder) / FIELD_LAYERS
    found = QgsProviderRegistry.instance().querySublayers(str(path)) if path.is_file() else []
    tables = (details for details in found if details.name() != "layer_styles")
    layers = [QgsVectorLayer(details.uri(), details.name(), details.providerKey()) for details in tables]
    for layer in layers:
        layer.loadDefaultStyle()  # again: at its birth a layer takes the symbols of its style, but not its times
    return layers


def surface_layers(folder):
    """The surfaces of a run: what was changed in colours over the hillshade of the surface as left."""
    layers = []
    for name in SURFACES:
        path = Path(folder) / name
        if path.is_file():
            layer = QgsRasterLayer(str(path), path.stem, "gdal")
            if layer.isValid():
                (show_as_change if path.stem == "change" else show_as_surface)(layer)
            layers.append(layer)
    return layers


def cloud_layers(folder):
    """The cloud of a run, if it is there, coloured by class."""
    path = Path(folder) / CLOUD
    if not path.is_file():
        return []
    layer = QgsPointCloudLayer(str(path), "cloud", "copc")
    if layer.isValid():
        show_by_class(layer)
    return [layer]


def read_report(folder):
    """The content of `report.json`; empty where there is none that can be read."""
    try:
        report = json.loads((Path(folder) / REPORT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return report if isinstance(report, dict) else {}


def session_name(report, folder):
    """The session's name, else the folder's."""
    session = report.get("session")
    return (session.get("name") if isinstance(session, dict) else None) or Path(folder).name


def play_day(project, report):
    """Give the project the time of the session, so that the temporal controller replays it."""
    figures = report.get("figures")
    if not isinstance(figures, dict) or not figures.get("start") or not figures.get("end"):
        return
    start, end = (QDateTime.fromString(figures[key], Qt.DateFormat.ISODateWithMs) for key in ("start", "end"))
    if not (start.isValid() and end.isValid()):
        return
    known = project.timeSettings().temporalRange()
    if known.begin().isValid() and known.end().isValid():
        start, end = min(start, known.begin()), max(end, known.end())
    project.timeSettings().setTemporalRange(QgsDateTimeRange(start, end))


def tr(text):
    """`text` in the user's language."""
    return QCoreApplication.translate("Results", text)
