"""Colours of a run's points: how far frames that were held out are off, the colour error, speed.

    python benchmarks/colours.py SESSION CLOUD

The session has [camera] and an IMU; the cloud is of its run. Every fourth frame is held out: the points take their
colours from the others, are projected into the held-out ones, and the shift of their colours against the pixels there
is estimated in blocks by least squares (Lucas and Kanade 1981).
"""

from __future__ import annotations

import sys
from pathlib import Path
from time import process_time

import laspy
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.images.colouring import NO_FRAME, ColourMaker, Colours
from furrowmap.core.images.image_frames import Frames, frames_along
from furrowmap.core.images.pinhole import inside, project
from furrowmap.core.pipeline.solution import companions, ground_scale
from furrowmap.core.readers.image_pixels import read_pixels
from furrowmap.core.session.opened import open_session
from furrowmap.core.session.session_camera import camera_of
from furrowmap.core.trajectory.located import locate
from furrowmap.core.values.clock import las_time_to_utc

FloatArray = NDArray[np.float64]

BLOCK_PX = 200
FEWEST = 2000
ROUNDS = 4
PART = 500_000


def main() -> None:
    """Measure and print."""
    opened = open_session(Path(sys.argv[1]))
    located = locate(opened.positions(), opened.session, opened.frame, companions(opened))
    assert opened.session.camera is not None
    scale = ground_scale(opened.frame, located.trajectory)
    camera = camera_of(opened.session.camera)
    images, _ = opened.images()
    frames, _ = frames_along(images, camera, located.trajectory, scale)
    assert frames is not None
    with laspy.open(sys.argv[2]) as file:
        points = file.read()
    kept = np.isin(points.classification, (1, 2))
    origin = tuple(np.round(np.asarray(points.xyz[kept]).mean(axis=0), -2).tolist())
    xyz = np.ascontiguousarray(np.asarray(points.xyz)[kept] - origin)
    t_s = las_time_to_utc(np.asarray(points.gps_time)[kept])
    held = np.arange(len(frames)) % 4 == 2
    colours = made(frames.selected(~held), origin, xyz)
    begin = process_time()
    rgb, frame = colours.of_points(xyz, t_s)
    seconds = process_time() - begin
    print(
        f"{len(xyz):,} points, {len(xyz) / seconds / 1e6:.2f} M points a second of one processor, "
        f"{(frame != NO_FRAME).mean():.1%} with a colour; vignetting {colours.balance.corner:.3f}"
    )
    unseen = made(frames.selected(held), origin, xyz)
    shifts, errors = [], []
    for k in range(int(held.sum())):
        found, left = against(unseen, frames.selected(held), k, xyz, rgb, frame, origin)
        shifts += found
        errors += left
    length = np.linalg.norm(np.array(shifts), axis=1)
    print(
        f"{len(shifts)} blocks of {int(held.sum())} held-out frames: shift {np.median(length):.2f} px (median), "
        f"{np.percentile(length, 90):.2f} px (90 %); mean {np.mean(shifts, axis=0).round(2)} px; "
        f"colour error {np.median(errors):.1f} levels (RMS, median of blocks)"
    )


def made(frames: Frames, origin: tuple[float, float, float], xyz: FloatArray) -> Colours:
    """What colours the points from some frames."""
    maker, begin = ColourMaker(frames, origin), process_time()
    for part in np.array_split(xyz, -(-len(xyz) // PART)):
        maker.add(part)
    depth = process_time()
    colours = maker.finish()
    print(
        f"{len(frames)} frames: depth maps {len(xyz) / (depth - begin) / 1e6:.2f} M points a second of one processor, "
        f"images and balance {process_time() - depth:.1f} s"
    )
    return colours


def against(
    unseen: Colours,
    frames: Frames,
    k: int,
    xyz: FloatArray,
    rgb: NDArray[np.uint16],
    frame: NDArray[np.int32],
    origin: tuple[float, float, float],
) -> tuple[list[FloatArray], list[float]]:
    """Shifts (column, row) of the points' colours in blocks of a frame, and what is left of the differences."""
    pixels = project(frames.camera, frames.poses.in_frame(k, xyz + origin))
    depth = frames.poses.in_frame(k, xyz + origin)[:, 2]
    use = np.isfinite(pixels[:, 0]) & (frame != NO_FRAME)
    use[use] &= inside(frames.camera, pixels[use])
    cell = ((pixels[use] + 0.5) / unseen.visibility.cell_px).astype(int)
    nearest = unseen.visibility.depth_m[k][cell[:, 1], cell[:, 0]]
    use[use] &= depth[use] <= nearest + 0.1 + unseen.visibility.slack[k] * nearest
    image = read_pixels(frames.paths[k], 1).astype(np.float64)
    size = np.array([frames.camera.width, frames.camera.height])
    square = (((pixels - 0.5 * (size - 1)) ** 2).sum(axis=1) * 4.0 / (size**2).sum())[use]
    b = unseen.balance.vignetting
    dark = square * (b[0] + square * (b[1] + square * b[2]))
    at, levels = pixels[use], rgb[:, use].mean(axis=0) / 257.0 * np.exp(dark)
    grey = image.mean(axis=2)
    slope_v, slope_u = np.gradient(grey)
    found, left = [], []
    for row in range(0, frames.camera.height, BLOCK_PX):
        for column in range(0, frames.camera.width, BLOCK_PX):
            here = (
                (at[:, 0] >= column) & (at[:, 0] < column + BLOCK_PX) & (at[:, 1] >= row) & (at[:, 1] < row + BLOCK_PX)
            )
            if here.sum() < FEWEST:
                continue
            shift = np.zeros(2)
            for _ in range(ROUNDS):
                place = at[here] + shift
                d = bilinear(grey, place) - levels[here]
                d -= np.median(d)
                good = np.abs(d) < 3.0 * np.median(np.abs(d)) + 1.0
                g = np.column_stack([bilinear(slope_u, place), bilinear(slope_v, place)])[good]
                shift = shift - np.linalg.lstsq(g, d[good], rcond=None)[0]
            found.append(shift)
            left.append(float(np.sqrt((d**2).mean())))
    return found, left


def bilinear(image: FloatArray, at: FloatArray) -> FloatArray:
    """Values at pixels (n, 2)."""
    u, v = np.clip(at[:, 0], 0, image.shape[1] - 1.001), np.clip(at[:, 1], 0, image.shape[0] - 1.001)
    c, r = u.astype(int), v.astype(int)
    x, y = u - c, v - r
    top = (1 - x) * image[r, c] + x * image[r, c + 1]
    return (1 - y) * top + y * ((1 - x) * image[r + 1, c] + x * image[r + 1, c + 1])


if __name__ == "__main__":
    main()
