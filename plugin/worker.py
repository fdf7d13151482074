# SPDX-License-Identifier: GPL-2.0-or-later
"""Runs one command in `furrowmap worker`, a process that talks in lines of JSON, and always ends that process.

The protocol is described in furrowmap's documentation (reference/worker.md). The functions block: call them in a task's
thread.
"""

import json
import time
from dataclasses import dataclass
from functools import partial

from qgis.PyQt.QtCore import QCoreApplication, QIODevice, QProcess

from .program import process_environment

tr = partial(QCoreApplication.translate, "Worker")

PROTOCOL = 1
HELLO_S = 20.0
CANCEL_S = 20.0
"""Time for a cancelled worker to clean up; then it is terminated, and killed after :data:`END_S`. It reacts at once,
except while a kernel is being compiled. QGIS treats the work as cancelled before that."""
END_S = 2.0
SILENT_S = 1800.0
"""A worker that sends nothing for so long hangs; the longest step without progress takes minutes."""
MAX_LINE_BYTES = 1 << 20
_POLL_MS = 50
_KEPT_LINES = 40


class WorkerError(Exception):
    """The command failed.

    Attributes:
        lines: for the user: what is wrong, what that means, what to do.
        log: the last lines of the worker's standard error.
        code: of the command's error; "" for one of the worker.
    """

    def __init__(self, what, meaning, remedy, log=(), code=""):
        self.lines = (what, meaning, remedy)
        super().__init__("\n".join(self.lines))
        self.log = tuple(log)
        self.code = code


class WorkerCancelled(WorkerError):
    """The user cancelled the command."""


@dataclass
class Received:
    """The worker's messages so far: what it works on, and when the last one came."""

    value: object = None
    error: dict = None
    status: int = None
    hello: dict = None
    stage: str = ""
    at: float = 0.0


def run_command(program, arguments, on_message, is_cancelled):
    """Run one command in a worker.

    Args:
        program: program and arguments that start `furrowmap`.
        arguments: of the command line, the command's name first.
        on_message: is called with each message except hello, result, error and done.
        is_cancelled: is asked twenty times a second.

    Returns:
        The command's answer, as with `--json`.

    Raises:
        WorkerCancelled: if the user cancelled it.
        WorkerError: if it failed.
    """
    process = _start(program)
    try:
        return _Conversation(process, program, on_message, is_cancelled).run(arguments)
    finally:
        _end(process)


def greet(program, is_cancelled):
    """Start a worker, read its hello message, end it.

    Returns:
        The message: protocol, version, pid.

    Raises:
        WorkerError: if there is none, or it has another protocol version.
    """
    process = _start(program)
    try:
        return _Conversation(process, program, _ignore, is_cancelled).greet()
    finally:
        _end(process)


class _Conversation:
    def __init__(self, process, program, on_message, is_cancelled):
        self.process = process
        self.program = program
        self.on_message = on_message
        self.is_cancelled = is_cancelled
        self.received = Received()
        self.tail = b""
        self.log = []

    def greet(self):
        """Wait for the hello message and check its protocol version."""
        begun = time.monotonic()
        while self.received.hello is None:
            if self.is_cancelled():
                raise _cancelled()
            if time.monotonic() - begun > HELLO_S:
                raise self._silent()
            if not self._wait():
                raise self._crashed()
        self._check_protocol()
        return self.received.hello

    def run(self, arguments):
        """Start the command and read messages until it ends."""
        self.greet()
        self._send({"type": "start", "arguments": [str(word) for word in arguments]})
        cancelled_at = None
        self.received.at = time.monotonic()
        while self.received.status is None and self._wait():
            if time.monotonic() - self.received.at > SILENT_S:
                self.process.kill()
                raise self._hangs()
            if cancelled_at is None and self.is_cancelled():
                cancelled_at = time.monotonic()
                self._send({"type": "cancel"})
            if cancelled_at is not None and time.monotonic() - cancelled_at > CANCEL_S:
                break
        if cancelled_at is not None:
            raise _cancelled()
        return self._outcome()

    def _wait(self):
        """Read what arrives within a moment; returns whether more may come."""
        running = self.process.state() == QProcess.ProcessState.Running
        if running:
            self.process.waitForReadyRead(_POLL_MS)
        self._read()
        return running or bool(self.process.bytesAvailable())

    def _outcome(self):
        if self.received.error is not None:
            what, meaning, remedy, code = (
                str(self.received.error.get(key, "")) for key in ("what", "meaning", "remedy", "code")
            )
            raise WorkerError(what, meaning, remedy, self.log, code)
        status, value = self.received.status, self.received.value
        if status is None or (status != 0 and value is None):
            raise self._crashed()
        return value  # with a status other than 0 where a part failed, which is in the answer

    def _send(self, message):
        self.process.write(json.dumps(message).encode() + b"\n")
        self.process.waitForBytesWritten(1000)

    def _read(self):
        text = bytes(self.process.readAllStandardError()).decode("utf-8", "replace")
        self.log = (self.log + text.splitlines())[-_KEPT_LINES:] if text else self.log
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
            self._take(kind, message)

    def _take(self, kind, message):
        self.received.at = time.monotonic()
        if kind == "progress":
            self.received.stage = str(message.get("stage", ""))
        if kind == "hello":
            self.received.hello = message
        elif kind == "result":
            self.received.value = message.get("value")
        elif kind == "error":
            self.received.error = message
        elif kind == "done":
            self.received.status = message.get("status", 1)
        else:
            self.on_message(message)

    def _check_protocol(self):
        found = self.received.hello.get("protocol")
        if found != PROTOCOL:
            raise WorkerError(
                tr("furrowmap {version} has protocol version {found}; this plugin needs version {own}.").format(
                    version=self.received.hello.get("version"), found=found, own=PROTOCOL
                ),
                tr("Nothing was run."),
                tr("Update the older one: the plugin in QGIS's plugin manager, or furrowmap in its environment."),
                self.log,
            )

    def _silent(self):
        return WorkerError(
            tr("{program} did not answer within {seconds:.0f} s.").format(program=self.program[0], seconds=HELLO_S),
            self.log[-1] if self.log else tr("It wrote no output."),
            tr("Test it in Settings › Options › furrowmap."),
            self.log,
        )

    def _crashed(self):
        return WorkerError(
            tr("The worker ended without an answer (status {status}, at: {stage}).").format(
                status=self.process.exitCode(), stage=self._stage()
            ),
            self._last_words() if self.log else tr("It wrote no output; the computer may be out of memory."),
            tr("See its last lines in the log. Products of an earlier run are unchanged."),
            self.log,
        )

    def _hangs(self):
        return WorkerError(
            tr("The worker sent nothing for {minutes:.0f} minutes (at: {stage}).").format(
                minutes=SILENT_S / 60.0, stage=self._stage()
            ),
            tr("It was ended. Products of an earlier run are unchanged."),
            tr("Try again without the file that it was reading, or inspect that file first."),
            self.log,
        )

    def _stage(self):
        return self.received.stage or tr("the start")

    def _last_words(self):
        """The last line of its log; of a crash, the line that names it."""
        return next((line for line in self.log if line.startswith("Fatal Python error")), self.log[-1])


def _start(program):
    process = QProcess()
    process.setProcessEnvironment(process_environment())
    process.start(program[0], [*program[1:], "worker"], QIODevice.OpenModeFlag.ReadWrite)
    if not process.waitForStarted(10_000):
        raise WorkerError(
            tr("{program} could not be started: {reason}.").format(program=program[0], reason=process.errorString()),
            tr("Sessions cannot be run; existing results can still be opened."),
            tr("Choose or create an environment in Settings › Options › furrowmap."),
        )
    return process


def _end(process):
    """Make sure that the worker ends: close its input, at which it exits, else terminate it, else kill it."""
    if process.state() == QProcess.ProcessState.NotRunning:
        return
    process.closeWriteChannel()
    if process.waitForFinished(int(END_S * 1000)):
        return
    process.terminate()
    if not process.waitForFinished(int(END_S * 1000)):
        process.kill()
        process.waitForFinished(int(END_S * 1000))


def _cancelled():
    return WorkerCancelled(tr("Cancelled."), tr("No partial files are left."), "")


def _ignore(message):
    """Messages are not wanted."""
