# SPDX-License-Identifier: GPL-2.0-or-later
"""Which furrowmap does the work: the one the user chose, else one the plugin made, else one on the search path."""

import os
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

from qgis.core import QgsApplication, QgsSettings
from qgis.PyQt.QtCore import QStandardPaths

CHOSEN_KEY = "furrowmap/interpreter"
"""Setting: a Python interpreter with furrowmap, or the furrowmap command itself."""


@dataclass(frozen=True)
class Interpreter:
    """A way to start furrowmap.

    Attributes:
        program: the words of the command.
        origin: "chosen", "made" or "found".
    """

    program: tuple
    origin: str


def find_interpreter():
    """The one to use; None where there is none."""
    chosen = QgsSettings().value(CHOSEN_KEY, "", str)
    if chosen:
        return Interpreter(command_of(Path(chosen)), "chosen")
    made = executable_in(environment_folder())
    if made.is_file():
        return Interpreter((str(made),), "made")
    found = shutil.which("furrowmap")
    return Interpreter((found,), "found") if found else None


def command_of(path):
    """How to start furrowmap by a path that is a Python interpreter, an environment's folder, or the command itself."""
    if path.is_dir():
        return (str(executable_in(path)),)
    if path.stem.lower().startswith("python"):
        return (str(path), "-I", "-m", "furrowmap.cli")
    return (str(path),)


def environment_folder():
    """Where the plugin makes its own environment: per user, beside QGIS's profiles, never in QGIS's Python."""
    data = QStandardPaths.writableLocation(QStandardPaths.StandardLocation.GenericDataLocation)
    return Path(data or QgsApplication.qgisSettingsDirPath()) / "furrowmap" / "environment"


def executable_in(folder):
    """The command `furrowmap` of an environment."""
    return folder / ("Scripts/furrowmap.exe" if sys.platform == "win32" else "bin/furrowmap")


def log_folder():
    """Where logs of runs are kept."""
    return Path(QgsApplication.qgisSettingsDirPath()) / "furrowmap" / "logs"


def is_usable(interpreter):
    """Whether its file is there and may be started."""
    return interpreter is not None and os.access(interpreter.program[0], os.X_OK)
