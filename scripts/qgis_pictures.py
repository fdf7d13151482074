"""Runs inside the desktop QGIS (scripts/qgis_desktop.sh): pictures of the dock beside the map, and of a printed page.

Arguments: session file of a drive, folder with its result, folder for the pictures.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import qgis.utils
from qgis.core import QgsApplication, QgsLayoutExporter, QgsProject
from qgis.PyQt.QtCore import QPoint, QRect, QTimer
from qgis.PyQt.QtWidgets import QDockWidget, QScrollArea

SESSION, RESULT, IMAGES = (Path(word) for word in arguments)  # noqa: F821 - given by qgis_desktop.sh
WINDOW = iface.mainWindow()  # noqa: F821
CANVAS = iface.mapCanvas()  # noqa: F821
DOTS_PER_INCH = 100


def idle() -> bool:
    """Whether the result is open and the map drawn."""
    return qgis.utils.plugins["furrowmap"].dock._steps is None and not CANVAS.isDrawing()


def grab(dock: QDockWidget, name: str) -> None:
    """The picture of the map and the dock beside it, as on the screen."""
    iface.messageBar().clearWidgets()  # noqa: F821
    shown = QRect(CANVAS.mapToGlobal(QPoint(0, 0)), CANVAS.size())
    shown = shown.united(QRect(dock.mapToGlobal(QPoint(0, 0)), dock.size()))
    screen = QgsApplication.primaryScreen()
    screen.grabWindow(0, shown.x(), shown.y(), shown.width(), shown.height()).save(str(IMAGES / name))


def drawn() -> Iterator[None]:
    """Wait until the map is drawn, which it is again where a file has come."""
    for _ in range(40):
        yield
        while not idle():
            yield


def preview(dock: Any) -> Iterator[None]:
    """The form of the session beside its preview, and the form alone where it shows the vehicle."""
    dock.open_session(SESSION)
    yield from drawn()
    dock.preview_session(SESSION)
    while dock.previewer.busy:
        yield
    yield from drawn()
    grab(dock, "preview.png")
    dock.session.findChild(QScrollArea).ensureWidgetVisible(dock.session.vehicle, 0, 240)
    yield from drawn()
    dock.grab().save(str(IMAGES / "session.png"))
    dock.go_back()
    QgsProject.instance().clear()


def story() -> Iterator[None]:
    """Open the session, then the result, and take their pictures."""
    from furrowmap.results import groups_of, read_report
    from furrowmap.session_layout import session_layout

    dock = qgis.utils.plugins["furrowmap"].dock
    for other in WINDOW.findChildren(QDockWidget):
        other.setVisible(other is dock)
    dock.show()
    WINDOW.resizeDocks([dock], [290], 1)
    yield
    yield from preview(dock)
    dock.open_folder(RESULT)
    yield from drawn()
    grab(dock, "dock.png")
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
