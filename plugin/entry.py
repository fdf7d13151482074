# SPDX-License-Identifier: GPL-2.0-or-later
"""What the plugin registers in QGIS and removes again: algorithms, dock, locator filter, options page."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from qgis.core import QgsApplication
from qgis.PyQt.QtCore import QCoreApplication, Qt
from qgis.PyQt.QtGui import QIcon
from qgis.PyQt.QtWidgets import QAction

from .processing.algorithm import FurrowmapProvider
from .translation import install_translator

tr = partial(QCoreApplication.translate, "FurrowmapPlugin")


class FurrowmapPlugin:
    """The plugin: :meth:`unload` removes everything that :meth:`initGui` registered."""

    dock: Any = None

    def __init__(self, iface: Any) -> None:
        self.iface = iface  # a QgisInterface; None in qgis_process, which has no window
        self.provider: FurrowmapProvider | None = None
        self.translator = install_translator()

    def initProcessing(self) -> None:  # noqa: N802 - the names are QGIS's
        """Add the algorithms; qgis_process calls nothing else."""
        self.provider = FurrowmapProvider()
        QgsApplication.processingRegistry().addProvider(self.provider)

    def initGui(self) -> None:  # noqa: N802
        """Register the algorithms, the dock with its menu entry and toolbar button, and the rest."""
        from .basemap import AttributionLabel
        from .dock.dock import FurrowmapDock
        from .dock.dropped import ResultsDropHandler
        from .locator import PassLocator
        from .options_page import OptionsFactory, OptionsPage

        self.initProcessing()
        self.dock = FurrowmapDock(self.iface)
        self.iface.addDockWidget(Qt.DockWidgetArea.RightDockWidgetArea, self.dock)
        self.action = QAction(QIcon(str(Path(__file__).with_name("icon.svg"))), tr("furrowmap"), self.dock)
        self.action.setObjectName("furrowmapShow")
        self.action.setCheckable(True)
        self.dock.setToggleVisibilityAction(self.action)
        self.iface.pluginMenu().addAction(self.action)  # a submenu would stay after unloading
        self.iface.addToolBarIcon(self.action)
        self.drops = ResultsDropHandler(self.dock.open_paths)
        self.iface.registerCustomDropHandler(self.drops)
        self.locator = PassLocator(self.iface)
        self.iface.registerLocatorFilter(self.locator)
        self.attribution = AttributionLabel(self.iface.mapCanvas())
        self.options = OptionsFactory()
        OptionsPage.is_working = self.dock.is_working
        self.iface.registerOptionsWidgetFactory(self.options)

    def unload(self) -> None:
        """Remove everything; running tasks are cancelled."""
        if self.dock is not None:
            self.iface.unregisterOptionsWidgetFactory(self.options)
            self.options.end()
            self.options.forget_dock()
            self.attribution.remove()
            self.iface.deregisterLocatorFilter(self.locator)
            self.iface.unregisterCustomDropHandler(self.drops)
            self.iface.removeToolBarIcon(self.action)
            self.iface.pluginMenu().removeAction(self.action)
            self.dock.end()
            self.iface.removeDockWidget(self.dock)
            self.dock.deleteLater()
            del self.dock, self.action, self.attribution, self.drops, self.locator, self.options
        QgsApplication.processingRegistry().removeProvider(self.provider)
        self.provider = None
        if self.translator is not None:
            QCoreApplication.removeTranslator(self.translator)
            self.translator = None
