"""What the stories in the desktop QGIS have in common: widgets of the plugin, drops, and waiting without blocking.

A story is a generator: it yields what has to become true before it goes on, or None to let QGIS work for a moment.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import qgis.utils
from qgis.core import QgsApplication
from qgis.PyQt.QtCore import QMimeData, QPoint, QPointF, Qt, QTimer, QUrl
from qgis.PyQt.QtGui import QDragEnterEvent, QDropEvent
from qgis.PyQt.QtTest import QTest
from qgis.PyQt.QtWidgets import QApplication, QWidget

LONGEST_S = 120.0
KEPT: list[Any] = []
"""What Python must not collect while QGIS is running."""


def plugin() -> Any:
    return qgis.utils.plugins["furrowmap"]


def widget(name: str) -> Any:
    found = plugin().dock.findChild(QWidget, name)
    assert found is not None, name
    return found


def click(name: str) -> None:
    assert widget(name).isVisible(), name
    QTest.mouseClick(widget(name), Qt.MouseButton.LeftButton)


def drop(target: QWidget, paths: Sequence[str | Path]) -> None:
    mime = QMimeData()
    mime.setUrls([QUrl.fromLocalFile(str(path)) for path in paths])
    held = (Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier)
    QApplication.sendEvent(target, QDragEnterEvent(QPoint(30, 30), Qt.DropAction.CopyAction, mime, *held))
    QApplication.sendEvent(target, QDropEvent(QPointF(30, 30), Qt.DropAction.CopyAction, mime, *held))


def page(name: str) -> Callable[[], bool]:
    return lambda: plugin().dock.pages.currentWidget() is getattr(plugin().dock, name)


def current_page() -> str:
    dock = plugin().dock
    pages = ("start", "session", "run", "result", "drives")
    return next(name for name in pages if dock.pages.currentWidget() is getattr(dock, name))


def idle() -> bool:
    """Whether no task runs and no result is being opened."""
    return not QgsApplication.taskManager().countActiveTasks() and plugin().dock._steps is None


def tell(story: Iterator[Any], seen: dict[str, Any], iface: Any, leave: Callable[[], None]) -> None:
    """Run a story in the event loop of QGIS, print what it has seen as a line of JSON, and leave QGIS."""
    timer = QTimer(iface.mainWindow())
    wait: dict[str, Any] = {"for": None, "since": time.monotonic()}

    def tick() -> None:
        if wait["for"] is not None and not wait["for"]():
            if time.monotonic() - wait["since"] > LONGEST_S:
                timer.stop()
                bar = iface.messageBar().currentItem()
                raise AssertionError(story.gi_frame, story.gi_yieldfrom, bar.text() if bar else "", current_page())  # type: ignore[attr-defined]
            return
        try:
            wait["for"] = next(story)
            wait["since"] = time.monotonic()
        except BaseException as end:
            timer.stop()
            if not isinstance(end, StopIteration):
                raise
            sys.stdout.write(json.dumps(seen, default=str) + "\n")
            sys.stdout.flush()
            leave()

    timer.timeout.connect(tick)
    KEPT.extend((timer, tick, story))
    timer.start(5)
