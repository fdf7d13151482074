"""Colours of bare soil from two frames of the flight over wheat, against a third, with the true surface and poses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from furrowmap.core.images.colouring import NO_FRAME, ColourMaker, decode_frames
from furrowmap.core.images.image_frames import frames_along
from furrowmap.core.images.pinhole import inside, project
from furrowmap.core.pipeline.solution import ground_scale
from furrowmap.core.session.opened import open_session
from furrowmap.core.values.trajectory import trajectory_from_attitude

FIRST = 85
SEEN, HELD = (0, 2), 1
TRUE_RPY_DEG = (-179.749995, 0.349997, -89.598473)
DELAY_S = 0.012
POINTS = 60_000
FloatArray = NDArray[np.float64]


def ground(folder: Path, about_m: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Random places (n, 3) of soil and canopy within 4 m of a place, against it; which are bare soil."""
    truth = np.load(folder / "truth" / "surface.npz")
    cell, west, south = (float(truth[name]) for name in ("cell_m", "e0", "n0"))
    at = np.random.default_rng(1).uniform(-4.0, 4.0, (POINTS, 2))
    column, row = ((at + about_m[:2] - [west, south]) / cell - 0.5).T

    def read(values: FloatArray, order: int) -> FloatArray:
        out: FloatArray = map_coordinates(values, [row, column], order=order, mode="nearest")
        return out

    up = read(truth["soil"], 1) + read(truth["canopy_height"], 0) + float(truth["h0_m"]) - about_m[2]
    return np.column_stack([at, up]), read((truth["canopy_height"] > 0.0).astype(float), 1) == 0.0


def sampled(image: NDArray[np.uint8], pixel: FloatArray) -> FloatArray:
    """Levels (n, 3) between four pixels."""
    whole = np.clip(pixel.astype(int), 0, np.array(image.shape[1::-1]) - 2)
    (u, v), (x, y) = whole.T, (pixel - whole).T[:, :, None]
    levels = image.astype(np.float64)
    upper = levels[v, u] * (1 - x) + levels[v, u + 1] * x
    lower = levels[v + 1, u] * (1 - x) + levels[v + 1, u + 1] * x
    out: FloatArray = upper * (1 - y) + lower * y
    return out


def test_colours__of_soil_are_those_of_a_frame_that_was_held_out(shared_data: Path) -> None:
    folder = shared_data / "uav_wheat"
    opened = open_session(folder / "session.toml")
    table = np.genfromtxt(folder / "truth" / "trajectory.csv", delimiter=",", names=True)
    images, _ = opened.images()
    images = images.chosen(np.arange(FIRST, FIRST + 3))
    near = np.abs(table["time_unix_s"] - images.t_s[1]) < 2.0
    t_s, e, n, h, roll, pitch, heading = (table[name][near] for name in table.dtype.names)
    truth = trajectory_from_attitude(t_s, np.column_stack([e, n, h]), roll, pitch, heading, max_gap_s=0.1)
    camera = replace(opened.camera(), rpy_deg=TRUE_RPY_DEG, shutter_delay_s=DELAY_S)
    frames, _ = frames_along(images, camera, truth, ground_scale(opened.frame, truth))
    assert frames is not None
    about = np.round(frames.poses.xyz_m[HELD]) - [0.0, 0.0, 6.0]
    xyz, bare = ground(folder, about)
    maker = ColourMaker(frames.selected(list(SEEN)), tuple(about.tolist()))
    maker.add(xyz)
    rgb, frame = maker.finish().of_points(xyz, np.full(len(xyz), images.t_s[HELD]))
    pixel = project(camera, frames.poses.in_frame(HELD, xyz + about))
    use = bare & np.isfinite(pixel[:, 0]) & (frame != NO_FRAME)
    use[use] &= inside(camera, pixel[use])
    assert use.sum() > 3000
    held, given = decode_frames(frames)[0].rgb[HELD], rgb[:, use].T / 257.0
    square = ((pixel[use] - 0.5 * np.array([799, 599])) ** 2).sum(axis=1) / (400.0**2 + 300.0**2)
    design = np.column_stack([np.ones(len(square)), square, square**2])

    def error(shift: tuple[float, float]) -> float:
        """RMS in levels but for exposure and vignetting of the frame, which no other frame shows."""
        off = np.log(sampled(held, pixel[use] + shift) / given).mean(axis=1)
        left: FloatArray = off - design @ np.linalg.lstsq(design, off, rcond=None)[0]
        return float((left * given.mean(axis=1)).std())

    right = error((0.0, 0.0))
    assert right < 2.5, "noise of 0.8 levels in each, blur, JPEG, and interpolation in two images"
    assert min(map(error, ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)))) > 1.5 * right, "within a pixel"
