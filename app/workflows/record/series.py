"""The files of one source of a recording, written one after the other."""

import math
import os
import re
import time
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, TypeAlias

from furrowmap.exporters.files.plain_files import create_new

Waiting: TypeAlias = tuple[bytes, float]
"""A block, and the time of the monotonic clock at which its first byte was received."""

MAX_TAKEN: Final = 10_000
"""Names that something else has, after each other, until a file counts as impossible."""


def numbered_files(folder: Path, stem: str, suffix: str) -> dict[int, Path]:
    """The files STEM-NNNN.SUFFIX in a folder by their numbers, in that order.

    Links, folders and fifos are left out, and all other names, such as those of copies. Empty where the folder cannot
    be read.
    """
    name = re.compile(f"{re.escape(stem)}-([0-9]{{4,6}}){re.escape(suffix)}")
    found = dict[int, Path]()
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            named = name.fullmatch(entry.name)
            if named is not None and entry.is_file(follow_symlinks=False):
                found[int(named[1])] = folder / entry.name
    return dict(sorted(found.items()))


@dataclass(eq=False)
class Series:
    """The files of one source, such as `lidar-192.168.1.201-0001.pcap`, and the blocks that wait to be written.

    Attributes:
        head: what every file begins with.
        roll_s: age of a file from which on the next one is begun.
        roll_bytes: size of a file from which on the next one is begun.
        most_waiting_bytes: blocks that wait in memory, at most: each source has its own, so that none takes another's.
        files: names of all files with content, also those of an earlier recording into the same folder.
        written: bytes of all blocks of this recording.
        descriptor: of the open file; None for none.
        blocks: that wait.
        last_put: the last of all blocks that came here.
        waiting_bytes: of these.
        discarded_bytes: for which there was no memory, or at the end no disk.
        fault: why the disk took nothing; empty if it did.
        retry_s: when writing is tried again after a fault, by the monotonic clock.
        is_over: whether nothing comes any more.
    """

    folder: Path
    stem: str
    suffix: str
    head: bytes = b""
    roll_s: float = math.inf
    roll_bytes: float = math.inf
    most_waiting_bytes: int = 256 << 20
    files: list[str] = field(default_factory=list)
    descriptor: int | None = None
    blocks: deque[Waiting] = field(default_factory=deque, repr=False)
    last_put: Waiting | None = field(default=None, repr=False)
    waiting_bytes: int = 0
    discarded_bytes: int = 0
    fault: str = ""
    retry_s: float = -math.inf
    is_over: bool = False
    _is_listed: bool = False
    _number: int = 0
    _begun_s: float = 0.0
    _done: tuple[int, int, Waiting | None] = (0, 0, None)
    """Size of the open file, bytes of all blocks, and the last block: one value, so that all change at once."""

    @property
    def written(self) -> int:
        """Bytes of all blocks of this recording."""
        return self._done[1]

    @property
    def is_done(self) -> bool:
        """Whether the next block begins a file."""
        old = time.monotonic() - self._begun_s >= self.roll_s
        return self.descriptor is None or old or self._done[0] >= self.roll_bytes

    def begin(self) -> None:
        """Begin the next file, with a name that nothing has. Raises OSError."""
        if not self._is_listed:
            there = numbered_files(self.folder, self.stem, self.suffix)
            self._number = max(there, default=0)
            self.files[:0] = [path.name for path in there.values() if path.stat().st_size > len(self.head)]
            self._is_listed = True
        last = self._number + MAX_TAKEN
        while True:
            self._number += 1
            try:
                self.descriptor = create_new(self.folder / self._name)
                break
            except FileExistsError:  # a folder, a link or the file of another program
                if self._number >= last:
                    raise
        self._begun_s = time.monotonic()
        self._done = (0, self.written, self._done[2])

    def append(self, waiting: Waiting) -> None:
        """Append a block to the open file: the whole of it, or if that fails nothing. Raises OSError.

        One that is the last already is left: the writer was interrupted after it.
        """
        assert self.descriptor is not None
        block = waiting[0]
        size = self._done[0]
        if waiting is self._done[2]:
            return
        data = block if size else self.head + block
        done = 0
        try:
            while done < len(data):
                done += os.write(self.descriptor, memoryview(data)[done:])
            if not size:
                self.files.append(self._name)
            self._done = (size + len(data), self.written + len(block), waiting)
        except BaseException:
            with suppress(OSError):
                os.ftruncate(self.descriptor, size)
                os.lseek(self.descriptor, size, os.SEEK_SET)
            if not size and self.files[-1:] == [self._name]:
                self.files.pop()
            raise

    @property
    def _name(self) -> str:
        return f"{self.stem}-{self._number:04d}{self.suffix}"
