# SPDX-License-Identifier: GPL-2.0-or-later
"""The print layout of a session: A4 with map, legend, figures and scale, and an atlas with a page per pass."""

from functools import partial
from html import escape

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
from qgis.PyQt.QtCore import QCoreApplication, QDateTime, Qt

from ..basemap import attribution_of
from ..figures import figures_html
from ..legends import label_band, shown_name

tr = partial(QCoreApplication.translate, "SessionLayout")

MAP_MM = (10.0, 22.0, 200.0, 176.0)
SIDE_MM = (214.0, 22.0, 76.0)
"""Left, top and width of the column beside the map."""
FIGURES_MM, LEGEND_AT_MM, SCALE_AT_MM = 58.0, 82.0, 188.0
LEGEND_FONTS = {"Title": 9.0, "Group": 8.0, "Subgroup": 8.0, "SymbolLabel": 7.5}
NORTH_MM = (SIDE_MM[0] + 55.0, SCALE_AT_MM + 2.0, 25.0, 8.0)
"""North is up on all pages."""
TABLE = '<table style="font-family: sans-serif; font-size: 8pt">'
NO_PAGE = "@atlas_pagename is null or @atlas_pagename = ''"
"""Whether a page shows the whole session."""
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
    _label(layout, _figures(report, passes), (*SIDE_MM, FIGURES_MM), rich=True)
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
        node.setCustomProperty("legend/title-label", shown_name(layer.name()))
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


def _figures(report, passes):
    """The figures of the session; on pages of the atlas those of the pass."""
    whole = f"{TABLE}{figures_html(report)}</table>"
    if passes is None:
        return whole
    rows = "".join(
        f" || '<tr><td>{escape(label)}&nbsp;&nbsp;</td><td><b>' || {value} || '</b></td></tr>'"
        for label, value in _pass_rows(report)
    )
    of_pass = f"{_literal(TABLE)}{rows} || '</table>'"
    return f"[% if({NO_PAGE}, {_literal(whole)}, {of_pass}) %]"


def _pass_rows(report):
    """Pairs of a label and an expression for the figures of a pass."""
    figures = report.get("figures") if isinstance(report.get("figures"), dict) else {}
    moment = QDateTime.fromString(str(figures.get("start_local")), Qt.DateFormat.ISODateWithMs)
    zone, offset_s = (figures.get("time_zone"), moment.offsetFromUtc()) if moment.isValid() else ("UTC", 0)
    times = [f"format_date(\"{name}\" + to_interval('{offset_s} seconds'), 'HH:mm:ss')" for name in ("start", "end")]
    unknown = _literal(tr("unknown"))
    return (
        (tr("Pass"), 'to_string("pass")'),
        (tr("Time"), f"{times[0]} || ' – ' || {times[1]} || {_literal(f' ({zone})')}"),
        (tr("Length"), "format_number(\"length_m\", 1) || ' m'"),
        (tr("Width"), "format_number(\"width_m\", 2) || ' m'"),
        (tr("Area"), _with_sigma("area_m2", 1.0, 1, "m²", unknown)),
        (tr("Speed"), "format_number(3.6 * \"speed_mps\", 1) || ' km/h'"),
        (tr("Depth (approximate)"), _with_sigma("depth_m", 100.0, 0, "cm", unknown)),
    )


def _with_sigma(field, factor, digits, unit, unknown):
    """A value and, where it is known, twice its standard deviation."""
    sigma = f"{field.rpartition('_')[0]}_sigma_{field.rpartition('_')[2]}"
    value, spread = (f'format_number({k * factor} * "{name}", {digits})' for k, name in ((1, field), (2, sigma)))
    return f"coalesce({value} || coalesce(' ± ' || {spread}, '') || ' {unit}', {unknown})"


def _literal(text):
    """A text within an expression within a label."""
    plain = text.replace("\\", "\\\\").replace("'", "''")
    return "'{}'".format(plain.replace("%]", "% ]"))


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
    page = f"[% if({NO_PAGE}, '', ', ' || @atlas_pagename) %]"
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
