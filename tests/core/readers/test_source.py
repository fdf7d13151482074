"""Recordings as streams, compressed or not, against the libraries' own decompression."""

from __future__ import annotations

import gzip
import lzma
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from furrowmap.core.readers.source import Source, look
from furrowmap.core.runtime.errors import InputError

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd


def checked_zstd(content: bytes) -> bytes:
    """As the command zstd packs; without its checksum, damage would go unnoticed."""
    return zstd.compress(content, options={zstd.CompressionParameter.checksum_flag: 1})


@cache
def xz(content: bytes) -> bytes:
    """As most tests want the same content, which takes a third of a second."""
    return lzma.compress(content)


PACK = {"plain": bytes, "gzip": gzip.compress, "xz": xz, "zstd": checked_zstd}
CONTENT = np.random.default_rng(1).integers(0, 64, 3_000_000, np.uint8).tobytes()


def read_all(path: Path, size: int) -> tuple[bytes, str]:
    with Source(path) as source:
        blocks = []
        while block := source.read(size):
            blocks.append(block)
        return b"".join(blocks), source.fault


@pytest.mark.parametrize("kind", PACK)
@pytest.mark.parametrize("size", [1_000, 1 << 20, 10_000_000])
def test_source__gives_the_content_in_any_portions(tmp_path: Path, kind: str, size: int) -> None:
    path = tmp_path / "a"
    content = CONTENT[:100_000] if size == 1_000 else CONTENT
    path.write_bytes(PACK[kind](content))
    assert read_all(path, size) == (content, "")
    with Source(path) as source:
        assert source.read() == content
        assert source.share_read == 1.0


@pytest.mark.parametrize("kind", ["gzip", "xz", "zstd"])
def test_source__of_streams_behind_each_other(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "a"
    path.write_bytes(PACK[kind](b"first ") + PACK[kind](b"") + PACK[kind](b"second"))
    assert read_all(path, 100) == (b"first second", "")


@pytest.mark.parametrize("kind", ["gzip", "xz", "zstd"])
def test_source__cut_keeps_what_is_there_and_is_reported(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "a"
    packed = PACK[kind](CONTENT)
    path.write_bytes(packed[: len(packed) // 2])
    content, fault = read_all(path, 1 << 21)
    assert CONTENT.startswith(content)
    assert len(content) > 0.4 * len(CONTENT)
    assert fault == f"the {kind} stream is damaged or truncated (unexpected end of file)"


@given(length=st.integers(1 << 18, 1 << 21), size=st.integers(1, 1 << 21))
@settings(max_examples=30)
def test_source__of_very_even_content_is_whole(
    tmp_path_factory: pytest.TempPathFactory, length: int, size: int
) -> None:
    path = tmp_path_factory.mktemp("even") / "a.gz"
    path.write_bytes(gzip.compress(bytes(length), 1))
    with Source(path) as source:
        assert source.read(size) == bytes(min(size, length))
        assert len(source.read()) == max(0, length - size)
        assert source.fault == ""


@pytest.mark.parametrize("kind", ["gzip", "xz", "zstd"])
def test_source__damaged_is_no_exception(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "a"
    packed = bytearray(PACK[kind](CONTENT))
    packed[len(packed) // 2 : len(packed) // 2 + 50] = bytes(50)
    path.write_bytes(packed)
    content, fault = read_all(path, 1 << 20)
    assert fault.startswith(f"the {kind} stream is damaged or truncated")
    assert len(content) <= len(CONTENT)


def test_look__sees_through_the_compression(tmp_path: Path) -> None:
    path = tmp_path / "drive.PCAP.gz"
    path.write_bytes(gzip.compress(b"$GPGGA"))
    head = look(path)
    assert (head.data, head.compression, head.suffix) == (b"$GPGGA", "gzip", ".pcap")


@pytest.mark.parametrize(
    ("make", "code"),
    [
        (lambda p: p.write_bytes(b""), "empty-file"),
        (lambda p: p.write_bytes(gzip.compress(b"")), "empty-file"),
        (lambda p: None, "no-such-file"),
    ],
)
def test_look__refuses_what_holds_nothing(tmp_path: Path, make, code: str) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "a"
    make(path)
    with pytest.raises(InputError) as error:
        look(path)
    assert error.value.code == code
    assert len(error.value.lines) == 3


@pytest.mark.parametrize("kind", PACK)
@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("mark", ["\ufeff", ""])
@pytest.mark.parametrize("size", [7, 1 << 20])
def test_source__text_in_utf_16_comes_as_utf_8(tmp_path: Path, kind: str, encoding: str, mark: str, size: int) -> None:
    text = "time_unix_s,圃場\r\n" + "1780000000.25,0.5\r\n" * (2000 if size == 7 else 200_000)
    path = tmp_path / "a"
    path.write_bytes(PACK[kind]((mark + text).encode(encoding)))
    assert read_all(path, size) == (text.encode(), "")
    assert look(path).data == text.encode()[: 1 << 16]


@given(st.binary(max_size=600), st.sampled_from([b"\xff\xfe", b"\xfe\xff", b"", b"\0"]))
def test_source__binary_data_stay_as_they_are(
    tmp_path_factory: pytest.TempPathFactory, data: bytes, head: bytes
) -> None:
    """Also behind the bytes that mark UTF-16."""
    content = head + b"\x01\x9c\xff\x00" * 200 + data
    path = tmp_path_factory.mktemp("binary") / "a"
    path.write_bytes(content)
    assert read_all(path, 1 << 16) == (content, "")
