"""The LiDAR recording: beams cast in batches by threads, packets written in order.

Geometry, timing and packets of the scanners: VLP-16 User Manual 63-9243 Rev. E, chapter 9 and appendix; Hesai PandarXT
User Manual, point cloud data packet and appendix; Ouster Sensor Documentation (firmware 3.1), chapters "Coordinate
frames and XYZ calculation" and "Lidar data packet format". A Mid-360 has no rings, but 200,000 points a second in a
pattern that does not repeat; it is recorded as messages of livox_ros_driver2 (msg/CustomMsg) in a ROS 1 bag (format
2.0) without the index that a recorder writes when it ends.
"""

import gzip
import json
import math
import os
import struct
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from io import BufferedIOBase
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.progress import Progress
from furrowmap.core.simulator.capture import PCAP, Bytes, Container
from furrowmap.core.simulator.drive import SimulatedTrack
from furrowmap.core.simulator.machine_motion import SimulatedMotion, SimulatedMountMotion, mount_rotation
from furrowmap.core.simulator.noise import FloatArray, random_for
from furrowmap.core.simulator.rays import Beams, Firings, Met, Optics, Returns, Scene, cast, make_optics, make_scene
from furrowmap.core.simulator.scenario import Scenario, ScenarioLidar
from furrowmap.core.simulator.simulated_receiver import gprmc
from furrowmap.core.simulator.site import SimulatedSite
from furrowmap.core.simulator.soil_over_time import Ground
from furrowmap.core.simulator.truth import SeenAfter

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
    port: int
    packets: Callable[[Scenario, SimulatedSite, Spin, int, Returns], Bytes]
    columns: int = 0
    position_packets: bool = False
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


_CHANNELS: Final = 32
_BLOCKS: Final = 8
_HEAD: Final = (0xEE, 0xFF, 6, 1, 0, 0, _CHANNELS, _BLOCKS, 0, 4, 2, 1)
RETURN_MODE: Final = {"strongest": 0x37, "last": 0x38, "dual": 0x39}
_XT_CHANNEL: Final = np.arange(_CHANNELS, dtype=np.float64)
_CHANNEL_DEG: Final = np.round(15.0 - _XT_CHANNEL - 0.04 * np.sin(_XT_CHANNEL), 3)
"""Elevations of this sensor, as its calibration states them: some hundredths of a degree beside those of the model."""
_TURNED_DEG: Final = np.round(0.08 - 0.007 * _XT_CHANNEL, 3)
_RETURN: Final = np.dtype([("ticks", "<u2"), ("reflectivity", "u1"), ("reserved", "u1")])
_XT32_PACKET: Final = np.dtype([
    ("head", "u1", len(_HEAD)), ("blocks", [("azimuth", "<u2"), ("returns", _RETURN, _CHANNELS)], _BLOCKS),
    ("reserved", "u1", 10), ("mode", "u1"), ("speed", "<u2"), ("date", "u1", 6), ("stamp_us", "<u4"), ("factory", "u1"),
    ("sequence", "<u4"),
])  # fmt: skip


def _fill_blocks(blocks: NDArray[np.void], returns: Returns, mode: str) -> None:
    """Set the returns (n, blocks, lasers); of dual ones the last is in the first block of a pair, by index from 0."""
    for name, values in (("ticks", returns.ticks), ("reflectivity", returns.reflectivity)):
        packed = values.reshape(2, len(blocks), -1, blocks.shape[2])
        if mode == "dual":
            blocks[name][:, 0::2] = packed[1]
            blocks[name][:, 1::2] = packed[0]
        else:
            blocks[name] = packed[0 if mode == "strongest" else 1]


def _xt32_packets(scenario: Scenario, site: SimulatedSite, spin: Spin, first: int, returns: Returns) -> Bytes:
    """(n, 1080) payloads of the data packets, stamped with the time of their last block."""
    mode = scenario.lidar.return_mode
    n = returns.ticks.shape[1] // spin.firings_a_packet
    firing = first * spin.firings_a_packet + np.arange(n * spin.firings_a_packet)
    packets = np.zeros(n, _XT32_PACKET)
    packets["head"] = _HEAD
    azimuth = np.round(spin.turns(spin.time_s(firing)).reshape(n, -1) % 1.0 * 36000).astype(np.uint16) % 36000
    packets["blocks"]["azimuth"] = np.repeat(azimuth, _BLOCKS // spin.firings_a_packet, axis=1)
    _fill_blocks(packets["blocks"]["returns"], returns, mode)
    last = firing[spin.firings_a_packet - 1 :: spin.firings_a_packet]
    stamp_us = np.round(spin.time_s(last) * 1e6).astype(np.int64) + clock_us(scenario, site)
    for second in np.unique(stamp_us // 1_000_000):
        at = datetime.fromtimestamp(int(second), UTC)
        date = (at.year - 1900, at.month, at.day, at.hour, at.minute, at.second)
        packets["date"][stamp_us // 1_000_000 == second] = date
    packets["stamp_us"] = stamp_us % 1_000_000
    packets["mode"] = RETURN_MODE[mode]
    packets["speed"] = scenario.lidar.rpm
    packets["sequence"] = first + np.arange(n)
    return packets.view(np.uint8).reshape(n, -1)


def calibration(_: Scenario) -> tuple[str, str]:
    """Name and text of the sensor's angle calibration."""
    rows = [f"{i + 1},{e:.3f},{a:.3f}\n" for i, (e, a) in enumerate(zip(_CHANNEL_DEG, _TURNED_DEG, strict=True))]
    return "recording.csv", "Channel,Elevation,Azimuth\n" + "".join(rows)


XT32: Final = ScannerModel(
    beams=Beams(_CHANNEL_DEG, _TURNED_DEG, np.zeros(_CHANNELS), (6.0 + 1.512 * _XT_CHANNEL) * 1e-6, step_m=0.004),
    firings_a_packet=_BLOCKS,
    firings_a_packet_dual=_BLOCKS // 2,
    firing_s=50e-6,
    port=2368,
    packets=_xt32_packets,
    beside=calibration,
)


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
PRODUCT_ID: Final = {"VLP-16": 0x22, "Puck Hi-Res": 0x24}
POSITION_PORT: Final = 8308
HOUR_US: Final = 3_600_000_000
POSITION_BYTES: Final = 512
POSITION_EVERY_S: Final = 0.5
_BLOCK: Final = [("flag", "<u2"), ("azimuth", "<u2"), ("returns", [("ticks", "<u2"), ("reflectivity", "u1")], 32)]
_PACKET: Final = np.dtype([("blocks", _BLOCK, BLOCKS_PER_PACKET), ("stamp_us", "<u4"), ("factory", "u1", 2)])


def vlp16_packets(scenario: Scenario, site: SimulatedSite, spin: Spin, first: int, returns: Returns) -> Bytes:
    """(n, 1206) payloads of the data packets."""
    mode = scenario.lidar.return_mode
    n = returns.ticks.shape[1] // spin.firings_a_packet
    firing = first * spin.firings_a_packet + np.arange(n * spin.firings_a_packet)
    packets = np.zeros(n, _PACKET)
    packets["blocks"]["flag"] = 0xEEFF
    turn = spin.turns(spin.time_s(firing[::2])).reshape(n, -1) % 1.0
    azimuth = np.round(turn * (360.0 / AZIMUTH_STEP_DEG)).astype(np.uint16) % 36000
    _fill_blocks(packets["blocks"]["returns"], returns, mode)
    packets["blocks"]["azimuth"] = np.repeat(azimuth, 2, axis=1) if mode == "dual" else azimuth
    stamp_us = np.round(spin.time_s(firing[:: spin.firings_a_packet]) * 1e6).astype(np.int64)
    packets["stamp_us"] = (stamp_us + clock_us(scenario, site)) % HOUR_US
    packets["factory"] = RETURN_MODE[mode], PRODUCT_ID[scenario.lidar.model]
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
        ELEVATION_DEG, np.zeros(16), VERTICAL_OFFSET_M, LASER_S * np.arange(16, dtype=np.float64), step_m=0.002
    ),
    firings_a_packet=2 * BLOCKS_PER_PACKET,
    firings_a_packet_dual=BLOCKS_PER_PACKET,
    firing_s=FIRING_S,
    port=2368,
    packets=vlp16_packets,
    position_packets=True,
    stated="VLP-16",
)

HI_RES_ELEVATION_DEG: Final = np.array(
    [-10.0, 0.667, -8.667, 2.0, -7.333, 3.333, -6.0, 4.667, -4.667, 6.0, -3.333, 7.333, -2.0, 8.667, -0.667, 10.0]
)
HI_RES_OFFSET_M: Final = 1e-3 * np.array(
    [7.4, -0.9, 6.5, -1.8, 5.5, -2.7, 4.6, -3.7, 3.7, -4.6, 2.7, -5.5, 1.8, -6.5, 0.9, -7.4]
)
HI_RES: Final = replace(
    VLP16,
    beams=replace(VLP16.beams, elevation_deg=HI_RES_ELEVATION_DEG, height_m=HI_RES_OFFSET_M),
    stated="Puck Hi-Res",
)


OS1_COLUMNS: Final = 1024
OS1_BEAMS: Final = 32
_COLUMNS_A_PACKET: Final = 16
_PROFILE: Final = {False: "RNG19_RFL8_SIG16_NIR16", True: "RNG19_RFL8_SIG16_NIR16_DUAL"}
_SERIAL: Final = 122_000_000_032
_INIT_ID: Final = 46
_ELEVATION_DEG: Final = np.round(np.linspace(22.5, -22.5, OS1_BEAMS), 2)
_AZIMUTH_DEG: Final = np.tile([4.23, 1.41, -1.41, -4.23], OS1_BEAMS // 4)
"""Beams are staggered, so that adjacent ones do not disturb each other."""
_ORIGIN_MM: Final = 15.806
_HEIGHT_MM: Final = 36.18
OS1_TO_SENSOR: Final = [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, _HEIGHT_MM, 0, 0, 0, 1]
"""From the lidar frame, in which the encoder counts, to the sensor frame."""

OS1_PIXEL: Final = np.dtype(
    {"names": ["range", "reflectivity"], "formats": ["<u4", "u1"], "offsets": [0, 4], "itemsize": 12}
)
OS1_PIXEL_DUAL: Final = np.dtype({
    "names": ["range", "reflectivity", "range2", "reflectivity2"], "formats": ["<u4", "u1", "<u4", "u1"],
    "offsets": [0, 3, 4, 7], "itemsize": 16,
})  # fmt: skip
"""A pixel; of the ranges 19 bits count, those above hold flags and reflectivity."""


def _packet(pixel: np.dtype[np.void]) -> np.dtype[np.void]:
    column = np.dtype([("stamp_ns", "<u8"), ("number", "<u2"), ("status", "<u2"), ("pixels", pixel, OS1_BEAMS)])
    head = [("kind", "<u2"), ("frame", "<u2"), ("init_id", "u1", 3), ("serial", "u1", 5), ("alerts", "u1", 20)]
    return np.dtype([*head, ("columns", column, _COLUMNS_A_PACKET), ("tail", "u1", 32)])


def _os1_packets(scenario: Scenario, site: SimulatedSite, spin: Spin, first: int, returns: Returns) -> Bytes:
    """(n, 6400) payloads of the data packets, (n, 8448) of two returns."""
    mode = scenario.lidar.return_mode
    n = returns.ticks.shape[1] // _COLUMNS_A_PACKET
    packets = np.zeros(n, _packet(OS1_PIXEL_DUAL if mode == "dual" else OS1_PIXEL))
    firing = first * _COLUMNS_A_PACKET + np.arange(n * _COLUMNS_A_PACKET)
    turned = round(spin.first_turn * OS1_COLUMNS) + firing
    packets["kind"] = 1
    packets["frame"] = turned[::_COLUMNS_A_PACKET] // OS1_COLUMNS % 65_536
    packets["init_id"] = np.frombuffer(_INIT_ID.to_bytes(3, "little"), np.uint8)
    packets["serial"] = np.frombuffer(_SERIAL.to_bytes(5, "little"), np.uint8)
    columns = packets["columns"]
    stamp_us = 0 if not scenario.lidar.position_packets else clock_us(scenario, site)
    stamp_ns = np.round(spin.time_s(firing) * 1e9).astype(np.int64) + stamp_us * 1000
    columns["stamp_ns"] = stamp_ns.reshape(n, -1)
    columns["number"] = (turned % OS1_COLUMNS).reshape(n, -1)
    columns["status"] = 1
    shown = (1,) if mode == "last" else (0, 1) if mode == "dual" else (0,)
    for k, name in zip(shown, ("", "2"), strict=False):
        ticks = returns.ticks[k]
        if name:
            ticks = np.where(ticks == returns.ticks[0], 0, ticks)
        columns["pixels"]["range" + name] = ticks.reshape(n, _COLUMNS_A_PACKET, OS1_BEAMS)
        # after the range, whose upper byte it is with two returns
        columns["pixels"]["reflectivity" + name] = returns.reflectivity[k].reshape(n, _COLUMNS_A_PACKET, OS1_BEAMS)
    return packets.view(np.uint8).reshape(n, -1)


def metadata(scenario: Scenario) -> tuple[str, str]:
    """Name and text of the sensor's metadata."""
    profile = _PROFILE[scenario.lidar.return_mode == "dual"]
    mode = f"{OS1_COLUMNS}x{scenario.lidar.rpm // 60}"
    shift = np.round(_AZIMUTH_DEG * (OS1_COLUMNS / 360.0)).astype(int).tolist()
    said = {
        "sensor_info": {
            "prod_line": "OS-1-32-U0",
            "prod_pn": "840-102144-D",
            "prod_sn": str(_SERIAL),
            "image_rev": "ousteros-image-prod-bootes-v3.1.0+20240426041747",
            "build_rev": "v3.1.0",
            "build_date": "2024-04-26T02:34:31Z",
            "status": "RUNNING",
            "initialization_id": _INIT_ID,
        },
        "beam_intrinsics": {
            "beam_altitude_angles": _ELEVATION_DEG.tolist(),
            "beam_azimuth_angles": _AZIMUTH_DEG.tolist(),
            "lidar_origin_to_beam_origin_mm": _ORIGIN_MM,
            "beam_to_lidar_transform": [1, 0, 0, _ORIGIN_MM, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
        },
        "lidar_intrinsics": {"lidar_to_sensor_transform": OS1_TO_SENSOR},
        "imu_intrinsics": {"imu_to_sensor_transform": [1, 0, 0, 6.253, 0, 1, 0, -11.775, 0, 0, 1, 7.645, 0, 0, 0, 1]},
        "calibration_status": {"reflectivity": {"valid": True, "timestamp": "2023-01-25T15:11:58"}},
        "lidar_data_format": {
            "pixels_per_column": OS1_BEAMS,
            "columns_per_packet": _COLUMNS_A_PACKET,
            "columns_per_frame": OS1_COLUMNS,
            "pixel_shift_by_row": shift,
            "column_window": [0, OS1_COLUMNS - 1],
            "udp_profile_lidar": profile,
            "udp_profile_imu": "LEGACY",
        },
        "config_params": {
            "udp_port_lidar": 7502,
            "udp_port_imu": 7503,
            "udp_profile_lidar": profile,
            "udp_profile_imu": "LEGACY",
            "lidar_mode": mode,
            "timestamp_mode": f"TIME_FROM_{'SYNC_PULSE_IN' if scenario.lidar.position_packets else 'INTERNAL_OSC'}",
            "nmea_leap_seconds": 0,
        },
    }
    return "recording.json", json.dumps(said) + "\n"


OS1_32: Final = ScannerModel(
    beams=Beams(
        _ELEVATION_DEG,
        _AZIMUTH_DEG,
        np.full(OS1_BEAMS, 1e-3 * _HEIGHT_MM),
        np.zeros(OS1_BEAMS),
        origin_m=1e-3 * _ORIGIN_MM,
        step_m=0.001,
        zero_deg=180.0,
    ),
    firings_a_packet=_COLUMNS_A_PACKET,
    firings_a_packet_dual=_COLUMNS_A_PACKET,
    firing_s=float("nan"),
    columns=OS1_COLUMNS,
    port=7502,
    packets=_os1_packets,
    beside=metadata,
)


_SWING_S: Final = 0.5e-3
"""The beam swings up and down once, while the sensor turns."""
_POINTS_A_SWING: Final = 100
"""In a swing."""
_SWINGS: Final = 200
"""In a message."""
_LINES: Final = 4
_PHASE: Final = (np.arange(_POINTS_A_SWING) + 0.5) / _POINTS_A_SWING
_ROSETTE_DEG: Final = 22.5 + 29.5 * np.cos(2.0 * np.pi * _PHASE)
"""From -7 to 52 degrees, as of a Mid-360."""
_LIVOX_POINT: Final = np.dtype(
    [("offset_ns", "<u4"), ("xyz_m", "<f4", 3), ("reflectivity", "u1"), ("tag", "u1"), ("line", "u1")]
)
_CUSTOM_MESSAGE: Final = np.dtype(
    [
        *(("sequence", "<u4"), ("sec", "<u4"), ("nanosec", "<u4"), ("frame", "<u4")),
        *(("timebase", "<u8"), ("count", "<u4"), ("lidar", "u1", 4), ("points_count", "<u4")),
        ("points", _LIVOX_POINT, _POINTS_A_SWING * _SWINGS),
    ]
)
_CUSTOM_TYPE: Final = b"livox_ros_driver2/CustomMsg"


def messages(scenario: Scenario, site: SimulatedSite, spin: Spin, first: int, returns: Returns) -> Bytes:
    """(n, k) CustomMsg messages; a beam without a return has a point at 0, 0, 0."""
    n = returns.ticks.shape[1] // _SWINGS
    firing_s = spin.time_s(first * _SWINGS + np.arange(n * _SWINGS))
    azimuth = 2.0 * np.pi * spin.turns(firing_s[:, None] + MID360.beams.laser_s)
    elevation = np.radians(_ROSETTE_DEG)
    kept = 1 if scenario.lidar.return_mode == "last" else 0
    range_m = returns.ticks[kept] * MID360.beams.step_m
    out = np.zeros(n, _CUSTOM_MESSAGE)
    points = out["points"].reshape(-1, _POINTS_A_SWING)
    across_m = range_m * np.cos(elevation)
    xyz_m = np.stack([across_m * np.cos(azimuth), -across_m * np.sin(azimuth), range_m * np.sin(elevation)], axis=-1)
    out["points"]["xyz_m"] = xyz_m.reshape(n, -1, 3)
    begin_s = firing_s[::_SWINGS]
    since_s = firing_s.reshape(n, -1, 1) + MID360.beams.laser_s - begin_s[:, None, None]
    out["points"]["offset_ns"] = np.round(since_s * 1e9).reshape(n, -1)
    out["points"]["reflectivity"] = returns.reflectivity[kept].reshape(n, -1)
    out["points"]["line"] = np.arange(points.size).reshape(n, -1) % _LINES
    stamp_ns = np.round(begin_s * 1e9).astype(np.int64) + 1000 * clock_us(scenario, site)
    out["timebase"] = stamp_ns
    out["sec"] = stamp_ns // 10**9
    out["nanosec"] = stamp_ns % 10**9
    out["sequence"] = first + np.arange(n)
    out["count"] = _POINTS_A_SWING * _SWINGS
    out["points_count"] = _POINTS_A_SWING * _SWINGS
    return out.view(np.uint8).reshape(n, -1)


def _record(data: bytes, **header: bytes) -> bytes:
    """A record of a bag."""
    fields = b"".join(struct.pack("<I", len(k) + 1 + len(v)) + k.encode() + b"=" + v for k, v in header.items())
    return struct.pack("<I", len(fields)) + fields + struct.pack("<I", len(data)) + data


def _chunks(time_us: NDArray[np.int64], payload: Bytes, _: int, __: int) -> Bytes:
    """(n, k) chunks, each with the connection and a message (n, m), received at `time_us` (n,)."""
    said = _record(b"", topic=b"/livox/lidar", type=_CUSTOM_TYPE, md5sum=b"*", message_definition=b"")[4:-4]
    connection = _record(said, op=b"\x07", conn=bytes(4), topic=b"/livox/lidar")
    chunks = []
    for at_us, message in zip(time_us.tolist(), payload, strict=True):
        at = struct.pack("<II", at_us // 1_000_000, at_us % 1_000_000 * 1000)
        content = connection + _record(message.tobytes(), op=b"\x02", conn=bytes(4), time=at)
        chunk = _record(content, op=b"\x05", compression=b"none", size=struct.pack("<I", len(content)))
        chunks.append(np.frombuffer(chunk, np.uint8))
    return np.stack(chunks)


def _bag_head() -> bytes:
    counts = {"index_pos": bytes(8), "conn_count": bytes(4), "chunk_count": bytes(4)}
    empty = _record(b"", op=b"\x03", **counts)
    return b"#ROSBAG V2.0\n" + _record(b" " * (4096 - len(empty)), op=b"\x03", **counts)


MID360: Final = ScannerModel(
    beams=Beams(_ROSETTE_DEG, 0.0 * _PHASE, 0.0 * _PHASE, (_PHASE - 0.5 / _POINTS_A_SWING) * _SWING_S, step_m=0.001),
    firings_a_packet=_SWINGS,
    firings_a_packet_dual=_SWINGS,
    firing_s=_SWING_S,
    port=0,
    packets=messages,
    container=Container(".bag", _bag_head(), _chunks),
)


SCANNERS: Final = {"VLP-16": VLP16, "Puck Hi-Res": HI_RES, "OS1-32": OS1_32, "PandarXT-32": XT32, "Mid-360": MID360}
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
    """What there is to record, and from where: also heights of the crop, a mount that moves, an implement in front."""

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
    scenario = world.scenario
    site = world.site
    ground = world.ground
    motion = world.motion
    model = SCANNERS[scenario.lidar.model]
    spin = model.spin(scenario, duration_s)
    optics = make_optics(scenario, model.beams, mount_rotation(scenario.lidar.true_rpy_deg))
    scene = make_scene(scenario, ground, world.crop)
    rng = random_for(scenario.seed, "computer")
    counts = _ReturnCounts()
    seen = SeenAfter(scenario, ground)
    clock_us = 0
    position_packets = 0
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
                begin = end
                position_packets = position_packets + 1
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
    number = first * spin.firings_a_packet
    motion = world.motion
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
