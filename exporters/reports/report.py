"""`report.json`: what a run was given, what it found, and how far that can be trusted."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from furrowmap.core.values.errors import Notice
from furrowmap.core.values.json_text import json_text, plain
from furrowmap.core.values.progress import Progress, silent
from furrowmap.exporters.files.atomic import atomic_output

SCHEMA: Final = 1
_BLOCK_BYTES: Final = 4 << 20


@dataclass(frozen=True)
class FileRecord:
    """A file by which a run can be repeated.

    Attributes:
        name: as the session has it.
        bytes: its size as it lies on the disk.
        sha256: of these bytes, in hexadecimal.
    """

    name: str
    bytes: int
    sha256: str


def file_records(paths: Sequence[Path], root: Path, progress: Progress = silent) -> list[FileRecord]:
    """The records of files, read through in blocks.

    Args:
        paths: of the files, below `root`; a folder (of a ROS 2 bag) stands for the files in it.
        root: to which their names are relative.
        progress: is told of the stage "hashing inputs".

    Raises:
        OSError: if one cannot be read.
    """
    records = []
    files = [file for path in paths for file in (files_in(path) if path.is_dir() else [path])]
    total, done = sum(file.stat().st_size for file in files), 0
    for path in files:
        digest, begun = hashlib.sha256(), done
        with path.open("rb") as stream:
            while block := stream.read(_BLOCK_BYTES):
                digest.update(block)
                done += len(block)
                progress("hashing inputs", min(1.0, done / max(total, 1)))
        records.append(FileRecord(path.relative_to(root).as_posix(), done - begun, digest.hexdigest()))
    return records


def files_in(folder: Path) -> list[Path]:
    """The files in a folder, by name."""
    return sorted(path for path in folder.iterdir() if path.is_file())


@dataclass(frozen=True)
class Report:
    """The content of `report.json`; every table may hold whatever JSON can, and numpy's numbers.

    Attributes:
        session_file: the way to the file of the session, as seen from the products.
        session: the session as it was understood.
        inputs: the files that were read.
        figures: what came out, in SI units that the names state.
        coordinates: what they are, and every step that changed them on their way to the map.
        accuracy: how far the figures may be off.
        observability: what the recording could not tell.
        clocks: what each clock said, and how they disagree.
        warnings: what a user should know.
        timings: seconds of each stage.
        products: names of the files written.
    """

    session_file: str
    session: Mapping[str, Any]
    inputs: Sequence[FileRecord]
    figures: Mapping[str, Any]
    coordinates: Mapping[str, Any] = field(default_factory=dict)
    accuracy: Mapping[str, Any] = field(default_factory=dict)
    observability: Mapping[str, Any] = field(default_factory=dict)
    clocks: Mapping[str, Any] = field(default_factory=dict)
    warnings: Sequence[Notice] = ()
    timings: Mapping[str, float] = field(default_factory=dict)
    products: Sequence[str] = ()


def write_report(path: Path, report: Report) -> dict[str, Any]:
    """Write `report` as `report.json`.

    Returns:
        The content as it stands in the file.

    Raises:
        OSError: if the file cannot be written there.
    """
    content = {"furrowmap": version("furrowmap"), "schema": SCHEMA, **plain(report)}
    with atomic_output(path) as unfinished:
        unfinished.write_text(json_text(content), encoding="utf-8")
    return content
