# SPDX-License-Identifier: GPL-2.0-or-later
"""Settings › Options › furrowmap: which furrowmap does the work and why, whether it works, and how to get one."""

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
    QPushButton,
    QRadioButton,
    QVBoxLayout,
)

from .interpreter import CHOSEN_KEY, command_of, environment_folder, find_interpreter, python_in, why
from .making import MakingError, check, make_environment, remove_environment
from .program import ProgramError
from .worker import WorkerError

PAGE = "furrowmap"
"""By this name others open it."""
ICON = str(Path(__file__).with_name("icon.svg"))


class OptionsFactory(QgsOptionsWidgetFactory):
    """Makes the page when QGIS opens its options."""

    def __init__(self):
        super().__init__(PAGE, QIcon(ICON))
        self.setKey(PAGE)

    def createWidget(self, parent):  # noqa: N802 - the name is QGIS's
        """The page."""
        return OptionsPage(parent)

    def end(self):
        """Before the plugin goes: what is under way is stopped."""
        if OptionsPage.deed is not None:
            OptionsPage.deed.cancel()
            OptionsPage.deed.waitForFinished(8000)


class Deed(QgsTask):
    """Something that may take long, done in the background, told line by line."""

    line = pyqtSignal(str)
    done = pyqtSignal(bool, str)

    def __init__(self, title, work):
        super().__init__(title, QgsTask.Flag.CanCancel)
        self.work = work  # takes what hears a line and what says whether to stop; gives the last line
        self.last = ""

    def run(self):
        """Do it, in a thread of QGIS's."""
        try:
            self.last = self.work(self.line.emit, self.isCanceled)
        except (MakingError, WorkerError) as error:
            self.last = str(error)
            return False
        except ProgramError as error:
            self.last = tr("Stopped; nothing is left of it.") if error.cancelled else str(error)
            return False
        except OSError as error:
            self.last = f"{error.filename}: {error.strerror}"
            return False
        return True

    def finished(self, result):
        """Tell how it ended, in the main thread."""
        self.done.emit(bool(result), self.last)


class OptionsPage(QgsOptionsPageWidget):
    """The page; what it starts goes on if it is closed."""

    deed = None  # of all pages: one at a time

    def __init__(self, parent):
        super().__init__(parent)
        self.setObjectName(PAGE)
        layout = QVBoxLayout(self)
        layout.addWidget(self._used())
        layout.addWidget(self._own())
        self.log = QPlainTextEdit(readOnly=True, objectName="furrowmapLog")
        layout.addWidget(self.log, 1)
        self.refresh()
        if OptionsPage.deed is not None:
            self._follow(OptionsPage.deed)

    def _used(self):
        group = QGroupBox(tr("furrowmap that does the work"))
        layout = QVBoxLayout(group)
        self.used = QLabel(wordWrap=True, objectName="furrowmapUsed")
        layout.addWidget(self.used)
        layout.addWidget(QLabel(tr("Another one (a Python interpreter with furrowmap, or the command itself):")))
        self.chosen = QgsFileWidget(objectName="furrowmapChosen")
        self.chosen.setFilePath(QgsSettings().value(CHOSEN_KEY, "", str))
        self.chosen.lineEdit().setPlaceholderText(tr("Found by itself"))
        self.check_button = QPushButton(tr("Check"), objectName="furrowmapCheck")
        self.check_button.clicked.connect(self.check)
        row = QHBoxLayout()
        row.addWidget(self.chosen, 1)
        row.addWidget(self.check_button)
        layout.addLayout(row)
        return group

    def _own(self):
        group = QGroupBox(tr("An environment of its own"))
        layout = QVBoxLayout(group)
        self.own = QLabel(wordWrap=True)
        layout.addWidget(self.own)
        self.from_index = QRadioButton(
            tr("From the package index (network: about 240 MB; 920 MB on the disk)"), checked=True
        )
        self.from_folder = QRadioButton(tr("From a folder of wheels (no network; 920 MB on the disk)"))
        self.wheels = QgsFileWidget(objectName="furrowmapWheels")
        self.wheels.setStorageMode(QgsFileWidget.StorageMode.GetDirectory)
        self.wheels.setEnabled(False)
        self.from_folder.toggled.connect(self.wheels.setEnabled)
        for widget in (self.from_index, self.from_folder, self.wheels):
            layout.addWidget(widget)
        self.make_button = QPushButton(tr("Make environment…"), objectName="furrowmapMake")
        self.make_button.clicked.connect(self.ask_and_make)
        self.remove_button = QPushButton(tr("Remove it"), objectName="furrowmapRemove")
        self.remove_button.clicked.connect(self.remove)
        self.stop_button = QPushButton(tr("Stop"), objectName="furrowmapStop", enabled=False)
        self.stop_button.clicked.connect(self.stop)
        row = QHBoxLayout()
        for button in (self.make_button, self.remove_button, self.stop_button):
            row.addWidget(button)
        row.addStretch(1)
        layout.addLayout(row)
        return group

    def apply(self):
        """Keep what was chosen; QGIS calls it on OK."""
        path = self.chosen.filePath().strip()
        if path:
            QgsSettings().setValue(CHOSEN_KEY, path)
        else:
            QgsSettings().remove(CHOSEN_KEY)

    def refresh(self):
        """Show which furrowmap is used, and whether the plugin's own environment is there."""
        found = find_interpreter()
        program = found.program[0] if found else tr("None")
        self.used.setText(f"{program}\n{why(found)}")
        folder = environment_folder()
        there = python_in(folder).is_file()
        self.own.setText(
            (tr("It is there: {folder}") if there else tr("Not made yet. It would get: {folder}")).format(folder=folder)
        )
        self.remove_button.setEnabled(there)

    def check(self):
        """Start what is chosen, or found, and show its versions or what is wrong."""
        path = self.chosen.filePath().strip()
        found = find_interpreter()
        program = command_of(Path(path)) if path else (found.program if found else None)
        if program is None:
            self.log.setPlainText(why(None))
            return

        def work(_on_line, is_cancelled):
            versions = check(program, _ignore, is_cancelled)
            told = "\n".join(f"{name} {version}" for name, version in versions.items())
            return "\n".join([tr("It works: {program}").format(program=" ".join(program)), told])

        self._start(tr("Checking furrowmap"), work)

    def ask_and_make(self):
        """Make the environment if the user agrees."""
        buttons = QMessageBox.StandardButton
        question = tr(
            "A Python environment for furrowmap will be made in {folder}. QGIS's own Python stays as it is. Go on?"
        ).format(folder=environment_folder())
        if QMessageBox.question(self, "furrowmap", question, buttons.Yes | buttons.No) == buttons.Yes:
            self.make()

    def make(self):
        """Make it, in the background."""
        wheels = self.wheels.filePath().strip() if self.from_folder.isChecked() else None
        if wheels is not None and not Path(wheels).is_dir():
            self.log.setPlainText(tr("Choose the folder that holds the wheels."))
            return

        def work(on_line, is_cancelled):
            versions = make_environment(wheels, on_line, is_cancelled)
            return tr("The environment is ready: furrowmap {version}.").format(version=versions["furrowmap"])

        self._start(tr("Making furrowmap's environment"), work)

    def remove(self):
        """Remove it, in the background."""

        def work(_on_line, _is_cancelled):
            remove_environment()
            return tr("The environment was removed.")

        self._start(tr("Removing furrowmap's environment"), work)

    def stop(self):
        """Stop what is under way."""
        if OptionsPage.deed is not None:
            OptionsPage.deed.cancel()

    def _start(self, title, work):
        if OptionsPage.deed is not None:
            return
        self.log.clear()
        OptionsPage.deed = Deed(title, work)
        OptionsPage.deed.done.connect(_forget)
        self._follow(OptionsPage.deed)
        QgsApplication.taskManager().addTask(OptionsPage.deed)

    def _follow(self, deed):
        self._set_busy(busy=True)
        deed.line.connect(self.log.appendPlainText)
        deed.done.connect(self._tell_end)

    def _tell_end(self, _well, text):
        self.log.appendPlainText(text)
        self._set_busy(busy=False)
        self.refresh()

    def _set_busy(self, *, busy):
        for button in (self.check_button, self.make_button):
            button.setEnabled(not busy)
        self.remove_button.setEnabled(not busy and python_in(environment_folder()).is_file())
        self.stop_button.setEnabled(busy)


def _forget(_well, _text):
    OptionsPage.deed = None


def _ignore(line):
    """The versions are shown by themselves."""


def tr(text):
    """`text` in the user's language."""
    return QCoreApplication.translate("Options", text)
