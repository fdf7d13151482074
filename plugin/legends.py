# SPDX-License-Identifier: GPL-2.0-or-later
"""What the products' own styles call their colours, and what a raster's band is called, in the user's language."""

from qgis.core import QgsCategorizedSymbolRenderer, QgsMapLayerLegendUtils
from qgis.PyQt.QtCore import QT_TRANSLATE_NOOP, QCoreApplication

LABELS = (
    QT_TRANSLATE_NOOP("Legends", "RTK fixed"),
    QT_TRANSLATE_NOOP("Legends", "RTK float"),
    QT_TRANSLATE_NOOP("Legends", "PPP"),
    QT_TRANSLATE_NOOP("Legends", "differential"),
    QT_TRANSLATE_NOOP("Legends", "single"),
    QT_TRANSLATE_NOOP("Legends", "other, or from a file"),
    QT_TRANSLATE_NOOP("Legends", "tool lowered"),
    QT_TRANSLATE_NOOP("Legends", "tool lifted"),
    QT_TRANSLATE_NOOP("Legends", "tool down"),
    QT_TRANSLATE_NOOP("Legends", "tool up"),
    QT_TRANSLATE_NOOP("Legends", "stop"),
    QT_TRANSLATE_NOOP("Legends", "drives forward"),
    QT_TRANSLATE_NOOP("Legends", "drives backwards"),
    QT_TRANSLATE_NOOP("Legends", "positions end"),
    QT_TRANSLATE_NOOP("Legends", "missed between passes"),
    QT_TRANSLATE_NOOP("Legends", "missed along the boundary"),
    QT_TRANSLATE_NOOP("Legends", "headland"),
    QT_TRANSLATE_NOOP("Legends", "body of the field"),
    QT_TRANSLATE_NOOP("Legends", "other"),
    QT_TRANSLATE_NOOP("Legends", "unknown"),
)
"""Of the categories in the styles that lie in `field.gpkg`."""
BANDS = {
    "change": QT_TRANSLATE_NOOP("Legends", "Soil sunk or risen (m)"),
    "swaths": QT_TRANSLATE_NOOP("Legends", "Swaths apart in height (m)"),
    "dsm": QT_TRANSLATE_NOOP("Legends", "Relief as left at the end"),
    "dsm_before": QT_TRANSLATE_NOOP("Legends", "Relief before the work"),
}


def translate_categories(layer):
    """Tell the categories of a vector layer in the user's language."""
    renderer = layer.renderer()
    if isinstance(renderer, QgsCategorizedSymbolRenderer):
        for number, category in enumerate(renderer.categories()):
            renderer.updateCategoryLabel(number, QCoreApplication.translate("Legends", category.label()))


def tell_band(node):
    """Say in plain words what a raster's colours mean, instead of the name of its band.

    Args:
        node: of a layer in a tree. The layer panel has to see it after this, for it makes the legend at once.
    """
    label = BANDS.get(node.layer().name())
    if label:
        QgsMapLayerLegendUtils.setLegendNodeUserLabel(node, 0, QCoreApplication.translate("Legends", label))
