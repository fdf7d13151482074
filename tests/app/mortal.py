"""Writes products in processes of its own that end as if they were killed: a line of JSON each on standard input.

A process ends without a word before the n-th operation that changes files, of itself or of its workers and as far as
Python knows of them, or after so many seconds, which falls into the work of libraries as well. Or none of its files can
be larger than so many bytes. Or it is stopped before operations and after times, and the files are copied as a kill
would leave them. A task may also be the arguments of a command, with variables of the environment.

Each process is forked from this one, which has imported everything and loads kernels where many tasks follow; workers
of a batch are forked as well. So a kill costs what the writer does until then, and no start of Python.
"""

from __future__ import annotations

import importlib
import io
import itertools
import json
import mmap
import multiprocessing.context
import os
import pickle
import resource
import select
import shutil
import signal
import socket
import struct
import sys
import tempfile
import time
from base64 import b64decode, b64encode
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from typing import Any

from numba.core.dispatcher import Dispatcher

from furrowmap.cli.main import _in_three_lines, command_line
from furrowmap.core.live.live_session import warm_up
from furrowmap.core.runtime.errors import FurrowmapError
from tests.app.writers import WRITERS
from tests.fuzz_sessions.trials import load

CHANGES = {"os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.truncate", "os.link", "os.symlink"}


def change_files(event: str, arguments: tuple[Any, ...]) -> bool:
    """Whether an audit event is an operation that changes files."""
    if event == "open":
        return isinstance(arguments[2], int) and bool(arguments[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))
    return event in CHANGES


MAX_COMMAND_S = 300
MAX_WAIT_S = 60.0


def command(task: dict[str, Any]) -> dict[str, Any]:
    """Run a command; its exit status and what it writes to standard error."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, task.get("seconds", MAX_COMMAND_S))
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
    asking = supervised(task) if task.get("states") else None
    done = mmap.mmap(-1, 8)  # of this process and its workers, whose threads change files as well
    turn = multiprocessing.get_context("fork").Lock()
    own = os.getpid()
    copied = frozenset(task.get("operations", ()))

    def count(event: str, arguments: tuple[Any, ...]) -> None:
        if not change_files(event, arguments):
            return
        held = turn.acquire(timeout=MAX_WAIT_S)  # a worker may have ended in its turn
        operations = struct.unpack("q", done[:])[0] + 1
        done[:] = struct.pack("q", operations)
        if asking is not None and operations in copied:
            asking.send(b"%d" % operations)
            asking.recv(1)
        if held:
            turn.release()
        if operations == task.get("operation"):
            os.kill(own, signal.SIGKILL)

    sys.addaudithook(count)
    if task.get("seconds"):
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_REAL, task["seconds"])
    if task.get("temporary"):
        tempfile.tempdir = task["temporary"]
    if task.get("bytes"):  # as on a full disk; Python ignores the signal
        resource.setrlimit(resource.RLIMIT_FSIZE, (task["bytes"], task["bytes"]))
    WRITERS[task["deed"]].write(begun(task), Path(task["target"]))
    return int(struct.unpack("q", done[:])[0])


def supervised(task: dict[str, Any]) -> socket.socket:
    """Let a child of this process go on with the task, and copy the files when it asks, and at times.

    Whatever changes files stands still meanwhile: all threads of the child, and its workers. Returns in the child only,
    the socket by which it asks before an operation.
    """
    asked, asking = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    child = os.fork()
    if child == 0:
        asked.close()
        return asking
    asking.close()
    due_s = list(itertools.accumulate(task["pauses"], initial=time.monotonic()))[1:]
    pauses = 0
    while True:
        wait_s = max(0.0, due_s[pauses] - time.monotonic()) if pauses < len(due_s) else None
        operation = None
        if select.select([asked], [], [], wait_s)[0]:
            operation = asked.recv(20)
            if not operation:  # the child and its workers have ended
                break
        with stopped(child):
            copy_state(task, f"operation {operation.decode()}" if operation else f"pause {pauses}")
        if operation:
            with suppress(OSError):  # it has ended meanwhile
                asked.send(b".")
        else:
            pauses += 1
    os.waitpid(child, 0)
    os._exit(0)


@contextmanager
def stopped(child: int) -> Iterator[None]:
    """Within it, a process and those that it has started stand still; an error ends them."""
    processes: list[int] = []
    try:
        _stop(child, processes)
        yield
    except BaseException:
        for process in processes:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        raise
    finally:
        for process in processes:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGCONT)


def _stop(process: int, processes: list[int]) -> None:
    with suppress(FileNotFoundError, ProcessLookupError):  # it has ended
        os.kill(process, signal.SIGSTOP)
        processes.append(process)
        while _runs(process):
            time.sleep(0.001)
        for thread in Path(f"/proc/{process}/task").iterdir():
            for worker in (thread / "children").read_text().split():
                _stop(int(worker), processes)


def _runs(process: int) -> bool:
    """Whether a process is neither stopped nor ended."""
    return Path(f"/proc/{process}/stat").read_text().rpartition(") ")[2][0] not in "TZ"


def copy_state(task: dict[str, Any], name: str) -> None:
    """Copy the files as they are now."""
    shutil.copytree(Path(task["target"]).parent, Path(task["states"]) / name, symlinks=True)


def begun(task: dict[str, Any]) -> Path:
    """The source, after what a writer does before it touches its target."""
    source = Path(task["source"])
    WRITERS[task["deed"]].begin(source)
    return source


def fork_workers() -> None:
    """Let workers be forked that would be started anew, which takes seconds."""
    contexts = multiprocessing.context._concrete_contexts
    contexts["spawn"] = contexts["fork"]


def loaded_kernels() -> dict[tuple[str, str], list[Any]]:
    """The types of arguments with which each kernel is loaded, by its module and name."""
    modules = [(name, module) for name, module in sys.modules.items() if name.startswith("furrowmap.")]
    return {
        (name, key): list(value.overloads)
        for name, module in modules
        for key, value in vars(module).items()
        if isinstance(value, Dispatcher) and value.py_func.__module__ == name
    }


def load_kernels(kernels: dict[tuple[str, str], list[Any]]) -> None:
    """Load what another process has loaded or compiled, from where numba keeps it."""
    for (module, name), signatures in kernels.items():
        kernel = getattr(sys.modules[module], name)
        for types in signatures:
            if types not in kernel.overloads:
                kernel.compile(types)


if __name__ == "__main__":
    fork_workers()
    if os.environ.get("KILLS"):
        load()
        warm_up()
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
                signal.setitimer(signal.ITIMER_REAL, 0.0)
                said["modules"] = [name for name in sys.modules if name not in known]
                said["kernels"] = b64encode(pickle.dumps(loaded_kernels())).decode()
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
        answer = {"status": os.waitstatus_to_exitcode(ended)}
        with suppress(ValueError):  # it was killed while it wrote
            answer |= json.loads(words)
        for name in answer.pop("modules", ()):  # so that the next process need not import them
            with suppress(Exception):
                importlib.import_module(name)
        if kernels := answer.pop("kernels", ""):
            load_kernels(pickle.loads(b64decode(kernels)))
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()
