# SPDX-License-Identifier: GPL-2.0-or-later
"""Names of layers and legend labels of rasters in the user's language."""

import json
import re
from pathlib import Path

from qgis.core import (
    QgsColorRampShader,
    QgsLayerTreeLayer,
    QgsMapLayerLegendUtils,
    QgsRasterLayer,
    QgsSingleBandPseudoColorRenderer,
)
from qgis.PyQt.QtCore import QCoreApplication

LABELS = json.loads(Path(__file__).with_name("legends.json").read_text(encoding="utf-8"))
"""Names in the layer panel and labels of raster bands, by the names of layers; what both are where no tool worked;
labels of colours in the styles of rasters, other than numbers with units; classes of points with their colours; colours
of rasters without a style of their own."""
CHANGE_OF_DATES = re.compile(r"change_(\d+)_(\d+)")
"""Name of the change between two dates of a field."""


def name_node(node: QgsLayerTreeLayer, *, worked: bool = True) -> None:
    """Show a layer under its title in the layer panel; `worked` tells whether a tool worked the ground."""
    label = LABELS["layers"].get(node.layer().name())
    dates = CHANGE_OF_DATES.fullmatch(node.layer().name())
    if label:
        node.setUseLayerName(False)
        label = label if worked else LABELS["without_work"].get(label, label)
        node.setName(QCoreApplication.translate("Legends", label))
    elif dates:
        node.setUseLayerName(False)
        words = QCoreApplication.translate("Legends", "Change from date {earlier} to date {later}")
        node.setName(words.format(earlier=int(dates[1]), later=int(dates[2])))


def shown_name(layer: str) -> str:
    """The title of a product's layer in the panel and in legends; other layers keep their names."""
    return QCoreApplication.translate("Legends", LABELS["layers"][layer]) if layer in LABELS["layers"] else layer


def translate_colours(layer: QgsRasterLayer) -> None:
    """Translate the labels of a raster's colours."""
    renderer = layer.renderer()
    if isinstance(renderer, QgsSingleBandPseudoColorRenderer):
        ramp = renderer.shader().rasterShaderFunction()
        items = ramp.colorRampItemList()
        ramp.setColorRampItemList(
            [
                QgsColorRampShader.ColorRampItem(
                    item.value, item.color, QCoreApplication.translate("Legends", item.label)
                )
                for item in items
            ]
        )


def label_band(node: QgsLayerTreeLayer, *, worked: bool = True) -> None:
    """Label a raster's legend with what its colours mean, instead of the name of its band.

    Call this before the layer panel shows the node, since that builds the legend at once.
    """
    label = LABELS["bands"].get(node.layer().name())
    if label:
        label = label if worked else LABELS["without_work"].get(label, label)
        QgsMapLayerLegendUtils.setLegendNodeUserLabel(node, 0, QCoreApplication.translate("Legends", label))
