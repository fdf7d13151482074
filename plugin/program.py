# SPDX-License-Identifier: GPL-2.0-or-later
"""Runs a program outside QGIS to its end, without QGIS's environment variables. Blocks: call it in a task's thread."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from qgis.core import QgsApplication
from qgis.PyQt import sip
from qgis.PyQt.QtCore import QIODevice, QProcess, QProcessEnvironment

from .platforms import own_prefix, worker_environment
from .translation import translation_file


class ProgramError(Exception):
    """A program could not be started, failed with lines of output, or was cancelled by the user."""

    def __init__(self, text: str, output: Iterable[str] = (), *, cancelled: bool = False) -> None:
        super().__init__(text)
        self.output = tuple(output)
        self.cancelled = cancelled


def process_environment() -> QProcessEnvironment:
    """The environment variables for a program outside QGIS."""
    environment = QProcessEnvironment()
    for name, value in worker_environment(os.environ, own_prefix(Path(QgsApplication.prefixPath()))).items():
        environment.insert(name, value)
    language = (QgsApplication.locale() or "")[:2]
    environment.insert("FURROWMAP_LANG", language if translation_file(language).is_file() else "en")
    return environment


def run_program(words: Sequence[str], on_line: Callable[[str], None], is_cancelled: Callable[[], bool]) -> str:
    """Run a program, words unquoted; its standard output. Raises ProgramError with the last line of its output.

    `is_cancelled` is asked ten times a second.
    """
    process = QProcess()
    process.setProcessEnvironment(process_environment())
    try:
        return _answer_of(process, words, on_line, is_cancelled)
    finally:
        if process.state() != QProcess.ProcessState.NotRunning:
            process.kill()
            process.waitForFinished(2000)
        sip.delete(process)  # in this thread: what an error refers to may be collected in another one, and crash QGIS


def _answer_of(
    process: QProcess, words: Sequence[str], on_line: Callable[[str], None], is_cancelled: Callable[[], bool]
) -> str:
    process.start(words[0], list(words[1:]), QIODevice.OpenModeFlag.ReadOnly)
    if not process.waitForStarted(10_000):
        raise ProgramError(f"{words[0]}: {process.errorString()}")
    process.closeWriteChannel()  # a program that asks a question gets the end of its input
    answer = ""
    lines = []
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
    if process.exitStatus() != QProcess.ExitStatus.NormalExit or process.exitCode() != 0:
        last = next((line.strip() for line in reversed(lines) if line.strip()), "")
        raise ProgramError(last or f"{words[0]}: {process.exitCode()}", lines)
    return answer
