"""Files of Ouster's SDK, made of the packets of a simulated capture: FlatBuffers, PNG and Zpng are written here."""

from __future__ import annotations

import json
import struct
import sys
from collections.abc import Sequence
from pathlib import Path
from zlib import compress, crc32

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.simulator.recording import OS1_PIXEL_DUAL

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

Blob = tuple[bytes, int]
"""Bytes of an object, and where in them it begins."""
COLUMN = np.dtype([("ns", "<u8"), ("number", "<u2"), ("status", "<u2"), ("pixels", OS1_PIXEL_DUAL, 32)])
HEADS = [("s", "<u4"), ("us", "<u4"), ("head", "u1", 50), ("kind", "<u2"), ("frame", "<u2"), ("rest", "u1", 28)]
RECORD = np.dtype([*HEADS, ("columns", COLUMN, 16), ("tail", "u1", 32)])
"""A record of a capture, with its packet."""


def table(*fields: int | Blob | None) -> Blob:
    """A table: what its fields refer to lies behind it."""
    n = len(fields)
    places = [0 if field is None else 4 + 8 * k for k, field in enumerate(fields)]
    head = struct.pack(f"<HH{n}H", 4 + 2 * n, 4 + 8 * n, *places)
    slots, tail = bytearray(8 * n), bytearray()
    for k, field in enumerate(fields):
        if isinstance(field, int):
            slots[8 * k : 8 * k + 8] = struct.pack("<Q", field)
        elif field is not None:
            slots[8 * k : 8 * k + 4] = struct.pack("<I", 8 * (n - k) + len(tail) + field[1])
            tail += field[0]
    return head + struct.pack("<i", len(head)) + bytes(slots + tail), len(head)


def numbers(values: NDArray[np.generic] | bytes) -> Blob:
    """A vector of numbers."""
    return struct.pack("<I", len(values)) + bytes(values if isinstance(values, bytes) else values.tobytes()), 0


def tables(each: Sequence[Blob]) -> Blob:
    """A vector of tables."""
    offsets, body = b"", b""
    for k, (data, begin) in enumerate(each):
        offsets += struct.pack("<I", 4 * (len(each) - k) + len(body) + begin)
        body += data
    return struct.pack("<I", len(each)) + offsets + body, 0


def buffer(root: Blob, kind: bytes = b"\0\0\0\0") -> bytes:
    """A FlatBuffer with its length before it."""
    data = struct.pack("<I4s", 8 + root[1], kind) + root[0]
    return struct.pack("<I", len(data)) + data


def checked(data: bytes) -> bytes:
    return data + struct.pack("<I", crc32(data))


def png(image: NDArray[np.unsignedinteger]) -> bytes:
    """An image of 8 or 32 bits, of the latter the bytes are its colours (PNG specification, without filters)."""
    height, width = image.shape
    depth, colours = (8, 6) if image.dtype.itemsize == 4 else (8, 0)
    rows = np.ascontiguousarray(image).view(np.uint8).reshape(height, -1)
    content = np.hstack([np.zeros((height, 1), np.uint8), rows]).tobytes()
    out = b"\x89PNG\r\n\x1a\n"
    for kind, data in (
        (b"IHDR", struct.pack(">IIBBBBB", width, height, depth, colours, 0, 0, 0)),
        (b"IDAT", compress(content)),
        (b"IEND", b""),
    ):
        out += struct.pack(">I", len(data)) + kind + data + struct.pack(">I", crc32(kind + data))
    return out


def zpng(image: NDArray[np.unsignedinteger]) -> bytes:
    """An image as by the library Zpng: differences along the rows, of four bytes as planes of mixed colours."""
    height, width = image.shape
    n = image.dtype.itemsize
    values = np.ascontiguousarray(image).view(np.uint8).reshape(height, width, n)
    steps = np.diff(values, axis=1, prepend=np.zeros((height, 1, n), np.uint8))
    if n == 4:
        red, green, blue, alpha = np.moveaxis(steps, -1, 0)
        steps = np.stack([blue, green - blue, green - red, alpha])
    return struct.pack("<2sHHBB", b"\xf8\xfb", width, height, n, 1) + zstd.compress(steps.tobytes())


def osf_of(captures: Sequence[Path], *, encoding: str = "zpng") -> bytes:
    """A file with the turns of captures of two returns, each with its metadata beside it; 64 packets are a turn."""
    entries, chunks = [], b""
    for k, capture in enumerate(captures):
        said = json.loads(capture.with_suffix(".json").read_text())
        shifts = np.array(said["lidar_data_format"]["pixel_shift_by_row"])
        sensor, stream = 10 * k + 1, 10 * k + 2
        entries += [
            table(number, numbers(f"ouster/v1/os_sensor/{kind}".encode()), numbers(buffer(table(content))))
            for number, kind, content in (
                (sensor, "LidarSensor", numbers(json.dumps(said).encode())),
                (stream, "LidarScanStream", sensor),
            )
        ]
        packets = np.frombuffer(capture.read_bytes(), RECORD, offset=24)
        for frame in np.unique(packets["frame"]):
            chunks += checked(_chunk(packets[packets["frame"] == frame], int(frame), stream, shifts, encoding))
    metadata = checked(buffer(table(None, None, None, None, tables(entries)), b"OSF#"))
    size = len(checked(buffer(table(20, 2, 0, 0), b"OSF$")))
    head = checked(buffer(table(20, 2, size + len(chunks), size + len(chunks) + len(metadata)), b"OSF$"))
    return head + chunks + metadata


def _chunk(packets: NDArray[np.void], frame: int, stream: int, shifts: NDArray[np.int_], encoding: str) -> bytes:
    """A chunk of one turn; columns of packets that are not there are 0."""
    columns = np.zeros(1024, COLUMN)
    at = packets["columns"]["number"].reshape(-1)
    columns[at] = packets["columns"].reshape(-1)
    sent_ns = np.zeros(64, "<u8")
    sent_ns[at[::16] // 16] = packets["s"].astype("<u8") * 10**9 + packets["us"].astype("<u8") * 1000
    pixels = columns["pixels"].T
    images = {
        1: (pixels["range"] & 0x7FFFF).astype("<u4"),
        2: (pixels["range2"] & 0x7FFFF).astype("<u4"),
        5: pixels["reflectivity"],
        6: pixels["reflectivity2"],
    }
    if encoding == "png":
        packed = [
            png(np.stack([np.roll(row, by) for row, by in zip(image, shifts, strict=True)]))
            for image in images.values()
        ]
    else:
        packed = [zpng(image) for image in images.values()]
    kinds = np.array([k | {4: 3, 1: 1}[image.dtype.itemsize] << 8 for k, image in images.items()], "<u2")
    turn = table(
        tables([table(numbers(data)) for data in packed]),
        numbers(kinds),
        numbers(columns["ns"]),
        numbers(columns["number"]),
        numbers(columns["status"].astype("<u4")),
        frame,
        None,
        numbers(sent_ns),
    )
    return buffer(table(tables([table(int(sent_ns.max()), stream, numbers(buffer(turn)))])), b"OSF!")
