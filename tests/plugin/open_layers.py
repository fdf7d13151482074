"""Runs inside QGIS: opens every layer of the files named and prints, as JSON, what QGIS makes of each."""

from __future__ import annotations

import json
import sys
from typing import Any

from qgis.core import QgsApplication, QgsPointCloudLayer, QgsProject, QgsProviderRegistry, QgsProviderSublayerDetails

KINDS = {0: "vector", 1: "raster", 4: "mesh", 6: "point cloud"}


def describe(path: str, details: Any) -> dict[str, Any]:
    options = QgsProviderSublayerDetails.LayerOptions(QgsProject.instance().transformContext())
    layer = details.toLayer(options)
    box = layer.extent()
    cloud = isinstance(layer, QgsPointCloudLayer)
    fields = (
        [a.name() for a in layer.attributes().attributes()]
        if cloud
        else [f.name() for f in getattr(layer, "fields", list)()]
    )
    return {
        "path": path,
        "name": details.name(),
        "provider": details.providerKey(),
        "valid": layer.isValid(),
        "error": layer.error().summary(),
        "crs": layer.crs().authid(),
        "kind": KINDS.get(int(layer.type().value), "other"),
        "count": layer.pointCount() if cloud else getattr(layer, "featureCount", lambda: None)(),
        "fields": fields,
        "extent": [box.xMinimum(), box.yMinimum(), box.xMaximum(), box.yMaximum()],
        "renderer": layer.renderer().type() if getattr(layer, "renderer", None) and layer.renderer() else None,
    }


def main(paths: list[str]) -> None:
    application = QgsApplication([], False)
    application.initQgis()
    found = [(path, details) for path in paths for details in QgsProviderRegistry.instance().querySublayers(path)]
    print(json.dumps([describe(path, details) for path, details in found if details.name() != "layer_styles"]))
    QgsProject.instance().clear()
    application.exitQgis()


main(sys.argv[1:])
