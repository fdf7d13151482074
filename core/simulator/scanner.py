"""Spinning scanners: what the models have in common, and when their lasers fire."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.simulator.capture import PCAP, Bytes, Container
from furrowmap.core.simulator.noise import FloatArray, random_for
from furrowmap.core.simulator.rays import Beams, Returns
from furrowmap.core.simulator.scenario import Scenario
from furrowmap.core.simulator.site import SimulatedSite

_WANDER_PERIOD_S: Final = 23.0


@dataclass(frozen=True)
class Spin:
    """The rotation of the sensor, and the firings it makes.

    Attributes:
        firing_s: nominal time between firings.
        columns: number of fixed azimuths at which a sensor fires; 0 for one that fires at even times.
        wander: share by which the speed varies.
        first_turn: azimuth of the first firing, in turns.
    """

    start_s: float
    packets: int
    firings_a_packet: int
    firing_s: float
    columns: int
    turns_a_second: float
    wander: float
    first_turn: float

    def time_s(self, firing: NDArray[np.int64]) -> FloatArray:
        """Local time of firings by their number."""
        if not self.columns:
            return np.asarray(self.start_s + firing * self.firing_s, np.float64)
        evenly_s = np.asarray(firing * self.firing_s, np.float64)
        since = evenly_s
        for _ in range(3):
            since = evenly_s - self.wander * self._wandered_s(since)
        return np.asarray(self.start_s + since, np.float64)

    def turns(self, t_s: FloatArray) -> FloatArray:
        """Turns made, from azimuth 0 before the first firing."""
        since = t_s - self.start_s
        return self.first_turn + self.turns_a_second * (since + self.wander * self._wandered_s(since))

    def turn_radps(self, t_s: FloatArray) -> FloatArray:
        """Speed of rotation."""
        w = 2.0 * math.pi / _WANDER_PERIOD_S
        speed = 1.0 + self.wander * (1.0 + np.sin(w * (t_s - self.start_s)))
        return 2.0 * math.pi * self.turns_a_second * speed

    def _wandered_s(self, since: FloatArray) -> FloatArray:
        w = 2.0 * math.pi / _WANDER_PERIOD_S
        return since + (1.0 - np.cos(w * since)) / w


@dataclass(frozen=True)
class ScannerModel:
    """A model of scanner.

    Attributes:
        beams: geometry and timing of its lasers, in the order of the packet.
        firings_a_packet: firings in a packet with one return per laser and firing.
        firing_s: time between firings; nan where a turn has `columns`.
        packets: payloads (n, k) uint8 of the data packets from a number on, which hold all returns.
        position_packets: whether it sends a receiver's sentence in packets of its own.
        stated: as `model` in session.toml; empty where the recording says it.
        beside: name and text of a file that belongs to a recording; None where there is none.
    """

    beams: Beams
    firings_a_packet: int
    firings_a_packet_dual: int
    firing_s: float
    columns: int
    port: int
    packets: Callable[[Scenario, SimulatedSite, Spin, int, Returns], Bytes]
    position_packets: bool
    stated: str = ""
    beside: Callable[[Scenario], tuple[str, str]] | None = None
    container: Container = PCAP

    def spin(self, scenario: Scenario, duration_s: float) -> Spin:
        """The rotation over a drive of `duration_s`."""
        lidar = scenario.lidar
        firings = self.firings_a_packet_dual if lidar.return_mode == "dual" else self.firings_a_packet
        turns_a_second = lidar.rpm / 60.0
        firing_s = 1.0 / (turns_a_second * self.columns) if self.columns else self.firing_s
        packets = max(0, math.floor((duration_s + lidar.stop_s - lidar.start_s) / (firings * firing_s)))
        first = float(random_for(scenario.seed, "azimuth").uniform())
        if self.columns:  # packets begin at multiples of their number of columns
            first = math.floor(first * self.columns / firings) * firings / self.columns
        return Spin(lidar.start_s, packets, firings, firing_s, self.columns, turns_a_second, lidar.rpm_wander, first)


def clock_us(scenario: Scenario, site: SimulatedSite) -> int:
    """What the sensor's clock shows at local time 0, in microseconds since 1970."""
    return site.t0_us + round(scenario.clock.true_lidar_minus_gnss_s * 1e6)
