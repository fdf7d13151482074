"""The files of a set of task data: a folder, or a zip archive that holds one."""

from __future__ import annotations

import stat
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Final

from furrowmap.core.values.errors import InputError, Notice

MAIN: Final = "TASKDATA.XML"
MOST_FILES: Final = 100_000
LARGEST_BYTES: Final = 1 << 30
"""A day's time log has a few megabytes; more than this is none."""
MOST_GROWTH: Final = 1100
"""Deflate shrinks a file to a thousandth at best: an archive that promises more lies."""


@dataclass(frozen=True)
class TaskFiles:
    """Files by name; names are compared without regard to case, as terminals write them either way.

    Attributes:
        path: of the folder or archive, for messages.
        notices: what was odd about it.
    """

    path: Path
    notices: tuple[Notice, ...]
    _readers: dict[str, Callable[[], bytes]]

    def named(self, name: str) -> str:
        """How messages call one of the files."""
        return f"{self.path}, {name}"

    def names(self) -> list[str]:
        """The names, in capitals."""
        return sorted(self._readers)

    def __contains__(self, name: str) -> bool:
        return name.upper() in self._readers

    def read(self, name: str) -> bytes:
        """The content of a file.

        Raises:
            InputError: if it is not there, too large, or damaged.
        """
        reader = self._readers.get(name.upper())
        if reader is None:
            raise InputError(
                f"{self.path}: there is no file {name} in it.",
                "The task data name it, so a part of them is missing.",
                "Copy the whole TASKDATA folder from the terminal.",
                code="task-data-incomplete",
            )
        try:
            return reader()
        except (OSError, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError) as error:
            raise InputError(
                f"{self.named(name)}: {error}.",
                "The file is damaged or locked, so its content is lost.",
                "Copy the task data again; a zip archive with a password must be unpacked first.",
                code="task-data-unreadable",
            ) from None


def open_task_files(path: Path) -> TaskFiles:
    """The files beside the one TASKDATA.XML in a folder or archive; `path` may also name that file itself.

    Raises:
        InputError: if there is none or more than one, the archive is damaged, or a name in it leads out of it.
    """
    if path.is_dir():
        return _of_folder(path)
    if path.name.upper() == MAIN:
        return _of_folder(path.parent)
    return _of_archive(path)


def is_task_data(path: Path) -> bool:
    """Whether a folder or archive holds a TASKDATA.XML, or a file is one."""
    if path.is_dir():
        return bool(_mains(_folder_names(path)))
    if path.name.upper() == MAIN:
        return True
    try:
        with zipfile.ZipFile(path) as archive:
            return bool(_mains(archive.namelist()))
    except (OSError, zipfile.BadZipFile, ValueError, NotImplementedError):
        return False


def _folder_names(folder: Path) -> list[str]:
    """Files in the folder and those one below: where terminals put TASKDATA."""
    try:
        files = [p for p in folder.iterdir() if p.is_file()]
        files += [p for below in folder.iterdir() if below.is_dir() for p in below.glob("*") if p.is_file()]
    except OSError:
        return []
    return [p.relative_to(folder).as_posix() for p in files]


def _mains(names: list[str]) -> list[str]:
    """Names of main files; not those under which macOS keeps its own about them."""
    paths = [PurePosixPath(name) for name in names]
    return [p.as_posix() for p in paths if p.name.upper() == MAIN and not any("MACOSX" in part for part in p.parts)]


def _one_main(path: Path, names: list[str]) -> PurePosixPath:
    """The folder, inside `path`, of the main file.

    Raises:
        InputError: if there is none, or more than one.
    """
    mains = _mains(names)
    if len(mains) == 1:
        return PurePosixPath(mains[0]).parent
    if mains:
        raise InputError(
            f"{path}: there are {len(mains)} of {MAIN} in it: {', '.join(sorted(mains)[:4])}.",
            "Which of them is meant cannot be known.",
            "Give the folder of the one, or unpack the archive and give that.",
            code="task-data-ambiguous",
        )
    held = ", ".join(sorted(PurePosixPath(name).name for name in names)[:4]) or "nothing"
    raise InputError(
        f"{path}: there is no {MAIN} in it (but {held}).",
        f"{MAIN} says what the other files of task data mean; without it none can be read.",
        "Copy the whole TASKDATA folder from the terminal.",
        code="task-data-missing",
    )


def _of_folder(folder: Path) -> TaskFiles:
    names = _folder_names(folder)
    inside = folder / _one_main(folder, names)
    files = [p for p in sorted(inside.iterdir()) if p.is_file() and p.resolve().is_relative_to(inside.resolve())]
    return TaskFiles(folder, (), {p.name.upper(): partial(_read_file, p) for p in files})


def _read_file(path: Path) -> bytes:
    if path.stat().st_size > LARGEST_BYTES:
        raise OSError(f"{path.stat().st_size:,} bytes, more than any task data")
    return path.read_bytes()


def _of_archive(path: Path) -> TaskFiles:
    try:
        archive = zipfile.ZipFile(path)
    except (OSError, zipfile.BadZipFile, ValueError, NotImplementedError) as error:
        raise InputError(
            f"{path}: {error}.",
            "It is no zip archive, or a damaged one, so no task data can be read from it.",
            "Give the TASKDATA folder, its TASKDATA.XML, or an archive of it.",
            code="task-data-unreadable",
        ) from None
    with archive:
        ahead = min((entry.header_offset for entry in archive.infolist()), default=0)
        entries = [entry for entry in archive.infolist() if not entry.is_dir()]
        _refuse_hostile(path, entries)
        inside = _one_main(path, [entry.filename for entry in entries])
        here = [entry for entry in entries if PurePosixPath(entry.filename).parent == inside]
    notices = [
        Notice("archive-foreign-bytes", f"{path}: {ahead:,} bytes that are none of its own stand before the archive.")
    ] * (ahead > 0)
    return TaskFiles(
        path,
        tuple(notices),
        {PurePosixPath(entry.filename).name.upper(): partial(_read_entry, path, entry) for entry in here},
    )


def _read_entry(path: Path, entry: zipfile.ZipInfo) -> bytes:
    with zipfile.ZipFile(path) as archive, archive.open(entry) as stream:
        data = stream.read(entry.file_size + 1)
    if len(data) != entry.file_size:
        raise zipfile.BadZipFile(f"{len(data):,} bytes where the archive promises {entry.file_size:,}")
    return data


def _refuse_hostile(path: Path, entries: list[zipfile.ZipInfo]) -> None:
    """Refuse archives made to do harm.

    Raises:
        InputError: if a name leads out of the archive, an entry is a link, or it promises more than it can hold.
    """
    fault = ""
    if len(entries) > MOST_FILES:
        fault = f"it holds {len(entries):,} files"
    for entry in entries:
        name = entry.filename.replace("\\", "/")
        if name.startswith("/") or ".." in name.split("/") or ":" in name:
            fault = f"the name {entry.filename!r} leads out of it"
        elif stat.S_ISLNK(entry.external_attr >> 16):
            fault = f"{entry.filename!r} is a link"
        elif entry.file_size > min(LARGEST_BYTES, MOST_GROWTH * max(entry.compress_size, 1)):
            fault = f"{entry.filename!r} promises {entry.file_size:,} bytes from {entry.compress_size:,}"
        if fault:
            break
    if fault:
        raise InputError(
            f"{path}: {fault}.",
            "No terminal writes such an archive; nothing in it was used.",
            "Unpack it where nothing can be harmed, look at it, and give the TASKDATA folder.",
            code="archive-hostile",
        )
