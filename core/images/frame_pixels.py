"""The pixels of frames, decoded once into a scratch file that the system pages in and out."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.images.frames import Frames
from furrowmap.core.readers.exif import read_pixels
from furrowmap.core.runtime import scratch
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.runtime.threads import threads
from furrowmap.core.values.camera import Camera

MOST_BYTES: Final = 6_000_000_000
"""On disk, of all frames together; larger ones are reduced by 2, 4, ... until they fit."""


@dataclass(frozen=True)
class FramePixels:
    """Pixels of all frames.

    Attributes:
        camera: of the pixels, which may be reduced.
        rgb: (n, height, width, 3) uint8.
        usable: (n,) which could be read.
        reduction: a pixel is the mean of so many by so many.
    """

    camera: Camera
    rgb: NDArray[np.uint8]
    usable: NDArray[np.bool_]
    reduction: int


def decoded(frames: Frames, notices: list[Notice], progress: Progress = silent) -> FramePixels:
    """Decode all frames.

    Args:
        frames: at least one.
        notices: how many cannot be read, or have another size, is added.
        progress: receives the stage "reading images".

    Raises:
        OSError: if the disk has no room for them.
    """
    camera = frames.camera
    reduction = reduction_for(len(frames), camera)
    small = camera.reduced(reduction)
    rgb = scratch.zeros((len(frames), small.height, small.width, 3), np.uint8)
    faults: list[str] = [""] * len(frames)

    def decode(k: int) -> None:
        try:
            pixels = read_pixels(frames.paths[k], reduction)
        except ValueError as error:
            faults[k] = str(error)
            return
        if pixels.shape[:2] == (small.height, small.width):
            rgb[k] = pixels
        else:
            height, width = pixels.shape[:2]
            faults[k] = f"{frames.paths[k]}: {width * reduction} × {height * reduction} pixels"

    with ThreadPoolExecutor(threads()) as pool:
        for k, _ in enumerate(pool.map(decode, range(len(frames)))):
            progress("reading images", (k + 1) / len(frames))
    bad = [fault for fault in faults if fault]
    if bad:
        notices.append(
            Notice(
                "images-not-decoded",
                bad=len(bad),
                frames=len(frames),
                width=camera.width,
                height=camera.height,
                bad_first=bad[0],
            )
        )
    return FramePixels(small, rgb, np.array([not fault for fault in faults], bool), reduction)


def reduction_for(count: int, camera: Camera) -> int:
    """The least power of 2 by which images are reduced to fit into MOST_BYTES."""
    reduction = 1
    while 3 * count * camera.width * camera.height / reduction**2 > MOST_BYTES:
        reduction *= 2
    return reduction
