"""Files of anybody are regular ones: reading a pipe waits for ever, and a device such as `/dev/zero` has no end."""

import errno
import stat
from pathlib import Path
from typing import BinaryIO


def expect_plain_file(path: Path) -> None:
    """Raises OSError for a pipe, a socket or a device, and for a link to one; and if there is nothing."""
    mode = path.stat().st_mode
    if stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode) or stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
        raise OSError(errno.EINVAL, "it is no file, but a pipe, a socket or a device", str(path))


def open_plain(path: Path) -> BinaryIO:
    """A regular file, opened to be read as bytes. Raises OSError, also for what is none."""
    expect_plain_file(path)
    return path.open("rb")


def read_plain_bytes(path: Path) -> bytes:
    """The bytes of a regular file. Raises OSError, also for what is none."""
    expect_plain_file(path)
    return path.read_bytes()


def read_plain_text(path: Path, encoding: str = "utf-8", errors: str = "strict") -> str:
    """The text of a regular file. Raises OSError, also for what is none, and UnicodeDecodeError."""
    expect_plain_file(path)
    return path.read_text(encoding, errors)
