"""Sentences of NMEA 0183 for software that takes a position and a heading from a network port."""

import datetime as dt
from functools import reduce
from operator import xor

import numpy as np

from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.live.drive import LivePose
from furrowmap.core.values.gnss import Fix


def sentences(pose: LivePose, frame: MapFrame) -> bytes:
    """GGA, VTG and HDT of the vehicle's origin; the altitude of GGA is the height of the map frame."""
    e, n, h = (np.array([value]) for value in pose.xyz_m)
    lon, lat = (float(value[0]) for value in frame.to_lon_lat(e, n))
    heading = (pose.attitude_deg[2] + float(frame.convergence_deg(np.array([lon]), np.array([lat]))[0])) % 360.0
    course = heading if pose.speed_mps >= 0.0 else (heading + 180.0) % 360.0
    time = dt.datetime.fromtimestamp(pose.t_s, dt.UTC)
    fix = Fix.ESTIMATED if pose.is_guess else pose.fix
    quality = int(fix) if fix <= Fix.SIMULATED else int(Fix.DGPS)
    clock = f"{time:%H%M%S}.{time.microsecond // 10000:02d}"
    speed = abs(pose.speed_mps)
    return b"".join(
        f"${body}*{reduce(xor, body.encode('ascii')):02X}\r\n".encode("ascii")
        for body in (
            f"GPGGA,{clock},{_angle(lat, 2, 'NS')},{_angle(lon, 3, 'EW')},{quality},,,{float(h[0]):.3f},M,,M,,",
            f"GPVTG,{course:.2f},T,,M,{speed * 3600.0 / 1852.0:.2f},N,{speed * 3.6:.2f},K,A",
            f"GPHDT,{heading:.2f},T",
        )
    )


def _angle(angle_deg: float, digits: int, sides: str) -> str:
    """Degrees and minutes, and the hemisphere."""
    minutes = round(abs(angle_deg) * 60.0, 7)
    return f"{int(minutes // 60):0{digits}d}{minutes % 60:010.7f},{sides[angle_deg < 0.0]}"
