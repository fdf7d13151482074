"""Logs of VectorNav sensors as their manual describes them."""

from __future__ import annotations

import struct
from binascii import crc_hqx
from functools import reduce
from operator import xor

WEEK, TOW_S = 2422, 206_400.0


def message(fields: dict[int, tuple[int, bytes]]) -> bytes:
    """A binary message with the fields (bits, content) of some groups."""
    groups = sum(1 << group for group in fields)
    head = bytes((groups,)) + b"".join(struct.pack("<H", bits) for bits, _ in fields.values())
    body = head + b"".join(content for _, content in fields.values())
    return b"\xfa" + body + struct.pack(">H", crc_hqx(body, 0))


def common(k: int) -> bytes:
    """TimeGps, yaw, pitch, roll, and Imu of the common group, 100 Hz."""
    time_ns = int(1e9 * (604_800 * WEEK + TOW_S)) + 10_000_000 * k
    floats = (350.0 + k, 1.0, -2.0, 0.1, 0.01 * k, -9.8, 0.02, -0.01, 0.001 * k)
    return message({0: (1 << 1 | 1 << 3 | 1 << 9, struct.pack("<Q9f", time_ns, *floats))})


def grouped(k: int) -> bytes:
    """Time of week and week, and compensated measurements of the IMU group."""
    time = struct.pack("<QH", int(1e9 * TOW_S) + 10_000_000 * k, WEEK)
    return message({1: (1 << 2 | 1 << 3, time), 2: (1 << 9 | 1 << 10, struct.pack("<6f", 0, 0, -9.8, 0.1, 0.2, 0.3))})


def sentence(body: str) -> bytes:
    return f"${body}*{reduce(xor, body.encode()):02X}\r\n".encode()


def vnimu(k: int) -> bytes:
    return sentence(
        f"VNIMU,-00.035,+00.422,-00.664,+00.100,{0.01 * k:+.3f},-09.800,+00.02,-00.01,{0.001 * k:+.6f},+20.7,+84.3"
    )


def vnins(k: int) -> bytes:
    """At the time of the VNIMU before it."""
    return sentence(
        f"VNINS,{TOW_S + 0.01 * k:013.6f},{WEEK},8085,-149.042,+013.639,+010.915,+40.09623362,-088.20139124,+00204.179,"
        "+000.023,+000.007,-000.248,20.5,02.5,0.20"
    )
