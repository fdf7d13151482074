"""Whether a file is opened, and an address asked for, while something runs (inotify(7), which Linux has)."""

from __future__ import annotations

import ctypes
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

_IN_ACCESS = 0x1
_IN_OPEN = 0x20
POLL_S = 0.02
"""So soon a server ends that is to end."""


class Bait:
    """A file and an address that nothing has a reason to open."""

    def __init__(self, file: Path, port: int, asked: list[str], descriptor: int) -> None:
        self.file = file
        self.url = f"http://127.0.0.1:{port}/bait"
        self._asked = asked
        self._descriptor = descriptor

    def taken(self) -> bool:
        """Whether the file was opened or the address asked for since the last call."""
        try:
            opened = len(os.read(self._descriptor, 65536)) > 0
        except BlockingIOError:
            opened = False
        asked = bool(self._asked)
        self._asked.clear()
        return opened or asked


@contextmanager
def bait_beside(folder: Path) -> Iterator[Bait]:
    """A bait in a folder of its own; skips where a system does not tell of opened files."""
    if sys.platform != "linux":
        pytest.skip("needs inotify")
    asked: list[str] = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path)
            self.send_error(404)

        def do_HEAD(self) -> None:
            self.do_GET()

        def log_message(self, *_: object) -> None:
            pass

    file = folder / "bait" / "secret.csv"
    file.parent.mkdir()
    file.write_text("id,x,y,z\n1,1,1,1\n")
    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(POLL_S,), daemon=True)
    thread.start()
    libc = ctypes.CDLL(None, use_errno=True)
    descriptor = libc.inotify_init1(os.O_NONBLOCK)
    assert descriptor >= 0
    assert libc.inotify_add_watch(descriptor, os.fsencode(file), _IN_ACCESS | _IN_OPEN) >= 0
    try:
        yield Bait(file, server.server_address[1], asked, descriptor)
    finally:
        os.close(descriptor)
        server.shutdown()
        server.server_close()
        thread.join()
