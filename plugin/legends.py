# SPDX-License-Identifier: GPL-2.0-or-later
"""Names of layers and legend labels of rasters in the user's language."""

import json
import re
from pathlib import Path

from qgis.core import (
    QgsColorRampLegendNodeSettings,
    QgsColorRampShader,
    QgsLayerTreeLayer,
    QgsMapLayerLegendUtils,
    QgsRasterLayer,
    QgsSingleBandPseudoColorRenderer,
)
from qgis.PyQt.QtCore import QCoreApplication

from .own_layers import key_of

LABELS = json.loads(Path(__file__).with_name("legends.json").read_text(encoding="utf-8"))
"""Names in the layer panel and labels of raster bands, by the names of layers; what both are where no tool worked;
labels of colours in the styles of rasters, other than numbers with units; classes of points with their colours; colours
of rasters without a style of their own."""
CHANGE_OF_DATES = re.compile(r"change_(\d+)_(\d+)")
"""Name of the change between two dates of a field."""


OF_PREVIEWS = {"preview_track": "trajectory", "preview_dsm": "dsm"}
"""Layers of a preview, and those of a run that they are named after."""


def title_of(key: str, *, worked: bool = True) -> str:
    """The name of a product's layer, by its key; `worked` tells whether a tool worked the ground.

    What has no title keeps its key.
    """
    label = LABELS["layers"].get(OF_PREVIEWS.get(key, key))
    dates = CHANGE_OF_DATES.fullmatch(key)
    if label:
        label = label if worked else LABELS["without_work"].get(label, label)
        return QCoreApplication.translate("Legends", label)
    if dates:
        words = QCoreApplication.translate("Legends", "Change from date {earlier} to date {later}")
        return words.format(earlier=int(dates[1]), later=int(dates[2]))
    return key


def translate_colours(layer: QgsRasterLayer) -> None:
    """Translate the labels of a raster's colours; a continuous legend has those of its ends, with their unit.

    Without labels of its own QGIS writes the raster's numbers there, which may be in another unit than the title.
    """
    renderer = layer.renderer()
    if not isinstance(renderer, QgsSingleBandPseudoColorRenderer):
        return
    ramp = renderer.shader().rasterShaderFunction()
    items = [
        QgsColorRampShader.ColorRampItem(item.value, item.color, QCoreApplication.translate("Legends", item.label))
        for item in ramp.colorRampItemList()
    ]
    ramp.setColorRampItemList(items)
    if items and ramp.colorRampType() == QgsColorRampShader.Type.Interpolated:
        ends = QgsColorRampLegendNodeSettings(ramp.legendSettings())
        ends.setMinimumLabel(items[0].label)
        ends.setMaximumLabel(items[-1].label)
        ramp.setLegendSettings(ends)


def label_band(node: QgsLayerTreeLayer, *, worked: bool = True) -> None:
    """Label a raster's legend with what its colours mean, instead of the name of its band.

    Call this before the layer panel shows the node, since that builds the legend at once.
    """
    label = LABELS["bands"].get(key_of(node.layer()))
    if label:
        label = label if worked else LABELS["without_work"].get(label, label)
        QgsMapLayerLegendUtils.setLegendNodeUserLabel(node, 0, QCoreApplication.translate("Legends", label))
