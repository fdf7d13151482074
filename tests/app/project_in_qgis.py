"""Runs inside QGIS: opens a project file and prints, as JSON, what QGIS makes of its layers."""

from __future__ import annotations

import json
import sys

from qgis.core import (
    QgsApplication,
    QgsCategorizedSymbolRenderer,
    QgsProject,
    QgsVectorLayer,
)

application = QgsApplication([], False)
application.initQgis()
project = QgsProject.instance()
assert project.read(sys.argv[1])
found = []
for node in project.layerTreeRoot().findLayers():
    layer = node.layer()
    renderer = layer.renderer()
    categories = renderer.categories() if isinstance(renderer, QgsCategorizedSymbolRenderer) else []
    found.append(
        {
            "name": layer.name(),
            "valid": layer.isValid(),
            "source": layer.source(),
            "crs": layer.crs().authid(),
            "renderer": renderer.type(),
            "labels": [category.label() for category in categories],
            "features": layer.featureCount() if isinstance(layer, QgsVectorLayer) else None,
            "read_only": layer.readOnly(),
            "shown": node.itemVisibilityChecked(),
        }
    )
sys.stdout.write(json.dumps({"title": project.title(), "crs": project.crs().authid(), "layers": found}) + "\n")
