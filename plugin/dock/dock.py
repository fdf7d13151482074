# SPDX-License-Identifier: GPL-2.0-or-later
"""The dock: one page each to choose recordings, edit the session, run it, and see the result."""

from __future__ import annotations

import html
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from qgis.core import (
    Qgis,
    QgsApplication,
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsMapLayer,
    QgsMessageLog,
    QgsPointCloudLayer,
    QgsProject,
    QgsSettings,
)
from qgis.gui import QgisInterface, QgsDockWidget
from qgis.PyQt.QtCore import QSize, QTimer, QUrl
from qgis.PyQt.QtGui import QDesktopServices, QDragEnterEvent, QDropEvent
from qgis.PyQt.QtWidgets import QAction, QFileDialog, QPushButton, QStackedWidget, QVBoxLayout, QWidget

from ..dock_words import extra_words
from ..interpreter import find_interpreter, is_usable
from ..options_page import EXTRA_KEY, PAGE
from ..own_layers import key_of, nodes_by_key
from ..platforms import resolved
from ..previews import open_preview
from ..products import product
from ..results import (
    NoResultsError,
    folder_of,
    groups_of,
    open_farm_map,
    opening,
    read_report,
    session_name,
    show_theme,
    theme_of,
    themes_of,
)
from ..session_layout import session_layout
from .base_map_chooser import BaseMapChooser
from .dropped import CLOUDS, DRIVES, MACHINE, PREVIEW, RESULTS, SESSION, local_paths, recognise, results_folder
from .machines import add_machine
from .pages import BatchPage, ResultPage, RunPage, StartPage
from .places import choose_folder, common_home, copied, folder_for, free_folder_for, is_writable, session_for
from .replay import Replay, replay
from .session_lines import NotSimpleError
from .session_page import SessionPage
from .still_map import on_still_map
from .tasks import (
    ENDED,
    TASK_END_MS,
    WITH_RESULT,
    BatchRunner,
    CommandTask,
    CopyTask,
    Drive,
    End,
    Previewer,
    RunTask,
)

NAME = "furrowmap"
ZOOM_MARGIN = 1.3
"""Factor by which the shown extent exceeds that of the layer."""
DESIGNER_SIZE = QSize(1100, 760)
"""Pixels: QGIS opens its first layout window too small to read a page."""
PITCH_DEG = 45.0
"""Of the camera of a 3D view; 0 looks down."""
Z_IS_UP = 34100
"""QGIS from which on z points up in 3D views; it was y."""
OUTPUT_EXISTS = "output-exists"
"""Code of the error that a folder holds the products of another recording, or that a machine of this name is saved."""
NOT_WRITABLE = ("output-unwritable",)
"""Codes of errors at writing that another folder remedies."""
FILE_SUFFIXES = {"gpkg": ".gpkg", "kml": ".kml", "sbet": ".sbet", "tum": ".tum", "poses": ".csv", "glb": ".glb"}
"""Of the formats of which an export is one file; the others are folders."""
FARM_KEY = "furrowmap/farmMap"
"""Setting: the farm map used last."""


class FurrowmapDock(QgsDockWidget):
    """The dock widget."""

    def __init__(self, iface: QgisInterface) -> None:
        super().__init__(NAME, iface.mainWindow())
        self.setObjectName("furrowmapDock")
        self.setAcceptDrops(True)
        self._iface = iface
        self._task: RunTask | CommandTask | CopyTask | None = None
        self._leave: Callable[[], None] = self.show_start
        self._steps: Any = None
        self._in_step = False
        self._to_open: list[Path] = []
        self._player: Replay | None = None
        self._folder = self._session = Path()
        self._from_drives = False
        self.start = StartPage()
        self.session = SessionPage()
        self.run = RunPage()
        self.result = ResultPage()
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
        self.previewer = Previewer(self)
        self.batch = BatchRunner(self)
        for signal, slot in (
            (self.start.chosen, self.open_paths),
            (self.start.setup_wanted, self.offer_setup),
            (self.start.drives_wanted, self.show_drives),
            (self.start.run_wanted, self.run_session),
            (self.start.output_wanted, self._choose_output),
            (self.start.copy_wanted, self._choose_copy),
            (self.session.copy_wanted, self._choose_copy),
            (self.session.left, self.go_back),
            (self.session.saved, self._report_saved),
            (self.session.run_wanted, self.run_session),
            (self.session.preview_wanted, self.preview_session),
            (self.session.replace_wanted, partial(self.run_session, overwrite=True)),
            (self.session.keep_wanted, lambda session: self.run_session(session, free_folder_for(session))),
            (self.session.machine_wanted, self.save_machine),
            (self.session.machine_replaced, partial(self.save_machine, overwrite=True)),
            (self.session.calibration_wanted, self.calibrate),
            (self.previewer.status_changed, self.session.show_preview_status),
            (self.previewer.remedy_found, self.session.show_remedy),
            (self.previewer.opened, self._zoom_to_first),
            (self.run.cancelled, self.cancel),
            (self.result.wanted, self._do),
            (self.result.export_wanted, self._choose_export),
            (self.result.share_wanted, self._choose_share),
            (self.result.theme_wanted, self._show_theme),
            (self.batch.changed, self.drives.refresh),
            (self.drives.cancelled, self.batch.cancel),
            (self.drives.opened, self._open_drive),
            (self.drives.farm_wanted, self._choose_farm),
            (self.drives.left, self.show_start),
        ):
            signal.connect(slot)
        project = QgsProject.instance()
        project.layersWillBeRemoved["QList<QgsMapLayer*>"].connect(self._stop_drawing)
        project.aboutToBeCleared.connect(self._stop_opening)
        project.cleared.connect(self._follow_cleared)
        project.readProject.connect(self._follow_project)
        self.show_start()

    def _stop_drawing(self, layers: Sequence[QgsMapLayer]) -> None:
        """QGIS 3.40 crashes where a point cloud is removed while it is drawn, also by hand or with its project."""
        if not self._in_step:
            self._stop_opening()
        if any(isinstance(layer, QgsPointCloudLayer) for layer in layers):
            for canvas in self._iface.mapCanvases():
                canvas.stopRendering()

    # dropped files

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:  # noqa: N802 - the names are Qt's
        """Accept files anywhere on the dock."""
        if local_paths(event.mimeData()):
            event.acceptProposedAction()

    def dropEvent(self, event: QDropEvent) -> None:  # noqa: N802
        """Open what was dropped."""
        event.acceptProposedAction()
        self.open_paths(local_paths(event.mimeData()))

    def open_paths(self, paths: Sequence[Path]) -> None:
        """Open results or a session, or create a session from recordings."""
        dropped = recognise(paths)
        if dropped is None or self._is_busy():
            return
        if dropped.kind == RESULTS:
            self.open_folders([folder for folder in map(results_folder, paths) if folder is not None])
        elif dropped.kind == PREVIEW:
            layers = open_preview(dropped.paths[0])
            if layers:
                self._zoom_to_first(layers)
        elif dropped.kind == SESSION:
            self.open_session(dropped.paths[0], dropped.machine)
        elif dropped.kind == DRIVES:
            self.begin_batch(dropped.paths, dropped.machine)
        elif dropped.kind == MACHINE:
            self.add_machine(dropped.paths[0])
        elif dropped.kind == CLOUDS:
            self._offer_surfaces(dropped.paths)
        else:
            self.begin_session(dropped.paths, dropped.machine)

    def _offer_surfaces(self, clouds: Sequence[Path]) -> None:
        """Show finished clouds, which have no session, and offer what can be made of them."""
        bar = self._iface.messageBar()
        names = ", ".join(path.name for path in clouds)
        made = (
            QgsPointCloudLayer(str(p), p.stem, "copc" if p.name.lower().endswith(".copc.laz") else "pdal")
            for p in clouds
        )
        layers = [layer for layer in made if layer.isValid()]
        QgsProject.instance().addMapLayers(layers)
        if layers:
            self._zoom_to_first(layers)
        text = self.tr("{names}: a point cloud alone needs no session. Surfaces can be made of it.").format(names=names)
        message = bar.createMessage(NAME, text)
        parameters = {"CLOUDS": [layer.id() for layer in layers] or [str(path) for path in clouds]}
        surfaces = QPushButton(self.tr("Make surfaces…"), objectName="furrowmapSurfaces")
        surfaces.clicked.connect(lambda: _show_algorithm("furrowmap:surface", parameters))
        message.layout().addWidget(surfaces)
        bar.pushWidget(message, Qgis.MessageLevel.Info, 30)

    # sessions

    def begin_session(self, recordings: Sequence[Path], machine: Path | None = None) -> None:
        """Have the worker create a session file from recordings."""
        if self._free_program() is None:
            return
        known = self.session.recordings_beside(recordings) if self._in_form() else None
        if known:
            self._complete([*known, *recordings])
            return
        session = session_for(recordings)
        if session.exists():
            self.open_session(session, machine)
            self.report(self.tr("Opened the existing session of these recordings."), Qgis.MessageLevel.Info)
            return
        if not is_writable(session.parent):
            self._offer_copy(recordings)
            return
        words = ["init", *map(str, recordings), "-o", str(session)]
        words += ["--machine", str(machine)] if machine is not None else []
        refused = partial(self._refuse_recordings, recordings)
        self._command(self.tr("Inspecting the recordings"), words, self._show_new_session, refused)

    def _refuse_recordings(self, recordings: Sequence[Path], end: End) -> None:
        """Say on the start page, in full, why recordings make no session."""
        QgsMessageLog.logMessage(end.text, NAME, Qgis.MessageLevel.Critical, notifyUser=False)
        if end.code in NOT_WRITABLE:  # the folder's attributes did not say so
            self._offer_copy(recordings)
            return
        self.show_start()
        self.start.show_error(end.text)

    def _offer_copy(self, paths: Sequence[Path]) -> None:
        """Say that a folder, such as that of a locked card, takes no session, and offer to copy what is in it."""
        self.show_start()
        text = self.tr("{folder} is read-only, so that neither a session nor results can be written there.")
        remedy = self.tr("Copy the recordings to a folder of this computer; they are not changed.")
        self.start.offer_copy(f"{text.format(folder=common_home(paths))}\n{remedy}", paths)

    def _choose_copy(self, paths: Sequence[Path]) -> None:
        """Ask for the folder to which recordings are copied."""
        title = self.tr("Folder for the copy of the recordings, the session and the results")
        target = QFileDialog.getExistingDirectory(self, title)
        if target:
            self.copy_recordings(paths, Path(target))

    def copy_recordings(self, paths: Sequence[Path], target: Path) -> None:
        """Copy recordings, or the folder of a session, below a folder, and open the copies."""
        if self._is_busy():
            return

        def made(copies: list[Path]) -> None:
            self.show_start()
            self.open_paths(copies)

        def failed(end: End) -> None:
            self.show_start()
            self.start.offer_copy(end.text, paths)

        task = CopyTask(self.tr("Copying the recordings"), partial(copied, paths, target))
        self._begin(task, self.tr("Copying the recordings"), made, failed, partial(self._offer_copy, paths))

    def _complete(self, recordings: Sequence[Path]) -> None:
        """Create the session in the form again, with the recordings that were missing; what was typed is kept."""
        self._session, places = self.session.path, self.session.places()

        def proposed(answer: dict[str, Any]) -> None:
            self._show_new_session(answer)
            self.session.use_places(places)

        words = ["init", *map(str, recordings), "-o", str(self._session), "--overwrite"]
        title = self.tr("Inspecting the recordings")
        self._command(title, words, proposed, self._back_with_error, self._back_to_session)

    def _show_new_session(self, answer: dict[str, Any]) -> None:
        self.open_session(Path(answer["session"]), findings=answer)
        if not self.session.fault_of_preview():
            self.previewer.begin(answer["session"])

    def _command(
        self,
        title: str,
        words: Sequence[str],
        on_answer: Callable[[Any], None],
        on_failure: Callable[[End], None],
        leave: Callable[[], None] | None = None,
    ) -> None:
        """Have the worker do a command, with its progress on a page; `leave` shows the page after a cancellation."""
        program = self._free_program()
        if program is None:
            return
        task = CommandTask(f"furrowmap: {title}", program, words)
        task.progressChanged.connect(self.run.show_share)
        self._begin(task, title, on_answer, on_failure, leave or self.show_start)

    # many drives

    def begin_batch(self, paths: Sequence[Path], machine: Path | None = None) -> None:
        """Run sessions and folders of recordings one after another."""
        program = self._free_program()
        if program is None:
            return
        self.previewer.cancel()
        sessions = [path if path.is_file() else path / "session.toml" for path in paths]
        drives = [
            Drive(s, None if s.is_file() else path, folder_for(s)) for s, path in zip(sessions, paths, strict=True)
        ]
        self.drives.show_drives(drives)
        self.pages.setCurrentWidget(self.drives)
        self.batch.begin(program, drives, machine)

    def show_drives(self) -> None:
        """Show the list of drives, as it is or was."""
        self.drives.show_drives(self.batch.drives)
        self.pages.setCurrentWidget(self.drives)

    def go_back(self) -> None:
        """Back to the list of drives from one that was opened there, else to the start page."""
        if self._from_drives:
            self._from_drives = False
            self.previewer.cancel()
            self.show_drives()
        else:
            self.show_start()

    def _open_drive(self, drive: Drive) -> None:
        """Open a drive that has ended, also while others run."""
        if drive.state not in ENDED:
            self.report(self.tr("This drive has not ended yet."), Qgis.MessageLevel.Info)
            return
        self._from_drives = True
        if drive.state in WITH_RESULT and drive.folder.is_dir():
            self.start.remember(drive.session)
            self.open_folder(drive.folder)
            return
        if drive.session.is_file():
            self.open_session(drive.session)
        if drive.text and self._in_form():
            self.session.show_error(drive.text, may_replace=False)
        elif drive.text:
            self._show_failure(drive.text)

    # machines

    def add_machine(self, path: Path) -> None:
        """Add a profile to the saved machines; an open form gets its places."""
        try:
            name = add_machine(path)
        except OSError as error:
            self.report(self.tr("{path} cannot be added: {reason}.").format(path=path, reason=error.strerror))
            return
        if self._in_form():
            self.session.use_machine(path)
            self.session.show_machines(name)
        text = self.tr("Added the machine {name}. Choose it in the form of a session.").format(name=name)
        self.report(text, Qgis.MessageLevel.Success)

    def save_machine(self, session: Path, name: str, *, overwrite: bool = False) -> None:
        """Have the worker save the machine of a session; `overwrite` replaces a saved one of this name."""
        self._session = session

        def saved(_answer: object) -> None:
            self._back_with_machine(name, self.tr("Saved the machine {name}.").format(name=name))

        words = ["machine", "save", str(session), name, *(["--overwrite"] if overwrite else [])]
        failed = partial(self._back_with_error, machine=name)
        self._command(self.tr("Saving the machine"), words, saved, failed, self._back_to_session)

    def calibrate(self, session: Path, machine: str) -> None:
        """Have the worker find the scanner's angles, and write them into the session and its machine."""
        if self._free_program() is None:
            return
        self.previewer.cancel()
        self._session = session

        def found(answer: dict[str, Any]) -> None:
            text = self.tr("Calibrated: the recording shows no other angles than the session states.")
            if answer.get("written"):
                text = self.tr("Calibrated: the session has the angles that the recording shows.")
            if answer.get("machine"):
                text += " " + self.tr("The machine {name} has them for its next sessions.").format(name=machine)
            self._back_with_machine(machine, text)

        words = ["calibrate", str(session), "--write", *(["--machine", machine] if machine else [])]
        failed = partial(self._back_with_error, machine=machine)
        self._command(self.tr("Calibrating"), words, found, failed, self._back_to_session)

    def _back_with_machine(self, machine: str, text: str) -> None:
        self._back_to_session()
        self.session.show_machines(machine)
        self.report(text, Qgis.MessageLevel.Success)

    def _back_with_error(self, end: End, machine: str = "") -> None:
        self._back_to_session()
        self.session.show_machines(machine)
        if not self._in_form():
            self._show_failure(end.text)
        elif end.code == OUTPUT_EXISTS:
            self.session.show_known_machine(end.text)
        else:
            self.session.show_error(end.text, may_replace=False)

    def _in_form(self) -> bool:
        return self.pages.currentWidget() is self.session

    def open_session(self, path: Path, machine: Path | None = None, findings: dict[str, Any] | None = None) -> None:
        """Show a session in the form, with the places of a profile; offer to run one that the form cannot edit."""
        self.previewer.cancel()
        try:
            self.session.show_session(path, findings)
        except NotSimpleError as error:
            self._offer_run(path, error.number)
            return
        except (OSError, UnicodeDecodeError) as error:
            self.report(self.tr("{path} cannot be read: {reason}.").format(path=path, reason=error))
            return
        self.start.remember(path)
        self.pages.setCurrentWidget(self.session)
        if machine is not None:
            self.session.use_machine(machine)

    def _offer_run(self, path: Path, number: int) -> None:
        """Say that the form cannot edit a session, and offer to run it, which replaces earlier products."""
        self.show_start()
        self.start.remember(path)
        text = self.tr("The form cannot edit line {number} of {name}.").format(number=number, name=path.name)
        meaning = self.tr("The session can be run as it is.")
        if folder_for(path).is_dir():
            meaning = self.tr("The session can be run as it is. The results in {folder} are then replaced.").format(
                folder=folder_for(path).name
            )
        self.start.offer_run(f"{text}\n{meaning}", path)

    def preview_session(self, session: Path) -> None:
        """Preview a session in the background."""
        if self._free_program() is not None:
            self.start.remember(session)
            self.previewer.begin(session)

    def run_session(self, session: Path, folder: Path | None = None, *, overwrite: bool = False) -> None:
        """Run a session in the background, by default to the command line's folder; a running preview is cancelled."""
        if self._free_program() is None:
            return
        folder = folder or folder_for(session)
        self._session = session
        if not is_writable(folder):
            self._refuse_folder(folder)
            return
        self.previewer.cancel()
        self._folder = folder
        self.start.remember(session)
        name = (self.session.name.text() if self._in_form() else "") or session.parent.name
        parameters = {"SESSION": str(session), "OUTPUT": str(self._folder), "OPEN": False, "OVERWRITE": overwrite}
        task = RunTask(parameters, self.run.show_stage)
        task.feedback.progressChanged.connect(self.run.show_share)
        title = self.tr("Running {name}").format(name=html.escape(name))
        self._begin(task, title, self._show_run, self._refuse_run, self._back_to_session)

    def _refuse_folder(self, folder: Path) -> None:
        """Say that products cannot be written to a folder, and have another one chosen."""
        text = self.tr("{folder} is read-only, so that the results cannot be written there.").format(folder=folder)
        if not self._in_form():
            self._back_to_session()
        if self._in_form():
            self.session.ask_for_output(text)
            return
        self.show_start()
        self.start.offer_output(f"{text}\n{self.tr('Choose another folder for the results.')}", self._session)

    def _choose_output(self, session: Path) -> None:
        """Ask for the folder of a session's products, and run it."""
        target = QFileDialog.getExistingDirectory(self, self.tr("Folder for the results"))
        if target:
            choose_folder(session, target)
            self.run_session(session)

    def cancel(self) -> None:
        """Cancel the running task and leave its page; the worker ends a moment later, when it has cleaned up."""
        if self._task is not None:
            self._task.cancel()
            self.run.end()
            self._leave()

    # results

    def open_folder(self, folder: Path) -> None:
        """Open the products in a folder and show their figures."""
        self.open_folders([folder])

    def open_folders(self, folders: Sequence[Path]) -> None:
        """Open the products in folders one after another, and show the figures of the last."""
        self._to_open += [folder for folder in map(Path, folders) if folder not in self._to_open]
        if self._steps is None and self._to_open:
            self._folder = self._to_open.pop(0)
            self._end_replay()
            self._steps = on_still_map(self._iface.mapCanvases(), opening(self._folder))
            self._step()

    def show_start(self) -> None:
        """Show the start page."""
        self.previewer.cancel()
        self._from_drives = False
        self.start.offer_drives(len(self.batch.drives))
        self.start.show_error("")
        self.start.setup.setVisible(not is_usable(find_interpreter()))
        self.start.show_recent()
        self.pages.setCurrentWidget(self.start)

    def offer_setup(self) -> None:
        """Open the options page, to set up the worker."""
        self._iface.showOptionsDialog(self._iface.mainWindow(), PAGE)
        self.start.setup.setVisible(not is_usable(find_interpreter()))

    def report(self, text: str, level: Qgis.MessageLevel = Qgis.MessageLevel.Warning) -> None:
        """Show a text in the message bar and in the log."""
        QgsMessageLog.logMessage(text, NAME, level, notifyUser=False)
        bar = self._iface.messageBar()
        message = bar.createMessage(NAME, " ".join(text.splitlines()))
        if "\n" in text:
            log = QPushButton(self.tr("Log"))
            log.clicked.connect(lambda: self._iface.openMessageLog())
            message.layout().addWidget(log)
        bar.pushWidget(message, level, 0 if level == Qgis.MessageLevel.Critical else 8)

    def end(self) -> None:
        """Cancel tasks and timers, before the plugin is unloaded."""
        self._stop_opening()
        project = QgsProject.instance()
        project.layersWillBeRemoved["QList<QgsMapLayer*>"].disconnect(self._stop_drawing)
        project.aboutToBeCleared.disconnect(self._stop_opening)
        project.cleared.disconnect(self._follow_cleared)
        project.readProject.disconnect(self._follow_project)
        self._end_replay()
        self.base_map.end()
        self.previewer.end()
        drive = self.batch.cancel()
        self.run.end()
        task = self._task
        self._task = None
        if task is not None:
            task.cancel()
        for ending in (drive, task):
            if ending is not None:
                ending.waitForFinished(TASK_END_MS)

    # steps of a task

    def _begin(
        self,
        task: RunTask | CommandTask | CopyTask,
        title: str,
        on_answer: Callable[[Any], None],
        on_failure: Callable[[End], None],
        leave: Callable[[], None],
    ) -> None:
        """Show the page of a task and begin it; one of the three functions shows the page after its end."""
        self._task = task
        self._leave = leave
        self.run.begin(title)
        self.pages.setCurrentWidget(self.run)
        task.ended.connect(partial(self._end_task, task, on_answer, on_failure))
        QgsApplication.taskManager().addTask(task)

    def _end_task(
        self,
        task: RunTask | CommandTask | CopyTask,
        on_answer: Callable[[Any], None],
        on_failure: Callable[[End], None],
        end: End,
    ) -> None:
        """The end of every task: cancelled here, by QGIS's task manager or with QGIS, killed, failed or done."""
        if task is not self._task:
            return  # the plugin is being unloaded
        self._task = None
        self.run.end()
        left = self.pages.currentWidget() is not self.run  # cancelled here
        try:
            if end.cancelled:
                self.report(self.tr("Cancelled; no partial files are left."), Qgis.MessageLevel.Info)
            elif left:
                self.report(self.tr("The task had ended before it could be cancelled."), Qgis.MessageLevel.Info)
            elif end.text:
                on_failure(end)
                self._offer_extra(end.extra)
            else:
                on_answer(end.answer)
        finally:
            if self._task is None and self._steps is None and self.pages.currentWidget() is self.run:
                self._leave()

    def _offer_extra(self, extra: str) -> None:
        """Offer to install a part of furrowmap that was missing."""
        if not extra:
            return
        QgsSettings().setValue(EXTRA_KEY, extra)
        text = self.tr("A part of furrowmap is not installed: {part}.")
        message = self._iface.messageBar().createMessage(NAME, text.format(part=extra_words().get(extra, extra)))
        install = QPushButton(self.tr("Install…"), objectName="furrowmapInstall")
        install.clicked.connect(self.offer_setup)
        message.layout().addWidget(install)
        self._iface.messageBar().pushWidget(message, Qgis.MessageLevel.Warning, 0)

    def _is_busy(self) -> bool:
        """Whether a task or a batch runs, so that no other may begin; says so."""
        if self.batch.busy:
            text = self.tr("The drives are still running. Wait for their end, or cancel them in their list.")
        elif self._task is not None and self._task.isCanceled():
            text = self.tr("The previous task is being cancelled; try again in a moment.")
        elif self._task is not None:
            text = self.tr("A task is running. Wait for its end, or cancel it.")
        else:
            return False
        self.report(text, Qgis.MessageLevel.Info)
        return True

    def is_working(self) -> bool:
        """Whether a worker runs for the dock."""
        return self._task is not None or self.batch.busy or self.previewer.busy

    def _free_program(self) -> Sequence[str] | None:
        """The worker's command; None, with the reason on the screen, if there is none or one is at work."""
        return None if self._is_busy() else self._program()

    def _program(self) -> Sequence[str] | None:
        """The worker's command; None, with the offer to set it up, if there is none."""
        interpreter = find_interpreter()
        if interpreter is not None and is_usable(interpreter):
            return interpreter.program
        self.show_start()
        self.report(self.tr("Set up furrowmap's worker to run sessions. Results can be opened without it."))
        return None

    def _show_and_report(self, show: Callable[[], None], end: End) -> None:
        """Show a page, with why what was begun there failed."""
        show()
        self._show_failure(end.text)

    def _show_failure(self, text: str) -> None:
        """Show an error in full on the page that is shown, else in the message bar, and log it."""
        page = self.pages.currentWidget()
        if page not in (self.start, self.result, self.drives):
            self.report(text, Qgis.MessageLevel.Critical)
            return
        QgsMessageLog.logMessage(text, NAME, Qgis.MessageLevel.Critical, notifyUser=False)
        page.show_error(text)

    def _show_run(self, outputs: dict[str, Any]) -> None:
        """Open the products of a run that has ended."""
        self.open_folder(Path(outputs.get("FOLDER") or self._folder))

    def _refuse_run(self, end: End) -> None:
        """Say why a run failed: above the form, else on the start page."""
        if end.code in NOT_WRITABLE:
            QgsMessageLog.logMessage(end.text, NAME, Qgis.MessageLevel.Critical, notifyUser=False)
            self._refuse_folder(self._folder)
            return
        self._back_to_session()
        if self._in_form():
            self.session.show_error(end.text, may_replace=end.code == OUTPUT_EXISTS)
            self.session.show_remedy(end.setting)
        else:
            self.start.show_error(end.text)

    def _back_to_session(self) -> None:
        try:
            self.session.show_session(self._session)
            self.pages.setCurrentWidget(self.session)
        except (NotSimpleError, OSError, UnicodeDecodeError):
            self.show_start()

    def _report_saved(self, path: Path) -> None:
        self.report(self.tr("Saved {path}").format(path=path), Qgis.MessageLevel.Success)

    def _step(self) -> None:
        """Do one step of opening a folder, and schedule the next."""
        if self._steps is None:
            return
        self._in_step = True
        try:
            try:
                next(self._steps)
            finally:
                self._in_step = False
        except StopIteration as done:
            self._steps = None
            self._show_result(done.value)
        except NoResultsError as error:
            self._steps = None
            self.show_start()
            self.start.show_error(str(error))
            self.open_folders([])
        except Exception:
            self._steps = None
            self.show_start()
            raise
        else:
            QTimer.singleShot(1, self._step)  # other events of the window come first

    def _show_result(self, layers: Sequence[QgsMapLayer]) -> None:
        self._show_page_of_result()
        names = {key_of(layer): layer for layer in layers}
        layer = names.get("coverage") or names.get("trajectory") or layers[0]
        if names.get("coverage") and not names["coverage"].featureCount():
            layer = names.get("trajectory", layer)
        self._zoom_to_first([layer], [names[name] for name in ("boundary", "parcels") if name in names])
        self._offer_crs(layer)
        self.open_folders([])

    def _offer_crs(self, layer: QgsMapLayer) -> None:
        """Offer the session's CRS where that of the project, which has layers of the user, is made for another area."""
        project = QgsProject.instance()
        area = project.crs().bounds()
        if project.crs() == layer.crs() or area.isNull() or layer.extent().isEmpty():
            return
        to_degrees = QgsCoordinateTransform(layer.crs(), QgsCoordinateReferenceSystem("EPSG:4326"), project)
        place = to_degrees.transform(layer.extent().center())
        if area.contains(place):
            return
        text = self.tr("The session is outside of the area of the project's CRS, {crs}: shapes are wrong.")
        bar = self._iface.messageBar()
        message = bar.createMessage(NAME, text.format(crs=project.crs().authid()))
        use = QPushButton(self.tr("Use {crs}").format(crs=layer.crs().authid()), objectName="furrowmapUseCrs")
        crs = layer.crs()

        def change() -> None:
            project.setCrs(crs)
            bar.popWidget(message)
            if project.mapLayer(key) is not None:
                self._zoom_to_first([project.mapLayer(key)])

        key = layer.id()
        use.clicked.connect(change)
        message.layout().addWidget(use)
        bar.pushWidget(message, Qgis.MessageLevel.Warning, 0)

    def _show_page_of_result(self) -> None:
        """Show the figures of the result, and the themes of its group on the map."""
        self.result.show_folder(self._folder, from_drives=self._from_drives)
        self.pages.setCurrentWidget(self.result)
        groups = groups_of(QgsProject.instance(), self._folder)
        self.result.offer_themes(themes_of(groups[0]) if groups else [], theme_of(groups[0]) if groups else "")

    def _stop_opening(self) -> None:
        """The project or layers of it go while a result is being opened, whose next steps would use them."""
        steps = self._steps
        self._steps = None
        self._to_open = []
        if steps is not None:
            steps.close()
            if self.pages.currentWidget() is self.run:
                self.show_start()

    def _follow_cleared(self) -> None:
        """The project was closed: its result is not on the map any more."""
        if self.pages.currentWidget() is self.result:
            self.show_start()

    def _follow_project(self, *_: object) -> None:
        """Show the figures of the result that an opened project shows, unless the user is at something else."""
        if self._task is not None or self._steps is not None:
            return
        if self.pages.currentWidget() not in (self.start, self.result):
            return
        groups = groups_of(QgsProject.instance())
        shown = next((group for group in groups if group.isVisible()), groups[0] if groups else None)
        folder = folder_of(shown) if shown is not None else None
        if folder is None:
            self.show_start()
            return
        self._folder = folder
        self._show_page_of_result()

    def _show_theme(self, theme: str) -> None:
        self._end_replay()
        for group in groups_of(QgsProject.instance(), self._folder):
            show_theme(group, theme)

    def _zoom_to_first(self, layers: Sequence[QgsMapLayer], beside: Sequence[QgsMapLayer] = ()) -> None:
        """Zoom to the first layer and those beside it, with a margin for messages."""
        self._iface.setActiveLayer(layers[0])
        canvas = self._iface.mapCanvas()
        extent = canvas.mapSettings().layerExtentToOutputExtent(layers[0], layers[0].extent())
        for layer in beside:
            extent.combineExtentWith(canvas.mapSettings().layerExtentToOutputExtent(layer, layer.extent()))
        if extent.isFinite() and not extent.isEmpty():
            extent.scale(ZOOM_MARGIN)
            canvas.setExtent(extent)
            canvas.refresh()

    def _do(self, what: str) -> None:
        {
            "map": lambda: self.open_folder(self._folder),
            "replay": self._replay,
            "report": lambda: self._open_file(product(self._folder, "report.html")),
            "folder": lambda: self._open_file(self._folder),
            "print": self._print,
            "3d": self._show_in_3d,
            "farm": lambda: self._choose_farm([self._folder]),
            "edit": self._edit_session,
            "back": self.go_back,
        }[what]()

    def _edit_session(self) -> None:
        """Show the session of the result in the form."""
        named = read_report(self._folder).get("session_file")
        session = resolved(self._folder / named) if isinstance(named, str) else self._session
        if session.is_file():
            self.open_session(session)
        else:
            self.report(self.tr("The session file of this result is not there any more: {path}.").format(path=session))

    def _replay(self) -> None:
        self._end_replay()
        groups = groups_of(QgsProject.instance(), self._folder)
        if not groups:
            self.report(self.tr("Add the session to the map first."))
            return
        self._player = replay(self._iface, read_report(self._folder), groups[0])

    def _end_replay(self) -> None:
        if self._player is not None:
            self._player.end()
            self._player = None

    def _show_in_3d(self) -> None:
        """Open a view of the visible layers in three dimensions, with the camera above the ground of the run."""
        action = self._iface.mainWindow().findChild(QAction, "mActionNew3DMapCanvas")
        if action is None:
            self.report(self.tr("This QGIS has no 3D views."))
            return
        import qgis._3d  # noqa: F401 - for the types of the canvases

        known = self._iface.mapCanvases3D()
        action.trigger()
        for canvas in (canvas for canvas in self._iface.mapCanvases3D() if canvas not in known):
            camera = canvas.cameraController()
            place = camera.lookingAtPoint()  # at height 0, which may be far below the ground
            (place.setZ if Qgis.versionInt() >= Z_IS_UP else place.setY)(self._ground_height_m())
            camera.setLookingAtPoint(place, camera.distance(), PITCH_DEG, 0.0)

    def _ground_height_m(self) -> float:
        """Height of the run's first position; 0 where there is none."""
        groups = groups_of(QgsProject.instance(), self._folder)
        node = nodes_by_key(groups[0]).get("trajectory") if groups else None
        for pose in node.layer().getFeatures() if node is not None else ():
            if not pose.geometry().isNull():
                return float(pose.geometry().constGet().z())
        return 0.0

    def _choose_export(self, name: str) -> None:
        """Ask for the name of an export in a format."""
        suffix = FILE_SUFFIXES.get(name, "")
        beside = self._folder.with_name(f"{self._folder.name}{suffix or f'_{name}'}")
        target, _ = QFileDialog.getSaveFileName(self, self.tr("File or folder of the export"), str(beside))
        if target:
            self.export(name, target if target.lower().endswith(suffix) else target + suffix)

    def export(self, name: str, target: str) -> None:
        """Have the worker convert the result that is shown to a format, named as for `furrowmap export --to`."""
        show = partial(self.pages.setCurrentWidget, self.result)

        def written(answer: dict[str, Any]) -> None:
            show()
            self.report(self.tr("Exported to {path}").format(path=answer["target"]), Qgis.MessageLevel.Success)

        words = ["export", str(self._folder), "--to", name, "-o", target, "--overwrite"]
        self._command(self.tr("Exporting"), words, written, partial(self._show_and_report, show), show)

    def _choose_share(self, qfield: bool) -> None:
        """Ask for the folder of a page, or of a project for QField."""
        beside = self._folder.with_name(f"{self._folder.name}_{'qfield' if qfield else 'page'}")
        title = self.tr("Folder of the project") if qfield else self.tr("Folder of the page")
        target, _ = QFileDialog.getSaveFileName(self, title, str(beside))
        if target:
            self.share(target, qfield=qfield)

    def share(self, target: str, *, qfield: bool) -> None:
        """Have the worker write the result that is shown as a page, and open it, or as a project for QField."""
        show = partial(self.pages.setCurrentWidget, self.result)

        def written(answer: dict[str, Any]) -> None:
            show()
            self.report(self.tr("Exported to {path}").format(path=answer["start"]), Qgis.MessageLevel.Success)
            if not qfield:
                self._open_file(Path(answer["start"]))

        words = ["share", str(self._folder), "-o", target, "--overwrite", *(["--qfield"] if qfield else [])]
        self._command(self.tr("Exporting"), words, written, partial(self._show_and_report, show), show)

    def _choose_farm(self, folders: Sequence[Path]) -> None:
        """Ask for the farm map to which results are added: the one used last, another one, or a new one."""
        path, _ = QFileDialog.getSaveFileName(
            self,
            self.tr("Farm map"),
            QgsSettings().value(FARM_KEY, str(folders[0].parent / "farm.gpkg"), str),
            "GeoPackage (*.gpkg)",
            options=QFileDialog.Option.DontConfirmOverwrite,
        )
        if path:
            self.add_to_farm(folders, path if path.lower().endswith(".gpkg") else f"{path}.gpkg")

    def add_to_farm(self, folders: Sequence[Path], path: str) -> None:
        """Have the worker add the results in `folders` to a farm map, a GeoPackage that need not exist; open that."""
        show = partial(self.pages.setCurrentWidget, self.pages.currentWidget())
        waiting, failed, sessions = list(folders), list[str](), 0

        def go_on(answer: dict[str, Any]) -> None:  # one at a time: one that fails does not keep the others out
            nonlocal sessions
            sessions = answer["sessions"]
            del waiting[0]
            begin()

        def fail(end: End) -> None:
            failed.append(f"{session_name(read_report(waiting[0]), waiting[0])}: {end.text}")
            del waiting[0]
            begin()

        def begin() -> None:
            if waiting:
                words = ["farm", "add", str(waiting[0]), path]
                self._command(self.tr("Adding to the farm map"), words, go_on, fail, show)
                return
            show()
            if sessions:
                self._show_farm(path, sessions)
            if failed:
                self._show_failure("\n".join(failed))

        begin()

    def _show_farm(self, path: str, sessions: int) -> None:
        """Open a farm map to which results were added."""
        QgsSettings().setValue(FARM_KEY, path)
        layers = open_farm_map(path)
        text = self.tr("{count} sessions in the farm map.").format(count=sessions)
        self.report(text, Qgis.MessageLevel.Success)
        if layers:  # after QGIS has zoomed to the first layers of an empty project
            QTimer.singleShot(0, partial(self._zoom_to_first, layers, layers))

    def _open_file(self, path: Path) -> None:
        if not path.exists():
            self.report(self.tr("{path} does not exist.").format(path=path))
        elif not QDesktopServices.openUrl(QUrl.fromLocalFile(str(path))):
            self.report(self.tr("{path} was not opened: this computer has no program for it.").format(path=path))

    def _print(self) -> None:
        project = QgsProject.instance()
        groups = groups_of(project, self._folder)
        if not groups:
            self.report(self.tr("Add the session to the map first."))
            return
        designer = self._iface.openLayoutDesigner(session_layout(project, groups[0], read_report(self._folder)))
        window = designer.window()
        window.resize(window.size().expandedTo(DESIGNER_SIZE))
        QTimer.singleShot(0, designer.view().zoomFull)  # after the window was resized


def _show_algorithm(name: str, parameters: dict[str, Any]) -> None:
    """Show the dialog of an algorithm of the toolbox."""
    from qgis import processing  # QGIS adds it when its plugin Processing is loaded

    processing.createAlgorithmDialog(name, parameters).show()
