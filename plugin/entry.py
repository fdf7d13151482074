# SPDX-License-Identifier: GPL-2.0-or-later
"""What the plugin adds to QGIS, and takes away again: the algorithms' provider and an entry in the plugins menu."""

from pathlib import Path

from qgis.core import Qgis, QgsApplication
from qgis.PyQt.QtCore import QCoreApplication
from qgis.PyQt.QtGui import QIcon
from qgis.PyQt.QtWidgets import QAction, QFileDialog

from .processing.provider import FurrowmapProvider
from .results import NoResultsError, open_results

MENU = "furrowmap"


class FurrowmapPlugin:
    """Everything registered in :meth:`initGui` is gone after :meth:`unload`."""

    def __init__(self, iface):
        self.iface = iface  # None in qgis_process, which has no window
        self.action = None
        self.provider = None

    def initProcessing(self):  # noqa: N802 - the names are QGIS's
        """Add the algorithms; qgis_process calls nothing else."""
        self.provider = FurrowmapProvider()
        QgsApplication.processingRegistry().addProvider(self.provider)

    def initGui(self):  # noqa: N802
        """Add the algorithms and the menu entry."""
        self.initProcessing()
        icon = QIcon(str(Path(__file__).with_name("icon.svg")))
        self.action = QAction(icon, self.tr("Open furrowmap results…"), self.iface.mainWindow())
        self.action.setObjectName("furrowmapOpenResults")
        self.action.triggered.connect(self.choose_and_open)
        self.iface.addPluginToMenu(MENU, self.action)

    def unload(self):
        """Remove whatever was added."""
        QgsApplication.processingRegistry().removeProvider(self.provider)
        self.provider = None
        self.iface.removePluginMenu(MENU, self.action)
        self.action.deleteLater()
        self.action = None

    def choose_and_open(self):
        """Ask for the folder of a run and open what it holds."""
        title = self.tr("Folder that 'furrowmap run' wrote")
        folder = QFileDialog.getExistingDirectory(self.iface.mainWindow(), title)
        if not folder:
            return
        try:
            layers = open_results(folder)
        except NoResultsError as error:
            self.iface.messageBar().pushMessage(MENU, str(error), level=Qgis.MessageLevel.Warning)
            return
        self.iface.setActiveLayer(layers[0])
        self.iface.zoomToActiveLayer()

    @staticmethod
    def tr(text):
        """`text` in the user's language."""
        return QCoreApplication.translate("FurrowmapPlugin", text)
