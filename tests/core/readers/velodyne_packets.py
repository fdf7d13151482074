"""Small Velodyne recordings built in a test: packets by the manuals' tables, frames and captures by dpkt."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from pathlib import Path

import dpkt
import numpy as np
from numpy.typing import ArrayLike

VLP16, HI_RES, VLP32C, HDL32E = 0x22, 0x24, 0x28, 0x21
STRONGEST, LAST, DUAL = 0x37, 0x38, 0x39
PACKET_US = 1327.104
"""Time between the packets of a VLP-16 with one return."""
RETURN = np.dtype([("distance", "<u2"), ("intensity", "u1")])
BLOCK = np.dtype([("flag", "S2"), ("azimuth", "<u2"), ("returns", RETURN, 32)])
Frame = tuple[float, bytes]
"""The recorder's time of a frame, and its bytes."""


def data_packet(
    stamp_us: float = 0.0,
    azimuth: int = 0,
    *,
    step: int = 40,
    distance: ArrayLike = 5000,
    intensity: ArrayLike = 10,
    mode: int = STRONGEST,
    product: int = VLP16,
) -> bytes:
    """A data packet whose blocks (pairs of blocks in dual mode) turn on by `step` hundredths of a degree.

    `distance` and `intensity` are in counts, of any shape that fits (12 blocks, 32 slots).
    """
    blocks = np.zeros(12, BLOCK)
    blocks["flag"] = b"\xff\xee"
    blocks["azimuth"] = (azimuth + step * (np.arange(12) // (2 if mode == DUAL else 1))) % 36000
    blocks["returns"]["distance"] = np.broadcast_to(distance, (12, 32))
    blocks["returns"]["intensity"] = np.broadcast_to(intensity, (12, 32))
    return blocks.tobytes() + struct.pack("<IBB", round(stamp_us) % 3_600_000_000, mode, product)


def turning(
    count: int,
    stamp_us: float = 0.0,
    azimuth: int = 0,
    *,
    packet_us: float = PACKET_US,
    step: int = 40,
    mode: int = STRONGEST,
    product: int = VLP16,
    distance: ArrayLike = 5000,
) -> list[bytes]:
    """`count` packets in a row of a sensor that turns evenly."""
    per_packet = step * (6 if mode == DUAL else 12)
    return [
        data_packet(
            stamp_us + i * packet_us,
            azimuth + i * per_packet,
            step=step,
            distance=distance,
            mode=mode,
            product=product,
        )
        for i in range(count)
    ]


def rmc(time: str = "012341", date: str = "110626", status: str = "A") -> str:
    """A GPRMC sentence with its checksum."""
    body = f"GPRMC,{time},{status},3652.2039,N,14001.2103,E,000.0,328.5,{date},,,D"
    checksum = 0
    for c in body.encode():
        checksum ^= c
    return f"${body}*{checksum:02X}\r\n"


def position_packet(stamp_us: float, sentence: str, pps: int = 2) -> bytes:
    """A position packet."""
    head = bytes(198) + struct.pack("<IB3x", round(stamp_us) % 3_600_000_000, pps)
    return (head + sentence.encode()).ljust(512, b"\0")


def frame(payload: bytes, sender: str = "192.168.1.201", port: int = 2368) -> bytes:
    """An Ethernet frame with a UDP datagram."""
    udp = dpkt.udp.UDP(sport=port, dport=port, data=payload)
    udp.ulen = len(udp)
    ip = dpkt.ip.IP(src=bytes(map(int, sender.split("."))), dst=b"\xff" * 4, p=dpkt.ip.IP_PROTO_UDP, data=udp)
    ip.len = len(ip)
    return bytes(dpkt.ethernet.Ethernet(dst=b"\xff" * 6, src=b"\x60\x76\x88\0\0\1", data=ip))


def frames(packets: Iterable[bytes], host_s: float = 1.75e9, every_s: float = PACKET_US * 1e-6) -> list[Frame]:
    """Frames of packets that arrive evenly; position packets (512 bytes) go to their own port."""
    return [
        (host_s + i * every_s, frame(packet, port=8308 if len(packet) == 512 else 2368))
        for i, packet in enumerate(packets)
    ]


def write_pcap(path: Path, content: Sequence[Frame], *, nano: bool = False, link: int = 1) -> Path:
    """A classic pcap of these frames."""
    with path.open("wb") as file:
        writer = dpkt.pcap.Writer(file, linktype=link, nano=nano)
        for time_s, data in content:
            writer.writepkt(data, time_s)
    return path
