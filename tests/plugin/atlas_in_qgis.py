"""Runs inside QGIS: the atlas of a session's print layout, and its overview, as PDF.

The arguments are the folder with the plugin, the result folder and the folder for the PDFs.
"""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path

from qgis.core import (
    Qgis,
    QgsApplication,
    QgsField,
    QgsLayoutExporter,
    QgsLayoutItem,
    QgsLayoutItemPage,
    QgsProject,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QMetaType

plugin, result, out = (Path(word) for word in sys.argv[1:])
application = QgsApplication([], True)
application.initQgis()
sys.path.insert(0, str(plugin.parent))
own_layers = importlib.import_module("furrowmap.own_layers")
printing = importlib.import_module("furrowmap.session_layout")
project = QgsProject.instance()
group = project.layerTreeRoot().addGroup("North field")
for name in ("trajectory", "passes", "coverage"):
    layer = QgsVectorLayer(f"{result / 'field.gpkg'}|layername={name}", name, "ogr")
    project.addMapLayer(layer, False)
    group.addLayer(layer)
    own_layers.mark(layer, name)
    project.setCrs(layer.crs())
layout = printing.session_layout(project, group, json.loads((result / "report.json").read_text(encoding="utf-8")))
settings = QgsLayoutExporter.PdfExportSettings()
settings.textRenderFormat = Qgis.TextRenderFormat.AlwaysText
written = [QgsLayoutExporter(layout).exportToPdf(str(out / "page.pdf"), settings)]
layout.atlas().setEnabled(True)
written.append(QgsLayoutExporter.exportToPdf(layout.atlas(), str(out / "atlas.pdf"), settings)[0])
assert written == [QgsLayoutExporter.ExportResult.Success] * 2, written
passes = project.mapLayersByName("passes")[0]
passes.loadDefaultStyle()
shown = {category.label(): category.symbol().color().name() for category in passes.renderer().categories()}
boxes = []
for item in layout.items():
    if isinstance(item, QgsLayoutItem) and not isinstance(item, QgsLayoutItemPage):
        box = item.mapRectToScene(item.rect())
        boxes.append([item.displayName()[:40], box.left(), box.top(), box.right(), box.bottom()])
passes.addExpressionField("if(\"pass\" = 2, 'front', 'rear')", QgsField("tool", QMetaType.Type.QString))
atlas = printing.session_layout(project, group, {}).atlas()
atlas.setEnabled(True)
atlas.updateFeatures()
names = [atlas.nameForPage(page) for page in range(atlas.count())]
old = importlib.import_module("furrowmap.figures").figure_rows({"figures": {"start": "2026-06-11T16:23:40.937Z"}})
sys.stdout.write(
    "\n" + json.dumps({"legend": shown, "boxes": boxes, "pages of two tools": names, "old report": dict(old)})
)
del item, box, passes, atlas
project.clear()
application.exitQgis()
