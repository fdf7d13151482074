"""The LiDAR recording: beams cast in batches by threads, packets written in order."""

from __future__ import annotations

import gzip
import os
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from io import BufferedIOBase
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.progress import Progress
from furrowmap.core.simulator.capture import PCAP
from furrowmap.core.simulator.drive import SimulatedTrack
from furrowmap.core.simulator.gnss import gprmc
from furrowmap.core.simulator.livox import MID360
from furrowmap.core.simulator.motion import SimulatedMotion, mount_rotation
from furrowmap.core.simulator.moving_mount import SimulatedMountMotion
from furrowmap.core.simulator.noise import random_for
from furrowmap.core.simulator.ouster import OS1_32
from furrowmap.core.simulator.rays import Firings, Met, Optics, Returns, Scene, cast, make_optics, make_scene
from furrowmap.core.simulator.scanner import ScannerModel, Spin
from furrowmap.core.simulator.scenario import Scenario, ScenarioLidar
from furrowmap.core.simulator.site import SimulatedSite
from furrowmap.core.simulator.soil import Ground
from furrowmap.core.simulator.truth import SeenAfter
from furrowmap.core.simulator.vlp16 import POSITION_EVERY_S, POSITION_PORT, VLP16, position_packet
from furrowmap.core.simulator.xt32 import XT32

SCANNERS: Final = {"VLP-16": VLP16, "OS1-32": OS1_32, "PandarXT-32": XT32, "Mid-360": MID360}
"""By the name in a scenario."""
_FIRINGS_PER_BATCH: Final = 9600
"""Firings cast together, half a second of a VLP-16."""
_POSITION_PHASE_S: Final = 0.393
"""First position packet after the first firing."""


def recording_file(lidar: ScenarioLidar) -> str:
    """Name of the recording."""
    return "recording" + SCANNERS[lidar.model].container.suffix + (".gz" if lidar.gzip else "")


def second_file(lidar: ScenarioLidar) -> str:
    """Name of the recording of a second scanner."""
    return recording_file(lidar).replace("recording", "second", 1)


@dataclass(frozen=True)
class World:
    """What there is to record, and from where.

    Attributes:
        crop: heights on the ground's cells; None without.
        mount: that moves; None where it does not.
        front: the drive with the implement in front; None where there is none.
    """

    scenario: Scenario
    site: SimulatedSite
    ground: Ground
    motion: SimulatedMotion
    crop: NDArray[np.float32] | None = None
    mount: SimulatedMountMotion | None = None
    front: SimulatedTrack | None = None

    def mounted(self, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 3, 4) from sensor to vehicle at times (n,); (0, 3, 4) where the mount does not move."""
        if self.mount is None:
            return np.empty((0, 3, 4))
        lidar = self.scenario.lidar
        return self.mount.mounted(t_s, mount_rotation(lidar.true_rpy_deg), lidar.true_xyz_m)


class _ReturnCounts:
    """Counts of returns."""

    def __init__(self) -> None:
        self.met = np.zeros(len(Met), np.int64)
        self.second = 0

    def add(self, returns: Returns, mode: str) -> None:
        first = 1 if mode == "last" else 0
        self.met += np.bincount(returns.met[first].ravel(), minlength=len(Met))
        if mode == "dual":
            two = returns.ticks[0] != returns.ticks[1]
            self.second += int(two.sum())
            self.met += np.bincount(returns.met[1][two], minlength=len(Met))


def record(file: Path, world: World, duration_s: float, progress: Progress) -> tuple[dict[str, Any], NDArray[np.uint8]]:
    """Write the capture of a drive or flight; its figures, and how often each cell was seen after its last working."""
    scenario, site, ground, motion = world.scenario, world.site, world.ground, world.motion
    model = SCANNERS[scenario.lidar.model]
    spin = model.spin(scenario, duration_s)
    optics = make_optics(scenario, model.beams, mount_rotation(scenario.lidar.true_rpy_deg))
    scene = make_scene(scenario, ground, world.crop)
    rng = random_for(scenario.seed, "computer")
    counts, seen, clock_us, position_packets = _ReturnCounts(), SeenAfter(scenario, ground), 0, 0
    reported = 1 if scenario.lidar.return_mode == "last" else 0
    if model.beside is not None:
        name, text = model.beside(scenario)
        (file.parent / name).write_text(text, encoding="utf-8")
    with _open_capture(file, compress=scenario.lidar.gzip) as out:
        out.write(model.container.head)
        at_once = -(-_FIRINGS_PER_BATCH // spin.firings_a_packet)
        batches = (
            (first, _firings(spin, first, min(at_once, spin.packets - first), world, model))
            for first in range(0, spin.packets, at_once)
        )
        for first, firings, returns in cast_in_order(scene, optics, batches):
            counts.add(returns, scenario.lidar.return_mode)
            seen.add(returns.cell[reported].ravel(), np.repeat(firings.t_s, len(optics.lasers)))
            payload = model.packets(scenario, site, spin, first, returns)
            sent_s = spin.time_s((first + 1 + np.arange(len(payload))) * spin.firings_a_packet)
            late = np.abs(rng.standard_normal(len(sent_s))) * scenario.clock.jitter_s
            computer_s = sent_s + late + scenario.clock.computer_minus_utc_s
            computer_us = site.t0_us + np.round(computer_s * 1e6).astype(np.int64)
            stamp_us = np.maximum(np.maximum.accumulate(computer_us), clock_us)
            clock_us = int(stamp_us[-1])
            data = model.container.records(stamp_us, payload, model.port, 1000 + first)
            begin = 0
            for t_s in _position_times(scenario, spin, first, len(payload)):
                end = int(np.searchsorted(sent_s, t_s, side="right"))
                beside_us = stamp_us[max(end - 1, 0) : max(end, 1)]
                offset_s = scenario.clock.true_lidar_minus_gnss_s
                said = gprmc(motion, scenario.antenna.xyz_m, site, t_s, offset_s)
                position = position_packet(scenario, site, t_s, said)
                out.write(data[begin:end].tobytes())
                out.write(PCAP.records(beside_us, position, POSITION_PORT, 50_000 + position_packets).tobytes())
                begin, position_packets = end, position_packets + 1
            out.write(data[begin:].tobytes())
            progress("lidar", (first + len(payload)) / spin.packets)
    return _figures(site, spin, counts, optics, model, position_packets), seen.image


def cast_in_order(
    scene: Scene, optics: Optics, batches: Iterable[tuple[int, Firings]]
) -> Iterator[tuple[int, Firings, Returns]]:
    """(number, firings, returns) of each batch, in order; a few batches are cast ahead by other threads."""
    workers = os.cpu_count() or 1
    ahead: deque[tuple[int, Firings, Future[Returns]]] = deque()
    with ThreadPoolExecutor(workers) as threads:
        try:
            for first, firings in batches:
                ahead.append((first, firings, threads.submit(cast, scene, optics, firings)))
                if len(ahead) > workers + 1:
                    number, done, future = ahead.popleft()
                    yield number, done, future.result()
            while ahead:
                number, done, future = ahead.popleft()
                yield number, done, future.result()
        finally:
            threads.shutdown(wait=True, cancel_futures=True)


def _firings(spin: Spin, first: int, packets: int, world: World, model: ScannerModel) -> Firings:
    number, motion = first * spin.firings_a_packet, world.motion
    t_s = spin.time_s(number + np.arange(packets * spin.firings_a_packet))
    xyz, rotation = motion.at(t_s)
    return Firings(
        number,
        t_s,
        2.0 * np.pi * (spin.turns(t_s) % 1.0) + np.radians(model.beams.zero_deg),
        spin.turn_radps(t_s),
        xyz,
        rotation,
        np.interp(t_s, motion.t_s, motion.tool_m),
        np.interp(t_s, motion.t_s, motion.dusty),
        world.mounted(t_s),
        np.interp(t_s, world.front.t_s, world.front.tool_m) if world.front is not None else np.zeros(len(t_s)),
    )


def _position_times(scenario: Scenario, spin: Spin, first: int, packets: int) -> list[float]:
    """When position packets are sent while the data packets from `first` on are."""
    if not scenario.lidar.position_packets or not SCANNERS[scenario.lidar.model].position_packets:
        return []
    begin, end = (p * spin.firings_a_packet * spin.firing_s for p in (first, first + packets))
    k = np.arange(int(end / POSITION_EVERY_S) + 2)
    since = _POSITION_PHASE_S + k * POSITION_EVERY_S
    return [spin.start_s + float(s) for s in since[(since >= begin) & (since < end)]]


@contextmanager
def _open_capture(file: Path, *, compress: bool) -> Iterator[BufferedIOBase]:
    with file.open("wb") as raw:
        if compress:  # without name and time of writing: the same scenario gives the same bytes
            with gzip.GzipFile("", "wb", 6, raw, mtime=0) as packed:
                yield packed
        else:
            yield raw


def _figures(
    site: SimulatedSite, spin: Spin, returned: _ReturnCounts, optics: Optics, model: ScannerModel, position_packets: int
) -> dict[str, Any]:
    firings = spin.packets * spin.firings_a_packet
    last_packet_s = spin.time_s(np.array([max(0, spin.packets - 1) * spin.firings_a_packet]))
    begin, end = (float(t) for t in spin.turns(spin.time_s(np.array([0, max(0, firings - 1)]))))
    crossings = int(np.floor(end)) - int(np.floor(begin))
    counts = {met.name.lower(): int(returned.met[met]) for met in Met if met is not Met.NOTHING}
    return {
        "lidar": {
            "points": sum(counts.values()),
            **counts,
            "second_returns": returned.second,
            "data_packets": spin.packets,
            "position_packets": position_packets,
            "turns": end - begin,
            "scans_complete": max(0, crossings - 1),
            "azimuth_zero_crossings": crossings,
            "firings": firings,
            "first_firing_unix_s": round(site.t0_s + spin.start_s, 6),
            "last_packet_unix_s": round(site.t0_s + float(last_packet_s[0]), 6),
        },
        "laser_bias_m": {
            f"{elevation:+g}": round(bias, 4)
            for elevation, bias in sorted(
                zip(model.beams.elevation_deg.tolist(), optics.lasers[:, 3].tolist(), strict=True)
            )
        },
    }
