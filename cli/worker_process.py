"""`furrowmap worker`: runs any command for another program, over lines of JSON.

Protocol 1: one JSON object per line, UTF-8. The worker writes to standard output:

- ``hello`` first: ``protocol``, ``version``, ``pid``;
- ``progress``: ``stage`` and its ``share`` (0 while unknown), at most ten times a second except at the start of a
  stage;
- ``warning``: ``code``, ``text``; ``log``: ``text``, an informative message;
- ``result``: ``value``, the result of the command as with ``--json``;
- ``error``: ``code``, ``what``, ``meaning``, ``remedy``, and ``set``, the table, key and value of the session file that
  remedy it, if there are any;
- ``done`` last: ``status``, the exit status of the command.

It reads from standard input: first ``{"type": "start", "arguments": ["run", "session.toml", ...]}``, then optionally
``{"type": "cancel"}``. The end of standard input also cancels. A worker that has not ended :data:`ABANDONED_S` later
ends itself, as if it were killed.
"""

import _thread
import faulthandler
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.metadata import version
from typing import BinaryIO, Final

import click
import msgspec

from furrowmap.cli.console import Console, error_value
from furrowmap.cli.interruption import INTERRUPTION
from furrowmap.cli.main import asked_language, attempt
from furrowmap.core.runtime.errors import Cancelled, FurrowmapError, UsageError
from furrowmap.core.runtime.languages.texts import Text, reason
from furrowmap.core.runtime.progress import Progress, Step, WholeShare
from furrowmap.core.runtime.settings import using
from furrowmap.process import prepare_process

PROTOCOL: Final = 1
PERIOD_S: Final = 0.1
ABANDONED_S: Final = 60.0
"""Time to clean up once nobody listens any more; longer than any kernel is being compiled."""
_LONGEST_LINE: Final = 1 << 20


Send = Callable[..., None]
"""Sends a message of a type, which is the argument, with its content, the keyword arguments."""


@click.command(
    short_help="Run a command for another program that speaks JSON.",
    epilog="\b\nExample:\n  furrowmap worker < pipe\nFirst line of the input:\n"
    '  {"type": "start", "arguments": ["run", "session.toml"]}',
)
def worker() -> None:
    """Run one command for another program, which sends it on standard input and reads progress and result on output.

    Both streams carry one JSON object per line; the worker reference describes the protocol. The end of standard input
    cancels the command.
    """
    prepare_process()
    faulthandler.enable()  # where a native library crashed, for the log
    sys.exit(work(_own_input(), _own_output()))


def work(orders: BinaryIO, answers: BinaryIO) -> int:
    """Send hello, read the start message, run the command; its exit status.

    `orders` are lines of JSON; their end cancels the command, and the process ends within :data:`ABANDONED_S` of it.
    """
    send = _sender(answers)
    send("hello", protocol=PROTOCOL, version=version("furrowmap"), pid=os.getpid())
    error: FurrowmapError | None
    arguments: list[str] = []
    try:
        arguments = _arguments(orders.readline(_LONGEST_LINE))
    except UsageError as raised:
        status = raised.exit_status
        error = raised
    else:
        threading.Thread(target=_heed, args=(orders,), daemon=True).start()
        with using(language=asked_language(arguments)):
            status, error = attempt(arguments, WorkerConsole(send=send))
    if error is not None:
        with using(language=asked_language(arguments)):
            send("error", **error_value(error))
    send("done", status=status)
    return status


@dataclass(frozen=True, kw_only=True)
class WorkerConsole(Console):
    """A console that sends messages to a program."""

    send: Send

    def answer(self, value: object, words: str) -> None:  # noqa: ARG002 (programs take the value)
        """Send the result."""
        self.send("result", value=value)

    def say(self, text: str) -> None:
        """Send a log message."""
        self.send("log", text=text)

    def put_warning(self, code: str, text: str, *, explained: bool = False) -> None:  # noqa: ARG002 (reports tell it)
        """Send a warning."""
        self.send("warning", code=code, text=text)

    @contextmanager
    def work(
        self,
        *,
        passing: bool = False,  # noqa: ARG002 (there is no progress bar)
        steps: Sequence[Step] = (),
    ) -> Iterator[Progress]:
        """Send the progress of long work; that of all steps, too, where they are known ahead."""
        with self.reporting_compilation():
            yield _throttled(self.send, WholeShare(steps) if steps else None)


def _throttled(send: Send, whole: WholeShare | None = None) -> Progress:
    """Sends the start of every stage, and then at most ten messages per second."""
    last_stage = ""
    last_s = 0.0

    def show(stage: str, share: float) -> None:
        nonlocal last_stage, last_s
        INTERRUPTION.check()
        now_s = time.monotonic()
        of_all = {} if whole is None else {"whole": round(whole.take(stage, share), 4)}
        if stage != last_stage or now_s - last_s >= PERIOD_S:
            last_stage = stage
            last_s = now_s
            send("progress", stage=stage, share=round(share, 4), **of_all)

    return show


def _sender(answers: BinaryIO) -> Send:
    """Writes each message as a whole, from any thread."""
    from furrowmap.core.runtime.json_text import plain

    lock = threading.Lock()

    def send(kind: str, **content: object) -> None:
        line = json.dumps(plain({"type": kind, **content}), ensure_ascii=False, allow_nan=False)
        with lock:
            answers.write(line.encode() + b"\n")
            answers.flush()

    return send


def _own_input() -> BinaryIO:
    """Standard input for the protocol alone; others find it empty.

    Libraries look at standard input when they are loaded, as that of Fortran in SciPy. On Windows they would wait until
    the thread that reads it gets a line.
    """
    protocol = os.dup(0)
    empty = os.open(os.devnull, os.O_RDONLY)
    os.dup2(empty, 0)
    os.close(empty)
    # Unbuffered: a thread that waits for input would hold the lock of a buffer when the process exits.
    return open(protocol, "rb", buffering=0, closefd=False)


def _own_output() -> BinaryIO:
    """Standard output for the protocol alone; other output to it, as of native libraries, goes to standard error."""
    protocol = os.dup(1)
    os.dup2(2, 1)
    return os.fdopen(protocol, "wb")


def _arguments(line: bytes) -> list[str]:
    """The arguments in the start message."""
    try:
        order = msgspec.json.decode(line, type=_Order)
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise UsageError("worker-order", fault=reason(error)) from None
    if not order.arguments or order.arguments[0] == "worker":
        raise UsageError("worker-order", fault=Text("it names no command"))
    if any("\0" in argument for argument in order.arguments):
        raise UsageError("worker-order", fault=Text("an argument has a null byte"))
    return order.arguments


class _Order(msgspec.Struct, tag_field="type", tag="start", forbid_unknown_fields=True):
    arguments: list[str]


def _heed(orders: BinaryIO) -> None:
    """Cancel the command on a cancel message or at the end of the input; after that end, see that the process ends.

    The exception of an interruption can be lost or leave a lock behind where it meets a library, as in the midst of a
    compilation. Nobody is there then to end the process.
    """
    while line := orders.readline(_LONGEST_LINE):
        with suppress(ValueError):
            if json.loads(line) == {"type": "cancel"}:
                _cancel()
    _cancel()
    time.sleep(ABANDONED_S)
    os._exit(Cancelled.exit_status)


def _cancel() -> None:
    if not INTERRUPTION.asked:
        INTERRUPTION.asked = True
        _thread.interrupt_main(signal.SIGINT)
