# SPDX-License-Identifier: GPL-2.0-or-later
"""Which furrowmap runs as the worker.

The one that the user chose, else the one that installed this plugin, else the one that the plugin created, else one on
the PATH.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from qgis.core import QgsApplication, QgsSettings
from qgis.PyQt.QtCore import QCoreApplication, QStandardPaths

from .platforms import program_on_path, python_in

tr = partial(QCoreApplication.translate, "Interpreter")

CHOSEN_KEY = "furrowmap/interpreter"
"""Setting: a Python interpreter with furrowmap, the folder of its environment, or the furrowmap command itself."""
INSTALLED_BY = "installed_by.json"
"""File in this folder, written by `furrowmap qgis install`: the Python interpreter that ran it."""


@dataclass(frozen=True)
class Interpreter:
    """The words that start furrowmap, whose origin is "chosen", "installed", "created" or "found"."""

    program: tuple[str, ...]
    origin: str


def find_interpreter() -> Interpreter | None:
    """The furrowmap to use; None if there is none."""
    chosen = QgsSettings().value(CHOSEN_KEY, "", str)
    if chosen:
        return Interpreter(command_of(Path(chosen)), "chosen")
    installed = installing_python()
    if installed is not None:
        return Interpreter(command_of(installed), "installed")
    if python_in(environment_folder()).is_file():
        return Interpreter(command_of(environment_folder()), "created")
    found = program_on_path("furrowmap")
    return Interpreter((found,), "found") if found else None


def why(interpreter: Interpreter | None) -> str:
    """Why this furrowmap is used, for the user."""
    if interpreter is None:
        return tr("None found. Existing results can be opened; to run sessions, choose or create one.")
    return {
        "chosen": tr("Chosen below."),
        "installed": tr("It installed this plugin with 'furrowmap qgis install'."),
        "created": tr("Created by this plugin."),
        "found": tr("Found on the PATH."),
    }[interpreter.origin]


def installing_python() -> Path | None:
    """The interpreter whose `furrowmap qgis install` installed this plugin; None if none did or it is gone."""
    try:
        python = json.loads(Path(__file__).with_name(INSTALLED_BY).read_text(encoding="utf-8"))["python"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return Path(python) if isinstance(python, str) and Path(python).is_file() else None


def command_of(path: Path) -> tuple[str, ...]:
    """The command for a path that is a Python interpreter, an environment's folder, or the furrowmap command."""
    if path.is_dir():
        path = python_in(path)
    if path.stem.lower().startswith("python"):
        return (str(path), "-I", "-m", "furrowmap")
    return (str(path),)


def environment_folder() -> Path:
    """Folder of the plugin's own environment: per user, beside QGIS's profiles, never in QGIS's Python."""
    data = QStandardPaths.writableLocation(QStandardPaths.StandardLocation.GenericDataLocation)
    return Path(data or QgsApplication.qgisSettingsDirPath()) / "furrowmap" / "environment"


def is_usable(interpreter: Interpreter | None) -> bool:
    """Whether its file exists and may be executed."""
    return interpreter is not None and os.access(interpreter.program[0], os.X_OK)
