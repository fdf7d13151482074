"""Runs inside QGIS: loads the plugin as the plugin manager does, twenty times, and opens a folder with it.

Prints as JSON the menu's entries after each start and each unload, and the layers that the folder gave.
The window is a real one without a screen; of QGIS's interface there is what the plugin may touch.
"""

from __future__ import annotations

import json
import sys

import qgis.utils
from qgis.core import QgsApplication, QgsProject
from qgis.gui import QgsMessageBar
from qgis.PyQt.QtCore import QEvent
from qgis.PyQt.QtWidgets import QMainWindow, QMenu

PLUGIN = "furrowmap"


class Interface:
    def __init__(self) -> None:
        self.window = QMainWindow()
        self.bar = QgsMessageBar(self.window)
        self.menus: dict[str, QMenu] = {}

    def mainWindow(self) -> QMainWindow:
        return self.window

    def messageBar(self) -> QgsMessageBar:
        return self.bar

    def addPluginToMenu(self, name: str, action: object) -> None:
        self.menus.setdefault(name, QMenu(name, self.window)).addAction(action)

    def removePluginMenu(self, name: str, action: object) -> None:
        self.menus[name].removeAction(action)

    def entries(self) -> list[str]:
        return [action.text() for menu in self.menus.values() for action in menu.actions()]


def main(plugins_folder: str, results: str) -> None:
    application = QgsApplication([], True)
    application.initQgis()
    sys.path.insert(0, plugins_folder)
    qgis.utils.plugin_paths.append(plugins_folder)
    qgis.utils.iface = interface = Interface()
    qgis.utils.updateAvailablePlugins()
    started, unloaded = [], []
    for _ in range(20):
        assert qgis.utils.loadPlugin(PLUGIN)
        assert qgis.utils.startPlugin(PLUGIN)
        started.append(interface.entries())
        assert qgis.utils.unloadPlugin(PLUGIN)
        unloaded.append(interface.entries())
        QgsApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    children = [child.objectName() for child in interface.window.children() if "urrowmap" in child.objectName()]

    from furrowmap.results import NoResultsError, open_results

    layers = open_results(results)
    group = QgsProject.instance().layerTreeRoot().children()[0]
    try:
        open_results(plugins_folder)
        refusal = ""
    except NoResultsError as error:
        refusal = str(error)
    answer = {
        "version": qgis.utils.pluginMetadata(PLUGIN, "version"),
        "started": started,
        "unloaded": unloaded,
        "left": children,
        "layers": [
            [layer.name(), layer.crs().authid(), layer.isValid(), layer.temporalProperties().isActive()]
            for layer in layers
        ],
        "group": group.name(),
        "in_group": [node.name() for node in group.findLayers()],
        "refusal": refusal,
    }
    print(json.dumps(answer))
    QgsProject.instance().clear()
    application.exitQgis()


main(*sys.argv[1:])
