"""The files of a set of task data: a folder, or a zip archive of it."""

from __future__ import annotations

import stat
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Final

from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.file_names import is_file_name, leads_out
from furrowmap.core.runtime.limits import expect_growth, expect_memory

MAIN: Final = "TASKDATA.XML"
MAX_ARCHIVE_FILES: Final = 100_000
MAX_FILE_BYTES: Final = 1 << 30
"""Largest plausible file: the time log of a day has a few megabytes."""


@dataclass(frozen=True)
class TaskFiles:
    """Files of a folder or archive by name, ignoring case, because terminals write names in either."""

    path: Path
    notices: tuple[Notice, ...]
    _readers: dict[str, Callable[[], bytes]]

    def named(self, name: str) -> str:
        """Path of one of the files for messages."""
        return f"{self.path}, {name}"

    def read(self, name: str) -> bytes:
        """The content of a file; InputError if it is missing, too large, or damaged."""
        reader = self._readers.get(name.upper())
        if reader is None:
            raise InputError("task-data-incomplete", path=self.path, name=name)
        try:
            return reader()
        except Exception as error:  # noqa: BLE001 damage ends in errors of many families
            raise InputError("task-data-unreadable.read", name=self.named(name), error=error) from None


def open_task_files(path: Path) -> TaskFiles:
    """The files next to the only TASKDATA.XML in a folder or archive; `path` may also be that file.

    InputError if there is none or more than one, or the archive is damaged or hostile.
    """
    if not path.is_dir() and path.name.upper() != MAIN:
        return _open_archive(path)
    folder = path if path.is_dir() else path.parent
    inside = folder / _folder_of_main(folder, _folder_names(folder))
    files = [p for p in sorted(inside.iterdir()) if p.is_file() and not leads_out(p, inside)]
    return TaskFiles(folder, (), {p.name.upper(): partial(_read_file, p) for p in files})


def is_task_data(path: Path) -> bool:
    """Whether a folder or archive has a TASKDATA.XML, or a file is one."""
    if path.is_dir():
        return bool(_mains(_folder_names(path)))
    if path.name.upper() == MAIN:
        return True
    try:
        with zipfile.ZipFile(path) as archive:
            return bool(_mains(archive.namelist()))
    except Exception:  # noqa: BLE001 damage ends in errors of many families
        return False


def _folder_names(folder: Path) -> list[str]:
    """Files in the folder and in its subfolders: where terminals put TASKDATA."""
    try:
        files = [p for p in folder.iterdir() if p.is_file()]
        files += [p for below in folder.iterdir() if below.is_dir() for p in below.glob("*") if p.is_file()]
    except OSError:
        return []
    return [p.relative_to(folder).as_posix() for p in files]


def _mains(names: list[str]) -> list[str]:
    """Names of main files, without the resource files of macOS."""
    paths = [PurePosixPath(name) for name in names]
    return [p.as_posix() for p in paths if p.name.upper() == MAIN and not any("MACOSX" in part for part in p.parts)]


def _folder_of_main(path: Path, names: list[str]) -> PurePosixPath:
    """The folder, inside `path`, of the main file."""
    mains = _mains(names)
    if len(mains) == 1:
        return PurePosixPath(mains[0]).parent
    if mains:
        raise InputError("task-data-ambiguous", path=path, mains=len(mains), mains_list=", ".join(sorted(mains)[:4]))
    held = ", ".join(sorted(PurePosixPath(name).name for name in names)[:4]) or "nothing"
    raise InputError("task-data-missing.one-main", path=path, held=held)


def _read_file(path: Path) -> bytes:
    if path.stat().st_size > MAX_FILE_BYTES:
        raise OSError(f"{path.stat().st_size:,} bytes is more than any task data")
    return path.read_bytes()


def _open_archive(path: Path) -> TaskFiles:
    try:
        with zipfile.ZipFile(path) as archive:
            found = archive.infolist()
    except Exception as error:  # noqa: BLE001 damage ends in errors of many families
        raise InputError("task-data-unreadable", path=path, error=error) from None
    ahead = min((entry.header_offset for entry in found), default=0)
    entries = [entry for entry in found if not entry.filename.endswith("/")]
    expect_growth(path, path.stat().st_size, sum(entry.file_size for entry in entries))
    expect_memory(path, max((entry.file_size for entry in entries), default=0))
    if fault := _hostile_entry(entries):
        raise InputError("archive-hostile", path=path, fault=fault)
    inside = _folder_of_main(path, [entry.filename for entry in entries])
    here = [entry for entry in entries if PurePosixPath(entry.filename).parent == inside]
    notices = (Notice("archive-foreign-bytes", path=path, ahead=ahead),) * (ahead > 0)
    readers: dict[str, Callable[[], bytes]] = {
        PurePosixPath(entry.filename).name.upper(): partial(_read_entry, path, entry) for entry in here
    }
    return TaskFiles(path, notices, readers)


def _read_entry(path: Path, entry: zipfile.ZipInfo) -> bytes:
    with zipfile.ZipFile(path) as archive, archive.open(entry) as stream:
        data = stream.read(entry.file_size + 1)
    if len(data) != entry.file_size:
        raise zipfile.BadZipFile(f"{len(data):,} bytes instead of the {entry.file_size:,} that the archive states")
    return data


def _hostile_entry(entries: list[zipfile.ZipInfo]) -> str:
    """What is hostile about the first entry that is; "" without."""
    if len(entries) > MAX_ARCHIVE_FILES:
        return f"it has {len(entries):,} files"
    for entry in entries:
        # A backslash separates folders in archives of some programs for Windows.
        parts = PurePosixPath(entry.filename.replace("\\", "/")).parts
        if not parts or not all(map(is_file_name, parts)):
            return f"the name {entry.filename!r} points outside the archive"
        if stat.S_ISLNK(entry.external_attr >> 16):
            return f"{entry.filename!r} is a link"
    return ""
