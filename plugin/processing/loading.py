# SPDX-License-Identifier: GPL-2.0-or-later
"""Products that QGIS opens when an algorithm is done: named, in a group, in their style."""

from pathlib import Path

from qgis.core import (
    QgsColorRampShader,
    QgsProcessingContext,
    QgsProcessingLayerPostProcessorInterface,
    QgsProviderRegistry,
    QgsRasterBandStats,
    QgsRasterShader,
    QgsSingleBandPseudoColorRenderer,
    QgsStyle,
    QgsVectorLayer,
)

from ..styles import show_as_change, show_as_surface

HEIGHTS = ("dsm", "dsm_before", "dtm")
RAMPS = {"height_above_ground": "Viridis", "slope": "Reds", "roughness": "Magma", "low_spots": "Blues"}


def load_when_done(context, path, group):
    """Ask QGIS to open a file's layers when the algorithm is done, if there is a project to open them in.

    Args:
        context: the algorithm's.
        path: of a raster, or of vector layers.
        group: their place in the layer tree.
    """
    if context.project() is None:
        return
    for source, name in sources(path):
        details = QgsProcessingContext.LayerDetails(name, context.project(), name)
        details.forceName = True
        details.groupName = group
        details.setPostProcessor(_STYLE)
        context.addLayerToLoadOnCompletion(source, details)


def sources(path):
    """Source and name of each layer in a file."""
    found = QgsProviderRegistry.instance().querySublayers(str(path))
    return [
        (details.uri(), details.name() if len(found) > 1 else Path(path).stem)
        for details in found
        if details.name() != "layer_styles"
    ]


class _Style(QgsProcessingLayerPostProcessorInterface):
    """The look of a layer: a vector's own, stored beside it; a raster's by its name."""

    def postProcessLayer(self, layer, context, feedback):  # noqa: N802, ARG002 - the names are QGIS's
        """Set it, in the main thread."""
        if isinstance(layer, QgsVectorLayer):
            layer.loadDefaultStyle()
        elif layer.name() in HEIGHTS:
            show_as_surface(layer)
        elif layer.name() == "change":
            show_as_change(layer)
        elif layer.name() in RAMPS:
            show_by_ramp(layer, RAMPS[layer.name()])


_STYLE = _Style()
"""QGIS does not keep it, so the module does."""


def show_by_ramp(layer, name):
    """A ramp of QGIS's own over the values, estimated from a part of a large raster."""
    provider = layer.dataProvider()
    wanted = QgsRasterBandStats.Stats.Min | QgsRasterBandStats.Stats.Max
    values = provider.bandStatistics(1, wanted, layer.extent(), 250_000)
    ramp = QgsStyle.defaultStyle().colorRamp(name)
    if ramp is None or not values.maximumValue > values.minimumValue:
        return
    colours = QgsColorRampShader(values.minimumValue, values.maximumValue, ramp)
    colours.setColorRampType(QgsColorRampShader.Type.Interpolated)
    colours.classifyColorRamp(5, 1, layer.extent(), provider)
    shader = QgsRasterShader()
    shader.setRasterShaderFunction(colours)
    layer.setRenderer(QgsSingleBandPseudoColorRenderer(provider, 1, shader))
