"""Frames of a textured ground with a board above it, rendered by tracing a ray for each pixel."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from furrowmap.core.images.image_frames import FramePoses, Frames
from furrowmap.core.images.pinhole import unproject
from furrowmap.core.values.camera import Camera

FloatArray = NDArray[np.float64]

CAMERA = Camera(200, 150, 165.0, 165.0, 101.0, 74.0, k1=-0.08, k2=0.01)
HEIGHT_M = 6.0
BOARD_M = (-0.8, 0.8, -0.6, 0.6, 1.5)
"""West, east, south, north edge, and height."""
BOARD_LEVELS = (200.0, 30.0, 40.0)
VIGNETTING = (-0.15, -0.05, -0.02)


def texture(xy_m: FloatArray) -> FloatArray:
    """Levels (n, 3) of the ground at places (n, 2): waves of half a metre and more."""
    x, y = xy_m[:, 0], xy_m[:, 1]
    waves = [np.sin(2.1 * x + 1.3 * y) + np.sin(5.0 * x - 3.0 * y), np.cos(3.3 * y) + np.sin(7.0 * x), np.sin(4.0 * y)]
    return np.column_stack([110.0 + 20.0 * wave for wave in waves])


def behind_board(xyz_m: FloatArray, centre_m: FloatArray) -> NDArray[np.bool_]:
    """(n,) whether the board is between points (n, 3) and a camera above it at (3,) or (n, 3)."""
    west, east, south, north, height = BOARD_M
    share = (centre_m[..., 2] - height) / (centre_m[..., 2] - xyz_m[:, 2])
    at = centre_m + share[:, None] * (xyz_m - centre_m)
    below = xyz_m[:, 2] < height - 0.01
    return below & (at[:, 0] > west) & (at[:, 0] < east) & (at[:, 1] > south) & (at[:, 1] < north)


def frames_above(folder: Path, places: FloatArray, gains: FloatArray, *, noise: float = 1.0) -> Frames:
    """Frames of a camera that looks down, x to the east, from places (n, 2) 6 m above the ground, one a second."""
    down = np.diag([1.0, -1.0, -1.0])
    rows, columns = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
    pixels = np.column_stack([columns.ravel(), rows.ravel()]).astype(np.float64)
    ways = unproject(CAMERA, pixels) @ down.T
    square = 4.0 * ((pixels - [99.5, 74.5]) ** 2).sum(axis=1) / (CAMERA.width**2 + CAMERA.height**2)
    dark = sum(factor * square ** (k + 1) for k, factor in enumerate(VIGNETTING))
    rng, paths = np.random.default_rng(7), []
    for k, place in enumerate(places):
        centre = np.array([*place, HEIGHT_M])
        ground = centre + ways * HEIGHT_M
        levels = texture(ground[:, :2])
        levels[behind_board(ground, centre)] = BOARD_LEVELS
        levels = levels * np.exp(dark + gains[k])[:, None] + rng.normal(0.0, noise, levels.shape)
        image = np.rint(np.clip(levels, 0, 255)).astype(np.uint8).reshape(CAMERA.height, CAMERA.width, 3)
        paths.append(folder / f"{k:03}.png")
        Image.fromarray(image).save(paths[-1])
    n = len(places)
    centres = np.column_stack([places, np.full(n, HEIGHT_M)])
    return Frames(tuple(paths), CAMERA, FramePoses(np.arange(float(n)), centres, np.repeat(down[None], n, axis=0)))


def cloud() -> tuple[FloatArray, FloatArray]:
    """Points of the ground, that below the board included, and of the board, 4 cm apart."""
    x, y = np.meshgrid(np.arange(-4.0, 4.0, 0.04), np.arange(-3.0, 3.0, 0.04))
    ground = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    west, east, south, north, height = BOARD_M
    x, y = np.meshgrid(np.arange(west, east, 0.04), np.arange(south, north, 0.04))
    return ground, np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height)])
