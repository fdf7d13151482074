# SPDX-License-Identifier: GPL-2.0-or-later
"""Background tasks, whose messages arrive as signals in the main thread."""

from qgis.core import QgsApplication, QgsProcessingAlgRunnerTask, QgsProcessingContext, QgsProcessingFeedback, QgsTask
from qgis.PyQt.QtCore import pyqtSignal

from ..processing.algorithm import ERROR_CODE
from ..worker import WorkerError, run_command

QUIET = QgsTask.Flag.CanCancel | QgsTask.Flag.Silent
"""The dock shows itself how its tasks end."""


class StageFeedback(QgsProcessingFeedback):
    """Feedback of an algorithm in another thread, as signals.

    Signals:
        stage_changed: name of the new stage.
        failed: the three lines of an error, as one text.
    """

    stage_changed = pyqtSignal(str)
    failed = pyqtSignal(str)

    def setProgressText(self, text):  # noqa: N802 - the names are QGIS's
        """A new stage."""
        self.stage_changed.emit(text)

    def reportError(self, error, fatalError=False):  # noqa: N802, ARG002
        """An error."""
        self.failed.emit(error)


class RunTask(QgsProcessingAlgRunnerTask):
    """Runs the algorithm `furrowmap:run`.

    Args:
        parameters: of the algorithm.
        on_stage: is called with the name of each stage.
        on_error: is called with the text of an error.
    """

    def __init__(self, parameters, on_stage, on_error):
        self.context, self.feedback = QgsProcessingContext(), StageFeedback(logFeedback=False)
        self.feedback.stage_changed.connect(on_stage)
        self.feedback.failed.connect(on_error)
        algorithm = QgsApplication.processingRegistry().createAlgorithmById("furrowmap:run")
        super().__init__(algorithm, parameters, self.context, self.feedback, QUIET)

    @property
    def error_code(self):
        """Code of the error that ended it; "" if there is none."""
        return self.feedback.property(ERROR_CODE) or ""


class CommandTask(QgsTask):
    """Runs one command without its algorithm.

    Signals:
        answered: with the command's answer.
        failed: with the three lines of the error, as one text, and its code.
    """

    answered = pyqtSignal(object)
    failed = pyqtSignal(str, str)

    def __init__(self, title, program, arguments):
        super().__init__(title, QUIET)
        self._program, self._arguments = program, arguments
        self._answer = self._error = None

    def run(self):
        """Run the command, in a thread of QGIS's."""
        try:
            self._answer = run_command(self._program, self._arguments, self._on_message, self.isCanceled)
        except WorkerError as error:
            self._error = error
        return self._error is None

    def finished(self, result):
        """Emit a signal, in the main thread; none if the task was cancelled."""
        if result:
            self.answered.emit(self._answer)
        elif self._error is not None and not self.isCanceled():
            self.failed.emit("\n".join(self._error.lines), self._error.code)

    def _on_message(self, message):
        if message["type"] == "progress":
            self.setProgress(100.0 * float(message.get("share", 0.0)))
