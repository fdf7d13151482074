"""What packets and bytes say while they arrive, against what the readers of whole files find."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.readers.arrived_packets import ArrivedPackets
from furrowmap.core.readers.arrived_positions import ArrivedPositions
from furrowmap.core.readers.ouster.metadata import packet_bytes
from furrowmap.core.values.gnss import Fix


def arrived(payloads: list[tuple[float, bytes]], looks: int = 3) -> ArrivedPackets:
    """Payloads with their times, in blocks of 50 that are looked at every few blocks."""
    packets = ArrivedPackets()
    for k in range(0, len(payloads), 50):
        block, inside = bytearray(), []
        for t_s, payload in payloads[k : k + 50]:
            block += bytes(58)
            inside.append((len(block), len(payload), round(t_s * 1e9)))
            block += payload
        packets.add(block, inside)
        if k // 50 % looks == 0:
            packets.look()
    packets.look()
    return packets


def velodyne(k: int) -> tuple[float, bytes]:
    """Packet k of a VLP-16, near the end of an hour."""
    stamp_us = (3_599_900_000 + round(k * 1327.104)) % 3_600_000_000
    return k * 1327.104e-6, b"\xff\xee" + bytes(1198) + struct.pack("<IBB", stamp_us, 0x37, 0x22)


def hesai(k: int) -> tuple[float, bytes]:
    """Packet k of a PandarXT-32, of which packet 100 has the number 0."""
    head, number = bytes([0xEE, 0xFF, 6, 1, 0, 0, 32, 8]), (k - 100) % (1 << 32)
    return k * 1e-3, head + bytes(1068) + struct.pack("<I", number)


def ouster(k: int) -> tuple[float, bytes]:
    """Packet k of an OS-1-32 with 64 packets a turn."""
    size = packet_bytes("RNG19_RFL8_SIG16_NIR16", 32, 16)
    head = struct.pack("<HH", 1, k // 64) + bytes(28) + struct.pack("<QH", k * 1_562_500, k % 64 * 16)
    return k * 1.5625e-3, head + bytes(size - len(head))


@pytest.mark.parametrize("packet", [velodyne, hesai, ouster])
def test_missing_packets__are_counted(packet: object) -> None:
    lost = {130, 200, 201, 202, 390}
    whole = [packet(k) for k in range(70, 640)]  # type: ignore[operator]
    assert arrived(whole).lost == 0
    some = [packet(k) for k in range(70, 640) if k not in lost]  # type: ignore[operator]
    found = arrived(some)
    assert (found.maker, found.lost) == ({velodyne: "Velodyne", hesai: "Hesai", ouster: "Ouster"}[packet], 5)  # type: ignore[index]


def test_missing_packets__are_not_counted_in_pauses_and_where_the_clock_is_set() -> None:
    before = [velodyne(k) for k in range(300)]
    paused = [velodyne(k) for k in range(5000, 5300)]
    set_forward = [(velodyne(k)[0], velodyne(k + 300)[1]) for k in range(5300, 5600)]
    assert arrived([*before, *paused, *set_forward]).lost == 0


def test_positions__are_the_last_of_what_arrived(shared_data: Path) -> None:
    text = (shared_data / "tractor_loop" / "gnss.nmea").read_bytes()
    receiver = ArrivedPositions()
    for k in range(0, 40_000, 777):
        receiver.add(text[k : k + 777], 1_781_141_100.0)
        receiver.look()
    last = [line for line in text[:40_404].rpartition(b"\n")[0].splitlines() if line.startswith(b"$GNGGA")][-1].split(
        b","
    )
    assert (receiver.format, receiver.fix, receiver.satellites) == ("nmea", Fix.FIXED, int(last[7]))
    seconds = int(last[1][:2]) * 3600 + int(last[1][2:4]) * 60 + float(last[1][4:])
    assert receiver.t_s % 86_400 == pytest.approx(seconds, abs=1e-6)
    assert receiver.late_s == pytest.approx(1_781_141_100.0 - receiver.t_s)
    assert receiver.lat_deg == pytest.approx(float(last[2][:2]) + float(last[2][2:]) / 60, abs=1e-9)


@pytest.mark.parametrize("name", ["ubx/m8p_4hz.ubx", "sbf/x5_pvtgeod.sbf"])
def test_positions__of_binary_messages(shared_data: Path, name: str) -> None:
    receiver = ArrivedPositions()
    receiver.add((shared_data / "gnss" / name).read_bytes()[:200_000], 1.7e9)
    receiver.look()
    assert receiver.format == name[:3]
    assert np.isfinite([receiver.t_s, receiver.lon_deg, receiver.lat_deg]).all()


def test_noise__has_no_format() -> None:
    receiver = ArrivedPositions()
    receiver.add(np.random.default_rng(1).integers(0, 256, 20_000, np.uint8).tobytes(), 1.7e9)
    receiver.look()
    assert (receiver.format, receiver.fix) == ("", Fix.NONE)
