"""Runs inside QGIS: says of layers whether and by which field they take part in time, and how many colours they have.

The first argument is a GeoPackage, the others are names of its layers; without any it is `trajectory`.
"""

from __future__ import annotations

import sys

from qgis.core import QgsApplication, QgsVectorLayer

application = QgsApplication([], False)
application.initQgis()
for name in sys.argv[2:] or ["trajectory"]:
    layer = QgsVectorLayer(f"{sys.argv[1]}|layername={name}", name, "ogr")
    layer.loadDefaultStyle()  # as QGIS does for every layer that is added to its map
    temporal = layer.temporalProperties()
    renderer = layer.renderer()
    colours = len(renderer.categories()) if renderer.type() == "categorizedSymbol" else 1
    found = (temporal.isActive(), temporal.startField() or "-", temporal.mode().name, colours)
    sys.stdout.write(" ".join(map(str, found)) + "\n")
    del temporal, renderer, layer
application.exitQgis()
