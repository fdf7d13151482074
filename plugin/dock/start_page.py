# SPDX-License-Identifier: GPL-2.0-or-later
"""The dock's first page: where recordings, sessions and results are dropped, and the sessions of late."""

from pathlib import Path

from qgis.core import QgsSettings
from qgis.PyQt.QtCore import Qt, pyqtSignal
from qgis.PyQt.QtWidgets import (
    QFileDialog,
    QFrame,
    QLabel,
    QListWidget,
    QListWidgetItem,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

RECENT_KEY = "furrowmap/recent"
MOST_RECENT = 10


class StartPage(QWidget):
    """A place to drop files, and buttons to choose them.

    Signals:
        chosen: with a list of paths.
        setup_wanted: the user pressed *Set up*.
    """

    chosen = pyqtSignal(object)
    setup_wanted = pyqtSignal()

    def __init__(self, parent=None):
        super().__init__(parent)
        layout = QVBoxLayout(self)
        self.setup = self._setup_offer()
        layout.addWidget(self.setup)
        here = QLabel(
            self.tr(
                "Drop here:\nrecordings of a drive,\ntheir folder, a session.toml,\na machine or the folder of a run.\n"
                "Several sessions or folders run one after another."
            ),
            objectName="furrowmapHere",
        )
        here.setAlignment(Qt.AlignmentFlag.AlignCenter)
        here.setMinimumHeight(120)
        here.setWordWrap(True)
        here.setStyleSheet("QLabel { border: 2px dashed palette(mid); border-radius: 6px; }")
        layout.addWidget(here)
        for name, text, slot in (
            ("furrowmapChoose", self.tr("Choose recordings or a session…"), self._choose_files),
            ("furrowmapChooseResults", self.tr("Open the folder of a run…"), self._choose_folder),
        ):
            button = QPushButton(text, objectName=name)
            button.clicked.connect(slot)
            layout.addWidget(button)
        layout.addWidget(QLabel(self.tr("Recent sessions")))
        self.recent = QListWidget(objectName="furrowmapRecent")
        self.recent.itemActivated.connect(lambda item: self.chosen.emit([Path(item.data(Qt.ItemDataRole.UserRole))]))
        layout.addWidget(self.recent, 1)
        self.show_recent()

    def show_setup(self, *, needed):
        """Show the offer to set up the worker, or hide it."""
        self.setup.setVisible(needed)

    def remember(self, session):
        """Move a session to the top of the recent ones."""
        known = [path for path in recent_sessions() if path != str(session)]
        QgsSettings().setValue(RECENT_KEY, [str(session), *known][:MOST_RECENT])
        self.show_recent()

    def show_recent(self):
        """List the recent sessions whose files exist."""
        self.recent.clear()
        for path in map(Path, recent_sessions()):
            if path.is_file():
                item = QListWidgetItem(f"{path.parent.name} / {path.name}")
                item.setToolTip(str(path))
                item.setData(Qt.ItemDataRole.UserRole, str(path))
                self.recent.addItem(item)

    def _setup_offer(self):
        frame = QFrame(objectName="furrowmapSetup")
        frame.setFrameShape(QFrame.Shape.StyledPanel)
        layout = QVBoxLayout(frame)
        words = QLabel(
            self.tr(
                "Existing results can be opened at once. To run sessions, set up furrowmap's worker: a separate Python "
                "environment. QGIS's Python is not changed."
            )
        )
        words.setWordWrap(True)
        button = QPushButton(self.tr("Set up…"), objectName="furrowmapSetupButton")
        button.clicked.connect(self.setup_wanted)
        layout.addWidget(words)
        layout.addWidget(button)
        return frame

    def _choose_files(self):
        title = self.tr("Recordings of one drive, or a session")
        files, _ = QFileDialog.getOpenFileNames(self, title)
        if files:
            self.chosen.emit([Path(file) for file in files])

    def _choose_folder(self):
        folder = QFileDialog.getExistingDirectory(self, self.tr("Folder that 'furrowmap run' wrote"))
        if folder:
            self.chosen.emit([Path(folder)])


def recent_sessions():
    """Paths of recent sessions, the latest first."""
    known = QgsSettings().value(RECENT_KEY, [])
    return [known] if isinstance(known, str) else list(known or [])
