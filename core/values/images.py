"""Images of a camera, with their times: files, or images in a recording."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray

CONTRADICTING: Final = "images-contradict"
"""Code of the notice of images that are used for nothing."""


@dataclass(frozen=True)
class RawLayout:
    """How the bytes of an image without a file format lie: bytes of a row (`step`), encoding as ROS names it."""

    width: int
    height: int
    step: int
    encoding: str
    big_endian: bool = False


@dataclass(frozen=True, eq=False)
class StoredImage:
    """An image of a recording, in a scratch file: a JPEG or PNG file, or raw bytes of a layout."""

    name: str
    data: memoryview
    layout: RawLayout | None = None

    def __str__(self) -> str:
        return self.name


ImageFile = Path | StoredImage


@dataclass(frozen=True)
class Images:
    """Images in the order of time, by the UTC (n,) stated for each.

    Attributes:
        lon_lat_h: (n, 3) longitude and latitude in degrees and height in metres, nan where files do not state them.
        sigma_m: (n, 3) standard deviations of easting, northing and height, nan where files do not state them.
    """

    paths: tuple[ImageFile, ...]
    t_s: FloatArray
    lon_lat_h: FloatArray
    sigma_m: FloatArray

    def __post_init__(self) -> None:
        n = len(self.paths)
        if self.t_s.shape != (n,) or self.lon_lat_h.shape != (n, 3) or self.sigma_m.shape != (n, 3):
            shapes = f"t_s {self.t_s.shape}, lon_lat_h {self.lon_lat_h.shape}, sigma_m {self.sigma_m.shape}"
            raise ValueError(f"Images has {n} paths, {shapes}")
        if not bool(np.all(np.diff(self.t_s) >= 0)):
            raise ValueError("Images.t_s decreases")

    def __len__(self) -> int:
        return len(self.paths)

    @classmethod
    def sorted(
        cls,
        paths: Sequence[ImageFile],
        t_s: FloatArray,
        lon_lat_h: FloatArray | None = None,
        sigma_m: FloatArray | None = None,
    ) -> "Images":
        """Images in any order; without `lon_lat_h` and `sigma_m` (n, 3) these are unknown."""
        unknown = np.full((len(paths), 3), np.nan)
        place = unknown if lon_lat_h is None else lon_lat_h.reshape(-1, 3)
        sigma = unknown if sigma_m is None else sigma_m.reshape(-1, 3)
        order = np.argsort(t_s, kind="stable")
        return cls(tuple(paths[k] for k in order), t_s[order], place[order], sigma[order])

    def chosen(self, which: NDArray[np.intp]) -> "Images":
        """Those of some numbers (k,), which increase."""
        paths = tuple(self.paths[k] for k in which.tolist())
        return Images(paths, self.t_s[which], self.lon_lat_h[which], self.sigma_m[which])

    def earlier_by(self, seconds: float) -> "Images":
        """The images with earlier times."""
        return replace(self, t_s=self.t_s - seconds) if seconds else self


def joined(parts: Sequence[Images]) -> Images:
    """All images of several sources in the order of time."""
    if len(parts) == 1:
        return parts[0]
    paths = [path for part in parts for path in part.paths]
    times = np.concatenate([np.zeros(0), *(part.t_s for part in parts)])
    place, sigma = (
        np.concatenate([np.zeros((0, 3)), *values])
        for values in ([part.lon_lat_h for part in parts], [part.sigma_m for part in parts])
    )
    return Images.sorted(paths, times, place, sigma)
