"""What may have the name of a file that is going to be written: everything but a regular file of its own."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

OBSTACLES: Final = (
    "symbolic link",
    "dangling link",
    "hard link",
    "link to a folder",
    "link to a device",
    "fifo",
    "read fifo",
    "socket",
    "folder",
)
CONTENT: Final = "a file of the user\n"


@contextmanager
def obstacle(path: Path, kind: str) -> Iterator[Callable[[], None]]:
    """Something of a kind at `path`; yields the check that what it leads to, beside `path`, is unchanged."""
    victim = path.parent.parent / f"{path.parent.name} of the user"
    victim.mkdir(exist_ok=True)
    file = victim / "file"
    file.write_text(CONTENT)
    listener = socket.socket(socket.AF_UNIX)
    received: list[bytes] = []
    reader: int | None = None
    if kind == "symbolic link":
        path.symlink_to(file)
    elif kind == "dangling link":
        path.symlink_to(victim / "none")
    elif kind == "hard link":
        path.hardlink_to(file)
    elif kind == "link to a folder":
        path.symlink_to(victim)
    elif kind == "link to a device":
        path.symlink_to(os.devnull)
    elif kind in ("fifo", "read fifo"):
        os.mkfifo(path)
        reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK) if kind == "read fifo" else None
    elif kind == "socket":
        with _in_folder(path.parent):
            listener.bind(path.name)
    else:
        path.mkdir()

    def unchanged() -> None:
        assert sorted(item.name for item in victim.iterdir()) == ["file"]
        assert file.read_text() == CONTENT
        if reader is not None:
            with suppress(BlockingIOError):
                received.append(os.read(reader, 100))
            assert not b"".join(received)

    try:
        yield unchanged
    finally:
        listener.close()
        if reader is not None:
            os.close(reader)


@contextmanager
def _in_folder(folder: Path) -> Iterator[None]:
    """Paths of sockets have 107 bytes at most."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)
