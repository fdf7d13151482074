"""A packet capture: UDP datagrams in IPv4 in Ethernet in a classic pcap file.

Formats: draft-ietf-opsawg-pcap (file), RFC 791 (IPv4), RFC 768 (UDP), RFC 1071 (checksums).
"""

import struct
from collections.abc import Callable
from ipaddress import IPv4Address
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]

FILE_HEADER: Final = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)
_ETHERNET: Final = bytes.fromhex("ffffffffffff 60768820a1c4 0800")
_SCANNER: Final = "192.168.1.201"
_ALL: Final = "255.255.255.255"
HEADERS: Final = 42


def frame_head(source: tuple[str, int], target: tuple[str, int], size: int) -> bytes:
    """Ethernet, IPv4 (RFC 791) and UDP headers (RFC 768, without a checksum) of a datagram of `size` bytes.

    A socket shows no hardware addresses: those here are locally administered ones, made of the IP addresses.
    """
    ends = [IPv4Address(host).packed for host, _ in (source, target)]
    ip = struct.pack(">BBHHHBBH", 0x45, 0, 28 + size, 0, 0x4000, 64, 17, 0) + ends[0] + ends[1]
    total = int(sum(struct.unpack(">10H", ip)))
    checksum = ~(total + (total >> 16)) & 0xFFFF
    ethernet = b"\x02\0" + ends[1] + b"\x02\0" + ends[0] + b"\x08\0"
    udp = struct.pack(">HHHH", source[1], target[1], 8 + size, 0)
    return ethernet + ip[:10] + checksum.to_bytes(2, "big") + ip[12:] + udp


def records(time_us: NDArray[np.int64], payload: Bytes, port: int, number: int) -> Bytes:
    """(n, 16 + 42 + k) capture records of `payload` (n, k) uint8, k even, sent from and to `port`.

    Times (n,) are the capturing computer's clock, microseconds since 1970; `number` is that of the first datagram, for
    the IP identification.
    """
    n, k = payload.shape
    frame = np.zeros((n, 16 + HEADERS + k), np.uint8)
    frame[:, :16] = np.column_stack(
        [time_us // 1_000_000, time_us % 1_000_000, np.full(n, HEADERS + k), np.full(n, HEADERS + k)]
    ).astype("<u4").view(np.uint8).reshape(n, 16)  # fmt: skip
    ip = 16 + 14
    udp = 16 + 14 + 20
    frame[:, 16:ip] = np.frombuffer(_ETHERNET, np.uint8)
    frame[:, ip : udp + 8] = np.frombuffer(frame_head((_SCANNER, port), (_ALL, port), k)[14:], np.uint8)
    _put(frame, ip + 4, (number + np.arange(n)) & 0xFFFF)
    frame[:, ip + 10 : ip + 12] = 0
    _put(frame, ip + 10, _checksum(frame[:, ip:udp], 0))
    frame[:, udp + 8 :] = payload
    # the pseudo header adds addresses, protocol and length; 0 would mean that there is no checksum
    pseudo = int(_words(frame[:1, udp - 8 : udp]).sum()) + 17 + 8 + k
    checksum = _checksum(frame[:, udp:], pseudo)
    _put(frame, udp + 6, np.where(checksum == 0, 0xFFFF, checksum))
    return frame


class Container(NamedTuple):
    """A kind of file of recorded messages, with the first bytes.

    The times, the messages, port and first number make records.
    """

    suffix: str
    head: bytes
    records: Callable[[NDArray[np.int64], Bytes, int, int], Bytes]


PCAP: Final = Container(".pcap", FILE_HEADER, records)


def _words(data: Bytes) -> NDArray[np.int64]:
    return np.ascontiguousarray(data).view(">u2").astype(np.int64)


def _checksum(data: Bytes, more: int) -> NDArray[np.int64]:
    total = _words(data).sum(axis=1) + more
    for _ in range(2):
        total = (total & 0xFFFF) + (total >> 16)
    checksum: NDArray[np.int64] = ~total & 0xFFFF
    return checksum


def _put(frame: Bytes, at: int, value: NDArray[np.int64]) -> None:
    frame[:, at] = value >> 8
    frame[:, at + 1] = value & 0xFF
