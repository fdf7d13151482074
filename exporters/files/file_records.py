"""Names, sizes and SHA-256 of files by which a run can be repeated."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from furrowmap.core.readers.isoxml.content import MAIN
from furrowmap.core.runtime.plain_reads import open_plain
from furrowmap.core.runtime.progress import Progress, silent

_HASHED_BYTES: Final = 4 << 20


@dataclass(frozen=True)
class FileRecord:
    """An input file; `name` is as in the session."""

    name: str
    bytes: int
    sha256: str


def file_records(paths: Sequence[Path], root: Path, progress: Progress = silent) -> list[FileRecord]:
    """Hash files in blocks, under names relative to `root`; a folder (of a ROS 2 bag) stands for the files in it."""
    return rooted_records([(path, root) for path in paths], progress)


def rooted_records(rooted: Sequence[tuple[Path, Path]], progress: Progress = silent) -> list[FileRecord]:
    """Hash files of which each has its own root; otherwise as :func:`file_records`."""
    records = []
    files = [(file, root) for path, root in rooted for file in (files_in(path) if path.is_dir() else [path])]
    total = sum(file.stat().st_size for file, _ in files)
    done = 0
    for path, root in files:
        digest = hashlib.sha256()
        begun = done
        with open_plain(path) as stream:
            while block := stream.read(_HASHED_BYTES):
                digest.update(block)
                done += len(block)
                progress("hashing inputs", min(1.0, done / max(total, 1)))
        records.append(FileRecord(name_from(root, path), done - begun, digest.hexdigest()))
    return records


def name_from(root: Path, path: Path) -> str:
    """The name of a file relative to a folder; of polygons that a command named, which may lie anywhere, their own."""
    return path.relative_to(root).as_posix() if path.is_relative_to(root) else path.name


def files_in(folder: Path) -> list[Path]:
    """The files in a folder, by name, and in those of its subfolders that have task data."""
    found = sorted(path for path in folder.iterdir() if path.is_file())
    for below in sorted(path for path in folder.iterdir() if path.is_dir()):
        inside = sorted(path for path in below.iterdir() if path.is_file())
        found += inside if any(path.name.upper() == MAIN for path in inside) else []
    return found


def joint_record(path: Path, records: Sequence[FileRecord]) -> FileRecord:
    """That of a file; for a folder one of all its files, whose digest is that of their digests in a row."""
    if len(records) == 1:
        return records[0]
    digests = "".join(record.sha256 for record in records).encode()
    return FileRecord(path.name, sum(record.bytes for record in records), hashlib.sha256(digests).hexdigest())
