"""The files of a bag, and all their messages as one stream."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path, PurePath
from typing import Final

from furrowmap.core.readers.rosbag.db3 import SQLITE_MAGIC, Db3Storage
from furrowmap.core.readers.rosbag.mcap import MCAP_MAGIC, McapStorage
from furrowmap.core.readers.rosbag.rosbag1 import ROSBAG1_MAGIC, Rosbag1Storage
from furrowmap.core.readers.rosbag.storage import BagMessage, BagStorage
from furrowmap.core.readers.source import look
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.file_names import is_file_name

METADATA: Final = "metadata.yaml"

_STORAGE_NAME: Final = re.compile(r".+\.(db3|mcap)(\.(zstd|zst|gz|xz))?", re.IGNORECASE)
# Recorders write metadata.yaml in one form, indented by two spaces; only these two entries are needed. A YAML parser
# would take minutes for a hostile file with a few thousand brackets.
_FILES: Final = re.compile(r"^ {2}relative_file_paths: *\n((?: *- .+\n)+)", re.MULTILINE)
_MESSAGES: Final = re.compile(r"^ {2}message_count: (\d{1,18}) *$", re.MULTILINE)


class BagFiles:
    """The files of a recording, in the order of time.

    Args:
        paths: files, or folders of ROS 2 bags.

    Attributes:
        notices: files that are missing or damaged; complete when the messages have ended.

    Raises:
        InputError: if a folder has no file of a bag.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self.notices: list[Notice] = []
        self._declared = 0
        self._files = [file for path in paths for file in self._files_of(path)]
        self._sizes = [file.stat().st_size for file in self._files]
        self._behind = 0
        self._open: BagStorage | None = None

    @property
    def share_read(self) -> float:
        """How much has been read, 0 to 1."""
        now = self._sizes[self._behind] * self._open.share_read if self._open else 0.0
        return (sum(self._sizes[: self._behind]) + now) / max(sum(self._sizes), 1)

    def messages(self, topics: Collection[str] | None = None) -> Iterator[BagMessage]:
        """The messages (of some topics) of all files, each file's in the order of recording.

        Raises:
            InputError: if the only file cannot be read.
        """
        total = 0
        for behind, file in enumerate(self._files):
            self._behind = behind
            try:
                storage = self._open = _open_storage(file)
                count = 0
                for message in storage.messages(topics):
                    count += 1
                    yield message
            except InputError as error:
                if len(self._files) == 1:
                    raise
                self.notices.append(Notice.from_error(error))
                continue
            self.notices += storage.notices
            total += count
            if topics is None and storage.declared not in (None, count):
                self.notices.append(Notice("bag-count.index", file=file, count=count, declared=storage.declared))
        if topics is None and self._declared and total != self._declared:
            self.notices.append(Notice("bag-count", total=total, declared=self._declared))

    def _files_of(self, path: Path) -> list[Path]:
        """The file itself; of a folder, the files named in its metadata, else those with the names of bag files."""
        if not path.is_dir():
            return [path]
        names = self._names_in_metadata(path / METADATA)
        missing = [name for name in names if not (is_file_name(name) and (path / name).is_file())]
        if missing:
            self.notices.append(Notice("bag-file-missing", path=path, missing=", ".join(missing)))
        files = [path / name for name in names if name not in missing] or storage_files(path)
        if not files:
            raise InputError("bag-folder-empty", path=path)
        return files

    def _names_in_metadata(self, file: Path) -> list[str]:
        """The files that metadata.yaml names; none, with a notice, if it is missing or damaged."""
        try:
            text = file.read_text(encoding="utf-8", errors="replace")
        except OSError as error:
            self.notices.append(Notice("bag-no-metadata", file=file, reason=error.strerror))
            return []
        files, messages = _FILES.search(text), _MESSAGES.search(text)
        if files is None or messages is None:
            self.notices.append(Notice("bag-metadata-damaged", file=file))
            return []
        self._declared += int(messages[1])
        # Folders in the names are ignored, so that nothing outside the bag is read.
        return [PurePath(line.strip().removeprefix("- ").strip("\"'")).name for line in files[1].splitlines()]


def storage_files(folder: Path) -> list[Path]:
    """Files in a folder with the names of ROS 2 bag files, in the order of their numbers."""
    return sorted(
        (file for file in folder.iterdir() if _STORAGE_NAME.fullmatch(file.name) and file.is_file()),
        key=lambda file: [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", file.name)],
    )


def _open_storage(path: Path) -> BagStorage:
    """The file's storage, by its content."""
    data = look(path).data
    for magic, storage in ((ROSBAG1_MAGIC, Rosbag1Storage), (MCAP_MAGIC, McapStorage), (SQLITE_MAGIC, Db3Storage)):
        if data.startswith(magic):
            return storage(path)
    raise InputError("bag-unknown-storage", path=path)
