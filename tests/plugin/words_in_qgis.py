"""Runs inside QGIS in Japanese: opens a result by the plugin, and prints all words that people read of its layers.

The arguments are the folder with the plugin and the result folder.
"""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path
from typing import Any

from qgis.core import (
    QgsApplication,
    QgsExpression,
    QgsExpressionContext,
    QgsExpressionContextUtils,
    QgsProject,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QLocale

plugin, result = (Path(word) for word in sys.argv[1:])
application = QgsApplication([], True)
application.initQgis()
QgsApplication.setLocale(QLocale("ja_JP"))
sys.path.insert(0, str(plugin.parent))
translator = importlib.import_module("furrowmap.translation").install_translator(QgsApplication.locale())
results, legends = (importlib.import_module(f"furrowmap.{name}") for name in ("results", "legends"))


def words_of(layer: QgsVectorLayer) -> dict[str, list[str]]:
    """Names of fields, words for values, labels of categories, and the map tip of each feature."""
    renderer = layer.renderer()
    setups = [layer.editorWidgetSetup(k) for k in range(layer.fields().count())]
    maps: list[Any] = [setup.config()["map"] for setup in setups if setup.type() == "ValueMap"]
    tips = []
    for feature in layer.getFeatures():
        context = QgsExpressionContext(QgsExpressionContextUtils.globalProjectLayerScopes(layer))
        context.setFeature(feature)
        tips.append(QgsExpression.replaceExpressionText(layer.mapTipTemplate(), context))
    return {
        "fields": [field.alias() for field in layer.fields() if field.name() != "fid"],
        "values": [word for one in maps for pair in one for word in pair],
        "categories": [one.label() for one in renderer.categories()] if hasattr(renderer, "categories") else [],
        "map tips": tips,
    }


project = QgsProject.instance()
results.open_results(result, project)
nodes = project.layerTreeRoot().findLayers()
words = {node.layer().name(): {"name": [node.name()], **words_of(node.layer())} for node in nodes}
names = [legends.shown_name(Path(name).stem) for name in results.SURFACES]
sys.stdout.write("\n" + json.dumps({"layers": words, "surfaces": names}) + "\n")
del nodes
project.clear()
application.exitQgis()
