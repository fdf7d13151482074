"""A ground with a board above it: a cloud, images of it, and their session."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
from pyproj import CRS

from tests.core.images.scenes import CAMERA, HEIGHT_M, cloud, frames_above

CORNER_M = np.array([500_000.0, 5_900_000.0, 0.0])
PLACES = np.array([[-2.0, -1.0], [-1.0, 0.5], [0.5, 1.0], [2.0, -1.0]])

SESSION = """\
furrowmap = 1
[recording]
lidar = ["cloud.laz"]
[crs]
map = "EPSG:25832"
[trajectory]
files = ["trajectory.csv"]
"""


def write_scene(folder: Path) -> Path:
    """Cloud, trajectory, images and sessions with and without a camera, in the folder, which is returned."""
    frames = frames_above(folder, PLACES, np.zeros(len(PLACES)))
    seconds = np.arange(-1.0, 4.05, 0.1)
    at = np.column_stack([np.interp(seconds, np.arange(4.0), axis) for axis in PLACES.T]) + CORNER_M[:2]
    rows = np.column_stack([1_779_529_272.0 + seconds, at, np.full(len(at), HEIGHT_M), np.zeros((len(at), 2))])
    rows = np.column_stack([rows, np.full(len(at), 90.0)])
    head = "time_unix_s,e_m,n_m,h_m,roll_deg,pitch_deg,heading_deg"
    np.savetxt(folder / "trajectory.csv", rows, "%.4f", ",", header=head, comments="")
    listed = [f"{path.name},{1_779_529_272 + k}" for k, path in enumerate(frames.paths)] + ["late.png,1779530000"]
    (folder / "late.png").write_bytes(frames.paths[0].read_bytes())
    (folder / "images.csv").write_text("\n".join(["file,time_unix_s", *listed, ""]), encoding="utf-8")
    intrinsics = "".join(f"{name} = {getattr(CAMERA, name)}\n" for name in ("fx", "fy", "cx", "cy", "k1", "k2"))
    camera = f'[camera]\ntable = "images.csv"\nwidth = {CAMERA.width}\nheight = {CAMERA.height}\n{intrinsics}'
    (folder / "session.toml").write_text(f"{SESSION}{camera}rpy_deg = [180.0, 0.0, 0.0]\n", encoding="utf-8")
    (folder / "bare.toml").write_text(SESSION, encoding="utf-8")
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.add_crs(CRS("EPSG:25832"))
    header.scales = np.full(3, 0.001)
    header.offsets = CORNER_M
    las = laspy.LasData(header)
    las.xyz = np.concatenate(cloud()) + CORNER_M
    las.write(folder / "cloud.laz")
    return folder
