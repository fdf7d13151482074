"""Runs inside QGIS: opens the project stored in a base and prints, as JSON, what QGIS makes of it.

The argument is the address of the project; its layers' passwords come from the environment.
"""

from __future__ import annotations

import json
import sys
from typing import Any

from qgis.core import (
    QgsApplication,
    QgsExpressionContextUtils,
    QgsFeature,
    QgsLayerTreeGroup,
    QgsProject,
    QgsRenderContext,
    QgsVectorLayer,
)


def colours(layer: QgsVectorLayer) -> list[str]:
    """The colour in which the map shows each feature."""
    renderer = layer.renderer()
    context = QgsRenderContext()
    context.expressionContext().appendScopes(QgsExpressionContextUtils.globalProjectLayerScopes(layer))
    renderer.startRender(context, layer.fields())
    shown = []
    for feature in layer.getFeatures():
        feature = QgsFeature(feature)
        context.expressionContext().setFeature(feature)
        symbol = renderer.symbolForFeature(feature, context)
        shown.append(symbol.color().name() if symbol else "none")
    renderer.stopRender(context)
    return shown


def describe(layer: QgsVectorLayer) -> dict[str, Any]:
    temporal = layer.temporalProperties()
    styled = QgsVectorLayer(layer.source(), "again", layer.providerType())
    styled.loadDefaultStyle()
    answer = {
        "name": layer.name(),
        "valid": layer.isValid(),
        "error": layer.error().summary(),
        "features": layer.featureCount(),
        "crs": layer.crs().authid(),
        "fields": [field.name() for field in layer.fields()],
        "unnamed": [field.name() for field in layer.fields() if not field.alias()],
        "renderer": layer.renderer().type() if layer.renderer() else None,
        "colours": colours(layer) if layer.renderer() else [],
        "labels": layer.labelsEnabled(),
        "map_tip": layer.mapTipTemplate(),
        "time": temporal.startField() if temporal.isActive() else None,
        "own_style": styled.renderer().type() if styled.renderer() else None,
        "own_time": styled.temporalProperties().isActive(),
    }
    del temporal, styled
    return answer


def table(layer_id: str) -> str:
    """Name of the table; the layer has one for people."""
    return layer_id.removeprefix("furrowmap_")


def groups(group: QgsLayerTreeGroup) -> dict[str, list[str]]:
    return {g.name(): [table(layer.layerId()) for layer in g.findLayers()] for g in group.findGroups()}


def main(address: str) -> None:
    application = QgsApplication([], False)
    application.initQgis()
    project = QgsProject.instance()
    opened = project.read(address)
    span = project.timeSettings().temporalRange()
    extent = project.viewSettings().defaultViewExtent()
    sys.stdout.write(
        json.dumps(
            {
                "opened": opened,
                "error": project.error(),
                "title": project.title(),
                "crs": project.crs().authid(),
                "groups": groups(project.layerTreeRoot()),
                "layers": {
                    table(layer.id()): describe(layer)
                    for layer in project.mapLayers().values()
                    if isinstance(layer, QgsVectorLayer)
                },
                "relations": {
                    relation.name(): relation.isValid() for relation in project.relationManager().relations().values()
                },
                "begin": span.begin().toString("yyyy-MM-dd"),
                "end": span.end().toString("yyyy-MM-dd"),
                "extent": [extent.xMinimum(), extent.yMinimum(), extent.xMaximum(), extent.yMaximum()],
            }
        )
    )
    project.clear()
    application.exitQgis()


main(sys.argv[1])
