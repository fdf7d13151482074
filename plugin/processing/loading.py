# SPDX-License-Identifier: GPL-2.0-or-later
"""Products that QGIS opens as styled layers when an algorithm has finished."""

from __future__ import annotations

from pathlib import Path

from qgis.core import (
    Qgis,
    QgsColorRampShader,
    QgsMapLayer,
    QgsPointCloudLayer,
    QgsProcessingContext,
    QgsProcessingFeedback,
    QgsProcessingLayerPostProcessorInterface,
    QgsProcessingUtils,
    QgsProviderRegistry,
    QgsRasterLayer,
    QgsStyle,
    QgsVectorLayer,
)
from qgis.PyQt import sip

from ..legends import label_band, title_of, translate_colours
from ..own_layers import KEY_PROPERTY
from ..styles import (
    set_colours,
    show_as_change,
    show_as_counts,
    show_as_plots,
    show_as_surface,
    show_by_class,
    show_classes,
)

RASTER_SUFFIXES = (".tif", ".vrt")
CLOUD_SUFFIXES = (".laz",)
BY_CONTENT = {"height": show_as_surface, "change": show_as_change, "times worked": show_as_counts}
"""How a raster is drawn, by the description of its first band."""
RAMPS = {"height_above_ground": "Viridis", "slope": "Reds", "roughness": "Magma", "low_spots": "Blues"}
SHARES = (0.02, 0.98)
SAMPLED = 250_000
FARM_LAYERS = ("fields", "sessions", "boundary", "coverage", "plants", "lines", "planes")
"""Layers of a farm map that are seen at first: what one session missed, another one may have worked."""


def load_when_done(
    context: QgsProcessingContext, path: str | Path, group: str, *, below: int = 0, shown: bool = True
) -> None:
    """Have QGIS open a file's layers when the algorithm has finished, if there is a project.

    Args:
        below: layers with smaller numbers lie below those of the file.
        shown: whether they are seen at first.
    """
    if context.project() is None:
        return
    hints = QgsProcessingUtils.LayerHint
    suffix = Path(path).suffix.lower()
    hint = hints.Raster if suffix in RASTER_SUFFIXES else hints.PointCloud if suffix in CLOUD_SUFFIXES else hints.Vector
    found = sources(path)
    farm = {"fields", "sessions"} <= {key for _, key in found}
    for number, (source, key) in enumerate(reversed(found)):
        details = QgsProcessingContext.LayerDetails(title_of(key, worked=False), context.project(), key, hint)
        details.forceName = True
        details.groupName = group
        details.layerSortKey = below + number
        details.setPostProcessor(_Style.kept(key, shown=shown and (key in FARM_LAYERS or not farm)))
        context.addLayerToLoadOnCompletion(source, details)


def is_raster(path: str | Path) -> bool:
    """Whether a product is a raster."""
    return Path(path).suffix.lower() in RASTER_SUFFIXES


def style_when_done(context: QgsProcessingContext, path: str) -> None:
    """Style the raster of an output that QGIS itself opens when the algorithm has finished, if it does."""
    if context.willLoadLayerOnCompletion(path):
        context.layerToLoadOnCompletionDetails(path).setPostProcessor(_Style.kept(Path(path).stem, shown=True))


def sources(path: str | Path) -> list[tuple[str, str]]:
    """Source and key of each layer in a file."""
    path = Path(path)
    if path.suffix.lower() in RASTER_SUFFIXES:
        return [(str(path), path.stem)]
    if path.suffix.lower() in CLOUD_SUFFIXES:
        return [(str(path), path.name.removesuffix(path.suffix).removesuffix(".copc"))]
    found = QgsProviderRegistry.instance().querySublayers(str(path))
    layers = [details for details in found if details.wkbType() != Qgis.WkbType.NoGeometry]  # no tables
    return [(details.uri(), details.name() if len(layers) > 1 else path.stem) for details in layers]


class _Style(QgsProcessingLayerPostProcessorInterface):
    """Styles a layer: a vector by its default style, a point cloud by class, a raster by its key and content.

    QGIS deletes each object with its context, but does not keep its Python part alive until then: the class does.
    """

    _kept: tuple[_Style, ...] = ()
    key = ""
    shown = True

    @classmethod
    def kept(cls, key: str, *, shown: bool) -> _Style:
        """A new object, for one layer of this key, which is shown or hidden."""
        style = cls()
        style.key = key
        style.shown = shown
        cls._kept = (*(other for other in cls._kept if not sip.isdeleted(other)), style)
        return style

    def postProcessLayer(  # noqa: N802 - the names are QGIS's
        self,
        layer: QgsMapLayer,
        context: QgsProcessingContext,
        feedback: QgsProcessingFeedback,  # noqa: ARG002
    ) -> None:
        """Set the style and the key, in the main thread; QGIS has put the layer into the layer tree."""
        layer.setCustomProperty(KEY_PROPERTY, self.key)
        if isinstance(layer, QgsVectorLayer):
            _, styled = layer.loadDefaultStyle()
            if not styled and layer.fields().indexOf("block") >= 0:
                show_as_plots(layer)
            show_classes(layer, self.key)
        elif isinstance(layer, QgsPointCloudLayer):
            show_by_class(layer)
        elif self.key in RAMPS:
            show_by_ramp(layer, RAMPS[self.key])
        else:
            content = layer.bandName(1).partition(": ")[2].partition(" (")[0]
            BY_CONTENT.get(content, lambda _layer: None)(layer)
        if isinstance(layer, QgsRasterLayer):
            translate_colours(layer)
        node = context.project().layerTreeRoot().findLayer(layer.id()) if context.project() is not None else None
        if node is not None:
            label_band(node, worked=False)
            layer.legendChanged.emit()  # QGIS has built the legend already
            node.setItemVisibilityChecked(self.shown)


def show_by_ramp(layer: QgsRasterLayer, name: str) -> None:
    """One of QGIS's colour ramps between the percentiles :data:`SHARES`, estimated from a sample of a large raster."""
    provider = layer.dataProvider()
    low, high = provider.cumulativeCut(1, *SHARES, layer.extent(), SAMPLED)
    ramp = QgsStyle.defaultStyle().colorRamp(name)
    if ramp is None or not high > low:
        return
    colours = QgsColorRampShader(low, high, ramp)
    colours.setColorRampType(QgsColorRampShader.Type.Interpolated)
    colours.classifyColorRamp(5, 1, layer.extent(), provider)
    set_colours(layer, colours)
