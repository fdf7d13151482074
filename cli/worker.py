"""`furrowmap worker`: any verb, for another program, by lines of JSON.

Protocol 1, a JSON object a line, UTF-8. The worker says on standard output:

- ``hello`` first: ``protocol``, ``version``, ``pid``;
- ``progress``: ``stage`` and ``share`` of it (0 while unknown), at most ten times a second but for a stage's first and
  last;
- ``warning``: ``code``, ``text``; and ``log``: ``text``, something worth telling on the way;
- ``result``: ``value``, the verb's answer as its ``--json`` gives it;
- ``error``: ``code``, ``what``, ``meaning``, ``remedy``, the three lines of an error;
- ``done`` last: ``status``, the verb's exit status.

It reads on standard input: first ``{"type": "start", "arguments": ["run", "session.toml", ...]}``, then perhaps
``{"type": "cancel"}``. The end of standard input means that nobody is there any more, and cancels, too.
"""

from __future__ import annotations

import _thread
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.metadata import version
from typing import BinaryIO, Final, Protocol

import click
import msgspec

from furrowmap.cli.console import Console, error_value
from furrowmap.cli.interruption import INTERRUPTION
from furrowmap.cli.main import attempt
from furrowmap.core.values.errors import FurrowmapError, Notice, UsageError
from furrowmap.core.values.progress import Progress
from furrowmap.process import prepare_process, reporting_compilation

PROTOCOL: Final = 1
PERIOD_S: Final = 0.1
_LONGEST_LINE: Final = 1 << 20


class Tell(Protocol):
    """Sends a message of a kind."""

    def __call__(self, kind: str, **content: object) -> None:
        """Send it."""
        ...


@click.command(
    short_help="Work for another program, by lines of JSON.",
    epilog="\b\nExample:\n  furrowmap worker < pipe\nThrough the pipe comes first:\n"
    '  {"type": "start", "arguments": ["run", "session.toml"]}',
)
def worker() -> None:
    """Do one verb for another program: what, it says on standard input; how it goes, it hears on standard output.

    Both ways a JSON object a line, as the reference of the worker's protocol tells. The end of standard input cancels.
    """
    prepare_process()
    # Unbuffered: a thread that waits for input would hold a buffer's lock when the process wants to end.
    with open(0, "rb", buffering=0, closefd=False) as orders:
        sys.exit(work(orders, _own_output()))


def work(orders: BinaryIO, answers: BinaryIO) -> int:
    """Say hello, read the order, do it.

    Args:
        orders: lines of JSON; its end cancels the work.
        answers: takes lines of JSON.

    Returns:
        The exit status of the verb.
    """
    tell = _Teller(answers)
    tell("hello", protocol=PROTOCOL, version=version("furrowmap"), pid=os.getpid())
    error: FurrowmapError | None
    try:
        arguments = _arguments(orders.readline(_LONGEST_LINE))
    except UsageError as raised:
        status, error = raised.exit_status, raised
    else:
        threading.Thread(target=_heed, args=(orders,), daemon=True).start()
        status, error = attempt(arguments, INTERRUPTION, WorkerConsole(tell=tell))
    if error is not None:
        tell("error", **error_value(error))
    tell("done", status=status)
    return status


def _no_one(kind: str, **_: object) -> None:
    """Nobody listens."""


@dataclass(frozen=True)
class WorkerConsole(Console):
    """A console at whose other end is a program.

    Attributes:
        tell: sends a message of that kind.
    """

    tell: Tell = _no_one

    def answer(self, value: object, words: str) -> None:  # noqa: ARG002 (programs take the value)
        """Give the verb's answer."""
        self.tell("result", value=value)

    def say(self, text: str) -> None:
        """Tell something on the way."""
        self.tell("log", text=text)

    def warn(self, notice: Notice) -> None:
        """Tell something that the user should know."""
        self.tell("warning", code=notice.code, text=notice.text)

    @contextmanager
    def work(self, *, passing: bool = False) -> Iterator[Progress]:  # noqa: ARG002 (there are no bars)
        """Work that may take long: its stages and shares."""
        with reporting_compilation(self.say):
            yield _throttled(self.tell)


def _throttled(tell: Tell) -> Progress:
    """Tells of every stage's begin, and then not more than ten times a second."""
    last_stage, last_s = "", 0.0

    def show(stage: str, share: float) -> None:
        nonlocal last_stage, last_s
        INTERRUPTION.check()
        now_s = time.monotonic()
        if stage != last_stage or now_s - last_s >= PERIOD_S:
            last_stage, last_s = stage, now_s
            tell("progress", stage=stage, share=round(share, 4))

    return show


class _Teller:
    """Writes messages, each whole, whichever thread they come from."""

    def __init__(self, answers: BinaryIO) -> None:
        self._answers = answers
        self._lock = threading.Lock()

    def __call__(self, kind: str, **content: object) -> None:
        from furrowmap.core.values.json_text import plain

        line = json.dumps(plain({"type": kind, **content}), ensure_ascii=False, allow_nan=False)
        with self._lock:
            self._answers.write(line.encode() + b"\n")
            self._answers.flush()


def _own_output() -> BinaryIO:
    """Standard output for the protocol alone; what else writes there (native libraries do) goes to standard error."""
    protocol = os.dup(1)
    os.dup2(2, 1)
    return os.fdopen(protocol, "wb")


def _arguments(line: bytes) -> list[str]:
    """What is to be done.

    Raises:
        UsageError: if the line is no order.
    """
    try:
        order = msgspec.json.decode(line, type=_Order)
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise _misunderstood(f"The first line is no order ({error}).") from None
    if not order.arguments or order.arguments[0] == "worker":
        raise _misunderstood("The order names no verb.")
    return order.arguments


class _Order(msgspec.Struct, tag_field="type", tag="start", forbid_unknown_fields=True):
    arguments: list[str]


def _misunderstood(what: str) -> UsageError:
    return UsageError(
        what,
        "The worker did nothing.",
        'Send {"type": "start", "arguments": ["run", "session.toml"]} as the first line.',
        code="worker-order",
    )


def _heed(orders: BinaryIO) -> None:
    """Cancel the work when that is asked for, or nobody is there any more."""
    while line := orders.readline(_LONGEST_LINE):
        with suppress(ValueError):
            if json.loads(line) == {"type": "cancel"}:
                break
    INTERRUPTION.asked = True
    _thread.interrupt_main(signal.SIGINT)
