"""Runs inside QGIS: says whether a layer takes part in time, by which field, and how many colours its style has."""

from __future__ import annotations

import sys

from qgis.core import QgsApplication, QgsVectorLayer

application = QgsApplication([], False)
application.initQgis()
layer = QgsVectorLayer(f"{sys.argv[1]}|layername=trajectory", "trajectory", "ogr")
layer.loadDefaultStyle()  # as QGIS does for every layer that is added to its map
temporal = layer.temporalProperties()
found = (temporal.isActive(), temporal.startField(), temporal.mode().name, len(layer.renderer().categories()))
sys.stdout.write(" ".join(map(str, found)) + "\n")
del temporal, layer
application.exitQgis()
