# SPDX-License-Identifier: GPL-2.0-or-later
"""The products of a run as QGIS layers."""

from pathlib import Path

from qgis.core import QgsPointCloudLayer, QgsProject, QgsProviderRegistry, QgsVectorLayer

FIELD_LAYERS = "field.gpkg"
CLOUD = "cloud.copc.laz"


class NoResultsError(Exception):
    """A folder without anything that a run writes, or with products that QGIS cannot read."""


def open_results(folder, project=None):
    """Open the products in `folder` as a group of a project, the current one by default.

    Returns:
        The layers, topmost first: the field's vector layers above the cloud.

    Raises:
        NoResultsError: if there is nothing to open.
    """
    layers = [layer for layer in (*field_layers(folder), *cloud_layers(folder)) if layer.isValid()]
    if not layers:
        raise NoResultsError(
            f"No {FIELD_LAYERS} or {CLOUD} that QGIS can open in {folder}. Choose the folder of a run."
        )
    project = project or QgsProject.instance()
    group = project.layerTreeRoot().insertGroup(0, Path(folder).name)
    for layer in layers:
        project.addMapLayer(layer, addToLegend=False)
        group.addLayer(layer)
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


def cloud_layers(folder):
    """The cloud of a run, if it is there."""
    path = Path(folder) / CLOUD
    return [QgsPointCloudLayer(str(path), "cloud", "copc")] if path.is_file() else []
