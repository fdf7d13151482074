# SPDX-License-Identifier: GPL-2.0-or-later
"""Runs a program outside QGIS to its end, without QGIS's environment variables. Blocks: call it in a task's thread."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from qgis.core import QgsApplication
from qgis.PyQt.QtCore import QIODevice, QProcess, QProcessEnvironment

# Each of these breaks another interpreter, GDAL or PROJ.
REMOVED_VARIABLES = (
    *("PYTHONHOME", "PYTHONPATH", "PYTHONEXECUTABLE", "PYTHONSTARTUP", "PYTHONNOUSERSITE"),
    *("GDAL_DATA", "GDAL_DRIVER_PATH", "PROJ_DATA", "PROJ_LIB", "QT_PLUGIN_PATH", "QT_QPA_PLATFORM_PLUGIN_PATH"),
)
SEARCH_PATHS = ("PATH", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "DYLD_FRAMEWORK_PATH")
"""Variables from which QGIS's own folders are removed."""


class ProgramError(Exception):
    """A program could not be started, failed, or was cancelled.

    Attributes:
        output: the lines of its standard error and output.
        cancelled: whether the user cancelled it.
    """

    def __init__(self, text: str, output: Iterable[str] = (), *, cancelled: bool = False) -> None:
        super().__init__(text)
        self.output = tuple(output)
        self.cancelled = cancelled


def process_environment() -> QProcessEnvironment:
    """The environment variables for a program outside QGIS."""
    environment = QProcessEnvironment()
    for name, value in worker_environment(os.environ, own_prefix(QgsApplication.prefixPath())).items():
        environment.insert(name, value)
    environment.insert("FURROWMAP_LANG", "ja" if (QgsApplication.locale() or "").startswith("ja") else "en")
    return environment


def worker_environment(variables: Mapping[str, str], prefix: Path | None) -> dict[str, str]:
    """The variables for the worker: the user's, without what QGIS has set for itself.

    Args:
        variables: those of QGIS's process.
        prefix: folder in which QGIS is installed; its folders are removed from the search paths. None for a QGIS of the
            system, which shares its folders.
    """
    kept = {name: value for name, value in variables.items() if name.upper() not in REMOVED_VARIABLES}
    for name in SEARCH_PATHS:
        if name in kept and prefix is not None:
            folders = kept[name].split(os.pathsep)
            kept[name] = os.pathsep.join(folder for folder in folders if folder and not _is_within(folder, prefix))
    return {**kept, "PYTHONUTF8": "1", "PYTHONUNBUFFERED": "1"}


def own_prefix(application_prefix: str, platform: str = sys.platform) -> Path | None:
    """The folder that only QGIS uses: of an installer or a bundle; None where it is part of the system.

    Args:
        application_prefix: `QgsApplication.prefixPath()`.
        platform: as `sys.platform`.
    """
    prefix = Path(application_prefix)
    if platform == "win32":  # C:/Program Files/QGIS 3.40/apps/qgis: the libraries are in the folder above
        return prefix.parents[1] if prefix.parent.name.lower() == "apps" else prefix
    if platform == "darwin":
        return next((folder for folder in (prefix, *prefix.parents) if folder.suffix == ".app"), prefix)
    return None if prefix in (Path("/usr"), Path("/usr/local")) else prefix


def _is_within(folder: str, prefix: Path) -> bool:
    try:
        return Path(folder).resolve().is_relative_to(prefix.resolve())
    except OSError:
        return False


def run_program(words: Sequence[str], on_line: Callable[[str], None], is_cancelled: Callable[[], bool]) -> str:
    """Run a program.

    Args:
        words: program and arguments, which need no quoting.
        on_line: is called with each line of its standard error and output.
        is_cancelled: is asked ten times a second.

    Returns:
        Its standard output.

    Raises:
        ProgramError: with the last line of its output.
    """
    process = QProcess()
    process.setProcessEnvironment(process_environment())
    process.start(words[0], list(words[1:]), QIODevice.OpenModeFlag.ReadOnly)
    if not process.waitForStarted(10_000):
        raise ProgramError(f"{words[0]}: {process.errorString()}")
    process.closeWriteChannel()  # a program that asks a question gets the end of its input
    answer, lines = "", []
    try:
        running = True
        while running:
            running = not process.waitForFinished(100) and process.state() != QProcess.ProcessState.NotRunning
            errors = bytes(process.readAllStandardError()).decode("utf-8", "replace")
            output = bytes(process.readAllStandardOutput()).decode("utf-8", "replace")
            answer += output
            for line in (errors + output).splitlines():
                lines.append(line)
                on_line(line)
            if is_cancelled():
                raise ProgramError(words[0], cancelled=True)
    finally:
        if process.state() != QProcess.ProcessState.NotRunning:
            process.kill()
            process.waitForFinished(2000)
    if process.exitStatus() != QProcess.ExitStatus.NormalExit or process.exitCode() != 0:
        last = next((line.strip() for line in reversed(lines) if line.strip()), "")
        raise ProgramError(last or f"{words[0]}: {process.exitCode()}", lines)
    return answer
