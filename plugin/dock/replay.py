# SPDX-License-Identifier: GPL-2.0-or-later
"""Replay of a drive in QGIS's temporal controller: ground as it was worked, points as they were scanned."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from qgis.core import (
    Qgis,
    QgsDateTimeRange,
    QgsFeature,
    QgsFeatureRequest,
    QgsGeometry,
    QgsGroupLayer,
    QgsInterval,
    QgsLayerTreeGroup,
    QgsLayerTreeLayer,
    QgsMapLayer,
    QgsPointCloudLayer,
    QgsPointXY,
    QgsProject,
    QgsTemporalNavigationObject,
    QgsVectorLayer,
)
from qgis.gui import QgisInterface, QgsMapCanvas
from qgis.PyQt.QtCore import QDate, QDateTime, QObject, Qt, QTime
from qgis.PyQt.QtGui import QPainter
from qgis.PyQt.QtWidgets import QDockWidget, QLabel

from ..figures import local_start, object_in
from ..own_layers import nodes_by_key
from ..results import time_span
from ..styles import fill_worked

FRAMES_PER_S = 10.0
MAX_REPLAY_S = 120.0
"""A long day takes two minutes; shorter drives are played at :data:`REPLAY_SPEED`."""
REPLAY_SPEED = 10.0
CLOUD_FRAMES_PER_S = 2.0
"""With a visible cloud, which takes longer to draw."""
STRIP_S = 1.0
"""Ground is worked in pieces of so many seconds."""
CONTROLLER_DOCK = "Temporal Controller"
"""Object name of QGIS's panel."""
MAX_STRIPS = 5000
"""Of a long day, in longer pieces."""
GPS_EPOCH_UNIX_S = 315_964_800.0
LAS_OFFSET_S = 1e9
LEAP_S = ((QDate(2017, 1, 1), 18.0), (QDate(2015, 7, 1), 17.0), (QDate(2012, 7, 1), 16.0))
"""First day with so many leap seconds, the latest first."""


@dataclass(frozen=True)
class _ControllerState:
    """How the user had set the temporal controller, and which of its docks were closed."""

    mode: QgsTemporalNavigationObject.NavigationMode
    extents: QgsDateTimeRange
    frame: QgsInterval
    frames_per_s: float
    number: int
    closed: tuple[QDockWidget, ...]

    @classmethod
    def of(cls, controller: QgsTemporalNavigationObject, docks: Sequence[QDockWidget]) -> _ControllerState:
        return cls(
            controller.navigationMode(),
            controller.temporalExtents(),
            controller.frameDuration(),
            controller.framesPerSecond(),
            controller.currentFrameNumber(),
            tuple(dock for dock in docks if dock.isHidden()),
        )

    def restore(self, controller: QgsTemporalNavigationObject, *, by_user: bool) -> None:
        controller.setTemporalExtents(self.extents)
        controller.setFrameDuration(self.frame)
        controller.setFramesPerSecond(self.frames_per_s)
        if not by_user:
            controller.setNavigationMode(self.mode)
        controller.setCurrentFrameNumber(self.number)
        for dock in self.closed:
            dock.hide()


class Replay(QObject):
    """Plays a run, until the temporal navigation is turned off or the project is closed.

    While it lasts, ground worked and the change of the surface are shown as far as the tool had come, the points of a
    visible cloud as they were scanned, and the local time stands on the map.
    """

    def __init__(
        self,
        canvas: QgsMapCanvas,
        controller: QgsTemporalNavigationObject,
        report: dict[str, Any],
        group: QgsLayerTreeGroup,
        docks: Sequence[QDockWidget] = (),
    ) -> None:
        super().__init__(canvas)
        self._canvas = canvas
        self._controller = controller
        self._ended = False
        self._moment, self._zone = local_start(object_in(report, "figures"))
        self._hidden: list[str] = []
        self._added: list[str] = []
        nodes = nodes_by_key(group)
        shown = {key: node for key, node in nodes.items() if node.isVisible()}
        layers = {key: node.layer() for key, node in nodes.items()}
        clouds = [n.layer() for n in shown.values() if isinstance(n.layer(), QgsPointCloudLayer)]
        self._clouds = [(cloud.id(), cloud.subsetString()) for cloud in clouds]
        start, end = time_span(report) or (QDateTime(), QDateTime())
        seconds = max(start.msecsTo(end) / 1000.0, 1.0)
        if "trajectory" in layers:
            strips = worked_strips(layers["trajectory"], tools_of(report), max(STRIP_S, seconds / MAX_STRIPS))
            self._let_grow(shown, strips)
        self._before = _ControllerState.of(controller, docks)
        for dock in docks:
            dock.show()
        self._time = QLabel(canvas, objectName="furrowmapReplayTime")
        look = "background: rgba(255, 255, 255, 215); color: black; padding: 3px; font-weight: bold;"
        self._time.setStyleSheet(f"QLabel {{ {look} }}")
        self._time.move(8, 8)
        self._time.show()
        controller.updateTemporalRange.connect(self._show)  # navigationModeChanged crashes PyQt: it lacks the enum
        QgsProject.instance().aboutToBeCleared.connect(self._end_with_project)
        frames_per_s = CLOUD_FRAMES_PER_S if clouds else FRAMES_PER_S
        controller.setNavigationMode(QgsTemporalNavigationObject.NavigationMode.Animated)
        controller.setTemporalExtents(QgsDateTimeRange(start, end))
        controller.setFrameDuration(QgsInterval(max(REPLAY_SPEED, seconds / MAX_REPLAY_S) / frames_per_s))
        controller.setFramesPerSecond(frames_per_s)
        controller.rewindToStart()
        controller.playForward()

    def _end_with_project(self) -> None:
        self.end()

    def end(self, *, by_user: bool = False) -> None:
        """Show everything again as it was before; `by_user`: the user has turned the navigation off, which it stays."""
        if self._ended:
            return
        project = QgsProject.instance()
        self._ended = True
        self._controller.updateTemporalRange.disconnect(self._show)
        self._controller.pause()  # else the next frame comes although the navigation is off
        self._controller.setNavigationMode(QgsTemporalNavigationObject.NavigationMode.NavigationOff)
        self._before.restore(self._controller, by_user=by_user)
        project.aboutToBeCleared.disconnect(self._end_with_project)
        for layer_id, own in self._clouds:
            self._filter(layer_id, own)
        project.removeMapLayers([layer_id for layer_id in self._added if project.mapLayer(layer_id)])
        for layer_id in self._hidden:
            node = project.layerTreeRoot().findLayer(layer_id)
            if node is not None:
                node.setItemVisibilityChecked(True)
        self._time.deleteLater()
        self.deleteLater()

    def _let_grow(self, shown: dict[str, QgsLayerTreeLayer], strips: Sequence[QgsFeature]) -> None:
        """Show strips in place of the ground worked, and within them the change of the surface."""
        worked = shown.get("coverage") or shown.get("passes")
        change = shown.get("change")
        if worked is not None and strips:
            layer = _strip_layer(worked.layer(), strips)
            fill_worked(layer)
            self._replace(worked, layer, [])
        if change is not None and strips:
            whole = change.layer().clone()
            mask = _strip_layer(change.layer(), strips)
            whole.temporalProperties().setIsActive(False)
            mask.setBlendMode(QPainter.CompositionMode.CompositionMode_DestinationIn)
            both = QgsGroupLayer(whole.name(), QgsGroupLayer.LayerOptions(QgsProject.instance().transformContext()))
            both.setChildLayers([whole, mask])
            self._replace(change, both, [whole, mask])

    def _replace(self, node: QgsLayerTreeLayer, layer: QgsMapLayer, parts: Sequence[QgsMapLayer]) -> None:
        """Show a layer, which has others as its parts, in place of that of a node of the group."""
        project = QgsProject.instance()
        project.addMapLayers([*parts, layer], addToLegend=False)
        own = QgsLayerTreeLayer(layer)
        own.setUseLayerName(False)
        own.setName(node.name())
        node.parent().insertChildNode(node.parent().children().index(node), own)
        node.setItemVisibilityChecked(False)
        self._hidden.append(node.layerId())
        self._added += [each.id() for each in (layer, *parts)]

    def _show(self, until: QgsDateTimeRange) -> None:
        if not until.end().isValid():  # the navigation was turned off
            self.end(by_user=True)
            return
        moment = until.end().toOffsetFromUtc(self._moment.offsetFromUtc()) if self._moment.isValid() else until.end()
        self._time.setText(f"{moment.toString('yyyy-MM-dd HH:mm:ss')} ({self._zone or 'UTC'})")
        self._time.adjustSize()
        time = f"GpsTime <= {las_time_s(until.end()):.3f}"
        for layer_id, own in self._clouds:
            self._filter(layer_id, f"({own}) AND {time}" if own else time)

    def _filter(self, layer_id: str, text: str) -> None:
        cloud = QgsProject.instance().mapLayer(layer_id)
        if cloud is not None and cloud.subsetString() != text:
            self._canvas.stopRendering()  # it reads the cloud in another thread
            cloud.setSubsetString(text)
            cloud.triggerRepaint()


def replay(iface: QgisInterface, report: dict[str, Any], group: QgsLayerTreeGroup) -> Replay | None:
    """Start to play the time span of a run's report; None without a time span, or where QGIS has no controller."""
    controller = iface.mapCanvas().temporalController()
    if time_span(report) is None or not isinstance(controller, QgsTemporalNavigationObject):
        return None
    docks = [dock for dock in iface.mainWindow().findChildren(QDockWidget) if dock.objectName() == CONTROLLER_DOCK]
    return Replay(iface.mapCanvas(), controller, report, group, docks)


def tools_of(report: dict[str, Any]) -> list[dict[str, Any]]:
    """The tools of a report's session, each with `width_m` and `xy_m`."""
    session = object_in(report, "session")
    return [tool for tool in (session.get("implement"), *(session.get("further_implements") or [])) if tool]


def worked_strips(trajectory: QgsVectorLayer, tools: Sequence[dict[str, Any]], piece_s: float) -> list[QgsFeature]:
    """The ground that each tool's line swept, in pieces of `piece_s` seconds; their attribute is the end (UTC)."""
    strips: list[QgsFeature] = []
    for number, tool in enumerate(tools, 1):
        field = "pass" if number == 1 else f"pass_{number}"
        if trajectory.fields().indexOf(field) < 0:
            continue
        x, y = tool["xy_m"]
        half = tool["width_m"] / 2
        wanted = QgsFeatureRequest().setFilterExpression(f'"{field}" is not null and "heading_deg" is not null')
        wanted.setSubsetOfAttributes([field, "time", "heading_deg"], trajectory.fields())
        passes: dict[Any, list[tuple[QDateTime, QgsPointXY, QgsPointXY]]] = {}
        for pose in trajectory.getFeatures(wanted.addOrderBy("time")):
            place = pose.geometry().asPoint()
            turn = math.radians(pose["heading_deg"])
            ahead = (math.sin(turn), math.cos(turn))
            left = (-math.cos(turn), math.sin(turn))
            ends = (
                QgsPointXY(*(place[k] + x * ahead[k] + aside * left[k] for k in (0, 1)))
                for aside in (y + half, y - half)
            )
            passes.setdefault(pose[field], []).append((pose["time"], *ends))
        for swept in passes.values():
            first = 0
            for k, (time, _, _) in enumerate(swept):
                if k and (swept[first][0].msecsTo(time) >= 1000.0 * piece_s or k == len(swept) - 1):
                    piece = swept[first : k + 1]
                    first = k
                    ring = [*(end for _, end, _ in piece), *(end for _, _, end in reversed(piece))]
                    strip = QgsFeature()
                    strip.setGeometry(QgsGeometry.fromPolygonXY([ring]))
                    strip.setAttributes([time])
                    strips.append(strip)
    return strips


def _strip_layer(like: QgsMapLayer, strips: Sequence[QgsFeature]) -> QgsVectorLayer:
    """Strips as a layer of which each appears at its time."""
    layer = QgsVectorLayer("Polygon?field=end:datetime", like.name(), "memory")
    layer.setCrs(like.crs())
    layer.setCustomProperty("skipMemoryLayersCheck", 1)
    layer.dataProvider().addFeatures([QgsFeature(strip) for strip in strips])
    layer.updateExtents()
    time = layer.temporalProperties()
    time.setMode(Qgis.VectorTemporalMode.FeatureDateTimeInstantFromField)
    time.setStartField("end")
    time.setAccumulateFeatures(True)
    time.setIsActive(True)
    return layer


def las_time_s(when: QDateTime) -> float:
    """Adjusted standard GPS time, as LAS files have it, of a `QDateTime`."""
    leap_s = next((seconds for day, seconds in LEAP_S if when >= QDateTime(day, QTime(0, 0), Qt.TimeSpec.UTC)), 15.0)
    return when.toMSecsSinceEpoch() / 1000.0 - GPS_EPOCH_UNIX_S + leap_s - LAS_OFFSET_S
