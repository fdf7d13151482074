"""Leases: one run at a time writes to a folder, whichever hosts and containers share it.

A run has a folder of its own in the folder it writes to; its name states the process. A thread of the run changes a
file in it every second. Whether a run of this machine still exists is seen at once. A run of another machine has ended
if its file does not change while one watches, so no clocks are compared.
"""

import atexit
import os
import platform
import re
import secrets
import shutil
import stat
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from furrowmap.core.runtime.errors import RefusedError, printable
from furrowmap.exporters.files.owner import PATTERN, Owner

PREFIX: Final = ".furrowmap-run-"
STAGED_PRODUCTS: Final = "products"
"""Folder in a lease whose files become products together."""
COMPLETE: Final = "complete.json"
"""File in a lease whose products are valid; it names them. With it, the folder stays until they are in their places."""
BEAT_S: Final = 1.0
"""Time between two changes of the heartbeat."""
MAX_SILENCE_S: Final = 10.0
"""A heartbeat that does not change for so long has stopped."""
_POLL_S: Final = 0.1
_NAME: Final = re.compile(rf"{re.escape(PREFIX)}({PATTERN})-[0-9a-f]{{8}}")
_HEARTBEAT: Final = "heartbeat"
_HOLDS: Final = "holds"
"""Marks the lease that may write; one without it has just been asked for."""
_ENDED: Final = "ended"
"""Marks a lease whose run has been found to have ended."""
_MAX_SMALL_BYTES: Final = 16 << 20


@contextmanager
def hold_lease(folder: Path) -> Iterator[Path]:
    """Keep other runs from writing to `folder`.

    Yields a folder of one's own inside `folder`, which is removed at the end, unless it has a file COMPLETE. Raises
    RefusedError if another run is writing there.
    """
    own = folder / f"{PREFIX}{Owner.here().words()}-{secrets.token_hex(4)}"
    own.mkdir()
    stopped = threading.Event()
    _put_beat(own / _HEARTBEAT, 1)  # before another run can ask whose it is
    heart = threading.Thread(target=_beat, args=(own / _HEARTBEAT, stopped), daemon=True)
    heart.start()
    try:
        _await_turn(folder, own)
        yield own
    finally:
        stopped.set()
        heart.join()
        if not (own / COMPLETE).exists():
            shutil.rmtree(own, ignore_errors=True)
        if own.exists():
            with suppress(OSError):
                (own / _ENDED).touch()
        if own.exists() and not (own / COMPLETE).exists():  # Windows keeps the folder of a scratch file that is mapped
            atexit.register(shutil.rmtree, own, ignore_errors=True)


def leases(folder: Path) -> list[Path]:
    """The leases of `folder`, of runs that are writing or have ended without removing theirs."""
    return sorted(path for path in folder.glob(f"{PREFIX}*") if _NAME.fullmatch(path.name) and is_real_folder(path))


def is_staged(file: Path) -> bool:
    """Whether a file is among those that become products together, and are flushed to the disk before they do."""
    return any(
        place.name == STAGED_PRODUCTS and _NAME.fullmatch(place.parent.name) is not None
        for place in list(file.parents)[:2]
    )


def refuse_leased(folder: Path, own: Path | None = None) -> list[Path]:
    """Leases of ended runs; raises RefusedError if a run, other than that of the lease `own`, is writing there."""
    others = [lease for lease in leases(folder) if lease != own]
    for lease in others:
        if _is_alive(lease):
            raise _busy(folder, lease)
    return others


def is_revoked(lease: Path) -> bool:
    """Whether another run has found the run of this lease to have ended, as after hours of sleep."""
    return not lease.is_dir() or (lease / _ENDED).exists()


def is_real_folder(path: Path) -> bool:
    """Whether `path` is a folder, not a link to one."""
    return path.is_dir() and not path.is_symlink() and not getattr(path, "is_junction", bool)()


def read_small(path: Path) -> bytes:
    """The content of a small regular file; empty for anything else, such as a link or a pipe."""
    try:
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
    except (OSError, ValueError):
        return b""
    with os.fdopen(descriptor, "rb") as file:
        status = os.fstat(descriptor)
        regular = stat.S_ISREG(status.st_mode) and status.st_size <= _MAX_SMALL_BYTES
        return file.read(_MAX_SMALL_BYTES) if regular else b""


def _await_turn(folder: Path, own: Path) -> None:
    """Take the lease that `own` asks for.

    Of several runs that ask at a time, the one whose lease is the first by name gets it: each lists the leases after it
    has made its own, so that of any two at least one sees the other.
    """
    while True:
        alive = [lease for lease in leases(folder) if lease != own and _is_alive(lease)]
        rival = next((lease for lease in alive if lease < own or (lease / _HOLDS).exists()), None)
        if rival is not None:
            raise _busy(folder, rival)
        if not alive:
            (own / _HOLDS).touch(exist_ok=False)
            return
        time.sleep(_POLL_S)


def _is_alive(lease: Path) -> bool:
    """Whether the run of a lease still exists; one that does not is marked."""
    if (lease / _ENDED).exists():
        return False
    owner = _owner(lease)
    running = owner.is_running() if owner is not None else None
    if running is None:
        running = _beats(lease)
    if not running:
        with suppress(OSError):  # read-only, or removed meanwhile
            (lease / _ENDED).touch(exist_ok=False)
    return running


def _beats(lease: Path) -> bool:
    """Whether the heartbeat of a lease changes within MAX_SILENCE_S."""
    first = read_small(lease / _HEARTBEAT)
    until = time.monotonic() + MAX_SILENCE_S
    while lease.is_dir() and time.monotonic() < until:
        time.sleep(_POLL_S)
        if read_small(lease / _HEARTBEAT) != first:
            return True
    return False


def _beat(file: Path, stopped: threading.Event) -> None:
    """Change the file until `stopped`; an error leaves it as it is, and the lease is lost after a while."""
    count = 1
    while not stopped.wait(BEAT_S):
        count += 1
        _put_beat(file, count)


def _put_beat(file: Path, count: int) -> None:
    with suppress(OSError):
        # In its place, so that a full disk does not matter.
        descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0))
        try:
            os.write(descriptor, f"{count:09} {platform.node()}".encode()[:200])
        finally:
            os.close(descriptor)


def _busy(folder: Path, lease: Path) -> RefusedError:
    host = printable(read_small(lease / _HEARTBEAT)[10:].decode(errors="replace"))
    owner = _owner(lease)
    process = owner.process if owner is not None else None
    return RefusedError("output-busy", folder=folder, process=process, host=host or None)


def _owner(lease: Path) -> Owner | None:
    """The process of a lease."""
    match = _NAME.fullmatch(lease.name)
    return Owner.parse(match[1]) if match else None
