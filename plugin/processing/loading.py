# SPDX-License-Identifier: GPL-2.0-or-later
"""Products that QGIS opens when an algorithm is done: named, in a group, in their style."""

from pathlib import Path

from qgis.core import (
    Qgis,
    QgsColorRampShader,
    QgsPointCloudLayer,
    QgsProcessingContext,
    QgsProcessingLayerPostProcessorInterface,
    QgsProcessingUtils,
    QgsProviderRegistry,
    QgsRasterShader,
    QgsSingleBandPseudoColorRenderer,
    QgsStyle,
    QgsVectorLayer,
)
from qgis.PyQt import sip

from ..styles import show_as_change, show_as_surface, show_by_class

RASTERS = (".tif", ".vrt")
CLOUDS = (".laz",)
HEIGHTS = ("dsm", "dsm_before", "dtm")
RAMPS = {"height_above_ground": "Viridis", "slope": "Reds", "roughness": "Magma", "low_spots": "Blues"}
SHARES, SAMPLED = (0.02, 0.98), 250_000


def load_when_done(context, path, group):
    """Ask QGIS to open a file's layers when the algorithm is done, if there is a project to open them in.

    Args:
        context: the algorithm's.
        path: of a raster, a cloud, or of vector layers.
        group: their place in the layer tree.
    """
    if context.project() is None:
        return
    hints = QgsProcessingUtils.LayerHint
    suffix = Path(path).suffix.lower()
    hint = hints.Raster if suffix in RASTERS else hints.PointCloud if suffix in CLOUDS else hints.Vector
    for source, name in sources(path):
        details = QgsProcessingContext.LayerDetails(name, context.project(), name, hint)
        details.forceName = True
        details.groupName = group
        details.setPostProcessor(_Style.kept())
        context.addLayerToLoadOnCompletion(source, details)


def sources(path):
    """Source and name of each layer in a file."""
    path = Path(path)
    if path.suffix.lower() in RASTERS:
        return [(str(path), path.stem)]
    if path.suffix.lower() in CLOUDS:
        return [(str(path), path.name.removesuffix(path.suffix).removesuffix(".copc"))]
    found = QgsProviderRegistry.instance().querySublayers(str(path))
    layers = [details for details in found if details.wkbType() != Qgis.WkbType.NoGeometry]  # tables stay in the file
    return [(details.uri(), details.name() if len(layers) > 1 else path.stem) for details in layers]


class _Style(QgsProcessingLayerPostProcessorInterface):
    """The look of a layer: a vector's own, stored beside it; a cloud's by class; a raster's by its name.

    QGIS deletes each together with its context, but does not keep its Python half alive until then: the class does.
    """

    _kept = ()

    @classmethod
    def kept(cls):
        """A new one, for one layer."""
        style = cls()
        cls._kept = (*(other for other in cls._kept if not sip.isdeleted(other)), style)
        return style

    def postProcessLayer(self, layer, context, feedback):  # noqa: N802, ARG002 - the names are QGIS's
        """Set it, in the main thread."""
        if isinstance(layer, QgsVectorLayer):
            layer.loadDefaultStyle()
        elif isinstance(layer, QgsPointCloudLayer):
            show_by_class(layer)
        elif layer.name() in HEIGHTS:
            show_as_surface(layer)
        elif layer.name() == "change":
            show_as_change(layer)
        elif layer.name() in RAMPS:
            show_by_ramp(layer, RAMPS[layer.name()])


def show_by_ramp(layer, name):
    """A ramp of QGIS's own over all values but the outermost hundredths, estimated from a part of a large raster."""
    provider = layer.dataProvider()
    low, high = provider.cumulativeCut(1, *SHARES, layer.extent(), SAMPLED)
    ramp = QgsStyle.defaultStyle().colorRamp(name)
    if ramp is None or not high > low:
        return
    colours = QgsColorRampShader(low, high, ramp)
    colours.setColorRampType(QgsColorRampShader.Type.Interpolated)
    colours.classifyColorRamp(5, 1, layer.extent(), provider)
    shader = QgsRasterShader()
    shader.setRasterShaderFunction(colours)
    layer.setRenderer(QgsSingleBandPseudoColorRenderer(provider, 1, shader))
