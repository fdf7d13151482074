# SPDX-License-Identifier: GPL-2.0-or-later
"""Names of layers and legend labels of rasters in the user's language."""

import re

from qgis.core import (
    QgsColorRampShader,
    QgsLayerTreeLayer,
    QgsMapLayerLegendUtils,
    QgsRasterLayer,
    QgsSingleBandPseudoColorRenderer,
)
from qgis.PyQt.QtCore import QT_TRANSLATE_NOOP, QCoreApplication

COLOUR_LABELS = (
    QT_TRANSLATE_NOOP("Legends", "1.2 m and more"),
    QT_TRANSLATE_NOOP("Legends", "2 m and more"),
    QT_TRANSLATE_NOOP("Legends", "none: turns alone"),
    QT_TRANSLATE_NOOP("Legends", "4 and more"),
)
"""Labels of colours in the styles of rasters, other than numbers with units."""
BAND_LABELS = {
    "change": QT_TRANSLATE_NOOP("Legends", "Height change (m)"),
    "swaths": QT_TRANSLATE_NOOP("Legends", "Height difference of swaths (mm)"),
    "dsm": QT_TRANSLATE_NOOP("Legends", "Relief after the work"),
    "dsm_before": QT_TRANSLATE_NOOP("Legends", "Relief before the work"),
    "dtm": QT_TRANSLATE_NOOP("Legends", "Relief of the ground"),
    "height_above_ground": QT_TRANSLATE_NOOP("Legends", "Height above ground (m)"),
    "density": QT_TRANSLATE_NOOP("Legends", "Points a square metre"),
    "strip_overlap": QT_TRANSLATE_NOOP("Legends", "Number of strips"),
    "crop_height": QT_TRANSLATE_NOOP("Legends", "Height of the crop (m)"),
}
WITHOUT_WORK = {
    "Relief after the work": QT_TRANSLATE_NOOP("Legends", "Relief"),
    "Surface after the work": QT_TRANSLATE_NOOP("Legends", "Surface"),
}
"""What labels are where no tool worked."""
LAYER_LABELS = {
    "trajectory": QT_TRANSLATE_NOOP("Legends", "Positions of the vehicle"),
    "events": QT_TRANSLATE_NOOP("Legends", "Events of the drive"),
    "tool_path": QT_TRANSLATE_NOOP("Legends", "Cultivated path"),
    "coverage": QT_TRANSLATE_NOOP("Legends", "Worked ground"),
    "passes": QT_TRANSLATE_NOOP("Legends", "Passes of the tool"),
    "overlaps": QT_TRANSLATE_NOOP("Legends", "Ground worked twice"),
    "misses": QT_TRANSLATE_NOOP("Legends", "Missed ground"),
    "unworked": QT_TRANSLATE_NOOP("Legends", "Ground not worked"),
    "boundary": QT_TRANSLATE_NOOP("Legends", "Boundary of the field"),
    "zones": QT_TRANSLATE_NOOP("Legends", "Headland and body"),
    "parcels": QT_TRANSLATE_NOOP("Legends", "Parcels of the trial"),
    "strips": QT_TRANSLATE_NOOP("Legends", "Strips of the flight"),
    "strip_differences": QT_TRANSLATE_NOOP("Legends", "Differences of strips"),
    "change": QT_TRANSLATE_NOOP("Legends", "Change of the surface"),
    "dsm": QT_TRANSLATE_NOOP("Legends", "Surface after the work"),
    "dsm_before": QT_TRANSLATE_NOOP("Legends", "Surface before the work"),
    "dtm": QT_TRANSLATE_NOOP("Legends", "Surface of the ground"),
    "height_above_ground": QT_TRANSLATE_NOOP("Legends", "Height above ground"),
    "cloud": QT_TRANSLATE_NOOP("Legends", "Point cloud of the run"),
    "orthophoto": QT_TRANSLATE_NOOP("Legends", "Orthophoto"),
    "swaths": QT_TRANSLATE_NOOP("Legends", "Differences of swaths"),
    "density": QT_TRANSLATE_NOOP("Legends", "Point density"),
    "strip_overlap": QT_TRANSLATE_NOOP("Legends", "Overlap of strips"),
    "crop_height": QT_TRANSLATE_NOOP("Legends", "Height of the crop"),
    "slope": QT_TRANSLATE_NOOP("Legends", "Slope"),
    "roughness": QT_TRANSLATE_NOOP("Legends", "Roughness"),
    "low_spots": QT_TRANSLATE_NOOP("Legends", "Low spots"),
    "growth": QT_TRANSLATE_NOOP("Legends", "Growth of the crop"),
    "canopy_height": QT_TRANSLATE_NOOP("Legends", "Height of the canopy"),
    "fields": QT_TRANSLATE_NOOP("Legends", "Fields"),
    "visits": QT_TRANSLATE_NOOP("Legends", "Work of each session"),
    "seasons": QT_TRANSLATE_NOOP("Legends", "Work of each season"),
    "machines": QT_TRANSLATE_NOOP("Legends", "Machines"),
    "sessions": QT_TRANSLATE_NOOP("Legends", "Sessions"),
    "tracks": QT_TRANSLATE_NOOP("Legends", "Paths of the vehicle"),
    "provenance": QT_TRANSLATE_NOOP("Legends", "Reports and settings of the sessions"),
}
"""Names in the layer panel; the layers keep those of the products."""
CHANGE_OF_DATES = re.compile(r"change_(\d+)_(\d+)")
"""Name of the change between two dates of a field."""


def name_node(node: QgsLayerTreeLayer, *, worked: bool = True) -> None:
    """Show a layer under its title in the layer panel; `worked` tells whether a tool worked the ground."""
    label = LAYER_LABELS.get(node.layer().name())
    dates = CHANGE_OF_DATES.fullmatch(node.layer().name())
    if label:
        node.setUseLayerName(False)
        label = label if worked else WITHOUT_WORK.get(label, label)
        node.setName(QCoreApplication.translate("Legends", label))
    elif dates:
        node.setUseLayerName(False)
        words = QCoreApplication.translate("Legends", "Change from date {earlier} to date {later}")
        node.setName(words.format(earlier=int(dates[1]), later=int(dates[2])))


def shown_name(layer: str) -> str:
    """The title of a product's layer in the panel and in legends; other layers keep their names."""
    return QCoreApplication.translate("Legends", LAYER_LABELS[layer]) if layer in LAYER_LABELS else layer


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
    label = BAND_LABELS.get(node.layer().name())
    if label:
        label = label if worked else WITHOUT_WORK.get(label, label)
        QgsMapLayerLegendUtils.setLegendNodeUserLabel(node, 0, QCoreApplication.translate("Legends", label))
