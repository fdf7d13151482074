"""Which steps clean a cloud."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from furrowmap.core.runtime.options import OptionSettings, setting

if TYPE_CHECKING:
    from furrowmap.core.readers.las.cloud import Box
    from furrowmap.core.surfaces.ground_filter import GroundMethod
    from furrowmap.core.surfaces.outliers import Outliers


@dataclass(frozen=True)
class Cleaning(OptionSettings):
    """Cleaning steps, in order.

    Attributes:
        box: Keep points in this box, in the CRS of the output.
        without: Leave out these classes; 64,65 are the machine in furrowmap's own clouds.
        every: Keep every N-th point.
        outliers: Outlier detection method; outliers become noise (class 7).
        drop_noise: Leave out outliers and the noise classes 7 and 18 of the input.
        ground: Ground classification method: ground becomes class 2, the rest class 1, except noise and the machine in
            furrowmap's own clouds. none keeps the classes.
        voxel_m: Voxel size; keep the point nearest to the centre of each voxel.
    """

    box: Box | None = setting("--bbox", "W,S,E,N", label="Extent")
    without: frozenset[int] = setting(
        "--without-class", "N,N", default=frozenset(), label="Class codes to leave out, such as 64,65"
    )
    every: int = setting("--every", "N", default=1, minimum=1, label="Every n-th point")
    outliers: Outliers = setting(
        "--outliers", default="none", choices=("none", "radius", "statistical"), label="Outlier detection method"
    )
    drop_noise: bool = setting("--drop-noise", default=False, label="Leave out noise")
    ground: GroundMethod | Literal["none"] = setting(
        "--ground", default="none", choices=("none", "smrf", "csf"), label="Ground classification"
    )
    voxel_m: float | None = setting("--voxel", "METRES", minimum=0.001, maximum=10, label="Voxel size")
