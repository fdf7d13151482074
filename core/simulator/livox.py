"""A Livox-like scanner: no rings, 200,000 points a second in a pattern that does not repeat, recorded in a ROS 1 bag.

Formats: livox_ros_driver2, msg/CustomMsg; ROS bag format 2.0, without the index that a recorder writes when it ends.
"""

from __future__ import annotations

import struct
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.simulator.capture import Bytes, Container
from furrowmap.core.simulator.rays import Beams, Returns
from furrowmap.core.simulator.scanner import ScannerModel, Spin, clock_us
from furrowmap.core.simulator.scenario import Scenario
from furrowmap.core.simulator.site import SimulatedSite

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
    out["timebase"], out["sec"], out["nanosec"] = stamp_ns, stamp_ns // 10**9, stamp_ns % 10**9
    out["sequence"], out["count"], out["points_count"] = (
        first + np.arange(n),
        _POINTS_A_SWING * _SWINGS,
        _POINTS_A_SWING * _SWINGS,
    )
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
    beams=Beams(
        elevation_deg=_ROSETTE_DEG,
        azimuth_deg=np.zeros(_POINTS_A_SWING),
        height_m=np.zeros(_POINTS_A_SWING),
        laser_s=(_PHASE - 0.5 / _POINTS_A_SWING) * _SWING_S,
        origin_m=0.0,
        step_m=0.001,
        zero_deg=0.0,
    ),
    firings_a_packet=_SWINGS,
    firings_a_packet_dual=_SWINGS,
    firing_s=_SWING_S,
    columns=0,
    port=0,
    packets=messages,
    position_packets=False,
    container=Container(".bag", _bag_head(), _chunks),
)
