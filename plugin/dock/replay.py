# SPDX-License-Identifier: GPL-2.0-or-later
"""Replay of a drive in QGIS's temporal controller."""

from qgis.core import QgsDateTimeRange, QgsInterval, QgsTemporalNavigationObject
from qgis.PyQt.QtWidgets import QDockWidget

from ..results import time_span

FRAMES_PER_S = 10.0
LONGEST_S = 120.0
"""A long day takes two minutes; shorter drives are played at :data:`SPEED`."""
SPEED = 10.0


def replay(iface, report):
    """Start to play the time span of a report.

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
    seconds = max(start.msecsTo(end) / 1000.0, 1.0)
    step_s = max(SPEED, seconds / LONGEST_S) / FRAMES_PER_S
    controller.setNavigationMode(QgsTemporalNavigationObject.NavigationMode.Animated)
    controller.setTemporalExtents(QgsDateTimeRange(start, end))
    controller.setFrameDuration(QgsInterval(step_s))
    controller.setFramesPerSecond(FRAMES_PER_S)
    controller.rewindToStart()
    controller.playForward()
    return True
