"""Writes products in processes of its own that end as if they were killed: a line of JSON each on standard input.

A process ends without a word before its n-th operation that changes files, as far as Python knows of them, or after so
many seconds, which falls into the work of libraries as well. Everything is imported once.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from pathlib import Path
from typing import Any

import furrowmap
from furrowmap.core.pointclouds.surface_settings import SurfaceSettings
from furrowmap.workflows.export import export

CHANGES = {"os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.truncate", "os.link", "os.symlink"}


def work(deed: str, source: str, target: str) -> None:
    """Do what a command of that name does, replacing what is there."""
    if deed == "surface":
        furrowmap.surface([Path(source)], Path(target), SurfaceSettings(cell_m=0.5), overwrite=True)
    elif deed == "export":
        export([Path(source)], "csv", Path(target), overwrite=True)
    elif deed == "run":
        furrowmap.run(Path(source), Path(target), overwrite=True)
    else:
        raise ValueError(deed)


def change_files(event: str, arguments: tuple[Any, ...]) -> bool:
    """Whether an audit event is an operation that changes files."""
    if event == "open":
        return isinstance(arguments[2], int) and bool(arguments[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))
    return event in CHANGES


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
    work(task["deed"], task["source"], task["target"])
    return done


if __name__ == "__main__":
    for line in sys.stdin:
        reading, writing = os.pipe()
        process = os.fork()
        if process == 0:
            status = 1
            try:
                os.write(writing, str(mortal(json.loads(line))).encode())
                status = 0
            finally:
                os._exit(status)
        os.close(writing)
        _, ended = os.waitpid(process, 0)
        answer = {"status": os.waitstatus_to_exitcode(ended), "operations": int(os.read(reading, 20) or 0)}
        os.close(reading)
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()
