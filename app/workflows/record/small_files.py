"""Session, status and log of a recording."""

import threading
from collections import deque
from pathlib import Path
from typing import Final

from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.plain_files import append_to

RECORD_LOG: Final = "record.log"
MAX_LINES: Final = 10_000
"""Of the log that wait for the disk, at most; older ones are left out."""


class SmallFiles:
    """Small files that wait in memory until `write` puts them into the folder; those that fail wait for the next time.

    Nothing is written through links: see :mod:`~furrowmap.exporters.files.plain_files`.

    Attributes:
        faults: of the files that could not be written the last time, why, by their names.
    """

    def __init__(self, folder: Path) -> None:
        self.faults: dict[str, str] = {}
        self._folder = folder
        self._lock = threading.Lock()
        self._texts: dict[str, tuple[str, bool]] = {}
        self._lines: deque[str] = deque(maxlen=MAX_LINES)

    def replace(self, name: str, text: str, *, durable: bool = False) -> None:
        """Let a file be replaced in one step, and be safe from a power cut if it is to be durable."""
        with self._lock:
            self._texts[name] = (text, durable)

    def log(self, line: str) -> None:
        """Let a line be appended to the log."""
        self._lines.append(f"{line}\n")

    def write(self) -> None:
        """Write what waits."""
        self._write_log()
        for name in list(self._texts):
            with self._lock:
                waiting = self._texts[name]
            text, durable = waiting
            try:
                with atomic_output(self._folder / name, durable=durable) as unfinished:
                    unfinished.write_text(text, encoding="utf-8")
            except (OSError, FurrowmapError) as error:
                self.faults[name] = _words(error)
                continue
            self.faults.pop(name, None)
            with self._lock:
                if self._texts[name] is waiting:  # nothing newer came in the meantime
                    del self._texts[name]

    def _write_log(self) -> None:
        count = len(self._lines)
        if not count:
            return
        text = "".join(self._lines[number] for number in range(count))
        try:
            with append_to(self._folder / RECORD_LOG) as file:
                file.write(text.encode("utf-8", errors="backslashreplace"))
        except (OSError, FurrowmapError) as error:
            self.faults[RECORD_LOG] = _words(error)
            return
        self.faults.pop(RECORD_LOG, None)
        for _ in range(count):
            self._lines.popleft()


def _words(error: Exception) -> str:
    """Why a file could not be written."""
    if isinstance(error, FurrowmapError):
        return error.what
    return getattr(error, "strerror", None) or str(error)
