"""Runs inside the desktop QGIS (scripts/qgis_desktop.sh): drops the folder of a run on the dock and times what follows.

Argument: the folder. Prints a line of JSON for each round: seconds to the layers, to the first map that is drawn whole
after that, to the map with the cloud from the moment it is checked, and the longest time the window's thread was busy.
"""

from __future__ import annotations

import json
import time
from pathlib import Path

import qgis.utils
from qgis.core import QgsProject
from qgis.PyQt.QtCore import QMimeData, QPoint, QPointF, Qt, QTimer, QUrl
from qgis.PyQt.QtGui import QDragEnterEvent, QDropEvent
from qgis.PyQt.QtWidgets import QApplication

ROUNDS = 4
(FOLDER,) = arguments  # noqa: F821 - given by qgis_desktop.sh
DOCK = qgis.utils.plugins["furrowmap"].dock
CANVAS = iface.mapCanvas()  # noqa: F821
SEEN: dict[str, float] = {}
STATE = {"round": 0, "begun": 0.0, "checked": 0.0, "drawn": 0.0, "tick": time.monotonic(), "busy": 0.0}


def begin() -> None:
    QgsProject.instance().clear()
    DOCK.show_start()
    SEEN.clear()
    STATE.update(round=STATE["round"] + 1, begun=time.monotonic(), tick=time.monotonic(), busy=0.0)
    mime = QMimeData()
    mime.setUrls([QUrl.fromLocalFile(FOLDER)])
    held = (Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier)
    QApplication.sendEvent(DOCK, QDragEnterEvent(QPoint(30, 30), Qt.DropAction.CopyAction, mime, *held))
    QApplication.sendEvent(DOCK, QDropEvent(QPointF(30, 30), Qt.DropAction.CopyAction, mime, *held))


def look() -> None:
    now = time.monotonic()
    STATE["busy"] = max(STATE["busy"], now - STATE["tick"])
    STATE["tick"] = now
    if DOCK.pages.currentWidget() is not DOCK.result:
        return
    SEEN.setdefault("layers after", now - STATE["begun"])
    since = STATE["checked"] if "map after" in SEEN else STATE["begun"] + SEEN["layers after"]
    if CANVAS.isDrawing() or STATE["drawn"] < since:
        return
    if "map after" not in SEEN:
        SEEN["map after"] = now - STATE["begun"]
        for node in QgsProject.instance().layerTreeRoot().findLayers():
            if node.name() == "cloud":
                node.setItemVisibilityChecked(True)
        STATE["checked"] = now
        return
    SEEN["cloud after"] = now - STATE["checked"]
    SEEN["window busy at most"] = STATE["busy"]
    print(json.dumps(SEEN), flush=True)
    shot(Path(FOLDER) / f"round{STATE['round']:.0f}.png")  # noqa: F821
    if STATE["round"] < ROUNDS:
        begin()
    else:
        TIMER.stop()
        leave()  # noqa: F821


def drawn() -> None:
    STATE["drawn"] = time.monotonic()


CANVAS.mapCanvasRefreshed.connect(drawn)
TIMER = QTimer()
TIMER.timeout.connect(look)
begin()
TIMER.start(5)
