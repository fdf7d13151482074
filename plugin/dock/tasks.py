# SPDX-License-Identifier: GPL-2.0-or-later
"""The worker's verbs as QGIS's background tasks: what they say on the way comes as signals in the window's thread."""

import time

from qgis.core import QgsProcessingFeedback, QgsTask
from qgis.PyQt.QtCore import pyqtSignal

from ..worker import WorkerError, run_command

QUIET = QgsTask.Flag.CanCancel | QgsTask.Flag.Silent
"""The dock itself tells how its tasks end."""


class StageFeedback(QgsProcessingFeedback):
    """Hears an algorithm that works in another thread.

    Signals:
        stage_changed: name of the stage that begins.
        warned: text of a warning.
        failed: the three lines of an error, as one text.
    """

    stage_changed = pyqtSignal(str)
    warned = pyqtSignal(str)
    failed = pyqtSignal(str)

    def setProgressText(self, text):  # noqa: N802 - the names are QGIS's
        """A stage begins."""
        self.stage_changed.emit(text)

    def pushWarning(self, warning):  # noqa: N802
        """Something the user should know."""
        self.warned.emit(warning)

    def reportError(self, error, fatalError=False):  # noqa: N802, ARG002
        """Why nothing came of it."""
        self.failed.emit(error)


class CommandTask(QgsTask):
    """One verb that has no algorithm's form, such as a look at recordings.

    Signals:
        answered: with the verb's answer.
        failed: with the three lines of the error, as one text.
    """

    answered = pyqtSignal(object)
    failed = pyqtSignal(str)

    def __init__(self, title, program, arguments):
        super().__init__(title, QUIET)
        self._program, self._arguments = program, arguments
        self._answer = self._error = None

    def run(self):
        """In a thread of its own: order the verb and wait."""
        try:
            self._answer = run_command(self._program, self._arguments, self._heard, self.isCanceled)
        except WorkerError as error:
            self._error = error
        return self._error is None

    def finished(self, result):
        """In the window's thread: tell how it went; a task that was cancelled says nothing."""
        if result:
            self.answered.emit(self._answer)
        elif self._error is not None and not self.isCanceled():
            self.failed.emit("\n".join(self._error.lines))

    def _heard(self, message):
        if message["type"] == "progress":
            self.setProgress(100.0 * float(message.get("share", 0.0)))


class Clock:
    """Seconds since the work began, as words."""

    def __init__(self):
        self._begun = time.monotonic()

    def __str__(self):
        minutes, seconds = divmod(int(time.monotonic() - self._begun), 60)
        return f"{minutes}:{seconds:02d}"
