# SPDX-License-Identifier: GPL-2.0-or-later
"""Settings › Options › furrowmap: the furrowmap in use, a test of it, and an environment of the plugin's own."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from qgis.core import QgsApplication, QgsSettings, QgsTask
from qgis.gui import QgsFileWidget, QgsOptionsPageWidget, QgsOptionsWidgetFactory
from qgis.PyQt.QtCore import QCoreApplication, pyqtSignal
from qgis.PyQt.QtGui import QIcon
from qgis.PyQt.QtWidgets import (
    QGroupBox,
    QHBoxLayout,
    QLabel,
    QMessageBox,
    QPlainTextEdit,
    QRadioButton,
    QVBoxLayout,
    QWidget,
)

from .dock.form_parts import button, side_by_side
from .installer import InstallError, check, create_environment, remove_environment
from .interpreter import CHOSEN_KEY, command_of, environment_folder, find_interpreter, why
from .platforms import python_in
from .program import ProgramError
from .worker import WorkerError

tr = partial(QCoreApplication.translate, "Options")

PAGE = "furrowmap"
"""The page's name, by which QGIS opens it."""


class OptionsFactory(QgsOptionsWidgetFactory):
    """Makes the page when QGIS opens its options."""

    def __init__(self) -> None:
        super().__init__(PAGE, QIcon(str(Path(__file__).with_name("icon.svg"))))
        self.setKey(PAGE)

    def createWidget(self, parent: QWidget) -> OptionsPage:  # noqa: N802 - the name is QGIS's
        """The page."""
        return OptionsPage(parent)

    def end(self) -> None:
        """Cancel a running task before the plugin is unloaded."""
        if OptionsPage.task is not None:
            OptionsPage.task.cancel()
            OptionsPage.task.waitForFinished(8000)


class BackgroundTask(QgsTask):
    """A test, a creation or a deletion of an environment.

    Signals:
        done: whether it succeeded, and the last line.
    """

    line = pyqtSignal(str)
    done = pyqtSignal(bool, str)

    def __init__(self, title: str, work: Callable[[Callable[[str], None], Callable[[], bool]], str]) -> None:
        super().__init__(title, QgsTask.Flag.CanCancel)
        self.work = work  # takes on_line and is_cancelled, returns the last line
        self.last = ""

    def run(self) -> bool:
        """Do the work, in a thread of QGIS's."""
        try:
            self.last = self.work(self.line.emit, self.isCanceled)
        except (InstallError, WorkerError) as error:
            self.last = str(error)
            return False
        except ProgramError as error:
            self.last = tr("Cancelled; nothing was changed.") if error.cancelled else str(error)
            return False
        except OSError as error:
            self.last = f"{error.filename}: {error.strerror}"
            return False
        return True

    def finished(self, result: bool) -> None:
        """Report the end, in the main thread."""
        self.done.emit(bool(result), self.last)


class OptionsPage(QgsOptionsPageWidget):
    """The page; a task that it starts goes on when it is closed."""

    task: BackgroundTask | None = None  # of all pages: one at a time

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setObjectName(PAGE)
        layout = QVBoxLayout(self)
        layout.addWidget(self._used_group())
        layout.addWidget(self._own_group())
        self.log = QPlainTextEdit(readOnly=True, objectName="furrowmapLog")
        layout.addWidget(self.log, 1)
        self.refresh()
        if OptionsPage.task is not None:
            self._follow(OptionsPage.task)

    def _used_group(self) -> QGroupBox:
        group = QGroupBox(tr("furrowmap in use"))
        layout = QVBoxLayout(group)
        self.used = QLabel(wordWrap=True, objectName="furrowmapUsed")
        layout.addWidget(self.used)
        layout.addWidget(QLabel(tr("Another one (a Python interpreter with furrowmap, or the furrowmap command):")))
        self.chosen = QgsFileWidget(objectName="furrowmapChosen")
        self.chosen.setFilePath(QgsSettings().value(CHOSEN_KEY, "", str))
        self.chosen.lineEdit().setPlaceholderText(tr("Found automatically"))
        self.check_button = button("furrowmapCheck", tr("Test"), self.check)
        row = QHBoxLayout()
        row.addWidget(self.chosen, 1)
        row.addWidget(self.check_button)
        layout.addLayout(row)
        return group

    def _own_group(self) -> QGroupBox:
        group = QGroupBox(tr("Environment of the plugin"))
        layout = QVBoxLayout(group)
        self.own = QLabel(wordWrap=True)
        layout.addWidget(self.own)
        self.from_index = QRadioButton(
            tr("From a wheel or source checkout; dependencies from the package index (240 MB to download)"),
            checked=True,
        )
        self.package = QgsFileWidget(objectName="furrowmapPackage")
        self.package.setFilter(tr("Wheel or checkout (furrowmap-*.whl pyproject.toml)"))
        self.from_folder = QRadioButton(tr("From a folder with the wheels of furrowmap and its dependencies (offline)"))
        self.wheels = QgsFileWidget(objectName="furrowmapWheels")
        self.wheels.setStorageMode(QgsFileWidget.StorageMode.GetDirectory)
        self.wheels.setEnabled(False)
        self.from_index.toggled.connect(self.package.setEnabled)
        self.from_folder.toggled.connect(self.wheels.setEnabled)
        self.create_button = button("furrowmapCreate", tr("Create environment…"), self.ask_and_create)
        self.remove_button = button("furrowmapRemove", tr("Delete"), self.remove)
        self.stop_button = button("furrowmapStop", tr("Cancel"), self.stop)
        self.stop_button.setEnabled(False)
        row = side_by_side(self.create_button, self.remove_button, self.stop_button)
        row.layout().addStretch(1)
        for widget in (self.from_index, self.package, self.from_folder, self.wheels, row):
            layout.addWidget(widget)
        return group

    def apply(self) -> None:
        """Store the setting; QGIS calls this on OK."""
        path = self.chosen.filePath().strip()
        if path:
            QgsSettings().setValue(CHOSEN_KEY, path)
        else:
            QgsSettings().remove(CHOSEN_KEY)

    def refresh(self) -> None:
        """Show the furrowmap in use and the state of the plugin's own environment."""
        found = find_interpreter()
        program = found.program[0] if found else tr("None")
        self.used.setText(f"{program}\n{why(found)}")
        folder = environment_folder()
        there = python_in(folder).is_file()
        text = tr("Created in {folder}") if there else tr("Not created. Folder: {folder}")
        self.own.setText(text.format(folder=folder))
        self.remove_button.setEnabled(there)

    def check(self) -> None:
        """Start the furrowmap that is chosen or found, and show its versions or the error."""
        path = self.chosen.filePath().strip()
        found = find_interpreter()
        program = command_of(Path(path)) if path else (found.program if found else None)
        if program is None:
            self.log.setPlainText(why(None))
            return

        def work(_on_line: Callable[[str], None], is_cancelled: Callable[[], bool]) -> str:
            versions = check(program, lambda _line: None, is_cancelled)  # the log gets only the versions
            rows = [f"{name} {version}" for name, version in versions.items()]
            return "\n".join([tr("It works: {program}").format(program=" ".join(program)), *rows])

        self._start(tr("Testing furrowmap"), work)

    def ask_and_create(self) -> None:
        """Create the environment if the user agrees."""
        buttons = QMessageBox.StandardButton
        question = tr(
            "Create a Python environment for furrowmap in {folder}? It takes 920 MB. QGIS's Python is not changed."
        ).format(folder=environment_folder())
        if QMessageBox.question(self, "furrowmap", question, buttons.Yes | buttons.No) == buttons.Yes:
            self.create()

    def create(self) -> None:
        """Create the environment, in the background."""
        source = (self.wheels if self.from_folder.isChecked() else self.package).filePath().strip()
        if not source:
            self.log.setPlainText(tr("Choose where furrowmap is to be installed from."))
            return

        def work(on_line: Callable[[str], None], is_cancelled: Callable[[], bool]) -> str:
            versions = create_environment(source, on_line, is_cancelled)
            return tr("The environment is ready: furrowmap {version}.").format(version=versions["furrowmap"])

        self._start(tr("Creating furrowmap's environment"), work)

    def remove(self) -> None:
        """Delete the environment, in the background."""

        def work(_on_line: object, _is_cancelled: object) -> str:
            remove_environment()
            return tr("The environment was deleted.")

        self._start(tr("Deleting furrowmap's environment"), work)

    def stop(self) -> None:
        """Cancel the running task."""
        if OptionsPage.task is not None:
            OptionsPage.task.cancel()

    def _start(self, title: str, work: Callable[..., str]) -> None:
        if OptionsPage.task is not None:
            return
        self.log.clear()
        task = OptionsPage.task = BackgroundTask(title, work)
        task.done.connect(_forget)
        self._follow(task)
        QgsApplication.taskManager().addTask(task)

    def _follow(self, task: BackgroundTask) -> None:
        self._set_busy(busy=True)
        task.line.connect(self.log.appendPlainText)
        task.done.connect(self._show_end)

    def _show_end(self, _succeeded: bool, text: str) -> None:
        self.log.appendPlainText(text)
        self._set_busy(busy=False)
        self.refresh()

    def _set_busy(self, *, busy: bool) -> None:
        self.check_button.setEnabled(not busy)
        self.create_button.setEnabled(not busy)
        self.remove_button.setEnabled(not busy and python_in(environment_folder()).is_file())
        self.stop_button.setEnabled(busy)


def _forget(_succeeded: bool, _text: str) -> None:
    OptionsPage.task = None
