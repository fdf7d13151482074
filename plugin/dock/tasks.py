# SPDX-License-Identifier: GPL-2.0-or-later
"""The dock's background tasks: one command, a run or its preview, and many drives one after another."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from qgis.core import (
    QgsApplication,
    QgsProcessingAlgRunnerTask,
    QgsProcessingContext,
    QgsProcessingFeedback,
    QgsProject,
    QgsSettings,
    QgsTask,
)
from qgis.PyQt.QtCore import QCoreApplication, QObject, pyqtSignal

from ..figures import localized
from ..previews import open_preview, preview_text, read_account, remove_previews
from ..processing.algorithm import ERROR_CODE, ERROR_EXTRA, ERROR_SETTING
from ..products import product
from ..results import REPORT, read_report
from ..translation import in_marks
from ..worker import WorkerCancelled, WorkerError, percent_of, run_command
from .form_parts import FILL_IN, FORM_CODES

QUIET = QgsTask.Flag.CanCancel | QgsTask.Flag.Silent
"""The dock itself shows how its tasks end."""
TASK_END_MS = 8000
"""A cancelled task has this long to end before the plugin is unloaded."""
WAITING = "waiting"
RUNNING = "running"
DONE = "done"
DOUBTFUL = "doubtful"
CUT = "cut"
FAILED = "failed"
TO_FILL_IN = "to fill in"
CANCELLED = "cancelled"
WITH_RESULT = (DONE, DOUBTFUL, CUT)
ENDED = (*WITH_RESULT, FAILED, TO_FILL_IN, CANCELLED)
CUT_CODES = ("bag-cut", "cut-capture", "cut-stream", "stream-cut")
"""Codes of recordings that end within something."""
SHORTEST_DRIVE_S = 10.0
"""A shorter recording was cut, or began by mistake."""
DRIVES_KEY = "furrowmap/drives"
"""Setting: the last list of drives, as JSON."""


class StageFeedback(QgsProcessingFeedback):
    """Feedback of an algorithm that runs in another thread."""

    stage_changed = pyqtSignal(str)
    error = ""

    def setProgressText(self, text: str) -> None:  # noqa: N802 - the names are QGIS's
        """Emit the new stage."""
        self.stage_changed.emit(text)

    def reportError(self, error: str, fatalError: bool = False) -> None:  # noqa: N802, ARG002
        """Keep the error, three lines as one text."""
        self.error = error


@dataclass(frozen=True)
class End:
    """How a task ended: it answered, or it was cancelled, by whomever, or it failed.

    Attributes:
        answer: the command's; None if it was cancelled or failed.
        text: three lines on the failure; "" if it did not fail.
        code: of the error; "" for none.
        setting: table, key and value of the session file that remedy the error; None for another remedy.
        extra: part of furrowmap that has to be installed; "" for none.
    """

    cancelled: bool = False
    answer: Any = None
    text: str = ""
    code: str = ""
    setting: dict[str, Any] | None = None
    extra: str = ""


class RunTask(QgsProcessingAlgRunnerTask):
    """Runs the algorithm `furrowmap:run`; `on_stage` is called with the name of each stage.

    Signals:
        ended: with the :class:`End`, once, however it ended; its answer has the algorithm's outputs.
    """

    ended = pyqtSignal(object)

    def __init__(self, parameters: dict[str, Any], on_stage: Callable[[str], None]) -> None:
        self.context = QgsProcessingContext()
        self.feedback = StageFeedback(logFeedback=False)
        self.feedback.stage_changed.connect(on_stage)
        algorithm = QgsApplication.processingRegistry().createAlgorithmById("furrowmap:run")
        super().__init__(algorithm, parameters, self.context, self.feedback, QUIET)
        self.executed.connect(self._tell)

    def _tell(self, successful: bool, outputs: dict[str, Any]) -> None:
        feedback = self.feedback
        if successful:
            self.ended.emit(End(answer=outputs))
        elif self.isCanceled() or feedback.isCanceled():
            self.ended.emit(End(cancelled=True))
        else:
            setting = json.loads(feedback.property(ERROR_SETTING) or "null")
            text = feedback.error or QCoreApplication.translate("Worker", "The run failed; see the log.")
            code = feedback.property(ERROR_CODE) or ""
            known = setting if isinstance(setting, dict) else None
            self.ended.emit(End(text=text, code=code, setting=known, extra=feedback.property(ERROR_EXTRA) or ""))


class CommandTask(QgsTask):
    """Runs one command without its algorithm.

    Signals:
        ended: with the :class:`End`, once, however it ended.
    """

    ended = pyqtSignal(object)

    def __init__(self, title: str, program: Sequence[str], arguments: Sequence[str]) -> None:
        super().__init__(title, QUIET)
        self._program = program
        self._arguments = arguments
        self._end = End(cancelled=True)  # of a task that never began

    def run(self) -> bool:
        """Run the command, in a thread of QGIS's."""
        try:
            answer = run_command(self._program, self._arguments, self._on_message, self.isCanceled)
        except WorkerCancelled:
            return False
        except WorkerError as error:
            self._end = End(text="\n".join(error.lines), code=error.code, setting=error.setting, extra=error.extra)
            return False
        except Exception as error:  # noqa: BLE001 - whatever ends the task, the dock goes on
            self._end = End(text=f"{type(error).__name__}: {error}")
            return False
        self._end = End(answer=answer)
        return True

    def finished(self, result: bool) -> None:  # noqa: ARG002 - the end says more
        """Emit the signal, in the main thread."""
        self.ended.emit(End(cancelled=True) if self.isCanceled() and self._end.answer is None else self._end)

    def _on_message(self, message: dict[str, Any]) -> None:
        if message["type"] == "progress":
            self.setProgress(percent_of(message))


class CopyTask(QgsTask):
    """Copies files by a function that takes where to tell the share done, and what tells whether it is cancelled.

    Signals:
        ended: with the :class:`End`, once, however it ended; its answer are the copies.
    """

    ended = pyqtSignal(object)

    def __init__(self, title: str, work: Callable[[Callable[[float], None], Callable[[], bool]], list[Path]]) -> None:
        super().__init__(f"furrowmap: {title}", QUIET)
        self._work = work
        self._end = End(cancelled=True)

    def run(self) -> bool:
        """Copy, in a thread of QGIS's."""
        try:
            copies = self._work(lambda share: self.setProgress(100.0 * share), self.isCanceled)
        except OSError as error:
            self._end = End(text=f"{error.filename}: {error.strerror}.")
            return False
        self._end = End(answer=copies) if copies else End(cancelled=True)
        return bool(copies)

    def finished(self, result: bool) -> None:  # noqa: ARG002 - the end says more
        """Emit the signal, in the main thread."""
        self.ended.emit(self._end)


class Previewer(QObject):
    """Computes one preview at a time, into a temporary folder that is deleted with the plugin.

    Signals:
        status_changed: a line on the progress.
        remedy_found: with the setting that remedies the failure of the preview.
    """

    status_changed = pyqtSignal(str)
    remedy_found = pyqtSignal(object)
    opened = pyqtSignal(object)

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self._task: RunTask | None = None
        self._folders: list[str] = []

    def begin(self, session: Path) -> None:
        """Preview a session file; a running preview is cancelled."""
        self.cancel()
        folder = tempfile.mkdtemp(prefix="furrowmap-preview-")
        self._folders.append(folder)
        parameters = {"SESSION": str(session), "PREVIEW": True, "OUTPUT": folder, "OPEN": False}
        task = self._task = RunTask(parameters, self._show_stage)
        task.ended.connect(lambda end: self._finish(task, folder, end))
        self._show_stage(self.tr("starting"))
        QgsApplication.taskManager().addTask(task)

    @property
    def busy(self) -> bool:
        """Whether a preview is running."""
        return self._task is not None

    def cancel(self) -> RunTask | None:
        """Cancel the running preview; returns its task, which ends a moment later."""
        task = self._task
        self._task = None
        if task is not None:
            task.cancel()
            self.status_changed.emit("")
        return task

    def end(self) -> None:
        """Cancel, and remove files and layers, before the plugin is unloaded."""
        task = self.cancel()
        if task is not None:
            task.waitForFinished(TASK_END_MS)
        for folder in self._folders:
            remove_previews(QgsProject.instance(), read_account(folder))
            shutil.rmtree(folder, ignore_errors=True)
        self._folders = []

    def _show_stage(self, name: str) -> None:
        if self._task is not None:
            self.status_changed.emit(self.tr("Preview: {stage}…").format(stage=name))

    def _finish(self, task: RunTask, folder: str, end: End) -> None:
        if task is not self._task:
            return  # cancelled meanwhile, or another one has begun
        self._task = None
        if end.cancelled:
            self.status_changed.emit("")
            return
        if end.text:
            reason = " ".join(dict.fromkeys(end.text.splitlines()))
            self.status_changed.emit(self.tr("No preview: {reason}").format(reason=reason))
            self.remedy_found.emit(end.setting)
            return
        layers = open_preview(folder)
        figures = preview_text(read_account(folder))
        self.status_changed.emit(self.tr("Preview on the map: {figures}.").format(figures=figures))
        if layers:
            self.opened.emit(layers)


@dataclass
class Drive:
    """A drive in the queue: its session, the folder for a new one, state, and the stage, or why it failed."""

    session: Path
    recordings: Path | None
    folder: Path
    state: str = WAITING
    text: str = ""


def judged(folder: Path) -> tuple[str, str]:
    """The state of a drive by the report of its run, and why it is not simply done."""
    report = read_report(folder)
    verdict = report.get("verdict") or {}
    figures = report.get("figures") or {}
    warnings = [warning for warning in report.get("warnings") or [] if isinstance(warning, dict)]
    cut = next((localized(warning, "text") for warning in warnings if warning.get("code") in CUT_CODES), "")
    duration_s = figures.get("duration_s")
    if localized(verdict, "text"):
        return DOUBTFUL, str(localized(verdict, "text"))
    if isinstance(duration_s, (int, float)) and duration_s < SHORTEST_DRIVE_S:
        text = QCoreApplication.translate("BatchPage", "It lasts {duration:.1f} s.")
        text = in_marks(text.format(duration=duration_s))
        return CUT, " ".join(filter(None, (text, cut)))
    return (CUT, str(cut)) if cut else (DONE, "")


class BatchRunner(QObject):
    """Runs one drive at a time, without questions; one that fails does not stop the others.

    Signals:
        changed: with the number of the drive whose state has changed.
    """

    changed = pyqtSignal(int)

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self.drives: list[Drive] = []
        self._at = 0
        self._program: Sequence[str] = ()
        self._machine: Path | None = None
        self._task: RunTask | CommandTask | None = None
        for known in json.loads(QgsSettings().value(DRIVES_KEY, "[]", str)):
            session, recordings, folder, state, text = (known.get(each.name) for each in fields(Drive))
            state = state if state in ENDED else CANCELLED
            if state in WITH_RESULT and product(Path(folder), REPORT).is_file():
                state, text = judged(Path(folder))  # in the language that QGIS has now
            self.drives.append(
                Drive(Path(session), Path(recordings) if recordings else None, Path(folder), state, text)
            )
        self.changed.connect(self._keep)

    def _keep(self, number: int) -> None:
        """Keep the list for the next start of QGIS."""
        if self.drives[number].state != RUNNING:
            QgsSettings().setValue(DRIVES_KEY, json.dumps([asdict(drive) for drive in self.drives], default=str))

    @property
    def busy(self) -> bool:
        """Whether a drive is running or waiting."""
        return any(drive.state not in ENDED for drive in self.drives)

    def begin(self, program: Sequence[str], drives: list[Drive], machine: Path | None = None) -> None:
        """Run drives with the worker's command `program`; new sessions get the places of the profile `machine`."""
        self.drives = drives
        self._program = program
        self._machine = machine
        self._begin_next()

    def cancel(self) -> QgsTask | None:
        """Cancel the running drive and those that wait; returns the task, which ends a moment later."""
        task = self._task
        self._task = None
        for number, drive in enumerate(self.drives):
            if drive.state not in ENDED:
                drive.state = CANCELLED
                drive.text = ""
                self.changed.emit(number)
        if task is not None:
            task.cancel()
        return task

    def _begin_next(self) -> None:
        self._at = -1
        for number, drive in enumerate(self.drives):
            if drive.state in ENDED:
                continue
            known = _state_before(drive) if drive.recordings is None else None
            if known is None:
                self._at = number
                break
            drive.state, drive.text = known
            self.changed.emit(number)
        if self._at < 0:
            return
        drive = self.drives[self._at]
        drive.state = RUNNING
        self._show_stage("")
        if drive.recordings is None:
            self._run()
            return
        words = ["init", str(drive.recordings), "-o", str(drive.session)]
        words += ["--machine", str(self._machine)] if self._machine is not None else []
        self._add(CommandTask(f"furrowmap: {drive.recordings.name}", self._program, words), self._run_if_complete)

    def _run_if_complete(self, answer: dict[str, Any]) -> None:
        if {notice.get("code") for notice in answer.get("missing") or []} & set(FORM_CODES) - {"no-implement"}:
            self._finish(TO_FILL_IN)
        else:
            self._run()

    def _run(self) -> None:
        drive = self.drives[self._at]
        parameters = {"SESSION": str(drive.session), "OUTPUT": str(drive.folder), "OPEN": False}
        self._add(RunTask(parameters, self._show_stage), lambda _: self._finish(*judged(drive.folder)))

    def _add(self, task: RunTask | CommandTask, go_on: Callable[[Any], None]) -> None:
        """Begin a task of the running drive; however it ends, the drive goes on or has ended."""

        def ended(end: End) -> None:
            if task is not self._task:
                return  # the batch was cancelled, or the plugin is being unloaded
            self._task = None
            if end.cancelled:  # by QGIS's task manager, or since QGIS is to be closed: no other drive begins
                self.cancel()
            elif end.text:
                self._finish(FAILED, end.text)
            else:
                go_on(end.answer)

        self._task = task
        task.ended.connect(ended)
        QgsApplication.taskManager().addTask(task)

    def _show_stage(self, name: str) -> None:
        if 0 <= self._at < len(self.drives) and self.drives[self._at].state == RUNNING:
            self.drives[self._at].text = name
            self.changed.emit(self._at)

    def _finish(self, state: str, text: str = "") -> None:
        drive = self.drives[self._at]
        drive.state = state
        drive.text = text
        self.changed.emit(self._at)
        self._begin_next()


def _state_before(drive: Drive) -> tuple[str, str] | None:
    """The state of a drive that cannot run as its session is, or whose result is newer than that; None to run it."""
    try:
        lines = drive.session.read_text(encoding="utf-8").splitlines()
        if any(f'"{FILL_IN}"' in line and not line.lstrip().startswith("#") for line in lines):
            return TO_FILL_IN, ""
        report = product(drive.folder, REPORT)
        return judged(drive.folder) if report.stat().st_mtime > drive.session.stat().st_mtime else None
    except (OSError, UnicodeDecodeError):
        return None  # the run says why
