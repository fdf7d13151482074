"""Leases in a store: one host at a time writes to a folder of an object store or a server.

As in a folder of the disk (:mod:`furrowmap.exporters.files.lease`), but a store has neither folders of one's own nor
renaming: each writer has a file, which a thread changes, and lists those of others after it has written its own. Stores
list what has been written (Amazon S3 since 2020), so of any two writers at least one sees the other. A writer whose
file does not change while one watches has ended; its file is removed. Clocks are not compared.
"""

from __future__ import annotations

import platform
import posixpath
import secrets
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, Final

from furrowmap.core.runtime.errors import RefusedError, printable
from furrowmap.exporters.files.lease import PREFIX

STORE_BEAT_S: Final = 5.0
"""Time between two changes of a file."""
MAX_STORE_SILENCE_S: Final = 60.0
"""A file that does not change for so long is of a writer that has ended: a store may be busy or out of reach."""
_LOOK_AGAIN_S: Final = 1.0
_WRITES: Final = b"writes "
_ASKS: Final = b"asks "


@contextmanager
def hold_store_lease(system: Any, root: str, shown: str) -> Iterator[Callable[[], None]]:
    """Keep others from writing to a folder of a store.

    Args:
        system: file system of fsspec.
        root: path of the folder in it.
        shown: its URL, for messages.

    Yields:
        A function that raises RefusedError if another writer has taken over the folder.

    Raises:
        RefusedError: if another writer is there.
    """
    own = f"{root}/{PREFIX}{secrets.token_hex(8)}"
    stopped, holds = threading.Event(), threading.Event()
    _write(system, own, 0, holds)
    heart = threading.Thread(target=_beat, args=(system, own, stopped, holds), daemon=True)
    heart.start()

    def expect_held() -> None:
        there = _leases(system, root)
        # one that has just been removed may have been written again by its own thread
        if own not in there or any(_content(system, lease).startswith(_WRITES) for lease in there if lease != own):
            raise RefusedError("output-lost", folder=shown)

    try:
        _await_turn(system, root, own, shown)
        holds.set()
        _write(system, own, 0, holds)
        yield expect_held
    finally:
        stopped.set()
        heart.join()
        with suppress(Exception):  # it may be gone, or the store out of reach: then others wait a while
            system.rm_file(own)


def _await_turn(system: Any, root: str, own: str, shown: str) -> None:
    """Wait until no other writer is there; those whose file is later by name give up."""
    seen: dict[str, tuple[bytes, float]] = {}
    while True:
        others = [lease for lease in _leases(system, root) if lease != own]
        for lease in others:
            content = _content(system, lease)
            before, since = seen.get(lease, (b"", 0.0))
            if content != before:
                alive = bool(before)
                seen[lease] = (content, time.monotonic())
                if alive and (lease < own or content.startswith(_WRITES)):
                    host = printable(content.split(b" ", 2)[-1].decode(errors="replace"))
                    raise RefusedError("output-busy", folder=shown, process=None, host=host or None)
            elif time.monotonic() - since > MAX_STORE_SILENCE_S:
                with suppress(FileNotFoundError):
                    system.rm_file(lease)
        if not others:
            return
        time.sleep(_LOOK_AGAIN_S)


def _content(system: Any, lease: str) -> bytes:
    """Of a lease; empty where it has been removed meanwhile."""
    try:
        content: bytes = system.cat_file(lease)
    except FileNotFoundError:
        return b""
    return content


def _leases(system: Any, root: str) -> list[str]:
    system.invalidate_cache()
    listed = [f"{root}/{posixpath.basename(str(path))}" for path in system.ls(root, detail=False)]
    return sorted(path for path in listed if posixpath.basename(path).startswith(PREFIX))


def _write(system: Any, own: str, count: int, holds: threading.Event) -> None:
    state = _WRITES if holds.is_set() else _ASKS
    system.pipe_file(own, state + f"{count:09} {platform.node()}".encode())


def _beat(system: Any, own: str, stopped: threading.Event, holds: threading.Event) -> None:
    """Change the file until `stopped`, unless another writer has removed it."""
    count = 0
    while not stopped.wait(STORE_BEAT_S):
        count += 1
        with suppress(Exception):  # whatever a store raises: the lease is lost if it goes on
            if system.exists(own):
                _write(system, own, count, holds)
