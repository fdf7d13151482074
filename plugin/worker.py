# SPDX-License-Identifier: GPL-2.0-or-later
"""Drives `furrowmap worker`: starts it, orders one verb, hears its lines of JSON, and never leaves it behind.

The protocol is told in furrowmap's documentation (reference/worker.md). The calls block, so they belong into a thread
of a task; whoever calls looks at messages and says when to cancel.
"""

import json
import time
from dataclasses import dataclass, field

from qgis.PyQt.QtCore import QCoreApplication, QIODevice, QProcess

from .program import process_environment

PROTOCOL = 1
HELLO_S = 20.0
CANCEL_S = 20.0
"""How long a cancelled worker may take to clean up before it is ended, and then killed after :data:`END_S`: it heeds at
once, but for the seconds in which a kernel is compiled. Whoever waits need not: the work counts as stopped before."""
END_S = 2.0
LONGEST_LINE = 1 << 20
_POLL_MS = 50
_KEPT_LINES = 40


class WorkerError(Exception):
    """The work did not come to its end: three lines for the user.

    Attributes:
        code: stable name of what went wrong.
        lines: what is wrong; what that means; what to do.
        log: the last lines of the worker's standard error.
    """

    def __init__(self, code, lines, log=()):
        super().__init__("\n".join(lines))
        self.code = code
        self.lines = tuple(lines)
        self.log = tuple(log)


class WorkerCancelled(WorkerError):
    """The user stopped it."""


@dataclass
class Heard:
    """What a worker has said so far."""

    value: object = None
    error: dict = None
    status: int = None
    hello: dict = None
    warnings: list = field(default_factory=list)


def run_command(program, arguments, on_message, is_cancelled):
    """Let a worker do one verb.

    Args:
        program: the command that starts `furrowmap`, a list of words.
        arguments: of the verb, as on the command line.
        on_message: is called with each message but hello, result and done.
        is_cancelled: is asked twenty times a second.

    Returns:
        The verb's answer, as its ``--json`` gives it.

    Raises:
        WorkerCancelled: if the user stopped it.
        WorkerError: if it did not come to its end.
    """
    process = _start(program)
    try:
        return _Conversation(process, program, on_message, is_cancelled).hold(arguments)
    finally:
        _end(process)


def greet(program, is_cancelled):
    """Start a worker, hear its hello, end it.

    Returns:
        The hello: protocol, version, pid.

    Raises:
        WorkerError: if there is none, or of another protocol.
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
        self.heard = Heard()
        self.tail = b""
        self.log = []

    def greet(self):
        """Wait for the hello of a worker that speaks this plugin's protocol."""
        begun = time.monotonic()
        while self.heard.hello is None:
            if self.is_cancelled():
                raise _cancelled()
            if time.monotonic() - begun > HELLO_S:
                raise self._silent()
            if not self._wait():
                raise self._crashed()
        self._check_protocol()
        return self.heard.hello

    def hold(self, arguments):
        """Order the verb and listen to the end."""
        self.greet()
        self._say({"type": "start", "arguments": [str(word) for word in arguments]})
        cancelled_at = None
        while self.heard.status is None and self._wait():
            if cancelled_at is None and self.is_cancelled():
                cancelled_at = time.monotonic()
                self._say({"type": "cancel"})
            if cancelled_at is not None and time.monotonic() - cancelled_at > CANCEL_S:
                break
        if cancelled_at is not None:
            raise _cancelled()
        return self._outcome()

    def _wait(self):
        """Hear what comes for a moment; whether more may come."""
        running = self.process.state() == QProcess.ProcessState.Running
        if running:
            self.process.waitForReadyRead(_POLL_MS)
        self._hear()
        return running or bool(self.process.bytesAvailable())

    def _outcome(self):
        if self.heard.error is not None:
            error = self.heard.error
            lines = [str(error.get(key, "")) for key in ("what", "meaning", "remedy")]
            raise WorkerError(str(error.get("code", "failed")), lines, self.log)
        told = self.heard.status == 0 or (self.heard.status is not None and self.heard.value is not None)
        if not told:
            raise self._crashed()
        return self.heard.value  # with another status where a part could not be done, which the answer tells

    def _say(self, message):
        self.process.write(json.dumps(message).encode() + b"\n")
        self.process.waitForBytesWritten(1000)

    def _hear(self):
        text = bytes(self.process.readAllStandardError()).decode("utf-8", "replace")
        self.log = (self.log + text.splitlines())[-_KEPT_LINES:] if text else self.log
        *lines, self.tail = (self.tail + bytes(self.process.readAllStandardOutput())).split(b"\n")
        if len(self.tail) > LONGEST_LINE:
            self.log.append(tr("A line without end was thrown away."))
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
        if kind == "hello":
            self.heard.hello = message
        elif kind == "result":
            self.heard.value = message.get("value")
        elif kind == "error":
            self.heard.error = message
        elif kind == "done":
            self.heard.status = message.get("status", 1)
        else:
            self.on_message(message)

    def _check_protocol(self):
        found = self.heard.hello.get("protocol")
        if found != PROTOCOL:
            raise WorkerError(
                "worker-protocol",
                (
                    tr("furrowmap {version} speaks protocol {found}; this plugin speaks {own}.").format(
                        version=self.heard.hello.get("version"), found=found, own=PROTOCOL
                    ),
                    tr("They do not understand each other, so nothing was done."),
                    tr("Update whichever is older: the plugin in QGIS's plugin manager, furrowmap in its environment."),
                ),
                self.log,
            )

    def _silent(self):
        return WorkerError(
            "worker-silent",
            (
                tr("{program} has not answered for {seconds:.0f} s.").format(program=self.program[0], seconds=HELLO_S),
                self.log[-1] if self.log else tr("It said nothing at all."),
                tr("Check the interpreter in Settings › Options › furrowmap."),
            ),
            self.log,
        )

    def _crashed(self):
        return WorkerError(
            "worker-crashed",
            (
                tr("The worker ended without an answer (exit status {status}).").format(status=self.process.exitCode()),
                self.log[-1] if self.log else tr("It left no message; perhaps the memory did not suffice."),
                tr("The log has its last words. Products of an earlier run are as they were."),
            ),
            self.log,
        )


def _start(program):
    process = QProcess()
    process.setProcessEnvironment(process_environment())
    process.start(program[0], [*program[1:], "worker"], QIODevice.OpenModeFlag.ReadWrite)
    if not process.waitForStarted(10_000):
        raise WorkerError(
            "worker-not-started",
            (
                tr("{program} could not be started: {reason}.").format(
                    program=program[0], reason=process.errorString()
                ),
                tr("Without it nothing is computed; results that are there can still be opened."),
                tr("Choose or make an environment in Settings › Options › furrowmap."),
            ),
        )
    return process


def _end(process):
    """Whatever happened, no worker stays: its input ends, which it heeds; else it is ended, else killed."""
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
    return WorkerCancelled("cancelled", (tr("Stopped before the end."), tr("Nothing half-written is left."), ""))


def _ignore(message):
    """For who wants to know nothing on the way."""


def tr(text):
    """`text` in the user's language."""
    return QCoreApplication.translate("Worker", text)
