"""The VLP-16: firing times and directions, and its packets."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.simulator.capture import Bytes
from furrowmap.core.simulator.noise import FloatArray, random_for
from furrowmap.core.simulator.rays import Returns
from furrowmap.core.simulator.scenario import Scenario
from furrowmap.core.simulator.site import SimulatedSite
from furrowmap.core.simulator.vlp16 import (
    AZIMUTH_STEP_DEG,
    BLOCKS_PER_PACKET,
    FIRING_S,
    PRODUCT_ID,
    RETURN_MODE,
    VLP16_LASERS,
)

HOUR_US: Final = 3_600_000_000
POSITION_BYTES: Final = 512
POSITION_EVERY_S: Final = 0.5
_WANDER_PERIOD_S: Final = 23.0
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


@dataclass(frozen=True)
class Spin:
    """The rotation of the sensor, and the firings it makes.

    Attributes:
        start_s: local time of the first firing.
        packets: data packets of the whole recording.
        firings_a_packet: 24, or 12 in dual return mode.
        turns_a_second: nominal.
        wander: share by which the speed varies.
        first_turn: azimuth of the first firing, in turns.
    """

    start_s: float
    packets: int
    firings_a_packet: int
    turns_a_second: float
    wander: float
    first_turn: float

    def time_s(self, firing: NDArray[np.int64]) -> FloatArray:
        """Local time of firings by their number."""
        return np.asarray(self.start_s + firing * FIRING_S, np.float64)

    def turns(self, t_s: FloatArray) -> FloatArray:
        """Turns made, from azimuth 0 before the first firing."""
        since = t_s - self.start_s
        w = 2.0 * math.pi / _WANDER_PERIOD_S
        return self.first_turn + self.turns_a_second * (since + self.wander * (since + (1.0 - np.cos(w * since)) / w))

    def turn_radps(self, t_s: FloatArray) -> FloatArray:
        """Speed of rotation."""
        w = 2.0 * math.pi / _WANDER_PERIOD_S
        speed = 1.0 + self.wander * (1.0 + np.sin(w * (t_s - self.start_s)))
        return 2.0 * math.pi * self.turns_a_second * speed


def make_spin(scenario: Scenario, duration_s: float) -> Spin:
    """The rotation over a drive of `duration_s`."""
    lidar = scenario.lidar
    firings = BLOCKS_PER_PACKET if lidar.return_mode == "dual" else 2 * BLOCKS_PER_PACKET
    packets = max(0, math.floor((duration_s + lidar.stop_s - lidar.start_s) / (firings * FIRING_S)))
    first = float(random_for(scenario.seed, "azimuth").uniform())
    return Spin(lidar.start_s, packets, firings, lidar.rpm / 60.0, lidar.rpm_wander, first)


def data_packets(scenario: Scenario, site: SimulatedSite, spin: Spin, first: int, returns: Returns) -> Bytes:
    """(n, 1206) payloads of the data packets from number `first` on, which hold all `returns`."""
    mode = scenario.lidar.return_mode
    n = returns.ticks.shape[1] // spin.firings_a_packet
    firing = first * spin.firings_a_packet + np.arange(n * spin.firings_a_packet)
    packets = np.zeros(n, _PACKET)
    packets["blocks"]["flag"] = 0xEEFF
    turn = spin.turns(spin.time_s(firing[::2])).reshape(n, -1) % 1.0
    azimuth = np.round(turn * (360.0 / AZIMUTH_STEP_DEG)).astype(np.uint16) % 36000
    for name, values in (("ticks", returns.ticks), ("reflectivity", returns.reflectivity)):
        packed = values.reshape(2, n, -1, 2 * VLP16_LASERS)
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


def clock_us(scenario: Scenario, site: SimulatedSite) -> int:
    """What the sensor's clock shows at local time 0, in microseconds since 1970."""
    return site.t0_us + round(scenario.clock.true_lidar_minus_gnss_s * 1e6)
