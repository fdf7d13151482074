# SPDX-License-Identifier: GPL-2.0-or-later
"""Which furrowmap does the work.

The one the user chose, else the one that installed this plugin, else one that the plugin made, else one on the search
path.
"""

import json
import os
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

from qgis.core import QgsApplication, QgsSettings
from qgis.PyQt.QtCore import QCoreApplication, QStandardPaths

CHOSEN_KEY = "furrowmap/interpreter"
"""Setting: a Python interpreter with furrowmap, the folder of its environment, or the furrowmap command itself."""
INSTALLED_BY = "installed_by.json"
"""In this folder, by `furrowmap qgis install`: the Python interpreter which that ran in."""


@dataclass(frozen=True)
class Interpreter:
    """A way to start furrowmap.

    Attributes:
        program: the words of the command.
        origin: "chosen", "installed", "made" or "found".
    """

    program: tuple
    origin: str


def find_interpreter():
    """The one to use; None where there is none."""
    chosen = QgsSettings().value(CHOSEN_KEY, "", str)
    if chosen:
        return Interpreter(command_of(Path(chosen)), "chosen")
    installed = installing_python()
    if installed is not None:
        return Interpreter(command_of(installed), "installed")
    if python_in(environment_folder()).is_file():
        return Interpreter(command_of(environment_folder()), "made")
    found = shutil.which("furrowmap")
    return Interpreter((found,), "found") if found else None


def why(interpreter):
    """Why this one is used, for the user."""
    if interpreter is None:
        return tr("None was found. Results of others can be opened; to compute your own, choose or make one.")
    return {
        "chosen": tr("Chosen below."),
        "installed": tr("It installed this plugin by 'furrowmap qgis install'."),
        "made": tr("This plugin made it."),
        "found": tr("Found on the search path for programs."),
    }[interpreter.origin]


def installing_python():
    """The interpreter whose `furrowmap qgis install` put this plugin here; None if that is gone or was not the way."""
    try:
        python = json.loads(Path(__file__).with_name(INSTALLED_BY).read_text(encoding="utf-8"))["python"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return Path(python) if isinstance(python, str) and Path(python).is_file() else None


def command_of(path):
    """How to start furrowmap by a path that is a Python interpreter, an environment's folder, or the command itself."""
    if path.is_dir():
        path = python_in(path)
    if path.stem.lower().startswith("python"):
        return (str(path), "-I", "-m", "furrowmap")
    return (str(path),)


def environment_folder():
    """Where the plugin makes its own environment: per user, beside QGIS's profiles, never in QGIS's Python."""
    data = QStandardPaths.writableLocation(QStandardPaths.StandardLocation.GenericDataLocation)
    return Path(data or QgsApplication.qgisSettingsDirPath()) / "furrowmap" / "environment"


def python_in(folder):
    """The interpreter of an environment, which stays right when the folder is renamed; its commands do not."""
    return folder / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")


def log_folder():
    """Where logs of runs are kept."""
    return Path(QgsApplication.qgisSettingsDirPath()) / "furrowmap" / "logs"


def is_usable(interpreter):
    """Whether its file is there and may be started."""
    return interpreter is not None and os.access(interpreter.program[0], os.X_OK)


def tr(text):
    """`text` in the user's language."""
    return QCoreApplication.translate("Interpreter", text)
