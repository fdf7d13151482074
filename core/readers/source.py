"""A recording as a stream of bytes, decompressed by what it holds and not by what it is called."""

from __future__ import annotations

import gzip
import io
import lzma
import sys
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, cast

from furrowmap.core.values.errors import InputError

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

HEAD_BYTES = 1 << 16

_MAGIC = {b"\x1f\x8b": "gzip", b"\x28\xb5\x2f\xfd": "zstd", b"\xfd7zXZ\x00": "xz"}
_SUFFIX = {"gzip": ".gz", "zstd": ".zst", "xz": ".xz"}


@dataclass(frozen=True)
class Head:
    """What a file looks like before anyone has read it.

    Attributes:
        path: the file (for `.db3` and `.mcap` bags perhaps the folder that holds it).
        data: its first bytes, decompressed, up to 64 KiB; empty for a folder.
        compression: "gzip", "zstd", "xz" or "".
        suffix: of the name in lower case, without that of the compression.
    """

    path: Path
    data: bytes
    compression: str
    suffix: str


class Source(io.BufferedIOBase):
    """A file's decompressed bytes, in order, and how far they have been read.

    A compressed stream that ends too early or turns bad is no exception: reading ends there, and `fault` says why.

    Attributes:
        compression: "gzip", "zstd", "xz" or "".
        fault: why reading ended before the file did, or "".
    """

    def __init__(self, path: Path) -> None:
        _refuse_non_files(path)
        self.path = path
        self.size_bytes = path.stat().st_size
        self.fault = ""
        self._raw = path.open("rb")
        magic = self._raw.read(6)
        self._raw.seek(0)
        self.compression = next((name for start, name in _MAGIC.items() if magic.startswith(start)), "")
        self._stream: BinaryIO = self._raw
        if self.compression == "gzip":
            self._stream = cast("BinaryIO", gzip.GzipFile(fileobj=self._raw))
        elif self.compression == "zstd":
            self._stream = cast("BinaryIO", zstd.ZstdFile(self._raw))
        elif self.compression == "xz":
            self._stream = cast("BinaryIO", lzma.LZMAFile(self._raw))  # noqa: SIM115 (closed by close)

    def readable(self) -> bool:
        """Streams of this kind are for reading."""
        return True

    def read(self, size: int | None = -1, /) -> bytes:
        """Up to `size` bytes (all that remain if negative); fewer only at the end, or where the file is damaged."""
        wanted = -1 if size is None else size
        blocks: list[bytes] = []
        got = 0
        while wanted < 0 or got < wanted:
            try:
                block = self._stream.read(1 << 20 if wanted < 0 else wanted - got)
            except (EOFError, OSError, zlib.error, lzma.LZMAError, zstd.ZstdError) as error:
                self.fault = f"the {self.compression or 'file'} stream is damaged or cut ({error})"
                break
            if not block:
                break
            blocks.append(block)
            got += len(block)
        return blocks[0] if len(blocks) == 1 else b"".join(blocks)

    @property
    def share_read(self) -> float:
        """How much of the file (as it lies on the disk) has been read, 0 to 1."""
        return 1.0 if not self.size_bytes else min(1.0, self._raw.tell() / self.size_bytes)

    def close(self) -> None:
        """Close the file."""
        self._stream.close()
        self._raw.close()
        super().close()


def look(path: Path) -> Head:
    """The head of a file or folder.

    Raises:
        InputError: if there is no such file, or it is empty or unreadable.
    """
    if path.is_dir():
        return Head(path, b"", "", path.suffix.lower())
    _refuse_non_files(path)
    try:
        with Source(path) as source:
            data, compression, fault = source.read(HEAD_BYTES), source.compression, source.fault
    except OSError as error:
        raise InputError(
            f"{path}: {error.strerror}.",
            "The file could not be opened.",
            "Check that it may be read by you.",
            code="unreadable",
        ) from None
    if not data:
        raise InputError(
            f"{path} is empty ({path.stat().st_size} bytes{', ' + fault if fault else ''}).",
            "There is nothing in it to read.",
            "Copy the recording again; a recorder that was switched off early may have written nothing.",
            code="empty-file",
        )
    suffix = path.suffix.lower()
    if compression and suffix == _SUFFIX[compression]:
        suffix = path.with_suffix("").suffix.lower()
    return Head(path, data, compression, suffix)


def _refuse_non_files(path: Path) -> None:
    if not path.is_file():
        raise InputError(
            f"{path} {'is a folder' if path.is_dir() else 'is not there' if not path.exists() else 'is no file'}.",
            "A recording is a file.",
            "Check the name; give the recording itself.",
            code="no-such-file",
        )
