# SPDX-License-Identifier: GPL-2.0-or-later
"""The page of a batch: the state of each drive, and what can be done with those that have ended."""

from qgis.PyQt.QtCore import Qt, pyqtSignal
from qgis.PyQt.QtWidgets import QHBoxLayout, QLabel, QListWidget, QListWidgetItem, QPushButton, QVBoxLayout, QWidget

from .batch import CANCELLED, DONE, ENDED, FAILED, RUNNING, TO_FILL_IN, WAITING

MARKS = {WAITING: "·", RUNNING: "▸", DONE: "✓", FAILED: "✗", TO_FILL_IN: "?", CANCELLED: "–"}


class BatchPage(QWidget):
    """Shows the drives of a batch.

    Signals:
        cancelled: the user pressed *Cancel*.
        opened: with a drive that has ended: its result, or its session in the form.
        farm_wanted: with the folders of the results that are to be added to the farm map.
        left: back to the start page.
    """

    cancelled = pyqtSignal()
    opened = pyqtSignal(object)
    farm_wanted = pyqtSignal(object)
    left = pyqtSignal()

    def __init__(self, parent=None):
        super().__init__(parent)
        self._drives = []
        layout = QVBoxLayout(self)
        self.title = QLabel()
        self.list = QListWidget(objectName="furrowmapBatch")
        self.list.setWordWrap(True)
        self.list.itemActivated.connect(self._open)
        hint = QLabel(self.tr("Double-click a drive to open its result, or its session where something is missing."))
        hint.setWordWrap(True)
        for widget in (self.title, self.list, hint):
            layout.addWidget(widget)
        self.cancel = QPushButton(self.tr("Cancel"), objectName="furrowmapBatchCancel")
        self.farm = QPushButton(self.tr("Add all to farm map…"), objectName="furrowmapBatchFarm")
        self.back = QPushButton(self.tr("Other session"), objectName="furrowmapBatchBack")
        self.cancel.clicked.connect(self.cancelled)
        self.farm.clicked.connect(lambda: self.farm_wanted.emit([d.folder for d in self._drives if d.state == DONE]))
        self.back.clicked.connect(self.left)
        row = QHBoxLayout()
        for button in (self.cancel, self.farm, self.back):
            row.addWidget(button)
        layout.addLayout(row)

    def show_drives(self, drives):
        """Show these drives."""
        self._drives = drives
        self.list.clear()
        for number in range(len(drives)):
            self.list.addItem(QListWidgetItem())
            self.refresh(number)

    def refresh(self, number):
        """Show the state of a drive."""
        drive, item = self._drives[number], self.list.item(number)
        words = {
            WAITING: self.tr("waiting"),
            RUNNING: self.tr("running"),
            DONE: self.tr("done"),
            FAILED: self.tr("failed"),
            TO_FILL_IN: self.tr("not run: recordings or places are missing"),
            CANCELLED: self.tr("cancelled"),
        }
        name = drive.session.parent.name + ("" if drive.session.stem == "session" else f" / {drive.session.stem}")
        state = f"{words[drive.state]}: {drive.text.splitlines()[0]}" if drive.text else words[drive.state]
        item.setText(f"{MARKS[drive.state]} {name}\n    {state}")
        item.setToolTip(drive.text or str(drive.session))
        item.setData(Qt.ItemDataRole.UserRole, number)
        ended, all_of = sum(d.state in ENDED for d in self._drives), len(self._drives)
        self.title.setText("<b>" + self.tr("{ended} of {all} drives").format(ended=ended, all=all_of) + "</b>")
        self.cancel.setEnabled(ended < all_of)
        self.back.setEnabled(ended == all_of)
        self.farm.setEnabled(ended == all_of and any(d.state == DONE for d in self._drives))

    def _open(self, item):
        drive = self._drives[item.data(Qt.ItemDataRole.UserRole)]
        if not self.cancel.isEnabled():
            self.opened.emit(drive)
