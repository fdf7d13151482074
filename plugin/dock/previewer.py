# SPDX-License-Identifier: GPL-2.0-or-later
"""Previews a session in the background, and shows it on the map."""

import shutil
import tempfile

from qgis.core import QgsApplication, QgsProcessingAlgRunnerTask, QgsProcessingContext, QgsProject
from qgis.PyQt.QtCore import QObject, pyqtSignal

from ..previews import open_preview, preview_words, read_account, remove_previews
from .tasks import QUIET, StageFeedback


class Previewer(QObject):
    """At most one preview at a time; its files lie in a temporary folder and go with the plugin.

    Signals:
        told: a line on how it goes.
        opened: with the layers, when they are on the map.
    """

    told = pyqtSignal(str)
    opened = pyqtSignal(object)

    def __init__(self, parent=None):
        super().__init__(parent)
        self._task = self._feedback = self._context = None
        self._error = ""
        self._folders = []

    def begin(self, session):
        """Preview a session file; a preview under way is dropped."""
        self.cancel()
        folder = tempfile.mkdtemp(prefix="furrowmap-preview-")
        self._folders.append(folder)
        self._error = ""
        self._context = QgsProcessingContext()
        self._feedback = StageFeedback(logFeedback=False)
        self._feedback.stage_changed.connect(self._stage)
        self._feedback.failed.connect(self._keep_error)
        algorithm = QgsApplication.processingRegistry().createAlgorithmById("furrowmap:run")
        parameters = {"SESSION": str(session), "PREVIEW": True, "OUTPUT": folder, "OPEN": False}
        task = QgsProcessingAlgRunnerTask(algorithm, parameters, self._context, self._feedback, QUIET)
        task.executed.connect(lambda successful, _: self._done(task, folder, successful=successful))
        self._task = task
        self.told.emit(self.tr("Preview: {stage}…").format(stage=self.tr("starting")))
        QgsApplication.taskManager().addTask(task)

    @property
    def busy(self):
        """Whether a preview is under way."""
        return self._task is not None

    def cancel(self):
        """Drop the preview under way; the worker is gone a moment later."""
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            self.told.emit("")
        return task

    def end(self):
        """Before the plugin goes: neither work nor files nor layers of them are left."""
        task = self.cancel()
        if task is not None:
            task.waitForFinished(8000)
        for folder in self._folders:
            remove_previews(QgsProject.instance(), read_account(folder))
            shutil.rmtree(folder, ignore_errors=True)
        self._folders = []

    def _stage(self, name):
        if self._task is not None:
            self.told.emit(self.tr("Preview: {stage}…").format(stage=name))

    def _keep_error(self, text):
        self._error = text

    def _done(self, task, folder, *, successful):
        if task is not self._task:
            return  # dropped meanwhile
        self._task = None
        if not successful:
            lines = self._error.splitlines() or [self.tr("the log tells why.")]
            self.told.emit(
                self.tr("No preview: {reason}").format(reason=" ".join(dict.fromkeys((lines[0], lines[-1]))))
            )
            return
        layers = open_preview(folder)
        self.told.emit(self.tr("Preview on the map: {figures}.").format(figures=preview_words(read_account(folder))))
        if layers:
            self.opened.emit(layers)
