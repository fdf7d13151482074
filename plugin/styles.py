# SPDX-License-Identifier: GPL-2.0-or-later
"""Styles of surfaces and point clouds; the GeoPackage has the styles of its vector layers."""

from __future__ import annotations

from collections.abc import Sequence

from qgis.core import (
    QgsApplication,
    QgsColorRampShader,
    QgsFeatureRequest,
    QgsFillSymbol,
    QgsGraduatedSymbolRenderer,
    QgsHillshadeRenderer,
    QgsMapLayer,
    QgsPalLayerSettings,
    QgsPointCloudCategory,
    QgsPointCloudClassifiedRenderer,
    QgsPointCloudLayer,
    QgsProject,
    QgsRasterDemTerrainProvider,
    QgsRasterLayer,
    QgsRasterShader,
    QgsRendererRange,
    QgsSingleBandPseudoColorRenderer,
    QgsSingleSymbolRenderer,
    QgsVectorLayer,
    QgsVectorLayerSimpleLabeling,
)
from qgis.PyQt.QtCore import QCoreApplication
from qgis.PyQt.QtGui import QColor
from qgis.PyQt.QtXml import QDomDocument

from .legends import LABELS
from .own_layers import key_of

LIGHT_AZIMUTH_DEG = 315.0
LIGHT_ALTITUDE_DEG = 40.0
RELIEF_OPACITY = 0.6
"""The base map shows through the relief."""
WORKED_GROUND = "46,139,87,255"
WORKED_OPACITY = 0.75
CHANGES_M = LABELS["changes_m"]
"""Heights and colours: sunk, unchanged (transparent: the surface below is seen), risen; as the products' own style."""
COUNTS = LABELS["counts"]
"""How often ground was worked: up to a count, its colour and label."""
NOISE = 7
CLASSES = 5
BEYOND_ALL = 1e9
"""No number of a product is larger."""
UNKNOWN_COLOUR = "#d9d9d9"


def show_as_surface(layer: QgsRasterLayer, *, styled: bool = False) -> None:
    """Use a layer as elevation of profiles and 3D views; without a style it gets a hillshade."""
    layer.elevationProperties().setEnabled(True)
    layer.setOpacity(RELIEF_OPACITY)
    if styled:
        return
    renderer = QgsHillshadeRenderer(layer.dataProvider(), 1, LIGHT_AZIMUTH_DEG, LIGHT_ALTITUDE_DEG)
    renderer.setZFactor(1.0)  # with cells of 5 cm the clods of tilled soil are visible without exaggeration
    renderer.setMultiDirectional(False)
    layer.setRenderer(renderer)


def show_as_change(layer: QgsRasterLayer, *, styled: bool = False) -> None:
    """Draw a layer in the colours of its legend; without a style it gets those of :data:`CHANGES_M`."""
    if styled:
        return
    low_m = CHANGES_M[0][0]
    high_m = CHANGES_M[-1][0]
    ramp = QgsColorRampShader(low_m, high_m)
    ramp.setColorRampType(QgsColorRampShader.Type.Interpolated)
    item = QgsColorRampShader.ColorRampItem
    ramp.setColorRampItemList([item(rise_m, QColor(colour), f"{100 * rise_m:+.0f} cm") for rise_m, colour in CHANGES_M])
    renderer = set_colours(layer, ramp)
    renderer.setClassificationMin(low_m)
    renderer.setClassificationMax(high_m)


def show_as_counts(layer: QgsRasterLayer) -> None:
    """Draw how often ground was worked."""
    ramp = QgsColorRampShader(0.0, len(COUNTS) - 1)
    ramp.setColorRampType(QgsColorRampShader.Type.Discrete)
    items = [QgsColorRampShader.ColorRampItem(count, QColor(colour), label) for count, colour, label in COUNTS]
    ramp.setColorRampItemList(items)
    set_colours(layer, ramp)


def show_as_plots(layer: QgsVectorLayer) -> None:
    """Draw the outlines of the plots of a trial, with their identifiers."""
    look = {"style": "no", "outline_color": "31,42,48,255", "outline_width": "0.4"}
    layer.setRenderer(QgsSingleSymbolRenderer(QgsFillSymbol.createSimple(look)))
    label = QgsPalLayerSettings()
    label.fieldName = "id"
    layer.setLabeling(QgsVectorLayerSimpleLabeling(label))
    layer.setLabelsEnabled(True)


def show_classes(layer: QgsVectorLayer, key: str) -> None:
    """Give a layer that is coloured by a number classes, which its legend shows; the colours on the map stay.

    The style of the product has one symbol, whose colour is computed for each feature: its legend would be one colour.
    """
    facts = LABELS["classed"].get(key)
    if facts is None or not isinstance(layer.renderer(), QgsSingleSymbolRenderer):
        return
    field = layer.fields().indexOf(facts["field"])
    if field < 0:
        return
    low, high = facts.get("limits") or (layer.minimumValue(field), layer.maximumValue(field))
    if not (isinstance(low, (int, float)) and isinstance(high, (int, float)) and low < high):
        return
    edges = [low + k * (high - low) / CLASSES for k in range(CLASSES)] + [high]
    words = [f"{facts['factor'] * edge:.{facts['decimals']}f}" for edge in edges]
    open_ended = "limits" in facts
    ranges = []
    for k in range(CLASSES):
        symbol = layer.renderer().symbol().clone()
        symbol.setColor(_between(facts["colours"], (k + 0.5) / CLASSES))
        label = f"{words[k]} – {words[k + 1]} {facts['unit']}"
        lower, upper = edges[k], edges[k + 1]
        if open_ended and k == 0:
            lower, label = -BEYOND_ALL, f"< {words[1]} {facts['unit']}"
        elif open_ended and k == CLASSES - 1:
            upper, label = BEYOND_ALL, f"> {words[k]} {facts['unit']}"
        ranges.append(QgsRendererRange(lower, upper, symbol, label))
    request = QgsFeatureRequest().setFilterExpression(f'"{facts["field"]}" is null').setLimit(1)
    if next(layer.getFeatures(request), None) is not None:
        symbol = layer.renderer().symbol().clone()
        symbol.setColor(QColor(UNKNOWN_COLOUR))
        words_unknown = QCoreApplication.translate("Legends", "unknown")
        ranges.append(QgsRendererRange(2 * BEYOND_ALL, 2 * BEYOND_ALL, symbol, words_unknown))
    layer.setRenderer(QgsGraduatedSymbolRenderer(f'coalesce("{facts["field"]}", {2 * BEYOND_ALL:.0f})', ranges))


def _between(colours: Sequence[str], share: float) -> QColor:
    """The colour at a share of a ramp whose colours lie at even distances."""
    at = share * (len(colours) - 1)
    first = min(int(at), len(colours) - 2)
    one, other = QColor(colours[first]), QColor(colours[first + 1])
    part = at - first
    mixed = (a + part * (b - a) for a, b in zip(one.getRgbF()[:3], other.getRgbF()[:3], strict=True))
    return QColor.fromRgbF(*mixed)


def fill_worked(layer: QgsVectorLayer) -> None:
    """Fill all ground worked in one bold colour."""
    look = {"color": WORKED_GROUND, "outline_color": WORKED_GROUND, "outline_width": "0.3"}
    layer.setRenderer(QgsSingleSymbolRenderer(QgsFillSymbol.createSimple(look)))
    layer.setOpacity(WORKED_OPACITY)


def load_style_of_language(layer: QgsVectorLayer) -> None:
    """Load the style stored for the language of QGIS, such as "passes (ja)", where the default one is in another."""
    _, numbers, names, _, _ = layer.listStylesInDatabase()
    wanted = f"{key_of(layer) or layer.name()} ({(QgsApplication.locale() or '')[:2]})"
    if wanted in names:
        text, _ = layer.getStyleFromDatabase(numbers[names.index(wanted)])
        document = QDomDocument()
        document.setContent(text)
        layer.importNamedStyle(document)


def set_colours(layer: QgsRasterLayer, ramp: QgsColorRampShader) -> QgsSingleBandPseudoColorRenderer:
    """Draw a raster's first band with a QgsColorRampShader; returns the renderer."""
    shader = QgsRasterShader()
    shader.setRasterShaderFunction(ramp)
    renderer = QgsSingleBandPseudoColorRenderer(layer.dataProvider(), 1, shader)
    layer.setRenderer(renderer)
    return renderer


def show_by_class(layer: QgsPointCloudLayer) -> None:
    """Colour a point cloud by class; noise is hidden."""
    categories = [
        QgsPointCloudCategory(code, QColor(colour), QCoreApplication.translate("Classes", label), code != NOISE)
        for code, colour, label in LABELS["classes"]
    ]
    layer.setRenderer(QgsPointCloudClassifiedRenderer("Classification", categories))
    layer.setSync3DRendererTo2DRenderer(True)
    layer.convertRenderer3DFromRenderer2D()


def set_terrain(project: QgsProject, layers: Sequence[QgsMapLayer]) -> None:
    """Make the session's DSM the terrain of profiles and 3D views, unless the project has a terrain."""
    surface = next((layer for layer in layers if key_of(layer) == "dsm"), None)
    properties = project.elevationProperties()
    if surface is None or properties.terrainProvider().type() != "flat":
        return
    terrain = QgsRasterDemTerrainProvider()
    terrain.setLayer(surface)
    properties.setTerrainProvider(terrain)
