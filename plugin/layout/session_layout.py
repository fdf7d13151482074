# SPDX-License-Identifier: GPL-2.0-or-later
"""The print layout of a session: A4 with map, legend, figures and scale, and an atlas with a page per pass."""

from functools import partial

from qgis.core import (
    Qgis,
    QgsCoordinateTransform,
    QgsLayoutExporter,
    QgsLayoutItemLabel,
    QgsLayoutItemLegend,
    QgsLayoutItemMap,
    QgsLayoutItemScaleBar,
    QgsLayoutPoint,
    QgsLayoutSize,
    QgsLegendStyle,
    QgsPrintLayout,
    QgsRectangle,
)
from qgis.PyQt.QtCore import QCoreApplication

from ..basemap import attribution_of
from ..figures import figures_html
from ..legends import label_band

tr = partial(QCoreApplication.translate, "SessionLayout")

MAP_MM = (10.0, 22.0, 200.0, 176.0)
SIDE_MM = (214.0, 22.0, 76.0)
"""Left, top and width of the column beside the map."""
FIGURES_MM, LEGEND_AT_MM, SCALE_AT_MM = 58.0, 82.0, 188.0
LEGEND_FONTS = {"Title": 9.0, "Group": 8.0, "Subgroup": 8.0, "SymbolLabel": 7.5}
NORTH_MM = (SIDE_MM[0] + 55.0, SCALE_AT_MM + 2.0, 25.0, 8.0)
"""North is up on all pages."""
LEGEND = ("events", "trajectory", "misses", "unworked", "boundary", "overlaps", "coverage", "passes", "change")
"""Layers in the legend."""
MARGIN = 1.08
ATLAS_MARGIN = 0.15


def session_layout(project, group, report):
    """Create the layout of an open session; it replaces the one before.

    Args:
        project: holds the layers.
        group: the session's group in the layer tree.
        report: the content of its `report.json`; may be empty.

    Returns:
        The layout, added to the project; with an atlas if there are passes.
    """
    manager = project.layoutManager()
    name = f"furrowmap {group.name()}"
    old = manager.layoutByName(name)
    if old is not None:
        manager.removeLayout(old)
    layout = QgsPrintLayout(project)
    layout.initializeDefaults()
    layout.setName(name)
    shown = [layer for layer in project.layerTreeRoot().layerOrder() if _is_shown(project, layer)]
    session = [node.layer() for node in group.findLayers() if node.layer() in shown]
    passes = next((node.layer() for node in group.findLayers() if node.layer().name() == "passes"), None)
    page_map = _map(layout, project, shown, _extent(project, group))
    _label(layout, _title(group.name()), (MAP_MM[0], 8.0, 277.0, 10.0), size=16.0)
    _label(layout, _figures(report), (*SIDE_MM, FIGURES_MM), rich=True)
    _legend(layout, page_map, [layer for layer in session if layer.name() in LEGEND])
    _scale(layout, page_map)
    _label(layout, tr("▲ north"), NORTH_MM)
    _label(layout, attribution_of(shown), (MAP_MM[0], 200.0, MAP_MM[2], 6.0), size=7.0)
    if passes is not None and passes.featureCount():
        _atlas(layout, page_map, passes)
    manager.addLayout(layout)
    return layout


def export_pdf(layout, path):
    """Write the overview page as PDF.

    Raises:
        OSError: if it cannot be written.
    """
    _check(QgsLayoutExporter(layout).exportToPdf(str(path), _settings()), path)


def export_atlas(layout, path, feedback=None):
    """Write the atlas, a page per pass, as one PDF.

    Raises:
        OSError: if it cannot be written.
    """
    atlas = layout.atlas()
    atlas.setEnabled(True)
    atlas.beginRender()
    result, words = QgsLayoutExporter.exportToPdf(atlas, str(path), _settings(), feedback)
    atlas.endRender()
    _check(result, f"{path} {words}".strip())


def _settings():
    """Text stays text, which can be searched and copied."""
    settings = QgsLayoutExporter.PdfExportSettings()
    settings.textRenderFormat = Qgis.TextRenderFormat.AlwaysText
    return settings


def _check(result, path):
    if result != QgsLayoutExporter.ExportResult.Success:
        raise OSError(tr("{path} cannot be written.").format(path=path))


def _is_shown(project, layer):
    node = project.layerTreeRoot().findLayer(layer.id())
    return node is not None and node.isVisible()


def _extent(project, group):
    """Extent in the project's CRS of the worked ground, else of the trajectory, else of all layers."""
    by_name = {node.layer().name(): node.layer() for node in group.findLayers()}
    for names in (("coverage", "boundary"), ("trajectory",), tuple(by_name)):
        box = QgsRectangle()
        for layer in (by_name[name] for name in names if name in by_name):
            change = QgsCoordinateTransform(layer.crs(), project.crs(), project)
            if not layer.extent().isNull() and not layer.extent().isEmpty():
                box.combineExtentWith(change.transformBoundingBox(layer.extent()))
        if not box.isNull() and not box.isEmpty():
            return box
    return QgsRectangle(0, 0, 1, 1)


def _map(layout, project, layers, extent):
    page_map = QgsLayoutItemMap(layout)
    layout.addLayoutItem(page_map)
    _place(page_map, MAP_MM)
    page_map.setId("map")
    page_map.setCrs(project.crs())
    page_map.setLayers(layers)
    page_map.setKeepLayerSet(True)
    extent.scale(MARGIN)
    page_map.zoomToExtent(extent)
    page_map.setFrameEnabled(True)
    return page_map


def _legend(layout, page_map, layers):
    legend = QgsLayoutItemLegend(layout)
    layout.addLayoutItem(legend)
    legend.setId("legend")
    legend.setLinkedMap(page_map)
    legend.setAutoUpdateModel(False)
    tree = legend.model().rootGroup()
    tree.clear()
    for layer in layers:
        node = tree.addLayer(layer)
        node.setCustomProperty("legend/title-label", layer_title(layer.name()))
        label_band(node)
    legend.setLegendFilterByMapEnabled(True)
    for name, size in LEGEND_FONTS.items():
        style = legend.rstyle(getattr(QgsLegendStyle.Style, name))
        form = style.textFormat()
        form.setSize(size)
        style.setTextFormat(form)
    legend.setSymbolHeight(3.0)
    legend.attemptMove(QgsLayoutPoint(SIDE_MM[0], LEGEND_AT_MM, Qgis.LayoutUnit.Millimeters))
    legend.adjustBoxSize()


def layer_title(name):
    """A layer's title in the legend."""
    titles = {
        "events": tr("Events"),
        "trajectory": tr("Trajectory"),
        "misses": tr("Missed"),
        "overlaps": tr("Overlap"),
        "coverage": tr("Worked"),
        "passes": tr("Passes"),
        "change": tr("Height change"),
    }
    return titles.get(name, name)


def _figures(report):
    return f"<table style='font-family: sans-serif; font-size: 8pt'>{figures_html(report)}</table>"


def _scale(layout, page_map):
    bar = QgsLayoutItemScaleBar(layout)
    layout.addLayoutItem(bar)
    bar.setId("scale")
    bar.setStyle("Single Box")
    bar.setLinkedMap(page_map)
    bar.applyDefaultSize(Qgis.DistanceUnit.Meters)
    bar.attemptMove(QgsLayoutPoint(SIDE_MM[0], SCALE_AT_MM, Qgis.LayoutUnit.Millimeters))


def _atlas(layout, page_map, passes):
    """An atlas page per pass: the map follows, and the title names the pass."""
    atlas = layout.atlas()
    atlas.setCoverageLayer(passes)
    atlas.setPageNameExpression(f"'{tr('pass')} ' || \"pass\"")
    atlas.setSortFeatures(True)
    atlas.setSortExpression('"pass"')
    page_map.setAtlasDriven(True)
    page_map.setAtlasScalingMode(QgsLayoutItemMap.AtlasScalingMode.Auto)
    page_map.setAtlasMargin(ATLAS_MARGIN)
    atlas.setEnabled(False)  # the layout opens with the overview; *Preview Atlas* shows the pages


def _title(name):
    """The session's name, and on pages of the atlas the pass."""
    page = "[% if(@atlas_pagename is null or @atlas_pagename = '', '', ', ' || @atlas_pagename) %]"
    return name.replace("[%", "[ %") + page


def _label(layout, text, box_mm, size=10.0, *, rich=False):
    label = QgsLayoutItemLabel(layout)
    layout.addLayoutItem(label)
    if rich:
        label.setMode(QgsLayoutItemLabel.Mode.ModeHtml)
    label.setText(text)
    form = label.textFormat()
    form.setSize(size)
    label.setTextFormat(form)
    _place(label, box_mm)


def _place(item, box_mm):
    x, y, width, height = box_mm
    unit = Qgis.LayoutUnit.Millimeters
    item.attemptMove(QgsLayoutPoint(x, y, unit))
    item.attemptResize(QgsLayoutSize(width, height, unit))
