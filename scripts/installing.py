"""What the scripts share that install something: a lock, a folder for what is kept, and Debian's packages.

They run before furrowmap is installed, on Linux, macOS and Windows: only the standard library is used.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[1]


class CannotInstallError(Exception):
    """Something is missing and cannot be installed here; one line for the user."""


def kept(name: str) -> Path:
    """A path in the user's cache, in a folder that exists."""
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "furrowmap"
    folder.mkdir(parents=True, exist_ok=True)
    return folder / name


def digest(paths: Iterable[Path]) -> str:
    """Sixteen hexadecimal digits that change with the content of these files."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest()[:16]


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Wait until no other process is in here with the same file."""
    with path.open("a") as file:
        try:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX)
        except ModuleNotFoundError:  # Windows
            import msvcrt

            while True:
                with suppress(OSError):  # raised after ten seconds of waiting
                    msvcrt.locking(file.fileno(), msvcrt.LK_LOCK, 1)
                    break
        yield  # closing the file ends the lock


def apt_install(what: str, *arguments: str) -> None:
    """Install Debian packages.

    Args:
        what: the name of what is missing, for messages.
        arguments: packages, and options of apt-get.

    Raises:
        CannotInstallError: without apt-get, for users other than root, and if apt-get fails.
    """
    if not shutil.which("apt-get"):
        raise CannotInstallError(f"{what} is not installed, and there is no apt-get here")
    if os.geteuid() != 0:
        raise CannotInstallError(f"{what} is not installed, and only root can install it (Debian: {arguments[-1]})")
    settings = os.environ | {"DEBIAN_FRONTEND": "noninteractive"}
    install = ["apt-get", "install", "-y", "-qq", "--no-install-recommends", *arguments]
    for command in (["apt-get", "update", "-qq"], install):
        done = subprocess.run(command, env=settings, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            reason = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
            raise CannotInstallError(f"{what} cannot be installed: {reason}")
