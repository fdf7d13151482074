# SPDX-License-Identifier: GPL-2.0-or-later
"""The dock's pages other than the form: to choose files, of a running task, of a result, and of a batch of drives."""

from __future__ import annotations

import html
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from qgis.core import QgsSettings
from qgis.PyQt.QtCore import Qt, QTimer, pyqtSignal
from qgis.PyQt.QtWidgets import (
    QComboBox,
    QFileDialog,
    QFrame,
    QGridLayout,
    QLabel,
    QListWidget,
    QListWidgetItem,
    QMenu,
    QProgressBar,
    QPushButton,
    QTextBrowser,
    QVBoxLayout,
    QWidget,
)

from ..figures import figures_html, localized, object_in, texts_above, verdict_html
from ..processing.description import COMMAND_OPTIONS
from ..products import product
from ..results import read_report, session_name, theme_words
from .form_parts import button, side_by_side, small_text, warning_colour
from .tasks import CANCELLED, CUT, DONE, DOUBTFUL, ENDED, FAILED, RUNNING, TO_FILL_IN, WAITING, Drive

RECENT_KEY = "furrowmap/recent"
MAX_RECENT = 10
MOST_ABOVE = 3
"""Findings above the figures, which a small screen shows besides; further ones follow below."""
DRIVE_MARKS = {
    WAITING: "·",
    RUNNING: "▸",
    DONE: "✓",
    DOUBTFUL: "⚠",
    CUT: "⚠",
    FAILED: "✗",
    TO_FILL_IN: "?",
    CANCELLED: "–",
}


class StartPage(QWidget):
    """A place to drop recordings, sessions and results, buttons to choose them, and the recent sessions.

    Signals:
        chosen: with a list of paths.
        run_wanted: with a session file that the form cannot edit, to run it as it is.
        output_wanted: with such a session file, to choose a folder for its products.
        copy_wanted: with paths that are to be copied, since their folder is read-only.
    """

    chosen = pyqtSignal(object)
    setup_wanted = pyqtSignal()
    drives_wanted = pyqtSignal()
    run_wanted = pyqtSignal(object)
    output_wanted = pyqtSignal(object)
    copy_wanted = pyqtSignal(object)

    def __init__(self) -> None:
        super().__init__()
        layout = QVBoxLayout(self)
        self.setup = QFrame(objectName="furrowmapSetup")
        self.setup.setFrameShape(QFrame.Shape.StyledPanel)
        offer = QVBoxLayout(self.setup)
        words = self.tr(
            "Existing results can be opened at once. To run sessions, set up furrowmap's worker: a separate Python "
            "environment. QGIS's Python is not changed."
        )
        offer.addWidget(QLabel(words, wordWrap=True))
        offer.addWidget(button("furrowmapSetupButton", self.tr("Set up…"), self.setup_wanted.emit))
        here = QLabel(
            self.tr(
                "Drop here:\nrecordings of a drive,\ntheir folder, a session.toml,\na machine or the folder of a run.\n"
                "Several sessions or folders run one after another."
            ),
            objectName="furrowmapHere",
            wordWrap=True,
        )
        here.setAlignment(Qt.AlignmentFlag.AlignCenter)
        here.setMinimumHeight(120)
        here.setStyleSheet("QLabel { border: 2px dashed palette(mid); border-radius: 6px; }")
        self.error = error_text("furrowmapStartError")
        self.remedy = button("furrowmapStartRemedy", "", self._use_remedy)
        self.remedy.hide()
        self._remedy: Callable[[], None] | None = None
        self.drives = button("furrowmapDrives", "", self.drives_wanted.emit)
        self.drives.hide()
        for widget in (
            self.setup,
            here,
            self.error,
            self.remedy,
            button("furrowmapChoose", self.tr("Choose recordings or a session…"), self._choose_files),
            button("furrowmapChooseResults", self.tr("Open the folder of a run…"), self._choose_folder),
            self.drives,
            QLabel(self.tr("Recent sessions")),
        ):
            layout.addWidget(widget)
        self.recent = QListWidget(objectName="furrowmapRecent")
        self.recent.itemActivated.connect(lambda item: self.chosen.emit([Path(item.data(Qt.ItemDataRole.UserRole))]))
        layout.addWidget(self.recent, 1)
        self.show_recent()

    def show_error(self, text: str) -> None:
        """Show the lines of an error, what was dropped first; "" for none."""
        show_error(self.error, text)
        self.remedy.hide()

    def offer_run(self, text: str, session: Path) -> None:
        """Show why the form does not open a session, with a button that runs it as it is."""
        self._offer(text, self.tr("Run it as it is"), partial(self.run_wanted.emit, session))

    def offer_output(self, text: str, session: Path) -> None:
        """Show why a session cannot be run, with a button that chooses another folder for its products."""
        self._offer(text, self.tr("Choose a folder for the results…"), partial(self.output_wanted.emit, session))

    def offer_copy(self, text: str, paths: Sequence[Path]) -> None:
        """Show why recordings make no session where they are, with a button that copies them."""
        self._offer(text, self.tr("Copy to a folder of this computer…"), partial(self.copy_wanted.emit, list(paths)))

    def _offer(self, text: str, words: str, remedy: Callable[[], None]) -> None:
        self.show_error(text)
        self._remedy = remedy
        self.remedy.setText(words)
        self.remedy.show()

    def _use_remedy(self) -> None:
        if self._remedy is not None:
            self._remedy()

    def offer_drives(self, count: int) -> None:
        """Offer the way back to a list of so many drives; none for 0."""
        self.drives.setVisible(count > 0)
        self.drives.setText(self.tr("The last list of {count} drives…").format(count=count))

    def remember(self, session: str | Path) -> None:
        """Move a session to the top of the recent ones."""
        known = [path for path in recent_sessions() if path != str(session)]
        QgsSettings().setValue(RECENT_KEY, [str(session), *known][:MAX_RECENT])
        self.show_recent()

    def show_recent(self) -> None:
        """List the recent sessions whose files exist."""
        self.recent.clear()
        for path in map(Path, recent_sessions()):
            if path.is_file():
                item = QListWidgetItem(f"{path.parent.name} / {path.name}", self.recent)
                item.setToolTip(str(path))
                item.setData(Qt.ItemDataRole.UserRole, str(path))

    def _choose_files(self) -> None:
        files, _ = QFileDialog.getOpenFileNames(self, self.tr("Recordings of one drive, or a session"))
        if files:
            self.chosen.emit(list(map(Path, files)))

    def _choose_folder(self) -> None:
        folder = QFileDialog.getExistingDirectory(self, self.tr("Folder that 'furrowmap run' wrote"))
        if folder:
            self.chosen.emit([Path(folder)])


def error_text(name: str) -> QLabel:
    """A framed text for an error, hidden at first."""
    label = small_text(name)
    label.setStyleSheet("QLabel { border: 1px solid #b71c1c; border-radius: 4px; padding: 4px; }")
    label.hide()
    return label


def show_error(label: QLabel, text: str) -> None:
    """Show the lines of an error, the first in bold; "" hides the label."""
    what, *rest = [html.escape(line, quote=False) for line in text.splitlines()] or [""]
    label.setText("<br>".join([f"<b>{what}</b>", *rest]))
    label.setVisible(bool(text))


def _list_html(texts: Sequence[str]) -> str:
    """Warnings as a list; nothing for none."""
    items = "".join(f"<li>{html.escape(text)}</li>" for text in texts)
    return f"<ul style='margin-left:-20px'>{items}</ul>" if items else ""


def recent_sessions() -> list[str]:
    """Paths of recent sessions, the latest first."""
    known = QgsSettings().value(RECENT_KEY, [])
    return [known] if isinstance(known, str) else list(known or [])


class RunPage(QWidget):
    """The stages and the progress of a running task."""

    cancelled = pyqtSignal()

    def __init__(self) -> None:
        super().__init__()
        layout = QVBoxLayout(self)
        self.title = QLabel(objectName="furrowmapRunTitle", wordWrap=True)
        self.stages = QListWidget(objectName="furrowmapStages")
        self.bar = QProgressBar(objectName="furrowmapProgress")
        self.time = QLabel()
        self.cancel = button("furrowmapCancel", self.tr("Cancel"), self._cancel)
        for widget in (self.title, self.stages, self.bar, self.time, self.cancel):
            layout.addWidget(widget)
        self._timer = QTimer(self, interval=1000)
        self._timer.timeout.connect(self._show_time)
        self._begun = 0.0

    def begin(self, title: str) -> None:
        """Start with this title."""
        self.title.setText(f"<b>{title}</b>")
        self.stages.clear()
        self.bar.setRange(0, 0)
        self.cancel.setEnabled(True)
        self.cancel.setText(self.tr("Cancel"))
        self._begun = time.monotonic()
        self._show_time()
        self._timer.start()

    def end(self) -> None:
        """The task has ended."""
        self._timer.stop()

    def show_stage(self, name: str) -> None:
        """Show the next stage; mark the one before as done."""
        if self.stages.count():
            item = self.stages.item(self.stages.count() - 1)
            item.setText("✓ " + item.text()[2:])
        self.stages.addItem(f"▸ {name}")
        self.stages.scrollToBottom()

    def show_share(self, percent: float) -> None:
        """Show the progress of all stages, or of one where no more is known; at 0 the bar is indeterminate."""
        if percent > 0:
            self.bar.setRange(0, 100)
            self.bar.setValue(round(percent))

    def _cancel(self) -> None:
        self.cancel.setEnabled(False)
        self.cancel.setText(self.tr("Cancelling…"))
        self.cancelled.emit()

    def _show_time(self) -> None:
        minutes, seconds = divmod(int(time.monotonic() - self._begun), 60)
        self.time.setText(self.tr("Elapsed: {time}").format(time=f"{minutes}:{seconds:02d}"))


class ResultPage(QWidget):
    """The main figures and the warnings of a run, and what can be done with its products.

    Signals:
        wanted: with the name of the action: "map", "3d", "replay", "report", "folder", "farm", "print", "edit" or
            "back".
        share_wanted: as a page for people without a GIS; True: as a project for QField.
    """

    wanted = pyqtSignal(str)
    export_wanted = pyqtSignal(str)
    share_wanted = pyqtSignal(bool)
    theme_wanted = pyqtSignal(str)

    def __init__(self) -> None:
        super().__init__()
        layout = QVBoxLayout(self)
        self.text = QTextBrowser(objectName="furrowmapFigures")
        self.text.setFrameShape(QTextBrowser.Shape.NoFrame)
        self.error = error_text("furrowmapResultError")
        layout.addWidget(self.error)
        layout.addWidget(self.text, 1)
        self.theme = QComboBox(objectName="furrowmapTheme")
        self.theme.activated.connect(lambda _number: self.theme_wanted.emit(self.theme.currentData()))
        layout.addWidget(side_by_side(QLabel(self.tr("On the map")), self.theme))
        grid = QGridLayout()
        replay_tip = self.tr("Play the drive; ground worked, change and a visible cloud grow with it")
        actions = (
            ("map", self.tr("Add to map"), self.tr("Open the products as styled layers in a group")),
            ("3d", self.tr("3D view"), self.tr("The visible layers in three dimensions")),
            ("replay", self.tr("Replay"), replay_tip),
            ("report", self.tr("Open report"), self.tr("Open the HTML report in the browser")),
            ("folder", self.tr("Open folder"), self.tr("Open the folder of the products")),
            ("farm", self.tr("Add to farm map…"), self.tr("One file of all sessions, a layer for each kind")),
            ("print", self.tr("Print…"), self.tr("A layout with map, legend and figures, and a page per pass")),
            ("edit", self.tr("Edit this session"), self.tr("Back to its form, to change it and run it again")),
        )
        for k, (name, text, tip) in enumerate(actions):
            grid.addWidget(button(f"furrowmapDo_{name}", text, partial(self.wanted.emit, name), tip), *divmod(k, 2))
        self.back = button("furrowmapDo_back", "", partial(self.wanted.emit, "back"))
        grid.addWidget(self.back, 4, 0)
        export = QPushButton(self.tr("Export"), objectName="furrowmapExport")
        menu = self.export_menu = QMenu(self)
        menu.addAction(self.tr("Web page with map and 3D, to share…"), partial(self.share_wanted.emit, False))  # noqa: FBT003 - as the signal has it
        menu.addAction(self.tr("Project for QField…"), partial(self.share_wanted.emit, True))  # noqa: FBT003
        menu.addSeparator()
        words = self._formats()
        for name in COMMAND_OPTIONS["export"]["--to"]["choices"]:
            menu.addAction(words.get(name, name), partial(self.export_wanted.emit, name)).setData(name)
        export.setMenu(menu)
        grid.addWidget(export, 4, 1)
        layout.addLayout(grid)

    def offer_themes(self, themes: Sequence[str], chosen: str) -> None:
        """Offer these themes of the map, of which one is shown."""
        self.theme.clear()
        for name in themes:
            self.theme.addItem(theme_words()[name], name)
        self.theme.setCurrentIndex(max(self.theme.findData(chosen), 0))
        self.theme.setEnabled(bool(themes))

    def _formats(self) -> dict[str, str]:
        """What each format of `furrowmap export` is, and what it is for."""
        return {
            "gpkg": self.tr("GeoPackage: any GIS, with styles"),
            "geoparquet": self.tr("GeoParquet: analysis in Python, R or DuckDB"),
            "flatgeobuf": self.tr("FlatGeobuf: web maps"),
            "geojson": self.tr("GeoJSON: web maps, in WGS 84"),
            "shapefile": self.tr("Shapefile: older GIS"),
            "kml": self.tr("KML: Google Earth"),
            "csv": self.tr("CSV: spreadsheets"),
            "sbet": self.tr("SBET: the trajectory, for LiDAR software"),
            "tum": self.tr("TUM: the trajectory, for robotics"),
            "poses": self.tr("CSV of poses: the trajectory, for furrowmap"),
            "glb": self.tr("glTF: the surface in 3D, with its orthophoto"),
            "isoxml": self.tr("ISO 11783 task data: farm software"),
            "stac": self.tr("STAC: a catalogue of the products"),
        }

    def show_error(self, text: str) -> None:
        """Show why something that was to be done with the result failed, in full; "" for nothing."""
        show_error(self.error, text)

    def show_folder(self, folder: Path, *, from_drives: bool) -> None:
        """Show the figures of the run in a folder, which was opened from the list of drives or otherwise."""
        self.back.setText(self.tr("Back to the drives") if from_drives else self.tr("Other session"))
        for action in self.export_menu.actions():
            action.setEnabled(action.data() != "glb" or product(folder, "orthophoto.tif").is_file())
        report = read_report(folder)
        name = html.escape(session_name(report, folder))
        above = texts_above(report)
        others = [w for w in report.get("warnings") or [] if isinstance(w, dict) and w.get("text") not in above]
        texts = [str(localized(warning, "text") or "") for warning in others]
        findings = object_in(report, "verdict").get("findings") or []
        first = texts[: max(1, MOST_ABOVE - len(findings))]
        rest = texts[len(first) :]
        page = f"<h3>{name}</h3>{verdict_html(report, warning_colour(self))}{_list_html(first)}"
        if rest:
            more = self.tr("{count} more warnings below the figures").format(count=len(rest))
            page += f"<p><a href='#warnings'>{more}</a></p>"
        page += f"<table>{figures_html(report)}</table>"
        if rest:
            page += f"<h4><a name='warnings'></a>{self.tr('Warnings')}</h4>{_list_html(rest)}"
        if not report:
            page += f"<p>{self.tr('This folder has no report, so the accuracy is unknown.')}</p>"
        self.show_error("")
        self.text.setHtml(page)
        self.text.setAlignment(Qt.AlignmentFlag.AlignLeft)


class BatchPage(QWidget):
    """The state of each drive of a batch, and what can be done with those that have ended.

    Signals:
        opened: with a drive that has ended, to open its result, or its session in the form.
        farm_wanted: with the folders of the results that are to be added to the farm map.
    """

    cancelled = pyqtSignal()
    opened = pyqtSignal(object)
    farm_wanted = pyqtSignal(object)
    left = pyqtSignal()

    def __init__(self) -> None:
        super().__init__()
        self._drives: list[Drive] = []
        layout = QVBoxLayout(self)
        self.title = QLabel()
        self.list = QListWidget(objectName="furrowmapBatch", wordWrap=True)
        self.list.itemActivated.connect(self._open)
        hint = self.tr("Double-click a drive to open its result, or its session where something is missing.")
        self.cancel = button("furrowmapBatchCancel", self.tr("Cancel"), self.cancelled.emit)
        self.farm = button("furrowmapBatchFarm", self.tr("Add what is done to farm map…"), self._add_to_farm)
        self.back = button("furrowmapBatchBack", self.tr("Other session"), self.left.emit)
        self.error = error_text("furrowmapBatchError")
        for widget in (
            self.error,
            self.title,
            self.list,
            QLabel(hint, wordWrap=True),
            self.farm,
            side_by_side(self.cancel, self.back),
        ):
            layout.addWidget(widget)

    def show_error(self, text: str) -> None:
        """Show why something that was to be done with the drives failed, in full; "" for nothing."""
        show_error(self.error, text)

    def show_drives(self, drives: list[Drive]) -> None:
        """Show these drives."""
        self._drives = drives
        self.show_error("")
        self.list.clear()
        for number in range(len(drives)):
            self.list.addItem(QListWidgetItem())
            self.refresh(number)

    def refresh(self, number: int) -> None:
        """Show the state of a drive."""
        drive = self._drives[number]
        item = self.list.item(number)
        words = {
            WAITING: self.tr("waiting"),
            RUNNING: self.tr("running"),
            DONE: self.tr("done"),
            DOUBTFUL: self.tr("done, but it contradicts itself"),
            CUT: self.tr("done, but the recording is cut"),
            FAILED: self.tr("failed"),
            TO_FILL_IN: self.tr("not run: recordings or places are missing"),
            CANCELLED: self.tr("cancelled"),
        }
        name = drive.session.parent.name + ("" if drive.session.stem == "session" else f" / {drive.session.stem}")
        reason = " ".join(drive.text.splitlines())
        state = f"{words[drive.state]}: {reason}" if reason else words[drive.state]
        item.setText(f"{DRIVE_MARKS[drive.state]} {name}\n    {state}")
        item.setToolTip(drive.text or str(drive.session))
        item.setData(Qt.ItemDataRole.UserRole, number)
        ended = sum(d.state in ENDED for d in self._drives)
        count = len(self._drives)
        self.title.setText("<b>" + self.tr("{ended} of {all} drives").format(ended=ended, all=count) + "</b>")
        self.cancel.setEnabled(ended < count)
        self.back.setEnabled(ended == count)
        self.farm.setEnabled(ended == count and any(d.state == DONE for d in self._drives))

    def _add_to_farm(self) -> None:
        self.farm_wanted.emit([drive.folder for drive in self._drives if drive.state == DONE])

    def _open(self, item: QListWidgetItem) -> None:
        self.opened.emit(self._drives[item.data(Qt.ItemDataRole.UserRole)])
