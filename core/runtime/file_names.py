"""Names that were read from a file and become paths: they stay inside the folder that they belong to."""

import errno
import fnmatch
import os
import re
import unicodedata
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.plain_reads import read_plain_bytes

MAX_NAME_BYTES: Final = 255
"""Longest name of a file, in UTF-8, on the usual file systems."""
_RESERVED: Final = re.compile(r"(?i:con|prn|aux|nul|conin\$|conout\$|com[0-9¹²³]|lpt[0-9¹²³])\s*([.:].*)?", re.DOTALL)
"""Names of devices on Windows, with any suffix."""
_DRIVE: Final = re.compile(r"[A-Za-z]:")
_CONTROL: Final = frozenset({"Cc", "Cs", "Zl", "Zp"})
"""Unicode categories: control characters, halves of surrogate pairs, separators of lines and paragraphs."""


def is_file_name(name: str) -> bool:
    """Whether `name` is the name of one file inside a folder, on every system.

    It has no separator, drive letter, control character or trailing dot or space (which Windows drops), is no device of
    Windows, and not too long.
    """
    return (
        0 < len(name.encode(errors="surrogatepass")) <= MAX_NAME_BYTES
        and name == name.rstrip(". ")
        and not any(c in "/\\" or unicodedata.category(c) in _CONTROL for c in name)
        and _DRIVE.match(name) is None
        and _RESERVED.fullmatch(name) is None
    )


def is_portable_name(name: str) -> bool:
    """Whether a new file may have this name on every system: Windows takes some characters in no name at all."""
    return is_file_name(name) and not any(c in '<>:"|?*' for c in name)


def is_relative_name(name: str) -> bool:
    """Whether `name` is the path of one file below a folder, with slashes: each part is :func:`is_file_name`."""
    return all(is_file_name(part) for part in name.split("/"))


def is_network_path(name: str) -> bool:
    """Whether Windows would look for a path at another computer (UNC), or at a device: it begins with two slashes."""
    return name.replace("\\", "/").startswith("//")


def resolved(path: Path) -> Path:
    """`path` without links, as far as they can be followed: `Path.resolve` raises RuntimeError for a circle of links.

    Raises OSError or ValueError for a name that no file can have: too long, or with a null byte.
    """
    return Path(os.path.realpath(path))


def leads_out(path: Path, folder: Path) -> bool:
    """Whether `path`, after following links, is outside `folder`, or cannot be followed."""
    try:
        place = resolved(path)
        is_circle = os.path.islink(place)  # noqa: PTH114 (of a name that is too long, too)
        return is_circle or not place.is_relative_to(resolved(folder))
    except (OSError, ValueError):  # too long, or a null byte
        return True


def found_beside(folder: Path, pattern: str = "*") -> list[Path]:
    """The files of a folder that nobody named, by name: no pipe or device, and no link that leads out of it."""
    return [path for path in sorted(folder.glob(pattern)) if path.is_file() and not leads_out(path, folder)]


def inside(folder: Path, name: str, source: Path) -> Path:
    """The path of a file in `folder` whose name was read from `source`.

    InputError if the name is not that of one file in the folder, or that file is a link that leads out of it.
    """
    if is_file_name(name) and not leads_out(folder / name, folder):
        return folder / name
    raise InputError("name-outside", source=source, name=name, folder=folder)


def read_own(folder: Path, name: str) -> bytes:
    """The bytes of a file of a folder, such as a report among earlier products.

    Raises OSError, also for what is no regular file, and for a link that leads out of the folder.
    """
    return read_plain_bytes(own_file(folder, name))


def own_file(folder: Path, name: str) -> Path:
    """The path of a file of a folder. Raises OSError for a link that leads out of it."""
    path = folder / name
    if leads_out(path, folder):
        raise OSError(errno.ELOOP, "it is a link that leads out of its folder", str(path))
    return path


MAX_ENTRIES: Final = 200_000
"""Files and folders that a pattern is compared with."""


class LeavesFolder(Exception):
    """A pattern leads out of its folder."""


class TooManyEntries(Exception):
    """A pattern is compared with more than :data:`MAX_ENTRIES` files and folders."""


def matching(folder: Path, pattern: str) -> list[Path]:
    """The files and folders below one that match a pattern such as `images/*.jpg` or `**/*.jpg`, sorted.

    Raises:
        LeavesFolder: if the pattern is absolute, has a part `..`, or follows a link out of the folder.
        TooManyEntries: if there is too much to search.
        OSError: if a folder cannot be read.
    """
    parts = [part for part in pattern.replace("\\", "/").split("/") if part not in ("", ".")]
    if pattern.startswith(("/", "\\")) or _DRIVE.match(pattern) or ".." in parts or "\0" in pattern:
        raise LeavesFolder
    found: dict[Path, None] = {}
    count = 0
    # places are looked at one after another, each with the parts of the pattern that remain
    waiting: list[tuple[Path, int]] = [(folder, 0)]
    seen: set[tuple[Path, int]] = set()
    while waiting:
        state = waiting.pop()
        if state in seen:
            continue
        seen.add(state)
        place, k = state
        if k == len(parts):
            found[place] = None
            continue
        if place.is_symlink() and leads_out(place, folder):
            raise LeavesFolder
        if parts[k] == "**":
            waiting.append((place, k + 1))
        for entry in _entries(place):
            count += 1
            if count > MAX_ENTRIES:
                raise TooManyEntries
            if parts[k] == "**":
                if entry.is_dir(follow_symlinks=False):
                    waiting.append((Path(entry.path), k))
            elif fnmatch.fnmatch(entry.name, parts[k]):
                waiting.append((Path(entry.path), k + 1))
    return sorted(found)


def _entries(place: Path) -> Iterator[os.DirEntry[str]]:
    if place.is_dir():
        with os.scandir(place) as entries:
            yield from entries
