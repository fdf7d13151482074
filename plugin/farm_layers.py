# SPDX-License-Identifier: GPL-2.0-or-later
"""A farm map as a group of layers."""

from pathlib import Path

from qgis.core import QgsLayerTreeLayer, QgsProject, QgsVectorLayer

from .legends import name_node
from .processing.loading import sources

FARM_PROPERTY = "furrowmap/farmMap"
"""Property of a group in the layer tree: the file of the farm map whose layers it has."""


def open_farm_map(path, project=None):
    """Open the layers of a farm map in their styles, as a group on top of the others; an open group is replaced.

    Returns:
        The layers.
    """
    project = QgsProject.instance() if project is None else project
    root = project.layerTreeRoot()
    for old in root.findGroups():
        if old.customProperty(FARM_PROPERTY) == str(path):
            project.removeMapLayers(old.findLayerIds())
            root.removeChildNode(old)
    group = root.insertGroup(0, Path(path).stem)
    group.setCustomProperty(FARM_PROPERTY, str(path))
    layers = [QgsVectorLayer(source, name, "ogr") for source, name in sources(path)]
    for layer in layers:
        layer.loadDefaultStyle()
        project.addMapLayer(layer, addToLegend=False)
        node = QgsLayerTreeLayer(layer)
        name_node(node)
        group.addChildNode(node)
    return layers
