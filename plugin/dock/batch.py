# SPDX-License-Identifier: GPL-2.0-or-later
"""Drives that are run one after another, without questions."""

from dataclasses import dataclass
from pathlib import Path

from qgis.core import QgsApplication
from qgis.PyQt.QtCore import QObject, pyqtSignal

from .findings import FORM
from .tasks import CommandTask, RunTask

WAITING, RUNNING, DONE = "waiting", "running", "done"
FAILED, TO_FILL_IN, CANCELLED = "failed", "to fill in", "cancelled"
ENDED = (DONE, FAILED, TO_FILL_IN, CANCELLED)
ASKED = tuple(code for code in FORM if code != "no-implement")
"""Codes of what a session must not lack to be run without a question."""


@dataclass
class Drive:
    """A drive in the queue.

    Attributes:
        session: its file, which the batch writes where there is none yet.
        recordings: folder for a new session; None for a session that exists.
        state: one of the words above.
        text: the stage, or why it failed.
        folder: of its products.
    """

    session: Path
    recordings: Path | None
    folder: Path
    state: str = WAITING
    text: str = ""


class BatchRunner(QObject):
    """Runs one drive at a time; one that fails does not stop the others.

    Signals:
        changed: with the number of the drive whose state is another.
        ended: all drives have ended.
    """

    changed = pyqtSignal(int)
    ended = pyqtSignal()

    def __init__(self, parent=None):
        super().__init__(parent)
        self.drives = []
        self._at = 0
        self._task = self._program = self._machine = None

    @property
    def busy(self):
        """Whether a drive is running or waits."""
        return any(drive.state not in ENDED for drive in self.drives)

    def begin(self, program, drives, machine=None):
        """Run these drives.

        Args:
            program: the worker's command.
            drives: list of :class:`Drive`.
            machine: profile for the sessions that are new; None for none.
        """
        self.drives, self._at, self._program, self._machine = drives, 0, program, machine
        self._next()

    def cancel(self):
        """Cancel the running drive and those that wait; returns the task, which ends a moment later."""
        task, self._task = self._task, None
        for number, drive in enumerate(self.drives):
            if drive.state not in ENDED:
                drive.state, drive.text = CANCELLED, ""
                self.changed.emit(number)
        if task is not None:
            task.cancel()
        return task

    def _next(self):
        self._at = next((k for k, drive in enumerate(self.drives) if drive.state not in ENDED), -1)
        if self._at < 0:
            self.ended.emit()
            return
        drive = self.drives[self._at]
        drive.state = RUNNING
        self._stage("")
        if drive.recordings is None:
            self._run()
            return
        words = ["init", str(drive.recordings), "-o", str(drive.session)]
        words += ["--machine", str(self._machine)] if self._machine is not None else []
        task = CommandTask(f"furrowmap: {drive.recordings.name}", self._program, words)
        task.answered.connect(lambda answer: self._proposed(task, answer))
        task.failed.connect(lambda text, _code: self._end(task, FAILED, text))
        self._begin(task)

    def _proposed(self, task, answer):
        if task is not self._task:
            return
        if {notice.get("code") for notice in answer.get("missing") or []} & set(ASKED):
            self._end(task, TO_FILL_IN, "")
        else:
            self._run()

    def _run(self):
        drive = self.drives[self._at]
        parameters = {"SESSION": str(drive.session), "OUTPUT": str(drive.folder), "OPEN": False}
        errors = [""]
        task = RunTask(parameters, self._stage, errors.append)
        task.executed.connect(lambda ok, _: self._end(task, *((DONE, "") if ok else (FAILED, errors[-1]))))
        self._begin(task)

    def _begin(self, task):
        self._task = task
        QgsApplication.taskManager().addTask(task)

    def _stage(self, name):
        if 0 <= self._at < len(self.drives) and self.drives[self._at].state == RUNNING:
            self.drives[self._at].text = name
            self.changed.emit(self._at)

    def _end(self, task, state, text):
        if task is not self._task:
            return  # cancelled meanwhile
        self._task = None
        drive = self.drives[self._at]
        drive.state, drive.text = state, text
        self.changed.emit(self._at)
        self._next()
