"""Small E57 files, written here by the standard (ASTM E2807-11): packed fields, packets, XML, pages."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence

import numpy as np

PAGE = 1024
SCALED = '<cartesian{0} type="ScaledInteger" minimum="-1000000" maximum="1000000" scale="0.001" offset="{1}"/>'
FIELDS = (
    SCALED.format("X", 100),
    '<cartesianY type="Float" precision="single"/>',
    SCALED.format("Z", 0),
    '<cartesianInvalidState type="Integer" minimum="0" maximum="2"/>',
    '<intensity type="Integer" minimum="-5" maximum="4090"/>',
    '<rowIndex type="Integer" minimum="7" maximum="7"/>',
)
LIMITS = (
    '<intensityLimits type="Structure"><intensityMinimum type="Integer">-5</intensityMinimum>'
    '<intensityMaximum type="Integer">4090</intensityMaximum></intensityLimits>'
)
POSE = (
    '<pose type="Structure"><rotation type="Structure"><w type="Float">0.6</w><x type="Float"/><y type="Float"/>'
    '<z type="Float">0.8</z></rotation><translation type="Structure"><x type="Float">10</x><y type="Float"/>'
    '<z type="Float">-3</z></translation></pose>'
)


def crc32c(data: bytes) -> int:
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0x82F63B78 * (crc & 1)
    return crc ^ 0xFFFFFFFF


def paged(content: bytes) -> bytes:
    """Content in pages, each with its checksum."""
    step = PAGE - 4
    content = content.ljust(-(-len(content) // step) * step, b"\0")
    parts = [content[k : k + step] for k in range(0, len(content), step)]
    return b"".join(part + crc32c(part).to_bytes(4, "big") for part in parts)


def packed(values: Sequence[int], bits: int) -> bytes:
    """Integers from the lowest bit on."""
    whole = sum(value << (bits * k) for k, value in enumerate(values))
    return whole.to_bytes((bits * len(values) + 7) // 8, "little")


def place(logical: int) -> int:
    """Offset in the file of an offset without checksums."""
    return logical // (PAGE - 4) * PAGE + logical % (PAGE - 4)


def e57(rows: Mapping[str, np.ndarray], *, pose: str = "", packets: int = 3) -> bytes:
    """A scan of the fields of :data:`FIELDS`; streams are cut into packets at any byte."""
    streams = [
        packed((np.rint((rows["x"] - 100.0) * 1000).astype(int) + 1_000_000).tolist(), 21),
        rows["y"].astype("<f4").tobytes(),
        packed((np.rint(rows["z"] * 1000).astype(int) + 1_000_000).tolist(), 21),
        packed(rows["invalid"].tolist(), 2),
        packed((rows["intensity"] + 5).tolist(), 12),
        b"",
    ]
    body = b""
    for k in range(packets):
        parts = [s[len(s) * k // packets : len(s) * (k + 1) // packets] for s in streams]
        packet = struct.pack(f"<H{len(parts)}H", len(parts), *map(len, parts)) + b"".join(parts)
        packet += bytes(-(4 + len(packet)) % 4)
        body += struct.pack("<BBH", 1, 0, 4 + len(packet) - 1) + packet
    first = 48 + 32
    section = struct.pack("<B7xQQQ", 1, 32 + len(body), place(first), 0)
    xml = (
        '<?xml version="1.0" encoding="UTF-8"?><e57Root type="Structure" xmlns="http://www.astm.org/COMMIT/E57/2010-e57-v1.0">'
        f'<data3D type="Vector"><vectorChild type="Structure">{LIMITS}{pose}<points type="CompressedVector" '
        f'fileOffset="{place(48)}" recordCount="{len(rows["x"])}"><prototype type="Structure">{"".join(FIELDS)}'
        "</prototype></points></vectorChild></data3D></e57Root>"
    ).encode()
    at = first + len(body)
    size = -(-(at + len(xml)) // (PAGE - 4)) * PAGE
    head = struct.pack("<8sIIQQQQ", b"ASTM-E57", 1, 0, size, place(at), len(xml), PAGE)
    return paged(head + section + body + xml)


def some_rows(count: int, seed: int = 1) -> dict[str, np.ndarray]:
    chance = np.random.default_rng(seed)
    return {
        "x": np.round(100.0 + chance.uniform(-900, 900, count), 3),
        "y": chance.uniform(-50, 50, count).astype(np.float32),
        "z": np.round(chance.uniform(-5, 5, count), 3),
        "invalid": (chance.uniform(size=count) < 0.1) * 2,
        "intensity": chance.integers(-5, 4091, count),
    }
