"""What scanners and others send in tests, and what captures hold, by the byte."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterable
from pathlib import Path


def free_ports() -> tuple[int, int, int]:
    """Free UDP ports: data, positions, GNSS."""
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(3)]
    for each in sockets:
        each.bind(("", 0))
    numbers = [each.getsockname()[1] for each in sockets]
    for each in sockets:
        each.close()
    return numbers[0], numbers[1], numbers[2]


def payloads(folder: Path, stem: str) -> list[bytes]:
    """The payloads in all captures of a scanner, by the byte, without furrowmap's reader.

    A capture that is still written may end within a packet.
    """
    found = []
    for path in sorted(folder.glob(f"{stem}-*.pcap")):
        data = path.read_bytes()
        at = 24
        assert data[:4] in (struct.pack("<I", 0xA1B23C4D), b"")
        while at + 16 <= len(data):
            captured = struct.unpack_from("<I", data, at + 8)[0]
            frame = data[at + 16 : at + 16 + captured]
            if len(frame) < captured:
                break
            ip = struct.unpack(">10H", frame[14:34])
            assert sum(ip) % 0xFFFF == 0, "the header's checksum (RFC 791)"
            assert int.from_bytes(frame[16:18], "big") == len(frame) - 14
            found.append(frame[42:])
            at += 16 + captured
    return found


def velodyne_packet(number: int) -> bytes:
    """A data packet of a VLP-16 (user manual, section 9.3) whose stamp counts 1.33 ms each, with a number in it."""
    return (
        b"\xff\xee"
        + bytes(2)
        + struct.pack("<I", number)
        + bytes(1192)
        + struct.pack("<IBB", number * 1327 % 3600000000, 0x37, 0x22)
    )


def numbered(packets: Iterable[bytes]) -> list[int]:
    """The numbers in packets of `velodyne_packet`."""
    return [struct.unpack_from("<I", each, 4)[0] for each in packets]
