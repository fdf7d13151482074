# SPDX-License-Identifier: GPL-2.0-or-later
"""The page of a running task: its stages, progress, and a button to cancel."""

import time

from qgis.PyQt.QtCore import QTimer, pyqtSignal
from qgis.PyQt.QtWidgets import QLabel, QListWidget, QProgressBar, QPushButton, QVBoxLayout, QWidget

SECOND_MS = 1000


class RunPage(QWidget):
    """Shows the progress.

    Signals:
        cancelled: the user pressed *Cancel*.
    """

    cancelled = pyqtSignal()

    def __init__(self, parent=None):
        super().__init__(parent)
        layout = QVBoxLayout(self)
        self.title = QLabel(objectName="furrowmapRunTitle")
        self.title.setWordWrap(True)
        self.stages = QListWidget(objectName="furrowmapStages")
        self.bar = QProgressBar(objectName="furrowmapProgress")
        self.time = QLabel()
        self.cancel = QPushButton(self.tr("Cancel"), objectName="furrowmapCancel")
        self.cancel.clicked.connect(self._stop)
        for widget in (self.title, self.stages, self.bar, self.time, self.cancel):
            layout.addWidget(widget)
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._tick)
        self._begun = 0.0

    def begin(self, title):
        """Start with this title."""
        self.title.setText(f"<b>{title}</b>")
        self.stages.clear()
        self.bar.setRange(0, 0)
        self.cancel.setEnabled(True)
        self.cancel.setText(self.tr("Cancel"))
        self._begun = time.monotonic()
        self._tick()
        self._timer.start(SECOND_MS)

    def end(self):
        """The task has ended."""
        self._timer.stop()

    def show_stage(self, name):
        """Show the next stage; mark the one before as done."""
        last = self.stages.count() - 1
        if last >= 0:
            item = self.stages.item(last)
            item.setText("✓ " + item.text()[2:])
        self.stages.addItem(f"▸ {name}")
        self.stages.scrollToBottom()
        self.bar.setRange(0, 0)

    def show_share(self, percent):
        """Show the progress within the stage; at 0 the bar is indeterminate."""
        if percent > 0:
            self.bar.setRange(0, 100)
            self.bar.setValue(round(percent))

    def _stop(self):
        self.cancel.setEnabled(False)
        self.cancel.setText(self.tr("Cancelling…"))
        self.cancelled.emit()

    def _tick(self):
        minutes, seconds = divmod(int(time.monotonic() - self._begun), 60)
        self.time.setText(self.tr("Elapsed: {time}").format(time=f"{minutes}:{seconds:02d}"))
