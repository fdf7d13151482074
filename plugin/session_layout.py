# SPDX-License-Identifier: GPL-2.0-or-later
"""The print layout of a session: A4 with map, legend, figures and scale, and an atlas with a page per pass."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from html import escape
from typing import Any

from qgis.core import (
    Qgis,
    QgsCategorizedSymbolRenderer,
    QgsCoordinateTransform,
    QgsLayerTreeGroup,
    QgsLayout,
    QgsLayoutItem,
    QgsLayoutItemLabel,
    QgsLayoutItemLegend,
    QgsLayoutItemMap,
    QgsLayoutItemScaleBar,
    QgsLayoutPoint,
    QgsLayoutSize,
    QgsLegendStyle,
    QgsMapLayer,
    QgsMapLayerLegendUtils,
    QgsPrintLayout,
    QgsProject,
    QgsPropertyCollection,
    QgsRectangle,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QCoreApplication
from qgis.PyQt.QtGui import QTextDocument

from .basemap import attribution_of, with_tiles
from .figures import figures_html, local_start, object_in, verdict_html
from .legends import label_band
from .own_layers import key_of, nodes_by_key

tr = partial(QCoreApplication.translate, "SessionLayout")

LEFT_MM = 10.0
TOP_MM = 22.0
MAP_WIDTH_MM = 190.0
BOTTOM_MM = 190.0
"""Of the map; what is above, below and beside it begins there."""
SIDE_MM = (204.0, 86.0)
"""Left and width of the column beside the map, with figures and legend."""
PAGE_WIDTH_MM = 277.0
PIXELS_A_MM = 96.0 / 25.4
LEGEND_FONTS = {"Title": 9.0, "Group": 7.5, "Subgroup": 7.5, "SymbolLabel": 7.0}
FONT = "font-family: sans-serif; font-size: 8pt"
TABLE = f'<table style="{FONT}">'
IS_OVERVIEW = "@atlas_pagename is null or @atlas_pagename = ''"
"""Whether a page shows the whole session."""
WITHOUT_LEGEND = ("dsm", "dsm_before", "dtm", "orthophoto")
"""Layers whose colours say nothing: pictures and reliefs."""
EXTENT_FACTOR = 1.08
ATLAS_MARGIN = 0.15


def session_layout(project: QgsProject, group: QgsLayerTreeGroup, report: dict[str, Any]) -> QgsPrintLayout:
    """Create the layout of an open session in the project, in place of the one before; with an atlas of its passes."""
    manager = project.layoutManager()
    name = f"furrowmap {group.name()}"
    old = manager.layoutByName(name)
    if old is not None:
        manager.removeLayout(old)
    layout = QgsPrintLayout(project)
    layout.initializeDefaults()
    layout.setName(name)
    root = project.layerTreeRoot()
    visible = {node.layerId() for node in root.findLayers() if node.isVisible()}
    by_key = {key: node.layer() for key, node in nodes_by_key(group).items()}
    passes = by_key.get("passes")
    coverage = by_key.get("coverage")
    if (
        passes is not None and coverage is not None and coverage.id() in visible
    ):  # a page for each pass shows which it is
        visible = (visible - {coverage.id()}) | {passes.id()}
    shown = [layer for layer in root.layerOrder() if layer.id() in visible]
    session = [layer for layer in by_key.values() if layer in shown]
    warned = verdict_html(report)
    warned = warned and f'<div style="{FONT}">{warned}</div>'
    top_mm = TOP_MM + (_height_mm(warned, PAGE_WIDTH_MM) if warned else 0.0)
    page_map = _map(layout, project, shown, _extent(project, group), top_mm)
    title = group.name().replace("[%", "[ %") + f"[% if({IS_OVERVIEW}, '', ', ' || @atlas_pagename) %]"
    _label(layout, title, (LEFT_MM, 8.0, PAGE_WIDTH_MM, 10.0), size=16.0)
    if warned:
        _label(layout, warned, (LEFT_MM, TOP_MM - 3.0, PAGE_WIDTH_MM, top_mm - TOP_MM), rich=True)
    # Each of several tools has passes of its own, numbered from 1 on.
    several = passes is not None and passes.fields().indexOf("tool") >= 0
    of_pass = "<tr><td>&nbsp;</td></tr>" * len(_pass_rows(report, several=several))
    figures_mm = max(_height_mm(f"{TABLE}{rows}</table>", SIDE_MM[1]) for rows in (figures_html(report), of_pass))
    _label(layout, _figures(report, passes), (SIDE_MM[0], top_mm, SIDE_MM[1], figures_mm), rich=True)
    _legend(layout, page_map, [layer for layer in session if key_of(layer) not in WITHOUT_LEGEND], top_mm + figures_mm)
    bar = QgsLayoutItemScaleBar(layout)
    layout.addLayoutItem(bar)
    bar.setId("scale")
    bar.setStyle("Single Box")
    bar.setLinkedMap(page_map)
    bar.applyDefaultSize(Qgis.DistanceUnit.Meters)
    bar.attemptMove(QgsLayoutPoint(LEFT_MM + 25.0, BOTTOM_MM + 1.0, Qgis.LayoutUnit.Millimeters))
    _label(layout, tr("▲ north"), (LEFT_MM, BOTTOM_MM + 4.0, 25.0, 8.0))
    _label(
        layout,
        attribution_of(with_tiles(shown)),
        (LEFT_MM + 100.0, BOTTOM_MM + 5.0, MAP_WIDTH_MM - 100.0, 6.0),
        size=7.0,
    )
    if passes is not None and passes.featureCount():
        atlas = layout.atlas()
        atlas.setCoverageLayer(passes)
        page = f"'{tr('pass')} ' || \"pass\""
        atlas.setPageNameExpression(f"\"tool\" || ', ' || {page}" if several else page)
        atlas.setSortFeatures(True)
        atlas.setSortExpression('"tool" || lpad("pass", 9, \' \')' if several else '"pass"')
        page_map.setAtlasDriven(True)
        page_map.setAtlasScalingMode(QgsLayoutItemMap.AtlasScalingMode.Auto)
        page_map.setAtlasMargin(ATLAS_MARGIN)
        atlas.setEnabled(False)  # the layout opens with the overview; *Preview Atlas* shows the pages
    manager.addLayout(layout)
    return layout


def _extent(project: QgsProject, group: QgsLayerTreeGroup) -> QgsRectangle:
    """Extent in the project's CRS of the worked ground, else of the trajectory, else of all layers."""
    by_key = {key: node.layer() for key, node in nodes_by_key(group).items()}
    for names in (("coverage", "boundary"), ("trajectory",), tuple(by_key)):
        box = QgsRectangle()
        for layer in (by_key[name] for name in names if name in by_key):
            change = QgsCoordinateTransform(layer.crs(), project.crs(), project)
            if not layer.extent().isNull() and not layer.extent().isEmpty():
                box.combineExtentWith(change.transformBoundingBox(layer.extent()))
        if not box.isNull() and not box.isEmpty():
            return box
    return QgsRectangle(0, 0, 1, 1)


def _height_mm(rich: str, width_mm: float) -> float:
    """Height of a text in HTML at a width."""
    document = QTextDocument()
    document.setHtml(rich)
    document.setTextWidth(width_mm * PIXELS_A_MM)
    return float(document.size().height()) / PIXELS_A_MM


def _map(
    layout: QgsLayout, project: QgsProject, layers: Sequence[QgsMapLayer], extent: QgsRectangle, top_mm: float
) -> QgsLayoutItemMap:
    page_map = QgsLayoutItemMap(layout)
    layout.addLayoutItem(page_map)
    _place(page_map, (LEFT_MM, top_mm, MAP_WIDTH_MM, BOTTOM_MM - top_mm))
    page_map.setId("map")
    page_map.setCrs(project.crs())
    page_map.setLayers(layers)
    page_map.setKeepLayerSet(True)
    extent.scale(EXTENT_FACTOR)
    page_map.zoomToExtent(extent)
    page_map.setFrameEnabled(True)
    return page_map


def _legend(layout: QgsLayout, page_map: QgsLayoutItemMap, layers: Sequence[QgsMapLayer], top_mm: float) -> None:
    """The legend of the map, in two columns below the figures."""
    legend = QgsLayoutItemLegend(layout)
    layout.addLayoutItem(legend)
    legend.setId("legend")
    legend.setLinkedMap(page_map)
    legend.setAutoUpdateModel(False)
    tree = legend.model().rootGroup()
    tree.clear()
    for layer in layers:
        node = tree.addLayer(layer)
        label_band(node)
        if key_of(layer) == "passes" and isinstance(layer.renderer(), QgsCategorizedSymbolRenderer):
            for k, category in enumerate(
                layer.renderer().categories()
            ):  # pages of an atlas would colour all as their pass
                symbol = category.symbol().clone()
                symbol.symbolLayer(0).setDataDefinedProperties(QgsPropertyCollection())
                QgsMapLayerLegendUtils.setLegendNodeCustomSymbol(node, k, symbol)
            legend.model().refreshLayerLegend(node)
    legend.setLegendFilterByMapEnabled(True)
    for name, size in LEGEND_FONTS.items():
        style = legend.rstyle(getattr(QgsLegendStyle.Style, name))
        form = style.textFormat()
        form.setSize(size)
        style.setTextFormat(form)
    legend.rstyle(QgsLegendStyle.Style.Symbol).setMargin(QgsLegendStyle.Side.Top, 0.8)
    legend.setSymbolHeight(3.0)
    legend.setSymbolWidth(5.0)
    legend.attemptMove(QgsLayoutPoint(SIDE_MM[0], top_mm, Qgis.LayoutUnit.Millimeters))
    legend.setColumnCount(2)
    legend.setSplitLayer(True)
    legend.adjustBoxSize()


def _figures(report: dict[str, Any], passes: QgsVectorLayer | None) -> str:
    """The figures of the session; on pages of the atlas those of the pass."""
    whole = f"{TABLE}{figures_html(report)}</table>"
    if passes is None:
        return whole
    rows = "".join(
        f" || '<tr><td>{escape(label)}&nbsp;&nbsp;</td><td><b>' || {value} || '</b></td></tr>'"
        for label, value in _pass_rows(report, several=passes.fields().indexOf("tool") >= 0)
    )
    of_pass = f"{_literal(TABLE)}{rows} || '</table>'"
    return f"[% if({IS_OVERVIEW}, {_literal(whole)}, {of_pass}) %]"


def _pass_rows(report: dict[str, Any], *, several: bool) -> tuple[tuple[str, str], ...]:
    """Pairs of a label and an expression for the figures of a pass."""
    figures = object_in(report, "figures")
    moment, zone = local_start(figures)
    zone, offset_s = (zone, moment.offsetFromUtc()) if moment.isValid() else ("UTC", 0)
    times = [f"format_date(\"{name}\" + to_interval('{offset_s} seconds'), 'HH:mm:ss')" for name in ("start", "end")]
    unknown = _literal(tr("unknown"))
    return (
        *(((tr("Tool"), '"tool"'),) if several else ()),
        (tr("Pass"), 'to_string("pass")'),
        (tr("Time ({zone})").format(zone=zone), f"{times[0]} || ' – ' || {times[1]}"),
        (tr("Length"), "format_number(\"length_m\", 1) || ' m'"),
        (tr("Width"), "format_number(\"width_m\", 2) || ' m'"),
        (tr("Area"), _with_margin("area_m2", 1, 1, "m²", unknown)),
        (tr("Speed"), "format_number(3.6 * \"speed_mps\", 1) || ' km/h'"),
        (tr("Depth (approximate)"), _with_margin("depth_m", 100, 0, "cm", unknown)),
    )


def _with_margin(field: str, factor: int, digits: int, unit: str, unknown: str) -> str:
    """An expression for a value and, where it is known, its margin of error, as map tips have it."""
    name, _, suffix = field.rpartition("_")
    half = f'{2 * factor} * "{name}_sigma_{suffix}"'
    places = f"1 - floor(log10({half}))"
    decimals = f"max(0, {places})"
    spread = f"format_number(round({half}, {places}), {decimals}) || ' {unit} (95 %)'"
    return (
        f"coalesce(format_number({factor} * \"{field}\", {decimals}) || ' ± ' || {spread}, "
        f"format_number({factor} * \"{field}\", {digits}) || ' {unit}', {unknown})"
    )


def _literal(text: str) -> str:
    """A text within an expression within a label."""
    plain = text.replace("\\", "\\\\").replace("'", "''").replace("%]", "% ]")
    return f"'{plain}'"


def _label(layout: QgsLayout, text: str, box_mm: Sequence[float], size: float = 10.0, *, rich: bool = False) -> None:
    label = QgsLayoutItemLabel(layout)
    layout.addLayoutItem(label)
    if rich:
        label.setMode(QgsLayoutItemLabel.Mode.ModeHtml)
    label.setText(text)
    form = label.textFormat()
    form.setSize(size)
    label.setTextFormat(form)
    _place(label, box_mm)


def _place(item: QgsLayoutItem, box_mm: Sequence[float]) -> None:
    x, y, width, height = box_mm
    unit = Qgis.LayoutUnit.Millimeters
    item.attemptMove(QgsLayoutPoint(x, y, unit))
    item.attemptResize(QgsLayoutSize(width, height, unit))
