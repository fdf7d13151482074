"""Small Hesai recordings built in a test, by the tables of packets in the maker's manuals."""

from __future__ import annotations

import struct
from datetime import UTC, datetime
from typing import Final, NamedTuple

import numpy as np


class Shape(NamedTuple):
    """Head of the packets, blocks, channels, bytes of a return, and the order of the tail."""

    head: bytes
    blocks: int
    channels: int
    unit: int
    tail: str


SHAPES: Final = {
    "PandarXT-32": Shape(bytes((0xEE, 0xFF, 6, 1, 0, 0, 32, 8, 0, 4, 2, 1)), 8, 32, 4, "XT"),
    "PandarXT-16": Shape(bytes((0xEE, 0xFF, 6, 1, 0, 0, 16, 8, 0, 4, 2, 1)), 8, 16, 4, "XT"),
    "PandarXT-32M": Shape(bytes((0xEE, 0xFF, 6, 1, 0, 0, 32, 6, 0, 4, 2, 1)), 6, 32, 4, "XT"),
    "PandarQT64": Shape(bytes((0xEE, 0xFF, 3, 1, 0, 0, 64, 4, 0, 4, 2, 1)), 4, 64, 4, "QT"),
    "Pandar40P": Shape(b"", 10, 40, 3, "P"),
    "Pandar64": Shape(bytes((0xEE, 0xFF, 64, 6, 0, 4, 0, 0)), 6, 64, 3, "P"),
}
LATER_US: Final = {"PandarQT64": 500 / 3, "Pandar40P": 55.56, "Pandar64": 55.56}
"""Time from one azimuth to the next, of other models 50 µs."""


def packet(model: str, at_s: float, azimuth: int, *, returns: int = 1, step: int = 18, distance: int = 2500) -> bytes:
    """A packet whose azimuth (hundredths of a degree) turns on by `step` from one firing to the next.

    Distances are in counts of 4 mm, 100 counts farther for each further return; the stamp is `at_s` (UTC).
    """
    shape = SHAPES[model]
    body = shape.head
    for block in range(shape.blocks):
        turned = (azimuth + step * (block // returns)) % 36000
        body += (b"\xff\xee" if model == "Pandar40P" else b"") + struct.pack("<H", turned)
        far = distance + 100 * (block % returns)
        body += struct.pack("<HB", far, 10 + block % returns).ljust(shape.unit, b"\0") * shape.channels
    date = datetime.fromtimestamp(int(at_s), UTC)
    years = date.year - (2000 if shape.tail == "P" else 1900)
    utc = bytes((years, date.month, date.day, date.hour, date.minute, date.second))
    stamp, mode = struct.pack("<I", round(at_s % 1 * 1e6)), bytes(((0x37, 0x39, 0x3D)[returns - 1],))
    speed = struct.pack("<H", 600)
    tails = {
        "XT": bytes(10) + mode + speed + utc + stamp + bytes(5),
        "QT": bytes(10) + speed + stamp + mode + bytes(1) + utc + bytes(4),
        "P": bytes(8) + speed + stamp + mode + bytes(1) + utc,
    }
    return body + tails[shape.tail]


def turning(model: str, count: int, at_s: float = 1.75e9, *, returns: int = 1, azimuth: int = 0) -> list[bytes]:
    """`count` packets in a row of a sensor at 600 rpm."""
    firings = SHAPES[model].blocks // returns
    later_us = LATER_US.get(model, 50.0)
    step = round(later_us * 0.36)
    return [
        packet(model, at_s + i * firings * later_us * 1e-6, azimuth + i * firings * step, returns=returns, step=step)
        for i in range(count)
    ]


def gps_packet(at_s: float, sentence: str, *, locked: bool = True) -> bytes:
    """A GPS data packet: two digits each, the lower one first."""
    at = datetime.fromtimestamp(int(at_s), UTC)
    digits = "".join(f"{n % 100:02d}"[::-1] for n in (at.year, at.month, at.day, at.second, at.minute, at.hour))
    head = b"\xff\xee" + digits.encode() + struct.pack("<I", round(at_s % 1 * 1e6))
    return (head + sentence.encode()).ljust(506, b"\0") + b"A" + bytes((locked,)) + bytes(4)


def calibration(elevation_deg: np.ndarray, heading: str = "Channel,Elevation,Azimuth") -> str:
    """A calibration file with these elevations and no azimuths."""
    rows = [f"{i + 1},{deg:.3f},0" for i, deg in enumerate(elevation_deg)]
    return "\n".join([heading, *rows]) + "\n"
