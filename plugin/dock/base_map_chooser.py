# SPDX-License-Identifier: GPL-2.0-or-later
"""The choice of a base map: a row of the dock."""

from qgis.core import QgsProject
from qgis.PyQt.QtWidgets import QComboBox, QFormLayout, QLabel, QLineEdit, QWidget

from ..basemap import NONE, OWN, base_map_layers, base_maps, remember, remembered, show_base_map


class BaseMapChooser(QWidget):
    """A list of base maps; nothing is downloaded until one is chosen.

    Args:
        report: is called with an error message.
    """

    def __init__(self, report, parent=None):
        super().__init__(parent)
        self._report = report
        form = QFormLayout(self)
        form.setContentsMargins(6, 0, 6, 0)
        self.box = QComboBox(objectName="furrowmapBaseMap")
        self.box.addItem(self.tr("none (offline)"), NONE)
        for base in base_maps():
            self.box.addItem(base.name, base.key)
        self.box.addItem(self.tr("other tiles or file…"), OWN)
        self.own = QLineEdit(objectName="furrowmapOwnBaseMap")
        self.own.setPlaceholderText("https://…/{z}/{x}/{y}.png")
        self.own.setToolTip(
            self.tr("URL of XYZ tiles or of a RESTful WMTS in Web Mercator, or the path of an MBTiles file")
        )
        self.own.setText(remembered()[1])
        self.own.setVisible(False)
        form.addRow(QLabel(self.tr("Base map")), self.box)
        form.addRow(self.own)
        self.box.activated.connect(self._chosen)
        self.own.returnPressed.connect(self._apply)
        QgsProject.instance().readProject.connect(self.follow_project)
        self.follow_project()

    def follow_project(self, *_):
        """Show the project's base map."""
        layers = base_map_layers(QgsProject.instance())
        key = layers[0].customProperty("furrowmap/basemap") if layers else NONE
        self.box.setCurrentIndex(max(self.box.findData(key), 0))
        self.own.setVisible(key == OWN)

    def _chosen(self, *_):
        own = self.box.currentData() == OWN
        self.own.setVisible(own)
        if not own or self.own.text().strip():
            self._apply()

    def _apply(self):
        key, own = self.box.currentData(), self.own.text()
        try:
            show_base_map(key, own)
        except ValueError as error:
            self._report(str(error))
            return
        remember(key, own)
