"""Writes products in processes of its own that end as if they were killed: a line of JSON each on standard input.

A process ends without a word before its n-th operation that changes files, as far as Python knows of them, or after so
many seconds, which falls into the work of libraries as well. Or none of its files can be larger than so many bytes.
A task may also be the arguments of a command, with variables of the environment. Everything is imported once.
"""

from __future__ import annotations

import importlib
import io
import json
import os
import resource
import signal
import sys
import tempfile
from contextlib import redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from typing import Any

from furrowmap.cli.main import _in_three_lines, command_line
from furrowmap.core.runtime.errors import FurrowmapError
from tests.app.writers import WRITERS

CHANGES = {"os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.truncate", "os.link", "os.symlink"}


def change_files(event: str, arguments: tuple[Any, ...]) -> bool:
    """Whether an audit event is an operation that changes files."""
    if event == "open":
        return isinstance(arguments[2], int) and bool(arguments[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))
    return event in CHANGES


MAX_COMMAND_S = 300


def command(task: dict[str, Any]) -> dict[str, Any]:
    """Run a command; its exit status and what it writes to standard error."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(MAX_COMMAND_S)
    os.environ |= task.get("environment", {})
    os.chdir(task["folder"])
    tempfile.tempdir = None
    if task.get("bytes"):
        resource.setrlimit(resource.RLIMIT_FSIZE, (task["bytes"], task["bytes"]))
    said = io.StringIO()
    with redirect_stderr(said), redirect_stdout(io.StringIO()):
        status = command_line(task["arguments"])
    return {"exit": status, "said": said.getvalue()[-5000:]}


def mortal(task: dict[str, Any]) -> int:
    """Do a task; the number of operations that changed files."""
    done = 0

    def count(event: str, arguments: tuple[Any, ...]) -> None:
        nonlocal done
        if change_files(event, arguments):
            done += 1
            if done == task.get("operation"):
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(count)
    if task.get("seconds"):
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_REAL, task["seconds"])
    if task.get("temporary"):
        tempfile.tempdir = task["temporary"]
    if task.get("bytes"):  # as on a full disk; Python ignores the signal
        resource.setrlimit(resource.RLIMIT_FSIZE, (task["bytes"], task["bytes"]))
    WRITERS[task["deed"]].write(begun(task), Path(task["target"]))
    return done


def begun(task: dict[str, Any]) -> Path:
    """The source, after what a writer does before it touches its target."""
    source = Path(task["source"])
    WRITERS[task["deed"]].begin(source)
    return source


if __name__ == "__main__":
    for line in sys.stdin:
        if "deed" in json.loads(line):
            begun(json.loads(line))
        known = set(sys.modules)
        reading, writing = os.pipe()
        process = os.fork()
        if process == 0:
            said: dict[str, Any] = {}
            try:
                task = json.loads(line)
                said |= {"operations": mortal(task)} if "deed" in task else command(task)
                said["modules"] = [name for name in sys.modules if name not in known]
            except (FurrowmapError, OSError) as error:
                said["error"] = [line[:1000] for line in _in_three_lines(error, []).lines]
            except BaseException as error:  # noqa: BLE001
                said["fault"] = repr(error)[:1500]
            finally:
                os.write(writing, json.dumps(said, ensure_ascii=False).encode())
                os._exit(0)
        os.close(writing)
        with os.fdopen(reading, "rb") as answered:
            words = answered.read()
        _, ended = os.waitpid(process, 0)
        answer = {"status": os.waitstatus_to_exitcode(ended), **json.loads(words or "{}")}
        for name in answer.pop("modules", ()):  # so that the next process need not import them
            with suppress(Exception):
                importlib.import_module(name)
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()
