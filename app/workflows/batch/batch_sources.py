"""What a batch works through: session files, and folders of recordings without one."""

import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.file_names import is_portable_name, resolved
from furrowmap.core.runtime.urls import without_passwords
from furrowmap.exporters.files.batch_state import Stamp
from furrowmap.exporters.files.result_folder import PREVIEW_REPORT, REPORT, SESSION_FILE

SCAN_SUFFIXES: Final = frozenset({".pcap", ".pcapng", ".bag", ".mcap", ".db3"})
"""Suffixes of recordings that show a folder to be one of recordings."""
_PACKED: Final = frozenset({".gz", ".zst", ".xz", ".bz2"})


@dataclass(frozen=True)
class BatchSource:
    """A session file, or a folder of recordings.

    Attributes:
        file: path of the session file; in a folder of recordings, of the one that would be there.
        parts: names of the folders from the one given by the user to this one.
        made: whether the session is made from the recordings in the folder.
        stamps: the session file, or all files of the folder of recordings; in a store all files of the folder.
        url: of the folder, if it is in a store; `file` is then the session's name in it.
    """

    file: Path
    parts: tuple[str, ...]
    made: bool
    stamps: tuple[Stamp, ...]
    url: str = ""

    @property
    def place(self) -> str:
        """Path of the session file, or its URL without a password: what is shown and stored."""
        return without_passwords(f"{self.url}/{self.file.name}") if self.url else str(self.file)


def find_sources(folders: Sequence[Path], results: Path) -> list[BatchSource]:
    """The sources in folders and the folders below, in the order of their paths.

    Results of runs, hidden folders and the folder of the batch's own results are left out.
    """
    found: dict[Path, BatchSource] = {}
    for folder in folders:
        if folder.is_file():
            path = resolved(folder)
            found.setdefault(path, BatchSource(path, (path.parent.name,), made=False, stamps=(stamp(path),)))
        elif folder.is_dir():
            for source in _below(resolved(folder), resolved(results)):
                found.setdefault(source.file, source)
        else:
            raise InputError("batch-no-folder", folder=folder)
    return [found[path] for path in sorted(found)]


def stamp(path: Path) -> Stamp:
    """A file as it is now; its content is not read."""
    status = path.stat()
    return Stamp(str(path), status.st_size, str(status.st_mtime_ns))


def assign_names(sources: Iterable[tuple[str, Sequence[str]]], known: Mapping[str, str]) -> dict[str, str]:
    """A name for each source, given by its identity and its folders; it is that of its result folder.

    A source keeps the name that it has. Others are named after their folders, with a few digits of a hash where that
    name is taken.
    """
    wanted = dict(sources)
    names = {identity: known[identity] for identity in wanted if identity in known}
    taken = {name.casefold() for name in known.values()}
    for identity, parts in wanted.items():
        if identity not in names:
            name = "_".join(part for part in parts if part) or "session"
            if not is_portable_name(name) or name.startswith(".") or len(name) > 120 or name.casefold() in taken:
                usable = "".join(c if c.isalnum() or c in " -_.()" else "-" for c in name).strip(" .")[:100]
                name = f"{usable}-{hashlib.sha256(identity.encode(errors='surrogatepass')).hexdigest()[:6]}"
            names[identity] = name
            taken.add(name.casefold())
    return names


def holds_scans(names: Iterable[str]) -> bool:
    """Whether one of the file names is that of a scanner's recording, packed or not."""
    for name in names:
        path = PurePosixPath(name.lower())
        if (PurePosixPath(path.stem).suffix if path.suffix in _PACKED else path.suffix) in SCAN_SUFFIXES:
            return True
    return False


def _below(root: Path, results: Path) -> Iterator[BatchSource]:
    of_session: list[Path] = []
    for place, folders, files in os.walk(root):
        here = Path(place)
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        if here == results or REPORT in files or PREVIEW_REPORT in files:
            folders.clear()
            continue
        if SESSION_FILE in files:
            of_session.append(here)
            parts = here.relative_to(root).parts or (root.name,)
            yield BatchSource(here / SESSION_FILE, parts, made=False, stamps=(stamp(here / SESSION_FILE),))
        elif holds_scans(files) and not any(here.is_relative_to(home) for home in of_session):
            bag = "metadata.yaml" in files and here != root  # a ROS 2 bag is a folder that is one recording
            home = here.parent if bag else here
            parts = home.relative_to(root).parts or (root.name,)
            content = sorted(path for path in (home.rglob("*") if bag else home.iterdir()) if path.is_file())
            yield BatchSource(home / SESSION_FILE, parts, made=True, stamps=tuple(stamp(path) for path in content))
            folders.clear()
