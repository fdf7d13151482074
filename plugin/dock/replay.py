# SPDX-License-Identifier: GPL-2.0-or-later
"""Replay of a drive in QGIS's temporal controller, with the points of its cloud as they were scanned."""

from __future__ import annotations

from typing import Any

from qgis.core import (
    QgsDateTimeRange,
    QgsInterval,
    QgsLayerTreeGroup,
    QgsPointCloudLayer,
    QgsTemporalNavigationObject,
)
from qgis.gui import QgisInterface
from qgis.PyQt.QtCore import QDate, QDateTime, QObject, Qt, QTime
from qgis.PyQt.QtWidgets import QDockWidget

from ..results import time_span

FRAMES_PER_S = 10.0
MAX_REPLAY_S = 120.0
"""A long day takes two minutes; shorter drives are played at :data:`REPLAY_SPEED`."""
REPLAY_SPEED = 10.0
CLOUD_FRAMES_PER_S = 2.0
"""With a visible cloud, which takes longer to draw."""
GPS_EPOCH_UNIX_S = 315_964_800.0
LAS_OFFSET_S = 1e9
LEAP_S = ((QDate(2017, 1, 1), 18.0), (QDate(2015, 7, 1), 17.0), (QDate(2012, 7, 1), 16.0))
"""First day with so many leap seconds, the latest first."""


def replay(iface: QgisInterface, report: dict[str, Any], group: QgsLayerTreeGroup | None = None) -> bool:
    """Start to play the time span of a run's report.

    Args:
        group: of its layers; of a visible cloud in it, points appear at the time at which they were scanned.

    Returns:
        Whether the report has a time span and QGIS a temporal controller.
    """
    span, controller = time_span(report), iface.mapCanvas().temporalController()
    if span is None or not isinstance(controller, QgsTemporalNavigationObject):
        return False
    start, end = span
    for dock in iface.mainWindow().findChildren(QDockWidget):
        if dock.objectName() == "Temporal Controller":
            dock.show()
    nodes = group.findLayers() if group is not None else []
    clouds = [node.layer() for node in nodes if node.isVisible() and isinstance(node.layer(), QgsPointCloudLayer)]
    frames_per_s = CLOUD_FRAMES_PER_S if clouds else FRAMES_PER_S
    seconds = max(start.msecsTo(end) / 1000.0, 1.0)
    step_s = max(REPLAY_SPEED, seconds / MAX_REPLAY_S) / frames_per_s
    for cloud in clouds:
        _GrowingCloud(cloud, controller)
    controller.setNavigationMode(QgsTemporalNavigationObject.NavigationMode.Animated)
    controller.setTemporalExtents(QgsDateTimeRange(start, end))
    controller.setFrameDuration(QgsInterval(step_s))
    controller.setFramesPerSecond(frames_per_s)
    controller.rewindToStart()
    controller.playForward()
    return True


class _GrowingCloud(QObject):
    """Shows of a cloud what was scanned until the controller's time, until temporal navigation is turned off.

    QGIS's own temporal settings know no point clouds, but their filter does know the time of a point.
    """

    def __init__(self, cloud: QgsPointCloudLayer, controller: QgsTemporalNavigationObject) -> None:
        for other in cloud.findChildren(_GrowingCloud):
            other.end()
        super().__init__(cloud)
        self._controller, self._own_filter = controller, cloud.subsetString()
        controller.updateTemporalRange.connect(self._show)  # navigationModeChanged crashes PyQt: it lacks the enum

    def end(self) -> None:
        """Show all points again."""
        self._controller.updateTemporalRange.disconnect(self._show)
        self._filter(self._own_filter)
        self.setParent(None)
        self.deleteLater()

    def _show(self, until: QgsDateTimeRange) -> None:
        if not until.end().isValid():  # the navigation was turned off
            self.end()
            return
        time = f"GpsTime <= {las_time_s(until.end()):.3f}"
        self._filter(f"({self._own_filter}) AND {time}" if self._own_filter else time)

    def _filter(self, text: str) -> None:
        cloud = self.parent()
        if cloud.subsetString() != text:
            cloud.setSubsetString(text)
            cloud.triggerRepaint()


def las_time_s(when: QDateTime) -> float:
    """Adjusted standard GPS time, as LAS files have it, of a `QDateTime`."""
    leap_s = next((seconds for day, seconds in LEAP_S if when >= QDateTime(day, QTime(0, 0), Qt.TimeSpec.UTC)), 15.0)
    return when.toMSecsSinceEpoch() / 1000.0 - GPS_EPOCH_UNIX_S + leap_s - LAS_OFFSET_S
