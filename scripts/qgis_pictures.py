"""Runs inside the desktop QGIS (scripts/qgis_desktop.sh): pictures of the dock beside the map, and of a printed page.

Arguments: folder with the result of a drive, folder for the pictures.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import qgis.utils
from qgis.core import QgsApplication, QgsLayoutExporter, QgsProject
from qgis.PyQt.QtCore import QPoint, QRect, QTimer
from qgis.PyQt.QtWidgets import QDockWidget

RESULT, IMAGES = (Path(word) for word in arguments)  # noqa: F821 - given by qgis_desktop.sh
WINDOW = iface.mainWindow()  # noqa: F821
CANVAS = iface.mapCanvas()  # noqa: F821
DOTS_PER_INCH = 100


def idle() -> bool:
    """Whether the result is open and the map drawn."""
    return qgis.utils.plugins["furrowmap"].dock._steps is None and not CANVAS.isDrawing()


def story() -> Iterator[None]:
    """Open the result, and take its pictures."""
    from furrowmap.results import groups_of, read_report
    from furrowmap.session_layout import session_layout

    dock = qgis.utils.plugins["furrowmap"].dock
    for other in WINDOW.findChildren(QDockWidget):
        other.setVisible(other is dock)
    dock.show()
    WINDOW.resizeDocks([dock], [290], 1)
    yield
    dock.open_folder(RESULT)
    for _ in range(40):  # the map is drawn again where a file has come
        yield
        while not idle():
            yield
    iface.messageBar().clearWidgets()  # noqa: F821
    yield
    shown = QRect(CANVAS.mapToGlobal(QPoint(0, 0)), CANVAS.size())
    shown = shown.united(QRect(dock.mapToGlobal(QPoint(0, 0)), dock.size()))
    screen = QgsApplication.primaryScreen()
    screen.grabWindow(0, shown.x(), shown.y(), shown.width(), shown.height()).save(str(IMAGES / "dock.png"))
    project = QgsProject.instance()
    layout = session_layout(project, groups_of(project, RESULT)[0], read_report(RESULT))
    settings = QgsLayoutExporter.ImageExportSettings()
    settings.dpi = DOTS_PER_INCH
    settings.pages = [0]
    QgsLayoutExporter(layout).exportToImage(str(IMAGES / "page.png"), settings)


STEPS = story()
TIMER = QTimer(WINDOW)
KEPT: list[Any] = [TIMER]


def tick() -> None:
    """Do a step; leave after the last."""
    try:
        next(STEPS)
    except StopIteration:
        TIMER.stop()
        leave()  # noqa: F821


TIMER.timeout.connect(tick)
TIMER.start(50)
