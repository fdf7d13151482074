"""A Hesai PandarXT-32: geometry, timing and packets (PandarXT User Manual, point cloud data packet and appendix)."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Final

import numpy as np

from furrowmap.core.simulator.capture import Bytes
from furrowmap.core.simulator.rays import Beams, Returns
from furrowmap.core.simulator.scanner import ScannerModel, Spin, clock_us
from furrowmap.core.simulator.scenario import Scenario
from furrowmap.core.simulator.site import SimulatedSite

_CHANNELS: Final = 32
_BLOCKS: Final = 8
_HEAD: Final = (0xEE, 0xFF, 6, 1, 0, 0, _CHANNELS, _BLOCKS, 0, 4, 2, 1)
_MODE: Final = {"strongest": 0x37, "last": 0x38, "dual": 0x39}
_XT_CHANNEL: Final = np.arange(_CHANNELS, dtype=np.float64)
_CHANNEL_DEG: Final = np.round(15.0 - _XT_CHANNEL - 0.04 * np.sin(_XT_CHANNEL), 3)
"""Elevations of this sensor, as its calibration states them: some hundredths of a degree beside those of the model."""
_TURNED_DEG: Final = np.round(0.08 - 0.007 * _XT_CHANNEL, 3)
_RETURN: Final = np.dtype([("ticks", "<u2"), ("reflectivity", "u1"), ("reserved", "u1")])
_XT32_PACKET: Final = np.dtype(
    [
        ("head", "u1", len(_HEAD)),
        ("blocks", [("azimuth", "<u2"), ("returns", _RETURN, _CHANNELS)], _BLOCKS),
        ("reserved", "u1", 10),
        ("mode", "u1"),
        ("speed", "<u2"),
        ("date", "u1", 6),
        ("stamp_us", "<u4"),
        ("factory", "u1"),
        ("sequence", "<u4"),
    ]
)


def data_packets(scenario: Scenario, site: SimulatedSite, spin: Spin, first: int, returns: Returns) -> Bytes:
    """(n, 1080) payloads of the data packets, stamped with the time of their last block."""
    mode = scenario.lidar.return_mode
    n = returns.ticks.shape[1] // spin.firings_a_packet
    firing = first * spin.firings_a_packet + np.arange(n * spin.firings_a_packet)
    packets = np.zeros(n, _XT32_PACKET)
    packets["head"] = _HEAD
    azimuth = np.round(spin.turns(spin.time_s(firing)).reshape(n, -1) % 1.0 * 36000).astype(np.uint16) % 36000
    packets["blocks"]["azimuth"] = np.repeat(azimuth, _BLOCKS // spin.firings_a_packet, axis=1)
    for name, values in (("ticks", returns.ticks), ("reflectivity", returns.reflectivity)):
        packed = values.reshape(2, n, -1, _CHANNELS)
        if mode == "dual":  # the last return in the odd blocks (from 1), the strongest in the even ones
            packets["blocks"]["returns"][name][:, 0::2] = packed[1]
            packets["blocks"]["returns"][name][:, 1::2] = packed[0]
        else:
            packets["blocks"]["returns"][name] = packed[0 if mode == "strongest" else 1]
    last = firing[spin.firings_a_packet - 1 :: spin.firings_a_packet]
    stamp_us = np.round(spin.time_s(last) * 1e6).astype(np.int64) + clock_us(scenario, site)
    for second in np.unique(stamp_us // 1_000_000):
        at = datetime.fromtimestamp(int(second), UTC)
        date = (at.year - 1900, at.month, at.day, at.hour, at.minute, at.second)
        packets["date"][stamp_us // 1_000_000 == second] = date
    packets["stamp_us"] = stamp_us % 1_000_000
    packets["mode"], packets["speed"] = _MODE[mode], scenario.lidar.rpm
    packets["sequence"] = first + np.arange(n)
    return packets.view(np.uint8).reshape(n, -1)


def calibration(_: Scenario) -> tuple[str, str]:
    """Name and text of the sensor's angle calibration."""
    rows = [f"{i + 1},{e:.3f},{a:.3f}\n" for i, (e, a) in enumerate(zip(_CHANNEL_DEG, _TURNED_DEG, strict=True))]
    return "recording.csv", "Channel,Elevation,Azimuth\n" + "".join(rows)


XT32: Final = ScannerModel(
    beams=Beams(
        elevation_deg=_CHANNEL_DEG,
        azimuth_deg=_TURNED_DEG,
        height_m=np.zeros(_CHANNELS),
        laser_s=(6.0 + 1.512 * _XT_CHANNEL) * 1e-6,
        origin_m=0.0,
        step_m=0.004,
        zero_deg=0.0,
    ),
    firings_a_packet=_BLOCKS,
    firings_a_packet_dual=_BLOCKS // 2,
    firing_s=50e-6,
    columns=0,
    port=2368,
    packets=data_packets,
    position_packets=False,
    beside=calibration,
)
