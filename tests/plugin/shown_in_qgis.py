"""Runs inside QGIS in Japanese: opens results by the plugin, farm maps and projects, and prints what people read there.

The arguments are the folder with the plugin, and result folders, farm maps (.gpkg) and projects (.qgs). The answer has
the words of each layer, and of a result its figures in the dock and the texts of its print layout.
"""

from __future__ import annotations

import importlib
import json
import sys
from itertools import islice
from pathlib import Path
from typing import Any

from qgis.core import (
    QgsApplication,
    QgsExpression,
    QgsExpressionContext,
    QgsExpressionContextUtils,
    QgsLayoutItemLabel,
    QgsLayoutItemLegend,
    QgsProject,
    QgsRasterLayer,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QLocale, QMetaType

MOST = 40
"""Features of a layer."""
USERS = {"id", "treatment", "name", "folder", "session", "machine", "tool", "coordinates", "heights"}
"""Fields whose texts are the user's, or words of session files."""
plugin, *places = (Path(word) for word in sys.argv[1:])
application = QgsApplication([], True)
application.initQgis()
QgsApplication.setLocale(QLocale("ja_JP"))
sys.path.insert(0, str(plugin.parent))
translator = importlib.import_module("furrowmap.translation").install_translator(QgsApplication.locale())
results, figures, printing = (
    importlib.import_module(f"furrowmap.{name}") for name in ("results", "figures", "session_layout")
)


def words_of(layer: Any) -> dict[str, list[str]]:
    """Labels of the legend; of vectors names of fields, words for values, and the map tips of features."""
    renderer = layer.renderer()
    legend = [label for label, _ in renderer.legendSymbologyItems()] if isinstance(layer, QgsRasterLayer) else []
    if not isinstance(layer, QgsVectorLayer):
        return {"legend": legend}
    setups = [layer.editorWidgetSetup(k) for k in range(layer.fields().count())]
    maps: list[Any] = [setup.config()["map"] for setup in setups if setup.type() == "ValueMap"]
    texts = [k for k, field in enumerate(layer.fields()) if field.type() == QMetaType.Type.QString]
    formatter = QgsApplication.fieldFormatterRegistry().fieldFormatter
    tips, cells = [], set()
    for feature in islice(layer.getFeatures(), MOST):
        for k in (k for k in texts if feature.attribute(k)):
            setup = setups[k]
            shown = formatter(setup.type()).representValue(layer, k, setup.config(), None, feature.attribute(k))
            cells.add((layer.fields()[k].name(), shown))
        context = QgsExpressionContext(QgsExpressionContextUtils.globalProjectLayerScopes(layer))
        context.setFeature(feature)
        tips.append(QgsExpression.replaceExpressionText(layer.mapTipTemplate(), context))
    return {
        "fields": [field.alias() for field in layer.fields() if field.name() != "fid"],
        "values": [word for one in maps for pair in one for word in pair],
        "legend": [one.label() for kind in ("categories", "ranges") for one in getattr(renderer, kind, list)()],
        "map tips": tips,
        "cells": [shown for name, shown in sorted(cells) if name not in USERS],
    }


def printed(project: QgsProject, report: dict[str, Any]) -> list[str]:
    """Texts of the layout, on its overview and on the pages of its atlas."""
    layout = printing.session_layout(project, results.groups_of(project)[0], report)
    items = layout.items()
    texts = [item.currentText() for item in items if isinstance(item, QgsLayoutItemLabel)]
    trees = [item.model().rootGroup() for item in items if isinstance(item, QgsLayoutItemLegend)]
    texts += [node.name() for tree in trees for node in tree.findLayers()]
    atlas = layout.atlas()
    if atlas.coverageLayer() is not None:
        atlas.setEnabled(True)
        atlas.beginRender()
        while atlas.next():
            texts += [item.currentText() for item in items if isinstance(item, QgsLayoutItemLabel)]
        atlas.endRender()
    return texts


def shown(place: Path) -> dict[str, Any]:
    project = QgsProject.instance()
    project.clear()
    more: dict[str, Any] = {}
    if place.suffix == ".qgs":
        assert project.read(str(place))
    elif place.suffix == ".gpkg":
        results.open_farm_map(place)
    else:
        results.open_results(place, project)
        report = results.read_report(place)
        rows = [list(row) for row in figures.figure_rows(report)]
        more = {"figures": rows, "print": printed(project, report)}
    nodes = project.layerTreeRoot().findLayers()
    layers = {node.layer().id(): node for node in nodes}
    named = {
        node.layer().customProperty("furrowmap/key") if place.is_dir() else key: node for key, node in layers.items()
    }
    return {"layers": {key: {"name": [node.name()], **words_of(node.layer())} for key, node in named.items()}, **more}


answer = [shown(place) for place in places]
sys.stdout.write("\n" + json.dumps(answer) + "\n")
QgsProject.instance().clear()
application.exitQgis()
