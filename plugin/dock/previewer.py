# SPDX-License-Identifier: GPL-2.0-or-later
"""Previews of a session, computed in the background and opened as layers."""

import shutil
import tempfile

from qgis.core import QgsApplication, QgsProject
from qgis.PyQt.QtCore import QObject, pyqtSignal

from ..previews import open_preview, preview_text, read_account, remove_previews
from .tasks import RunTask


class Previewer(QObject):
    """Computes one preview at a time, into a temporary folder that is deleted with the plugin.

    Signals:
        status_changed: a line on the progress.
        opened: with the layers, when they are in the project.
    """

    status_changed = pyqtSignal(str)
    opened = pyqtSignal(object)

    def __init__(self, parent=None):
        super().__init__(parent)
        self._task = None
        self._error = ""
        self._folders = []

    def begin(self, session):
        """Preview a session file; a running preview is cancelled."""
        self.cancel()
        folder = tempfile.mkdtemp(prefix="furrowmap-preview-")
        self._folders.append(folder)
        self._error = ""
        parameters = {"SESSION": str(session), "PREVIEW": True, "OUTPUT": folder, "OPEN": False}
        task = RunTask(parameters, self._stage, self._keep_error)
        task.executed.connect(lambda successful, _: self._done(task, folder, successful=successful))
        self._task = task
        self.status_changed.emit(self.tr("Preview: {stage}…").format(stage=self.tr("starting")))
        QgsApplication.taskManager().addTask(task)

    @property
    def busy(self):
        """Whether a preview is running."""
        return self._task is not None

    def cancel(self):
        """Cancel the running preview; the worker ends a moment later."""
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            self.status_changed.emit("")
        return task

    def end(self):
        """Cancel, and remove files and layers, before the plugin is unloaded."""
        task = self.cancel()
        if task is not None:
            task.waitForFinished(8000)
        for folder in self._folders:
            remove_previews(QgsProject.instance(), read_account(folder))
            shutil.rmtree(folder, ignore_errors=True)
        self._folders = []

    def _stage(self, name):
        if self._task is not None:
            self.status_changed.emit(self.tr("Preview: {stage}…").format(stage=name))

    def _keep_error(self, text):
        self._error = text

    def _done(self, task, folder, *, successful):
        if task is not self._task:
            return  # cancelled meanwhile
        self._task = None
        if not successful:
            lines = self._error.splitlines() or [self.tr("see the log.")]
            self.status_changed.emit(
                self.tr("No preview: {reason}").format(reason=" ".join(dict.fromkeys((lines[0], lines[-1]))))
            )
            return
        layers = open_preview(folder)
        self.status_changed.emit(
            self.tr("Preview on the map: {figures}.").format(figures=preview_text(read_account(folder)))
        )
        if layers:
            self.opened.emit(layers)
