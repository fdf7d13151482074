"""The VLP-16: geometry, timing and packets (VLP-16 User Manual 63-9243 Rev. E, chapter 9 and appendix)."""

from __future__ import annotations

from typing import Final

import numpy as np

from furrowmap.core.simulator.capture import Bytes
from furrowmap.core.simulator.rays import Beams, Returns
from furrowmap.core.simulator.scanner import ScannerModel, Spin, clock_us
from furrowmap.core.simulator.scenario import Scenario
from furrowmap.core.simulator.site import SimulatedSite

ELEVATION_DEG: Final = np.array(
    [-15.0, 1.0, -13.0, 3.0, -11.0, 5.0, -9.0, 7.0, -7.0, 9.0, -5.0, 11.0, -3.0, 13.0, -1.0, 15.0]
)
"""Of the lasers in the order in which they fire and stand in a packet."""
VERTICAL_OFFSET_M: Final = 1e-3 * np.array(
    [11.2, -0.7, 9.7, -2.2, 8.1, -3.7, 6.6, -5.1, 5.1, -6.6, 3.7, -8.1, 2.2, -9.7, 0.7, -11.2]
)
"""Height of each beam's origin on the axis above the sensor's origin."""
LASER_S: Final = 2.304e-6
"""From one laser to the next."""
FIRING_S: Final = 55.296e-6
"""From one firing of all lasers to the next."""
BLOCKS_PER_PACKET: Final = 12
"""Blocks in a packet, each of two firings of all lasers."""
AZIMUTH_STEP_DEG: Final = 0.01
RETURN_MODE: Final = {"strongest": 0x37, "last": 0x38, "dual": 0x39}
PRODUCT_ID: Final = 0x22
POSITION_PORT: Final = 8308
HOUR_US: Final = 3_600_000_000
POSITION_BYTES: Final = 512
POSITION_EVERY_S: Final = 0.5
_PACKET: Final = np.dtype(
    {
        "names": ["blocks", "stamp_us", "factory"],
        "formats": [
            (
                np.dtype(
                    [("flag", "<u2"), ("azimuth", "<u2"), ("returns", [("ticks", "<u2"), ("reflectivity", "u1")], 32)]
                ),
                BLOCKS_PER_PACKET,
            ),
            "<u4",
            ("u1", 2),
        ],
        "offsets": [0, 1200, 1204],
        "itemsize": 1206,
    }
)


def data_packets(scenario: Scenario, site: SimulatedSite, spin: Spin, first: int, returns: Returns) -> Bytes:
    """(n, 1206) payloads of the data packets."""
    mode = scenario.lidar.return_mode
    n = returns.ticks.shape[1] // spin.firings_a_packet
    firing = first * spin.firings_a_packet + np.arange(n * spin.firings_a_packet)
    packets = np.zeros(n, _PACKET)
    packets["blocks"]["flag"] = 0xEEFF
    turn = spin.turns(spin.time_s(firing[::2])).reshape(n, -1) % 1.0
    azimuth = np.round(turn * (360.0 / AZIMUTH_STEP_DEG)).astype(np.uint16) % 36000
    for name, values in (("ticks", returns.ticks), ("reflectivity", returns.reflectivity)):
        packed = values.reshape(2, n, -1, 2 * len(ELEVATION_DEG))
        if mode == "dual":  # the last return in the even blocks, the strongest or second-strongest in the odd ones
            packets["blocks"]["returns"][name][:, 0::2] = packed[1]
            packets["blocks"]["returns"][name][:, 1::2] = packed[0]
        else:
            packets["blocks"]["returns"][name] = packed[0 if mode == "strongest" else 1]
    packets["blocks"]["azimuth"] = np.repeat(azimuth, 2, axis=1) if mode == "dual" else azimuth
    stamp_us = np.round(spin.time_s(firing[:: spin.firings_a_packet]) * 1e6).astype(np.int64)
    packets["stamp_us"] = (stamp_us + clock_us(scenario, site)) % HOUR_US
    packets["factory"] = RETURN_MODE[mode], PRODUCT_ID
    return packets.view(np.uint8).reshape(n, 1206)


def position_packet(scenario: Scenario, site: SimulatedSite, t_s: float, gprmc: str) -> Bytes:
    """(1, 512) payload of a position packet: the sensor's clock, the PPS locked, the receiver's sentence."""
    payload = np.zeros((1, POSITION_BYTES), np.uint8)
    stamp_us = (round(t_s * 1e6) + clock_us(scenario, site)) % HOUR_US
    payload[0, 198:202] = np.frombuffer(stamp_us.to_bytes(4, "little"), np.uint8)
    payload[0, 202] = 2
    text = np.frombuffer(gprmc.encode("ascii"), np.uint8)
    payload[0, 206 : 206 + len(text)] = text
    return payload


VLP16: Final = ScannerModel(
    beams=Beams(
        elevation_deg=ELEVATION_DEG,
        azimuth_deg=np.zeros(len(ELEVATION_DEG)),
        height_m=VERTICAL_OFFSET_M,
        laser_s=LASER_S * np.arange(len(ELEVATION_DEG), dtype=np.float64),
        origin_m=0.0,
        step_m=0.002,
        zero_deg=0.0,
    ),
    firings_a_packet=2 * BLOCKS_PER_PACKET,
    firings_a_packet_dual=BLOCKS_PER_PACKET,
    firing_s=FIRING_S,
    columns=0,
    port=2368,
    packets=data_packets,
    position_packets=True,
    stated="VLP-16",
)
