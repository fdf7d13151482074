"""Ground classification of a cloud."""

from __future__ import annotations

from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import map_coordinates

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.surfaces.gaps import filled
from furrowmap.core.surfaces.smrf import Smrf, ground_cells
from furrowmap.core.surfaces.tiles import tiles

FloatArray = NDArray[np.float64]
GroundMethod = Literal["smrf", "csf"]

TILE_M: Final = 128.0


def classify_ground(
    xyz_m: ArrayLike,
    method: GroundMethod = "smrf",
    smrf: Smrf | None = None,
    asked: NDArray[np.bool_] | None = None,
) -> NDArray[np.bool_]:
    """Which points (n,) are ground, computed in overlapping squares of 128 m.

    Args:
        xyz_m: (n, 3) easting, northing, height; points that are not finite are not ground.
        method: "smrf", the simple morphological filter of Pingel et al. (2013); "csf", the cloth simulation filter of
            Zhang et al. (2016), which requires the extra `csf`.
        smrf: parameters of the first.
        asked: (n,) the points to classify, None for all; squares without any are skipped.

    Raises:
        InputError: if the method is unknown, or its library not installed.
    """
    if method not in get_args(GroundMethod):
        raise InputError("bad-ground-method", method=method, groundmethod=", ".join(get_args(GroundMethod)))
    xyz = np.asarray(xyz_m, np.float64)
    if xyz.ndim != 2 or xyz.shape[1] != 3:
        raise ValueError(f"points of shape {xyz.shape}, not (n, 3)")
    known = np.flatnonzero(np.isfinite(xyz).all(axis=1))
    ground = np.zeros(len(xyz), bool)
    filter_ = smrf if smrf is not None else Smrf()
    if method == "csf":
        from furrowmap.core.surfaces.cloth import cloth_ground, require_cloth

        require_cloth()
    finite = xyz if len(known) == len(xyz) else xyz[known]
    for tile in tiles(finite, TILE_M, min(2.0 * filter_.window_m, TILE_M)):
        if asked is not None and not asked[known[tile.own]].any():
            continue
        part = finite[tile.members]
        found = smrf_ground(part, filter_) if method == "smrf" else cloth_ground(part)
        ground[known[tile.own]] = found[: len(tile.own)]
    return ground


def smrf_ground(xyz_m: FloatArray, filter_: Smrf) -> NDArray[np.bool_]:
    """Which points (n, 3), at least one, of one square are ground."""
    corner = np.floor(xyz_m[:, :2].min(axis=0) / filter_.cell_m) * filter_.cell_m
    place = (xyz_m[:, :2] - corner) / filter_.cell_m
    cell = np.floor(place).astype(np.intp)
    shape = cell.max(axis=0) + 1
    lowest = np.full(shape.prod(), np.inf)
    np.minimum.at(lowest, cell[:, 0] * shape[1] + cell[:, 1], xyz_m[:, 2])
    lowest = np.where(np.isinf(lowest), np.nan, lowest).reshape(shape)
    ground = ground_cells(lowest, filter_)
    if not ground.any():
        return np.zeros(len(xyz_m), bool)
    surface = filled(np.where(ground, lowest, np.nan))
    steps = [np.gradient(surface, filter_.cell_m, axis=k) if surface.shape[k] > 1 else 0.0 * surface for k in (0, 1)]
    at = place.T - 0.5
    height = map_coordinates(surface, at, order=1, mode="nearest")
    slope = map_coordinates(np.hypot(*steps), at, order=1, mode="nearest")
    near: NDArray[np.bool_] = np.abs(xyz_m[:, 2] - height) <= filter_.threshold_m + filter_.scale * slope
    return near
