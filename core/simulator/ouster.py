"""An Ouster OS1-32: 32 beams over 45 degrees, 1024 columns a turn, in packets of the profiles RNG19 and dual RNG19.

Formats: Ouster Sensor Documentation (firmware 3.1), chapters "Coordinate frames and XYZ calculation" and "Lidar data
packet format".
"""

from __future__ import annotations

import json
from typing import Final

import numpy as np

from furrowmap.core.simulator.capture import Bytes
from furrowmap.core.simulator.rays import Beams, Returns
from furrowmap.core.simulator.scanner import ScannerModel, Spin, clock_us
from furrowmap.core.simulator.scenario import Scenario
from furrowmap.core.simulator.site import SimulatedSite

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
OS1_PIXEL_DUAL: Final = np.dtype(
    {
        "names": ["range", "reflectivity", "range2", "reflectivity2"],
        "formats": ["<u4", "u1", "<u4", "u1"],
        "offsets": [0, 3, 4, 7],
        "itemsize": 16,
    }
)
"""A pixel; of the ranges 19 bits count, those above hold flags and reflectivity."""


def _packet(pixel: np.dtype[np.void]) -> np.dtype[np.void]:
    column = np.dtype([("stamp_ns", "<u8"), ("number", "<u2"), ("status", "<u2"), ("pixels", pixel, OS1_BEAMS)])
    head = [("kind", "<u2"), ("frame", "<u2"), ("init_id", "u1", 3), ("serial", "u1", 5), ("alerts", "u1", 20)]
    return np.dtype([*head, ("columns", column, _COLUMNS_A_PACKET), ("tail", "u1", 32)])


def data_packets(scenario: Scenario, site: SimulatedSite, spin: Spin, first: int, returns: Returns) -> Bytes:
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
            "timestamp_mode": "TIME_FROM_SYNC_PULSE_IN"
            if scenario.lidar.position_packets
            else "TIME_FROM_INTERNAL_OSC",
            "nmea_leap_seconds": 0,
        },
    }
    return "recording.json", json.dumps(said) + "\n"


OS1_32: Final = ScannerModel(
    beams=Beams(
        elevation_deg=_ELEVATION_DEG,
        azimuth_deg=_AZIMUTH_DEG,
        height_m=np.full(OS1_BEAMS, 1e-3 * _HEIGHT_MM),
        laser_s=np.zeros(OS1_BEAMS),
        origin_m=1e-3 * _ORIGIN_MM,
        step_m=0.001,
        zero_deg=180.0,
    ),
    firings_a_packet=_COLUMNS_A_PACKET,
    firings_a_packet_dual=_COLUMNS_A_PACKET,
    firing_s=float("nan"),
    columns=OS1_COLUMNS,
    port=7502,
    packets=data_packets,
    position_packets=False,
    beside=metadata,
)
