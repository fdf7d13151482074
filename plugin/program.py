# SPDX-License-Identifier: GPL-2.0-or-later
"""Runs another program to its end, in the user's environment instead of QGIS's; blocks, so for a task's thread."""

import os

from qgis.core import QgsApplication
from qgis.PyQt.QtCore import QIODevice, QProcess, QProcessEnvironment

from .environment import own_prefix, worker_environment

_POLL_MS = 100
_START_MS = 10_000
_END_MS = 2000


class ProgramError(Exception):
    """A program could not be started, ended badly, or was stopped.

    Attributes:
        cancelled: whether the user stopped it.
    """

    def __init__(self, text, *, cancelled=False):
        super().__init__(text)
        self.cancelled = cancelled


def process_environment():
    """What a program outside QGIS gets as its environment."""
    environment = QProcessEnvironment()
    for name, value in worker_environment(dict(os.environ), own_prefix(QgsApplication.prefixPath())).items():
        environment.insert(name, value)
    return environment


def run_program(words, on_line, is_cancelled):
    """Run a program.

    Args:
        words: program and arguments, which need no quoting.
        on_line: is called with each line of its standard error and output.
        is_cancelled: is asked ten times a second.

    Returns:
        Its standard output.

    Raises:
        ProgramError: with its last words.
    """
    process = QProcess()
    process.setProcessEnvironment(process_environment())
    process.start(words[0], list(words[1:]), QIODevice.OpenModeFlag.ReadOnly)
    if not process.waitForStarted(_START_MS):
        raise ProgramError(f"{words[0]}: {process.errorString()}")
    process.closeWriteChannel()  # who asks gets no answer, instead of waiting for one
    told, last = [], ""
    try:
        running = True
        while running:
            running = not process.waitForFinished(_POLL_MS) and process.state() != QProcess.ProcessState.NotRunning
            errors = bytes(process.readAllStandardError()).decode("utf-8", "replace")
            told.append(bytes(process.readAllStandardOutput()).decode("utf-8", "replace"))
            for line in (errors + told[-1]).splitlines():
                last = line.strip() or last
                on_line(line)
            if is_cancelled():
                raise ProgramError(words[0], cancelled=True)
    finally:
        if process.state() != QProcess.ProcessState.NotRunning:
            process.kill()
            process.waitForFinished(_END_MS)
    if process.exitStatus() != QProcess.ExitStatus.NormalExit or process.exitCode() != 0:
        raise ProgramError(last or f"{words[0]}: {process.exitCode()}")
    return "".join(told)
