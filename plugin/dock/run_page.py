# SPDX-License-Identifier: GPL-2.0-or-later
"""The page of work under way: its stages, the share of the present one, and a button that stops it."""

from qgis.PyQt.QtCore import QTimer, pyqtSignal
from qgis.PyQt.QtWidgets import QLabel, QListWidget, QProgressBar, QPushButton, QVBoxLayout, QWidget

from .tasks import Clock

SECOND_MS = 1000


class RunPage(QWidget):
    """Tells how the work goes.

    Signals:
        cancelled: the user wants it to stop.
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
        self._clock = None

    def begin(self, title):
        """Work with this title begins."""
        self.title.setText(f"<b>{title}</b>")
        self.stages.clear()
        self.bar.setRange(0, 0)
        self.cancel.setEnabled(True)
        self.cancel.setText(self.tr("Cancel"))
        self._clock = Clock()
        self._tick()
        self._timer.start(SECOND_MS)

    def end(self):
        """No work any more."""
        self._timer.stop()

    def show_stage(self, name):
        """The next stage begins; those before are done."""
        last = self.stages.count() - 1
        if last >= 0:
            item = self.stages.item(last)
            item.setText("✓ " + item.text()[2:])
        self.stages.addItem(f"▸ {name}")
        self.stages.scrollToBottom()
        self.bar.setRange(0, 0)

    def show_share(self, percent):
        """How much of the present stage is done; while nothing is known of it the bar only moves."""
        if percent > 0:
            self.bar.setRange(0, 100)
            self.bar.setValue(round(percent))

    def _stop(self):
        self.cancel.setEnabled(False)
        self.cancel.setText(self.tr("Stopping…"))
        self.cancelled.emit()

    def _tick(self):
        self.time.setText(self.tr("{time} since the beginning").format(time=self._clock))
