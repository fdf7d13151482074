"""What a killed writer would leave is looked at while nothing changes it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from tests.app.mortal import stopped

LONGEST_S = 60.0
WRITES = """
import os, sys, threading, time
def write(name):
    while True:
        with open(os.path.join(sys.argv[1], name), "a") as file:
            file.write(".")
        time.sleep(0.001)
def thread():
    if os.fork() == 0:
        write("worker")
    write("thread")
threading.Thread(target=thread, daemon=True).start()
write("main")
"""
"""A process, a thread of it and a process that the thread has started."""
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are listed in /proc")


def sizes(folder: Path) -> dict[str, int]:
    return {path.name: path.stat().st_size for path in folder.iterdir()}


def wait_for(folder: Path, before: dict[str, int]) -> None:
    """Until all three have written more than before."""
    ends_s = time.monotonic() + LONGEST_S
    while not all(sizes(folder).get(name, 0) > before.get(name, 0) for name in ("main", "thread", "worker")):
        assert time.monotonic() < ends_s
        time.sleep(0.01)


def test_stopped__threads_and_workers_stand_still_and_go_on(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", WRITES, str(tmp_path)], start_new_session=True) as program:
        try:
            wait_for(tmp_path, {})
            with stopped(program.pid):
                before = sizes(tmp_path)
                time.sleep(0.1)
                assert sizes(tmp_path) == before
            wait_for(tmp_path, before)
            with pytest.raises(OSError, match="in it"), stopped(program.pid):
                raise OSError("in it")
            assert program.wait(LONGEST_S) == -signal.SIGKILL
            after = sizes(tmp_path)
            time.sleep(0.1)
            assert sizes(tmp_path) == after
        finally:
            with suppress(ProcessLookupError):
                os.killpg(program.pid, signal.SIGKILL)
