# SPDX-License-Identifier: GPL-2.0-or-later
"""Play a drive in QGIS's temporal controller."""

from qgis.core import QgsDateTimeRange, QgsInterval, QgsTemporalNavigationObject
from qgis.PyQt.QtCore import QDateTime, Qt
from qgis.PyQt.QtWidgets import QDockWidget

FRAMES_PER_S = 10.0
LONGEST_S = 120.0
"""A day is played in two minutes, a drive of a minute ten times as fast as it was."""
SPEED = 10.0


def replay(iface, report):
    """Begin to play the time of a report, from its start.

    Returns:
        Whether the report tells its time and QGIS has a temporal controller.
    """
    figures = report.get("figures")
    controller = iface.mapCanvas().temporalController()
    if not isinstance(figures, dict) or not isinstance(controller, QgsTemporalNavigationObject):
        return False
    start, end = (QDateTime.fromString(str(figures.get(k)), Qt.DateFormat.ISODateWithMs) for k in ("start", "end"))
    if not (start.isValid() and end.isValid()):
        return False
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
