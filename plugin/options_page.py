# SPDX-License-Identifier: GPL-2.0-or-later
"""Settings › Options › furrowmap: the furrowmap in use, a test of it, and an environment of the plugin's own."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import ClassVar

from qgis.core import QgsApplication, QgsSettings, QgsTask
from qgis.gui import QgsFileWidget, QgsOptionsPageWidget, QgsOptionsWidgetFactory
from qgis.PyQt.QtCore import QCoreApplication, QTimer, pyqtSignal
from qgis.PyQt.QtGui import QIcon
from qgis.PyQt.QtWidgets import (
    QComboBox,
    QGroupBox,
    QHBoxLayout,
    QLabel,
    QMessageBox,
    QPlainTextEdit,
    QProgressBar,
    QRadioButton,
    QVBoxLayout,
    QWidget,
)

from .dock.form_parts import button, side_by_side
from .dock_words import extra_words
from .installer import InstallError, check, create_environment, install_extra, remove_environment, size_of
from .interpreter import CHOSEN_KEY, command_of, environment_folder, find_interpreter, why
from .platforms import python_in
from .program import ProgramError
from .worker import WorkerError

tr = partial(QCoreApplication.translate, "Options")

PAGE = "furrowmap"
"""The page's name, by which QGIS opens it."""
SIZE_KEY = "furrowmap/environmentSize"
"""Setting: MB that the environment takes on the disk, as measured after it was created."""
EXTRA_KEY = "furrowmap/extra"
"""Setting: the extra that was missing last."""
DISK_MB = 920
"""What an environment takes, before it is measured."""


class OptionsFactory(QgsOptionsWidgetFactory):
    """Makes the page when QGIS opens its options."""

    def __init__(self) -> None:
        super().__init__(PAGE, QIcon(str(Path(__file__).with_name("icon.svg"))))
        self.setKey(PAGE)

    def createWidget(self, parent: QWidget) -> OptionsPage:  # noqa: N802 - the name is QGIS's
        """The page."""
        return OptionsPage(parent)

    def forget_dock(self) -> None:
        """The dock goes."""
        OptionsPage.is_working = staticmethod(lambda: False)

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
    lines: ClassVar[list[str]] = []  # of the log, which outlives the window
    begun_s = 0.0
    is_working: ClassVar[Callable[[], bool]] = staticmethod(lambda: False)  # whether the dock's worker runs

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setObjectName(PAGE)
        layout = QVBoxLayout(self)
        layout.addWidget(self._used_group())
        layout.addWidget(self._own_group())
        layout.addWidget(self._extras_group())
        self.bar = QProgressBar(objectName="furrowmapOptionsBar", minimum=0, maximum=0, textVisible=False)
        self.elapsed = QLabel()
        self.progress = side_by_side(self.bar, self.elapsed)
        self.progress.hide()
        layout.addWidget(self.progress)
        self.log = QPlainTextEdit(readOnly=True, objectName="furrowmapLog")
        self.log.setPlainText("\n".join(OptionsPage.lines))
        layout.addWidget(self.log, 1)
        self._timer = QTimer(self, interval=1000)
        self._timer.timeout.connect(self._show_time)
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
        self.remove_button = button("furrowmapRemove", tr("Delete…"), self.ask_and_remove)
        self.stop_button = button("furrowmapStop", tr("Cancel"), self.stop)
        self.stop_button.setEnabled(False)
        row = side_by_side(self.create_button, self.remove_button, self.stop_button)
        row.layout().addStretch(1)
        for widget in (self.from_index, self.package, self.from_folder, self.wheels, row):
            layout.addWidget(widget)
        return group

    def _extras_group(self) -> QGroupBox:
        group = QGroupBox(tr("Further parts of furrowmap"))
        self.extra = QComboBox(objectName="furrowmapExtra")
        for name, label in extra_words().items():
            self.extra.addItem(label, name)
        self.extra.setCurrentIndex(max(self.extra.findData(QgsSettings().value(EXTRA_KEY, "", str)), 0))
        self.extra_button = button("furrowmapInstallExtra", tr("Install"), self.install_extra)
        row = QHBoxLayout(group)
        row.addWidget(self.extra, 1)
        row.addWidget(self.extra_button)
        return group

    def install_extra(self) -> None:
        """Install the packages of an extra into the environment of the furrowmap in use, in the background."""
        found = find_interpreter()
        if found is None:
            self._show(why(None))
            return
        name = self.extra.currentData()

        def work(on_line: Callable[[str], None], is_cancelled: Callable[[], bool]) -> str:
            packages = install_extra(found.program, name, on_line, is_cancelled)
            return tr("Installed: {packages}.").format(packages=", ".join(packages))

        self._start(tr("Installing packages"), work)

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
        size_mb = QgsSettings().value(SIZE_KEY, 0, int)
        text = tr("Not created. Folder: {folder}")
        if there:
            text = tr("Created in {folder} ({size} MB)") if size_mb else tr("Created in {folder}")
        self.own.setText(text.format(folder=folder, size=size_mb))
        self.remove_button.setEnabled(there)

    def check(self) -> None:
        """Start the furrowmap that is chosen or found, and show its versions or the error."""
        path = self.chosen.filePath().strip()
        found = find_interpreter()
        program = command_of(Path(path)) if path else (found.program if found else None)
        if program is None:
            self._show(why(None))
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
            "Create a Python environment for furrowmap in {folder}? It takes {size} MB on the disk. "
            "QGIS's Python is not changed."
        ).format(folder=environment_folder(), size=QgsSettings().value(SIZE_KEY, DISK_MB, int))
        if QMessageBox.question(self, "furrowmap", question, buttons.Yes | buttons.No) == buttons.Yes:
            self.create()

    def create(self) -> None:
        """Create the environment, in the background."""
        source = (self.wheels if self.from_folder.isChecked() else self.package).filePath().strip()
        if not source:
            self._show(tr("Choose where furrowmap is to be installed from."))
            return

        def work(on_line: Callable[[str], None], is_cancelled: Callable[[], bool]) -> str:
            versions = create_environment(source, on_line, is_cancelled)
            QgsSettings().setValue(SIZE_KEY, round(size_of(environment_folder()) / 1e6))
            return tr("The environment is ready: furrowmap {version}.").format(version=versions["furrowmap"])

        self._start(tr("Creating furrowmap's environment"), work)

    def ask_and_remove(self) -> None:
        """Delete the environment if the user agrees."""
        buttons = QMessageBox.StandardButton
        question = tr("Delete furrowmap's environment in {folder}? Sessions cannot be run without it.").format(
            folder=environment_folder()
        )
        if QMessageBox.question(self, "furrowmap", question, buttons.Yes | buttons.No) == buttons.Yes:
            self.remove()

    def remove(self) -> None:
        """Delete the environment, in the background."""

        def work(_on_line: object, _is_cancelled: object) -> str:
            remove_environment()
            QgsSettings().remove(SIZE_KEY)
            return tr("The environment was deleted.")

        self._start(tr("Deleting furrowmap's environment"), work)

    def stop(self) -> None:
        """Cancel the running task."""
        if OptionsPage.task is not None:
            OptionsPage.task.cancel()

    def _start(self, title: str, work: Callable[..., str]) -> None:
        if OptionsPage.task is not None:
            return
        if OptionsPage.is_working():
            self._show(tr("A task of furrowmap is running. Wait for its end, or cancel it."))
            return
        OptionsPage.lines.clear()
        self.log.clear()
        OptionsPage.begun_s = time.monotonic()
        task = OptionsPage.task = BackgroundTask(title, work)
        task.line.connect(OptionsPage.lines.append)
        task.done.connect(_forget)
        self._follow(task)
        QgsApplication.taskManager().addTask(task)

    def _follow(self, task: BackgroundTask) -> None:
        self._set_busy(busy=True)
        task.line.connect(self.log.appendPlainText)
        task.done.connect(self._show_end)

    def _show(self, text: str) -> None:
        OptionsPage.lines[:] = [text]
        self.log.setPlainText(text)

    def _show_time(self) -> None:
        minutes, seconds = divmod(int(time.monotonic() - OptionsPage.begun_s), 60)
        self.elapsed.setText(f"{minutes}:{seconds:02d}")

    def _show_end(self, _succeeded: bool, text: str) -> None:
        self.log.appendPlainText(text)
        self._set_busy(busy=False)
        self.refresh()

    def _set_busy(self, *, busy: bool) -> None:
        self.progress.setVisible(busy)
        self._show_time()
        if busy:
            self._timer.start()
        else:
            self._timer.stop()
        self.check_button.setEnabled(not busy)
        self.extra_button.setEnabled(not busy)
        self.create_button.setEnabled(not busy)
        self.remove_button.setEnabled(not busy and python_in(environment_folder()).is_file())
        self.stop_button.setEnabled(busy)


def _forget(_succeeded: bool, text: str) -> None:
    OptionsPage.lines.append(text)
    OptionsPage.task = None
