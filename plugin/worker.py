# SPDX-License-Identifier: GPL-2.0-or-later
"""Runs one command in `furrowmap worker`, a process that talks in lines of JSON, and always ends that process.

The protocol is described in furrowmap's documentation (reference/worker.md). The functions block: call them in a task's
thread.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

from qgis.PyQt import sip
from qgis.PyQt.QtCore import QCoreApplication, QIODevice, QProcess

from .dock_words import in_dock_words, missing_extra
from .program import process_environment

tr = partial(QCoreApplication.translate, "Worker")

PROTOCOL = 1
HELLO_S = 20.0
CANCEL_S = 20.0
"""Time for a cancelled worker to clean up; then it is terminated, and killed after :data:`END_MS`. It reacts at once,
except while a kernel is being compiled. QGIS treats the work as cancelled before that."""
END_MS = 2000
SILENT_S = 1800.0
"""A worker that sends nothing for so long hangs; the longest step without progress takes minutes."""
MAX_LINE_BYTES = 1 << 20
MAX_LOG_LINES = 40
READ_MS = 50


class WorkerError(Exception):
    """The command failed: lines for the user, last lines of the worker's log, error code, setting that remedies it."""

    setting: dict[str, Any] | None = None
    extra = ""
    """The extra of furrowmap that has to be installed."""

    def __init__(self, what: str, meaning: str, remedy: str, log: Iterable[str] = (), code: str = "") -> None:
        self.lines = (what, meaning, remedy)
        super().__init__("\n".join(self.lines))
        self.log = tuple(log)
        self.code = code


class WorkerCancelled(WorkerError):
    """The user cancelled the command."""

    def __init__(self) -> None:
        super().__init__(tr("Cancelled."), tr("No partial files are left."), "")


def run_command(
    program: Sequence[str],
    arguments: Sequence[str],
    on_message: Callable[[dict[str, Any]], None],
    is_cancelled: Callable[[], bool],
) -> Any:
    """Run one command in a worker; raises WorkerCancelled if the user cancelled it, WorkerError if it failed.

    Args:
        on_message: is called with each message except hello, result, error and done.
        is_cancelled: is asked twenty times a second.

    Returns:
        The command's answer, as with `--json`.
    """
    conversation = _Conversation(program, on_message, is_cancelled)
    try:
        return conversation.run(arguments)
    finally:
        conversation.end()


def greet(program: Sequence[str], is_cancelled: Callable[[], bool]) -> None:
    """Start a worker, read its hello message, end it; WorkerError for none, or another protocol version."""
    conversation = _Conversation(program, lambda _message: None, is_cancelled)
    try:
        conversation.greet()
    finally:
        conversation.end()


class _Conversation:
    def __init__(
        self, program: Sequence[str], on_message: Callable[[dict[str, Any]], None], is_cancelled: Callable[[], bool]
    ) -> None:
        self.program = program
        self.on_message = on_message
        self.is_cancelled = is_cancelled
        self.received: dict[str, dict[str, Any]] = {}  # the last hello, result, error and done
        self.stage = ""
        self.received_at = 0.0
        self.tail = b""
        self.log: list[str] = []
        process = self.process = QProcess()
        process.setProcessEnvironment(process_environment())
        process.start(program[0], [*program[1:], "worker"], QIODevice.OpenModeFlag.ReadWrite)
        if not process.waitForStarted(10_000):
            reason = process.errorString()
            sip.delete(process)
            raise WorkerError(
                tr("{program} could not be started: {reason}.").format(program=program[0], reason=reason),
                tr("Sessions cannot be run; existing results can still be opened."),
                tr("Choose or create an environment in Settings › Options › furrowmap."),
            )

    def greet(self) -> None:
        """Wait for the hello message and check its protocol version."""
        begun = time.monotonic()
        while "hello" not in self.received:
            if self.is_cancelled():
                raise WorkerCancelled
            if time.monotonic() - begun > HELLO_S:
                raise WorkerError(
                    tr("{program} did not answer within {seconds:.0f} s.").format(
                        program=self.program[0], seconds=HELLO_S
                    ),
                    self.log[-1] if self.log else tr("It wrote no output."),
                    tr("Test it in Settings › Options › furrowmap."),
                    self.log,
                )
            if not self._wait():
                raise self._crash()
        hello = self.received["hello"]
        if hello.get("protocol") != PROTOCOL:
            raise WorkerError(
                tr("furrowmap {version} has protocol version {found}; this plugin needs version {own}.").format(
                    version=hello.get("version"), found=hello.get("protocol"), own=PROTOCOL
                ),
                tr("Nothing was run."),
                tr("Update the older one: the plugin in QGIS's plugin manager, or furrowmap in its environment."),
                self.log,
            )

    def run(self, arguments: Sequence[str]) -> Any:
        """Start the command and read messages until it ends."""
        self.greet()
        self._send({"type": "start", "arguments": [str(word) for word in arguments]})
        cancelled_at = None
        self.received_at = time.monotonic()
        while "done" not in self.received and self._wait():
            if time.monotonic() - self.received_at > SILENT_S:
                self.process.kill()
                raise WorkerError(
                    tr("The worker sent nothing for {minutes:.0f} minutes (at: {stage}).").format(
                        minutes=SILENT_S / 60.0, stage=self.stage or tr("the start")
                    ),
                    tr("It was ended. Products of an earlier run are unchanged."),
                    tr("Try again without the file that it was reading, or inspect that file first."),
                    self.log,
                )
            if cancelled_at is None and self.is_cancelled():
                cancelled_at = time.monotonic()
                self._send({"type": "cancel"})
            if cancelled_at is not None and time.monotonic() - cancelled_at > CANCEL_S:
                break
        if cancelled_at is not None:
            raise WorkerCancelled
        error = self.received.get("error")
        if error is not None:
            what, meaning, remedy = (in_dock_words(str(error.get(key, ""))) for key in ("what", "meaning", "remedy"))
            failed = WorkerError(what, meaning, remedy, self.log, str(error.get("code", "")))
            failed.setting = error.get("set")
            failed.extra = missing_extra(str(error.get("remedy", "")))
            raise failed
        answer = self.received.get("result", {}).get("value")
        if "done" not in self.received or (self.received["done"].get("status", 1) != 0 and answer is None):
            raise self._crash()
        return answer  # with a status other than 0 where a part failed, which is in the answer

    def end(self) -> None:
        """Make sure that the worker ends: close its input, at which it exits, else terminate it, else kill it."""
        process = self.process
        for stop in (process.closeWriteChannel, process.terminate, process.kill):
            if process.state() == QProcess.ProcessState.NotRunning:
                break
            stop()
            process.waitForFinished(END_MS)
        sip.delete(process)  # in this thread: what an error refers to may be collected in another one, and crash QGIS

    def _wait(self) -> bool:
        """Read what arrives within a moment; returns whether more may come."""
        running = self.process.state() == QProcess.ProcessState.Running
        if running:
            self.process.waitForReadyRead(READ_MS)
        self._read()
        return running or bool(self.process.bytesAvailable())

    def _send(self, message: dict[str, Any]) -> None:
        self.process.write(json.dumps(message).encode() + b"\n")
        self.process.waitForBytesWritten(1000)

    def _read(self) -> None:
        text = bytes(self.process.readAllStandardError()).decode("utf-8", "replace")
        self.log = (self.log + text.splitlines())[-MAX_LOG_LINES:] if text else self.log
        *lines, self.tail = (self.tail + bytes(self.process.readAllStandardOutput())).split(b"\n")
        if len(self.tail) > MAX_LINE_BYTES:
            self.log.append(tr("A line of output was too long and was dropped."))
            self.tail = b""
        for line in lines:
            try:
                message = json.loads(line.decode("utf-8", "replace"))
                kind = message["type"]
            except (ValueError, KeyError, TypeError):
                self.log.append(line.decode("utf-8", "replace")[:500])
                continue
            self.received_at = time.monotonic()
            if kind in ("hello", "result", "error", "done"):
                self.received[kind] = message
                continue
            if kind == "progress":
                self.stage = str(message.get("stage", ""))
            self.on_message(message)

    def _crash(self) -> WorkerError:
        meaning = tr("It wrote no output; the computer may be out of memory.")
        if self.log:  # of a crash, the line that names it
            meaning = next((line for line in self.log if line.startswith("Fatal Python error")), self.log[-1])
        return WorkerError(
            tr("The worker ended without an answer (status {status}, at: {stage}).").format(
                status=self.process.exitCode(), stage=self.stage or tr("the start")
            ),
            meaning,
            tr("See its last lines in the log. Products of an earlier run are unchanged."),
            self.log,
        )


def percent_of(message: dict[str, Any]) -> float:
    """How much is done, by a message of progress: of all stages where these are known ahead, else of one."""
    return 100.0 * float(message.get("whole", message.get("share", 0.0)))


def stage_name(stage: str) -> str:
    """A stage's name in the user's language."""
    return QCoreApplication.translate("Stages", stage)
