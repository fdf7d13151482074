"""Runs inside QGIS: what it shows of the words in the styles of a `field.gpkg`, as lines of text.

The argument is the GeoPackage. First the names of the fields of passes, then a value of each formatted field, then the
actions with their addresses.
"""

from __future__ import annotations

import sys

from qgis.core import QgsApplication, QgsExpression, QgsVectorLayer

application = QgsApplication([], False)
application.initQgis()


def shown(layer: QgsVectorLayer, name: str) -> str:
    number = layer.fields().indexOf(name)
    setup, feature = layer.editorWidgetSetup(number), next(layer.getFeatures())
    formatter = QgsApplication.fieldFormatterRegistry().fieldFormatter(setup.type())
    return str(formatter.representValue(layer, number, setup.config(), None, feature[name]))


passes, events = (QgsVectorLayer(f"{sys.argv[1]}|layername={name}", name, "ogr") for name in ("passes", "events"))
sys.stdout.write("\n" + "; ".join(passes.attributeDisplayName(number) for number in range(len(passes.fields()))))
sys.stdout.write("\n" + f"{shown(passes, 'area_m2')}; {shown(events, 'kind')}")
for action in passes.actions().actions():
    context = passes.createExpressionContext()
    sys.stdout.write("\n" + f"{action.name()}; {QgsExpression.replaceExpressionText(action.command(), context)}")
del passes, events
application.exitQgis()
