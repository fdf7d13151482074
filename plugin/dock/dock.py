# SPDX-License-Identifier: GPL-2.0-or-later
"""The dock: one page each to choose recordings, edit the session, run it, and see the result."""

import html
import os.path
from functools import partial
from pathlib import Path

from qgis.core import Qgis, QgsApplication, QgsMessageLog, QgsProject, QgsSettings
from qgis.gui import QgsDockWidget
from qgis.PyQt.QtCore import QSize, QTimer, QUrl
from qgis.PyQt.QtGui import QDesktopServices
from qgis.PyQt.QtWidgets import QFileDialog, QPushButton, QStackedWidget, QVBoxLayout, QWidget

from ..farm_layers import open_farm_map
from ..interpreter import find_interpreter, is_usable
from ..layout.session_layout import session_layout
from ..options_page import PAGE
from ..previews import open_preview
from ..products import product
from ..results import NoResultsError, groups_of, opening, read_report
from .base_map_chooser import BaseMapChooser
from .batch import DONE, BatchRunner, Drive
from .batch_page import BatchPage
from .dropped import DRIVES, MACHINE, PREVIEW, RESULTS, SESSION, home_of, local_paths, recognise
from .machines import NotSimpleError, add_machine, read_places
from .previewer import Previewer
from .replay import replay
from .result_page import ResultPage
from .run_page import RunPage
from .session_page import SessionPage
from .start_page import StartPage
from .tasks import CommandTask, RunTask

NAME = "furrowmap"
MARGIN = 1.3
"""Around the extent to which the map zooms."""
DESIGNER = QSize(1100, 760)
"""Pixels: QGIS opens its first layout window too small to read a page."""
OUTPUT_EXISTS = "output-exists"
"""Code of the error that a folder holds the products of another recording, or that a machine of this name is saved."""
FARM_KEY = "furrowmap/farmMap"
"""Setting: the farm map of late."""
STEP_MS = 1
"""Between two steps of opening a result, for the window's other events."""


class FurrowmapDock(QgsDockWidget):
    """The dock widget.

    Args:
        iface: QGIS's interface.
    """

    def __init__(self, iface):
        super().__init__(NAME, iface.mainWindow())
        self.setObjectName("furrowmapDock")
        self.setAcceptDrops(True)
        self._iface = iface
        self._task = self._steps = None
        self._folder = self._session = None
        self._error = ""
        self.start, self.session, self.run, self.result = StartPage(), SessionPage(), RunPage(), ResultPage()
        self.drives = BatchPage()
        self.pages = QStackedWidget()
        for page in (self.start, self.session, self.run, self.result, self.drives):
            self.pages.addWidget(page)
        self.base_map = BaseMapChooser(self.report)
        inside = QWidget()
        layout = QVBoxLayout(inside)
        layout.setContentsMargins(4, 4, 4, 4)
        layout.addWidget(self.pages, 1)
        layout.addWidget(self.base_map)
        self.setWidget(inside)
        self.start.chosen.connect(self.open_paths)
        self.start.setup_wanted.connect(self.offer_setup)
        self.session.left.connect(self.show_start)
        self.session.saved.connect(self._saved)
        self.session.run_wanted.connect(self.run_session)
        self.session.preview_wanted.connect(self.preview_session)
        self.session.replace_wanted.connect(lambda session: self.run_session(session, overwrite=True))
        self.session.keep_wanted.connect(lambda session: self.run_session(session, free_folder_for(session)))
        self.session.machine_wanted.connect(self.save_machine)
        self.session.machine_replaced.connect(lambda *words: self.save_machine(*words, overwrite=True))
        self.session.calibration_wanted.connect(self.calibrate)
        self.previewer = Previewer(self)
        self.previewer.status_changed.connect(self.session.show_preview_status)
        self.previewer.opened.connect(self._zoom_to_first)
        self.run.cancelled.connect(self.cancel)
        self.result.wanted.connect(self._do)
        self.result.export_wanted.connect(self._choose_export)
        self.batch = BatchRunner(self)
        self.batch.changed.connect(self.drives.refresh)
        self.drives.cancelled.connect(self.batch.cancel)
        self.drives.opened.connect(self._open_drive)
        self.drives.farm_wanted.connect(self._choose_farm)
        self.drives.left.connect(self.show_start)
        self.show_start()

    # dropped files

    def dragEnterEvent(self, event):  # noqa: N802 - the names are Qt's
        """Accept files anywhere on the dock."""
        if local_paths(event.mimeData()):
            event.acceptProposedAction()

    def dropEvent(self, event):  # noqa: N802
        """Open what was dropped."""
        event.acceptProposedAction()
        self.open_paths(local_paths(event.mimeData()))

    def open_paths(self, paths):
        """Open results or a session, or create a session from recordings."""
        dropped = recognise(paths)
        if dropped is None:
            return
        if self._task is not None or self.batch.busy:
            self.report(self.tr("A task is running. Wait for its end, or cancel it."))
        elif dropped.kind == RESULTS:
            self.open_folder(dropped.paths[0])
        elif dropped.kind == PREVIEW:
            layers = open_preview(dropped.paths[0])
            if layers:
                self._zoom_to_first(layers)
        elif dropped.kind == SESSION:
            self.open_session(dropped.paths[0])
            self._use_machine(dropped.machine)
        elif dropped.kind == DRIVES:
            self.begin_batch(dropped.paths, dropped.machine)
        elif dropped.kind == MACHINE:
            self.add_machine(dropped.paths[0])
        else:
            self.begin_session(dropped.paths, dropped.machine)

    # sessions

    def begin_session(self, recordings, machine=None):
        """Have the worker create a session file from recordings.

        Args:
            recordings: files and folders.
            machine: profile that was dropped with them; None for none.
        """
        program = self._program() if self._task is None else None
        if program is None:
            return
        known = self.session.recordings_beside(recordings) if self.pages.currentWidget() is self.session else None
        if known:
            self._complete(program, [*known, *recordings])
            return
        session = session_for(recordings)
        if session.exists():
            self.open_session(session)
            self._use_machine(machine)
            self.report(self.tr("Opened the existing session of these recordings."), Qgis.MessageLevel.Info)
            return
        words = ["init", *map(str, recordings), "-o", str(session)]
        words += ["--machine", str(machine)] if machine is not None else []
        self._command(program, self.tr("Inspecting the recordings"), words, self._proposed, self._failed)

    def _complete(self, program, recordings):
        """Propose the session in the form again, with the recordings that were missing; what was typed is kept."""
        self._session, places = self.session.path, self.session.places()

        def proposed(answer):
            self._proposed(answer)
            self.session.use_places(places)

        words = ["init", *map(str, recordings), "-o", str(self._session), "--overwrite"]
        self._command(program, self.tr("Inspecting the recordings"), words, proposed, self._back_with_error)

    def _command(self, program, title, words, on_answer, on_failure):
        """Have the worker do a command, with its progress on a page."""
        self.run.begin(title)
        self.pages.setCurrentWidget(self.run)
        task = CommandTask(f"furrowmap: {title}", program, words)
        task.answered.connect(on_answer)
        task.failed.connect(on_failure)
        task.taskTerminated.connect(self._stopped)
        self._begin(task)

    # many drives

    def begin_batch(self, paths, machine=None):
        """Run sessions and folders of recordings one after another.

        Args:
            paths: of session files and folders.
            machine: profile that was dropped with them, for new sessions.
        """
        program = self._program()
        if program is None:
            return
        self.previewer.cancel()
        drives = list(map(drive_of, paths))
        self.drives.show_drives(drives)
        self.pages.setCurrentWidget(self.drives)
        self.batch.begin(program, drives, machine)

    def _open_drive(self, drive):
        if drive.state == DONE:
            self.open_folder(drive.folder)
        elif drive.session.is_file():
            self.open_session(drive.session)
        if drive.state != DONE and drive.text:
            self.report(drive.text, Qgis.MessageLevel.Critical)

    # machines

    def add_machine(self, path):
        """Add a profile to the saved machines; an open form gets its places."""
        try:
            name = add_machine(path)
        except OSError as error:
            self.report(self.tr("{path} cannot be added: {reason}.").format(path=path, reason=error.strerror))
            return
        if self.pages.currentWidget() is self.session:
            self._use_machine(path)
            self.session.show_machines(name)
        self.report(
            self.tr("Added the machine {name}. Choose it in the form of a session.").format(name=name),
            Qgis.MessageLevel.Success,
        )

    def _use_machine(self, path):
        """Fill the places of a profile into the form."""
        if path is None or self.pages.currentWidget() is not self.session:
            return
        try:
            self.session.use_places(read_places(path))
        except (OSError, UnicodeDecodeError, NotSimpleError):
            self.report(self.tr("The machine {name} cannot be read.").format(name=Path(path).name))

    def save_machine(self, session, name, *, overwrite=False):
        """Have the worker save the machine of a session; `overwrite` replaces a saved one of this name."""
        program = self._program() if self._task is None else None
        if program is None:
            return
        self._session = Path(session)

        def saved(_answer):
            self._ended()
            self.session.show_machines(name)
            self.report(self.tr("Saved the machine {name}.").format(name=name), Qgis.MessageLevel.Success)

        words = ["machine", "save", str(session), name, *(["--overwrite"] if overwrite else [])]
        failed = partial(self._back_with_error, machine=name)
        self._command(program, self.tr("Saving the machine"), words, saved, failed)

    def calibrate(self, session, machine):
        """Have the worker find the scanner's angles, and write them into the session and its machine."""
        program = self._program() if self._task is None else None
        if program is None:
            return
        self.previewer.cancel()
        self._session = Path(session)

        def found(answer):
            self._ended()
            self.session.show_machines(machine)
            changed, kept = answer.get("written"), answer.get("machine")
            text = self.tr("Calibrated: the session has the angles that the recording shows.")
            unchanged = self.tr("Calibrated: the recording shows no other angles than the session states.")
            learned = self.tr("The machine {name} has them for its next sessions.").format(name=machine)
            lines = [text if changed else unchanged, *([learned] if kept else [])]
            self.report(" ".join(lines), Qgis.MessageLevel.Success)

        words = ["calibrate", str(session), "--write", *(["--machine", machine] if machine else [])]
        failed = partial(self._back_with_error, machine=machine)
        self._command(program, self.tr("Calibrating"), words, found, failed)

    def _ended(self):
        self._task = None
        self.run.end()
        self._back_to_session()

    def _back_with_error(self, text, code="", machine=""):
        self._ended()
        self.session.show_machines(machine)
        if self.pages.currentWidget() is self.session and code == OUTPUT_EXISTS:
            self.session.show_known_machine(text)
        elif self.pages.currentWidget() is self.session:
            self.session.show_error(text, may_replace=False)
        else:
            self.report(text, Qgis.MessageLevel.Critical)

    def open_session(self, path, findings=None):
        """Show a session in the form; a session that the form cannot edit is run as it is."""
        self.previewer.cancel()
        try:
            self.session.show_session(path, findings)
        except NotSimpleError as error:
            self.report(
                self.tr("The form cannot edit line {number} of {name}. The session is run as it is.").format(
                    number=error.number, name=Path(path).name
                ),
                Qgis.MessageLevel.Info,
            )
            self.run_session(path)
            return
        except (OSError, UnicodeDecodeError) as error:
            self.report(self.tr("{path} cannot be read: {reason}.").format(path=path, reason=error))
            return
        self.start.remember(path)
        self.pages.setCurrentWidget(self.session)

    def preview_session(self, session):
        """Preview a session in the background."""
        if self._program() is not None:
            self.start.remember(session)
            self.previewer.begin(session)

    def run_session(self, session, folder=None, *, overwrite=False):
        """Run a session in the background; a running preview is cancelled.

        Args:
            folder: for the products; by default that of the command line.
            overwrite: replace the products of another recording in it.
        """
        if self._task is not None:
            self.report(self.tr("The previous task is being cancelled; try again in a moment."), Qgis.MessageLevel.Info)
            return
        if self._program() is None:
            return
        self.previewer.cancel()
        self._session, self._folder = Path(session), folder or folder_for(session)
        self.start.remember(session)
        self._error = ""
        parameters = {"SESSION": str(session), "OUTPUT": str(self._folder), "OPEN": False, "OVERWRITE": overwrite}
        self.run.begin(self.tr("Running {name}").format(name=self._name()))
        self.pages.setCurrentWidget(self.run)
        task = RunTask(parameters, self.run.show_stage, self._keep_error)
        task.feedback.progressChanged.connect(self.run.show_share)
        task.executed.connect(self._ran)
        self._begin(task)

    def _name(self):
        """The session's name from the form, else the name of its folder."""
        shown = self.session.name.text() if self.pages.currentWidget() is self.session else ""
        return html.escape(shown or self._session.parent.name)

    def cancel(self):
        """Cancel the running task; the worker ends a moment later, when it has cleaned up."""
        if self._task is None:
            return
        self._task.cancel()
        self.run.end()
        if isinstance(self._task, CommandTask):
            self.show_start()
        else:
            self._back_to_session()

    # results

    def open_folder(self, folder):
        """Open the products in a folder and show their figures."""
        self._folder = Path(folder)
        self._steps = opening(self._folder)
        self._step()

    def show_start(self):
        """Show the start page."""
        self.previewer.cancel()
        self.start.show_setup(needed=not is_usable(find_interpreter()))
        self.start.show_recent()
        self.pages.setCurrentWidget(self.start)

    def offer_setup(self):
        """Open the options page, to set up the worker."""
        self._iface.showOptionsDialog(self._iface.mainWindow(), PAGE)
        self.start.show_setup(needed=not is_usable(find_interpreter()))

    def report(self, text, level=Qgis.MessageLevel.Warning):
        """Show the first and last line of a text in the message bar, and all of it in the log."""
        QgsMessageLog.logMessage(text, NAME, level, notifyUser=False)
        first, _, rest = text.partition("\n")
        bar = self._iface.messageBar()
        message = bar.createMessage(NAME, first if not rest else f"{first} {rest.splitlines()[-1]}")
        if rest:
            button = QPushButton(self.tr("Log"))
            button.clicked.connect(lambda: self._iface.openMessageLog())
            message.layout().addWidget(button)
        bar.pushWidget(message, level, 0 if level == Qgis.MessageLevel.Critical else 8)

    def end(self):
        """Cancel tasks and timers, before the plugin is unloaded."""
        self._steps = None
        self.base_map.end()
        self.previewer.end()
        last = self.batch.cancel()
        if last is not None:
            last.waitForFinished(8000)
        self.run.end()
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            task.waitForFinished(8000)

    # steps of a task

    def _begin(self, task):
        self._task = task
        QgsApplication.taskManager().addTask(task)

    def _program(self):
        """The worker's command; None, with the offer to set it up, if there is none."""
        interpreter = find_interpreter()
        if is_usable(interpreter):
            return interpreter.program
        self.show_start()
        self.report(self.tr("Set up furrowmap's worker to run sessions. Results can be opened without it."))
        return None

    def _proposed(self, answer):
        self._task = None
        self.run.end()
        self.open_session(Path(answer["session"]), answer)
        if not self.session.fault_of_preview():
            self.previewer.begin(answer["session"])

    def _failed(self, text, _code=""):
        self._task = None
        self.run.end()
        self.show_start()
        self.report(text, Qgis.MessageLevel.Critical)

    def _stopped(self):
        """The creation of a session was cancelled; a failure has its own signal."""
        if self._task is not None and self._task.isCanceled():
            self._task = None

    def _keep_error(self, text):
        self._error = text

    def _ran(self, successful, results):
        if self._task is None:
            return  # the plugin is being unloaded
        cancelled, code = self._task.feedback.isCanceled(), self._task.error_code
        self._task = None
        self.run.end()
        if cancelled:
            self.report(self.tr("Cancelled; no partial files are left."), Qgis.MessageLevel.Info)
            return
        if not successful:
            text = self._error or self.tr("The run failed; see the log.")
            self._back_to_session()
            if self.pages.currentWidget() is self.session:
                self.session.show_error(text, may_replace=code == OUTPUT_EXISTS)
            else:
                self.report(text, Qgis.MessageLevel.Critical)
            return
        self.open_folder(results.get("FOLDER", self._folder))

    def _back_to_session(self):
        try:
            self.session.show_session(self._session)
            self.pages.setCurrentWidget(self.session)
        except (NotSimpleError, OSError, UnicodeDecodeError):
            self.show_start()

    def _saved(self, path):
        self.report(self.tr("Saved {path}").format(path=path), Qgis.MessageLevel.Success)

    def _step(self):
        """Do one step of opening a folder, and schedule the next."""
        if self._steps is None:
            return
        try:
            next(self._steps)
        except StopIteration as done:
            self._steps = None
            self._opened(done.value)
        except NoResultsError as error:
            self._steps = None
            self.show_start()
            self.report(str(error))
        else:
            QTimer.singleShot(STEP_MS, self._step)

    def _opened(self, layers):
        self.result.show_folder(self._folder)
        self.pages.setCurrentWidget(self.result)
        names = {layer.name(): layer for layer in layers}
        layer = names.get("coverage") or names.get("trajectory") or layers[0]
        if names.get("coverage") and not names["coverage"].featureCount():
            layer = names.get("trajectory", layer)
        self._zoom_to_first([layer])

    def _zoom_to_first(self, layers):
        """Zoom to the first layer, with a margin for messages."""
        self._iface.setActiveLayer(layers[0])
        canvas = self._iface.mapCanvas()
        extent = canvas.mapSettings().layerExtentToOutputExtent(layers[0], layers[0].extent())
        if extent.isFinite() and not extent.isEmpty():
            extent.scale(MARGIN)
            canvas.setExtent(extent)
            canvas.refresh()

    def _do(self, what):
        {
            "map": lambda: self.open_folder(self._folder),
            "replay": self._replay,
            "report": lambda: self._open_file(product(self._folder, "report.html")),
            "folder": lambda: self._open_file(self._folder),
            "print": self._print,
            "farm": lambda: self._choose_farm([self._folder]),
            "back": self.show_start,
        }[what]()

    def _replay(self):
        groups = groups_of(QgsProject.instance(), self._folder)
        replay(self._iface, read_report(self._folder), groups[0] if groups else None)

    def _choose_export(self, name):
        """Ask for the name of an export in a format."""
        beside = self._folder.with_name(f"{self._folder.name}_{name}")
        target, _ = QFileDialog.getSaveFileName(self, self.tr("File or folder of the export"), str(beside))
        if target:
            self.export(name, target)

    def export(self, name, target):
        """Have the worker convert the result that is shown.

        Args:
            name: of the format, as `furrowmap export --to` has it.
            target: file or folder; one that exists is replaced.
        """
        program = self._program() if self._task is None else None
        if program is None:
            return

        def written(answer):
            self._ended_on(self.result)
            text = self.tr("Exported to {path}").format(path=answer["target"])
            self.report(text, Qgis.MessageLevel.Success)

        words = ["export", str(self._folder), "--to", name, "-o", str(target), "--overwrite"]
        self._command(program, self.tr("Exporting"), words, written, partial(self._failed_on, self.result))

    def _choose_farm(self, folders):
        """Ask for the farm map to which results are added: that of late, another one, or a new one."""
        path, _ = QFileDialog.getSaveFileName(
            self,
            self.tr("Farm map"),
            QgsSettings().value(FARM_KEY, str(folders[0].parent / "farm.gpkg"), str),
            "GeoPackage (*.gpkg)",
            options=QFileDialog.Option.DontConfirmOverwrite,
        )
        if path:
            self.add_to_farm(folders, path if path.lower().endswith(".gpkg") else f"{path}.gpkg")

    def add_to_farm(self, folders, path):
        """Have the worker add results to a farm map, and open that.

        Args:
            folders: of the results.
            path: of the GeoPackage, which is created if it does not exist.
        """
        program = self._program() if self._task is None else None
        if program is None:
            return
        page = self.pages.currentWidget()

        def added(answer):
            self._ended_on(page)
            QgsSettings().setValue(FARM_KEY, str(path))
            layers = open_farm_map(path)
            text = self.tr("{count} sessions in the farm map.").format(count=answer["sessions"])
            self.report(text, Qgis.MessageLevel.Success)
            if layers:
                self._zoom_to_first(layers)

        words = ["farm", "add", *map(str, folders), str(path)]
        self._command(program, self.tr("Adding to the farm map"), words, added, partial(self._failed_on, page))

    def _ended_on(self, page):
        self._task = None
        self.run.end()
        self.pages.setCurrentWidget(page)

    def _failed_on(self, page, text, _code):
        self._ended_on(page)
        self.report(text, Qgis.MessageLevel.Critical)

    def _open_file(self, path):
        if not path.exists():
            self.report(self.tr("{path} does not exist.").format(path=path))
        else:
            QDesktopServices.openUrl(QUrl.fromLocalFile(str(path)))

    def _print(self):
        project = QgsProject.instance()
        groups = groups_of(project, self._folder)
        if not groups:
            self.report(self.tr("Add the session to the map first."))
            return
        designer = self._iface.openLayoutDesigner(session_layout(project, groups[0], read_report(self._folder)))
        window = designer.window()
        window.resize(window.size().expandedTo(DESIGNER))
        QTimer.singleShot(0, designer.view().zoomFull)  # after the window was resized


def folder_for(session):
    """The folder for the products of a session, the same as on the command line."""
    session = Path(session).resolve()
    return session.parent / f"{session.stem}_result"


def drive_of(path):
    """The drive of a session file, of a folder with a session, or of a folder of recordings."""
    path = Path(path)
    session = path if path.is_file() else path / "session.toml"
    return Drive(session, None if session.is_file() else path, folder_for(session))


def free_folder_for(session):
    """The first folder `NAME_result-2`, `NAME_result-3`, … that does not exist."""
    first, number = folder_for(session), 2
    while (folder := first.with_name(f"{first.name}-{number}")).exists():
        number += 1
    return folder


def session_for(recordings):
    """The session file of recordings: the first of `session.toml`, `session-2.toml`, … that names them or is new.

    A folder may have the recordings of many drives.
    """
    folder = Path(_common([str(home_of(path)) for path in recordings]))
    number = 1
    while True:
        session = folder / ("session.toml" if number == 1 else f"session-{number}.toml")
        if not session.exists() or _names_all(session, recordings):
            return session
        number += 1


def _common(folders):
    try:
        return os.path.commonpath(folders)
    except ValueError:  # on different drives; the worker refuses that
        return folders[0]


def _names_all(session, recordings):
    try:
        text = session.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return False
    return all(Path(path).name in text for path in recordings)
