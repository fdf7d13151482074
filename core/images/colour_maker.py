"""From frames and the points of a cloud to what colours both points and surfaces."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.images.balance import Balance, balanced
from furrowmap.core.images.colouring import Colours, observations
from furrowmap.core.images.frame_pixels import FramePixels, decoded
from furrowmap.core.images.frames import Frames
from furrowmap.core.images.visibility import Visibility, VisibilityMaker
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.progress import Progress, silent

FloatArray = NDArray[np.float64]

SAMPLES: Final = 8_000
"""Points from whose colours in several frames these are balanced."""
MOST_OBSERVATIONS: Final = 400_000


class ColourMaker:
    """Takes the points of a cloud in pieces, and gives what colours them.

    Args:
        frames: at least one.
        origin_m: local origin of the points' coordinates.
    """

    def __init__(self, frames: Frames, origin_m: tuple[float, float, float]) -> None:
        self._frames, self._visibility = frames, VisibilityMaker(frames, origin_m)
        self._samples: list[FloatArray] = []
        self._every, self._next, self._count = 1, 0, 0

    def add(self, xyz_m: FloatArray) -> None:
        """Points (n, 3) of surfaces, which hide what is behind them, against the local origin."""
        self._visibility.add(xyz_m)
        chosen = xyz_m[self._next :: self._every]
        self._next = (self._next - len(xyz_m)) % self._every
        self._samples.append(chosen.copy())
        self._count += len(chosen)
        while self._count > 2 * SAMPLES:
            kept = np.concatenate(self._samples)[::2]
            self._samples, self._count, self._every = [kept], len(kept), 2 * self._every

    def finish(self, notices: list[Notice], progress: Progress = silent) -> Colours:
        """What colours the points; the maker cannot be used any more.

        Args:
            notices: images that cannot be used are added.
            progress: receives the stage "reading images".

        Raises:
            OSError: if the disk has no room for the images.
        """
        visibility = self._visibility.finish()
        pixels = decoded(self._frames, notices, progress)
        samples = np.concatenate([np.zeros((0, 3)), *self._samples])
        return Colours(visibility, pixels, _balance(visibility, pixels, samples), self._frames.poses.t_s)


def _balance(visibility: Visibility, pixels: FramePixels, samples: FloatArray) -> Balance:
    """The balance of the frames from points that several of them see."""
    count = len(visibility.slack)
    plain = Colours(visibility, pixels, Balance.none(count), np.zeros(count))
    point, frame, at_px, levels = observations(samples, *plain.arguments[:-2], MOST_OBSERVATIONS)
    middle = 0.5 * (visibility.view.size - 1.0)
    radius = np.linalg.norm(at_px - middle, axis=1) / (0.5 * np.linalg.norm(visibility.view.size))
    return balanced(count, point, frame, radius, levels)
