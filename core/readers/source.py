"""A recording as a stream of bytes, decompressed if its content is compressed, text in UTF-16 as UTF-8.

Content decides, not the name. Shells of Windows write redirected text in UTF-16.
"""

import codecs
import io
import lzma
import sys
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final, Protocol

from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.memory import expect_growth

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

HEAD_BYTES: Final = 1 << 16

_MAGIC: Final = {b"\x1f\x8b": "gzip", b"\x28\xb5\x2f\xfd": "zstd", b"\xfd7zXZ\x00": "xz"}
_SUFFIX: Final = {"gzip": ".gz", "zstd": ".zst", "xz": ".xz"}
_UTF16: Final = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}
_TEXT_LOOKED_AT: Final = 1024
"""Bytes that tell text in UTF-16 from binary data that begins like it."""
_LEAST_TEXT: Final = 8
_PLAIN_SHARE: Final = 0.9
_PLAIN_SHARE_BEHIND_MARK: Final = 0.2
"""Of ASCII in text that begins with a byte order mark: a table of Japanese names has separators and digits."""
_CONTROLS: Final = bytes(k for k in range(128) if not (chr(k).isprintable() or chr(k).isspace()))
_RAW_BYTES: Final = 1 << 18
_PIECE_BYTES: Final = 1 << 20


class _Member(Protocol):
    """One of the consecutive compressed streams in a file."""

    @property
    def eof(self) -> bool: ...
    @property
    def needs_input(self) -> bool: ...
    @property
    def unused_data(self) -> bytes: ...
    def decompress(self, data: bytes, max_length: int, /) -> bytes: ...


class _GzipMember:
    """zlib's decompressor with the interface of those of lzma and zstd."""

    def __init__(self) -> None:
        self._zlib = zlib.decompressobj(wbits=31)
        self._more = False

    @property
    def eof(self) -> bool:
        return self._zlib.eof

    @property
    def needs_input(self) -> bool:
        return not self._more

    @property
    def unused_data(self) -> bytes:
        return self._zlib.unused_data

    def decompress(self, data: bytes, max_length: int, /) -> bytes:
        piece = self._zlib.decompress(self._zlib.unconsumed_tail + data, max_length)
        self._more = len(piece) == max_length
        return piece


_MEMBER: dict[str, Callable[[], _Member]] = {
    "gzip": _GzipMember,
    "zstd": zstd.ZstdDecompressor,
    "xz": lzma.LZMADecompressor,
}


@dataclass(frozen=True)
class Head:
    """The start of a file, for recognising its format.

    Attributes:
        data: its first bytes, decompressed, up to 64 KiB; empty for a folder.
        compression: "gzip", "zstd", "xz" or "".
        suffix: suffix of the name in lower case, without that of the compression.
    """

    path: Path
    data: bytes
    compression: str
    suffix: str


class Source(io.BufferedIOBase):
    """A file's decompressed bytes, in order, and the share that has been read.

    A truncated or damaged compressed stream raises no exception: reading ends there, and `fault` describes it. One with
    far more content than a recording has is refused. `compression` is "gzip", "zstd", "xz" or "".
    """

    def __init__(self, path: Path) -> None:
        if not path.is_file():
            raise InputError(
                "no-such-file.refuse-non-files", path=path, is_path=path.is_dir(), is_path_is=path.exists()
            )
        self.path = path
        self.size_bytes = path.stat().st_size
        self.fault = ""
        self._raw: BinaryIO = path.open("rb")
        head = self._raw.read(_TEXT_LOOKED_AT)
        self._raw.seek(0)
        self.compression = next((name for start, name in _MAGIC.items() if head.startswith(start)), "")
        self._is_plain = not self.compression and not utf16_encoding(head)
        self._pieces = _as_utf8(self._decompressed() if self.compression else iter(self._read_raw, b""))
        self._piece = memoryview(b"")

    def readable(self) -> bool:
        """True: the stream can be read."""
        return True

    def read(self, size: int | None = -1, /) -> bytes:
        """Up to `size` bytes (all that remain if negative); fewer only at the end or at damage."""
        wanted = -1 if size is None else size
        blocks: list[bytes | memoryview] = []
        got = 0
        while wanted < 0 or got < wanted:
            try:
                block = self._next(_PIECE_BYTES if wanted < 0 else wanted - got)
            except (EOFError, OSError, zlib.error, lzma.LZMAError, zstd.ZstdError) as error:
                self.fault = f"the {self.compression or 'file'} stream is damaged or truncated ({error})"
                break
            if not block:
                break
            blocks.append(block)
            got += len(block)
        return bytes(blocks[0]) if len(blocks) == 1 else b"".join(blocks)

    def _next(self, size: int) -> bytes | memoryview:
        """At most `size` bytes; none at the end."""
        if self._is_plain:
            return self._raw.read(size)
        if not self._piece:
            self._piece = memoryview(next(self._pieces, b""))
        block = self._piece[:size]
        self._piece = self._piece[size:]
        return block

    def _read_raw(self) -> bytes:
        return self._raw.read(_PIECE_BYTES)

    def _decompressed(self) -> Iterator[bytes]:
        """All content before a truncation; the file objects of the libraries lose the last part of it."""
        unpacked = 0
        data = self._raw.read(_RAW_BYTES)
        while data:
            member = _MEMBER[self.compression]()
            while not member.eof:
                if not data and member.needs_input:
                    data = self._raw.read(_RAW_BYTES)
                    if not data:
                        raise EOFError(Text("unexpected end of file"))
                piece = member.decompress(data, _PIECE_BYTES)
                data = b""
                if piece:
                    unpacked += len(piece)
                    expect_growth(self.path, self.size_bytes, unpacked)
                    yield piece
            data = member.unused_data or self._raw.read(_RAW_BYTES)
            if not data.strip(b"\0"):
                data = b""  # padding

    @property
    def share_read(self) -> float:
        """Share of the file (of its bytes on disk) that has been read, 0 to 1."""
        return 1.0 if not self.size_bytes else min(1.0, self._raw.tell() / self.size_bytes)

    def close(self) -> None:
        """Close the file."""
        self._raw.close()
        super().close()


class Piece(Source):
    """Bytes in memory in the place of a file, such as the end of a log that is still written."""

    def __init__(self, data: bytes) -> None:
        self.path = Path("stream")
        self.size_bytes = len(data)
        self.fault = ""
        self.compression = ""
        self._raw = io.BytesIO(data)
        self._is_plain = True


def utf16_encoding(head: bytes) -> str:
    """The encoding of text in UTF-16 that begins with `head`, with or without a byte order mark; "" for other content.

    Its share of ASCII tells it from binary data that begins with the same two bytes.
    """
    head = head[: min(len(head), _TEXT_LOOKED_AT) // 2 * 2]
    marked = _UTF16.get(head[:2], "")
    least = _PLAIN_SHARE_BEHIND_MARK if marked else _PLAIN_SHARE
    for encoding in [marked] if marked else _UTF16.values():
        text = head.decode(encoding, "replace").removeprefix("\ufeff")
        plain = len(text.encode("ascii", "ignore").translate(None, _CONTROLS))
        if len(text) >= _LEAST_TEXT and plain > least * len(text) and "\ufffd" not in text[:-1]:
            return encoding
    return ""


def _as_utf8(pieces: Iterator[bytes]) -> Iterator[bytes]:
    """The pieces of a stream, those of text in UTF-16 in UTF-8."""
    first = next(pieces, b"")
    encoding = utf16_encoding(first)
    if not encoding:
        yield first
        yield from pieces
        return
    decoder = codecs.getincrementaldecoder(encoding)("replace")
    yield decoder.decode(first).removeprefix("\ufeff").encode()
    for piece in pieces:
        text = decoder.decode(piece)
        if text:  # none of half a character, and no bytes are the end
            yield text.encode()


def look(path: Path) -> Head:
    """The head of a file or folder; InputError if the file does not exist, is empty, or cannot be read."""
    try:
        if path.is_dir():
            return Head(path, b"", "", path.suffix.lower())
        with Source(path) as source:
            data = source.read(HEAD_BYTES)
            compression = source.compression
            fault = source.fault
    except OSError as error:
        raise InputError("unreadable", path=path, strerror=error.strerror) from None
    if not data:
        raise InputError("empty-file", path=path, size_bytes=path.stat().st_size, fault=fault)
    suffix = path.suffix.lower()
    if compression and suffix == _SUFFIX[compression]:
        suffix = path.with_suffix("").suffix.lower()
    return Head(path, data, compression, suffix)


def cut_notice(path: Path, fault: str) -> Notice:
    """The notice of a truncated file; `fault` describes where it ends."""
    return Notice("stream-cut", path=path, fault=fault)
