"""What scan matching found, kept in a file for a run that continues after this one was killed."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from furrowmap.core.runtime.json_text import json_text
from furrowmap.core.runtime.packed import packed, unpacked
from furrowmap.core.session.opened import OpenSession
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.file_records import FileRecord

if TYPE_CHECKING:
    from furrowmap.core.adjustment.session_match import MatchedSession


class KeptMatching:
    """A checkpoint in a file, valid for one version of furrowmap, one session and one set of recordings."""

    def __init__(self, path: Path, opened: OpenSession, inputs: Sequence[FileRecord]) -> None:
        known = {"furrowmap": version("furrowmap"), "session": msgspec.to_builtins(opened.session), "inputs": inputs}
        self._path, self._key = path, hashlib.sha256(json_text(known).encode()).digest()

    def load(self) -> MatchedSession | None:
        """What an earlier run kept; None for nothing, or that of another session."""
        if not self._path.is_file():
            return None
        from furrowmap.core.adjustment.session_match import MatchedSession

        try:
            data = np.memmap(self._path, np.uint8, "r").data
            if data[: len(self._key)] != self._key:
                return None
            return unpacked(data[len(self._key) :], MatchedSession)
        except (ValueError, TypeError, MemoryError):  # damaged
            return None

    def save(self, found: MatchedSession) -> None:
        """Keep what matching found.

        Raises:
            OSError: if the disk is full.
        """
        with atomic_output(self._path) as unfinished, unfinished.open("wb") as file:
            file.write(self._key)
            file.writelines(packed(found))
