"""Whether parcels lie where the crop stands: by the rims of the crop, which parcels that are shifted miss together.

Parcels of another place, or of a mirrored layout, stand out from the soil little or not at all, and do elsewhere.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import shapely
from scipy.fft import irfft2, next_fast_len, rfft2
from scipy.ndimage import distance_transform_edt
from scipy.special import ndtr, stdtrit
from shapely.affinity import translate

from furrowmap.core.readers.areas.rings import pixels_in
from furrowmap.core.runtime.arrays import Float32Array, FloatArray
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.values.parcel import Parcel

MAX_PARCEL_SHIFT_M: Final = 8.0
"""Shifts are looked for up to this."""
SOIL_RING_M: Final = 0.3
"""Width of the ring around a parcel whose heights are those of the soil."""
MIN_SHIFTED_PARCELS: Final = 3
SHIFT_SIGMAS: Final = 5.0
"""Standard errors of the mean over the parcels by which a shifted layer must meet the crop better."""
FAR_SHIFT_M: Final = 200.0
"""Parcels of a neighbour's field are looked for up to this."""
ONE_AXIS: Final = ((True, False), (False, True))
"""Layouts mirrored east to west, and north to south."""
MAX_CONTRAST_SO: Final = 0.8
"""Share of the contrast elsewhere, or mirrored, which parcels may have as they are stated."""
MIN_SEEN_SHARE: Final = 0.8
"""Share of the parcels that must be known elsewhere."""
MIN_KNOWN_SHARE: Final = 0.5
"""Share of the cells of a parcel, and of the ring around it, that must be known: canopies hide some of the soil."""
MIN_HEIGHT_SIGMAS: Final = 3.0
"""Stated standard deviations of a parcel's height by which the shift must change it."""


@dataclass(frozen=True)
class ParcelShift:
    """A shift with which parcels meet the crop better.

    Attributes:
        east_m, north_m: to be added to the parcels' coordinates.
        height_off_m: by how much mean heights change with it (RMS over the parcels).
        mirrored: whether they are mirrored about their middle first, east to west and north to south.
    """

    east_m: float
    north_m: float
    height_off_m: float
    mirrored: tuple[bool, bool] = (False, False)

    @property
    def of_positions(self) -> bool:
        """Whether positions may be off instead of the parcels."""
        return not any(self.mirrored) and max(abs(self.east_m), abs(self.north_m)) <= MAX_PARCEL_SHIFT_M


def parcel_shift(
    height_m: Float32Array, grid: Grid, parcels: Sequence[Parcel], height_sigma_m: float
) -> ParcelShift | None:
    """The shift of all parcels together with which they stand out most from the soil around; None for no other.

    `height_m` (rows, columns) is a surface with the crop, nan where unknown, which reaches MAX_PARCEL_SHIFT_M beyond
    the parcels where it can; `height_sigma_m` is the stated standard deviation of a parcel's mean height.
    """
    if len(parcels) < MIN_SHIFTED_PARCELS or not np.isfinite(height_m).any():
        return None
    filled = _filled(height_m)
    east_m, north_m = _best_shift(filled, grid, parcels, MAX_PARCEL_SHIFT_M)
    if not (east_m or north_m):
        return None
    stated, moved = (_contrasts(filled, grid, parcels, by) for by in ((0.0, 0.0), (east_m, north_m)))
    if not _fits(moved, stated):
        return None
    height_off_m = _certainly_better(moved - stated, height_sigma_m)
    return ParcelShift(east_m, north_m, height_off_m) if height_off_m else None


def parcels_elsewhere(
    height_m: Float32Array, grid: Grid, parcels: Sequence[Parcel], height_sigma_m: float, convergence_deg: float
) -> ParcelShift | None:
    """Another place, or a mirrored layout, with which parcels stand out that do not as they are stated; None for none.

    `height_m` (rows, columns) is a surface with the crop and the parcels, nan where unknown; `convergence_deg` is that
    of the meridians there, true heading − grid heading: a layout may be mirrored on the map, or in its longitudes.
    """
    if len(parcels) < MIN_SHIFTED_PARCELS or not np.isfinite(height_m).any():
        return None
    known = np.isfinite(height_m)
    filled = _filled(height_m)
    stated = np.nan_to_num(_contrasts(np.where(known, filled, np.nan), grid, parcels, (0.0, 0.0)))
    # Crop that stands where it is stated to stand may have a taller neighbour.
    stands = float(stated.mean()) > SHIFT_SIGMAS * float(stated.std(ddof=1)) / np.sqrt(len(stated))
    found: list[tuple[float, ParcelShift]] = []
    layouts = [(mirrored, turn_deg) for mirrored in ONE_AXIS for turn_deg in {0.0, 2.0 * convergence_deg}]
    layouts += [((True, True), 0.0)] if stands else [((True, True), 0.0), ((False, False), 0.0)]
    for mirrored, turn_deg in layouts:
        turned = _mirrored(parcels, mirrored, turn_deg)
        reach_m = MAX_PARCEL_SHIFT_M if any(mirrored) else FAR_SHIFT_M
        by_m = _best_shift(filled, grid, turned, reach_m)
        moved = _contrasts(np.where(known, filled, np.nan), grid, turned, by_m)
        seen = np.isfinite(moved)
        if seen.mean() < MIN_SEEN_SHARE or stated.mean() > MAX_CONTRAST_SO * moved[seen].mean():
            continue
        if _fits(moved, stated) and (height_off_m := _certainly_better(moved - stated, height_sigma_m)):
            found.append((float(moved[seen].mean()), ParcelShift(*by_m, height_off_m, mirrored)))
    return max(found, key=lambda one: one[0])[1] if found else None


def _mirrored(parcels: Sequence[Parcel], mirrored: tuple[bool, bool], turn_deg: float) -> list[Parcel]:
    """The parcels mirrored about the middle of their extent, and turned anticlockwise."""
    west, south, east, north = shapely.total_bounds([parcel.gross for parcel in parcels]).tolist()
    middle = np.array([0.5 * (west + east), 0.5 * (south + north)])
    cos, sin = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    by = np.array([[cos, -sin], [sin, cos]]) * np.where(mirrored, -1.0, 1.0)

    def turned(shape: shapely.Polygon) -> shapely.Polygon:
        return shapely.transform(shape, lambda places: middle + (places - middle) @ by.T)

    return [replace(parcel, gross=turned(parcel.gross), net=turned(parcel.net)) for parcel in parcels]


def _best_shift(filled: FloatArray, grid: Grid, parcels: Sequence[Parcel], reach_m: float) -> tuple[float, float]:
    """East and north by which parcels, shifted up to `reach_m`, stand out most from the soil around."""
    kernel = np.sum([_contrast_kernel(parcel, grid) for parcel in parcels], axis=0)
    # By hand: importing scipy.signal would take longer than a whole start.
    size = [next_fast_len(2 * side - 1, real=True) for side in grid.shape]
    contrast = irfft2(rfft2(filled, size) * rfft2(kernel[::-1, ::-1], size), size)
    rows, columns = (min(round(reach_m / grid.cell_m), side - 1) for side in grid.shape)
    middle = np.array(grid.shape) - 1
    near = contrast[middle[0] - rows : middle[0] + rows + 1, middle[1] - columns : middle[1] + columns + 1]
    row, column = np.unravel_index(int(np.argmax(near)), near.shape)
    return float(column - columns) * grid.cell_m, -float(row - rows) * grid.cell_m


def _fits(moved_m: FloatArray, stated_m: FloatArray) -> bool:
    """Whether parcels stand out where they are moved to, by contrasts (n,), nan where unknown, and more than as stated.

    Of thousands of places one meets uneven crop by chance: few parcels must stand out alike, by Student's distribution.
    Right ones differ from what is around, which may be lower crop or higher one.
    """
    moved_m = moved_m[np.isfinite(moved_m)]
    if len(moved_m) < MIN_SHIFTED_PARCELS:
        return False
    sigmas = float(stdtrit(len(moved_m) - 1, ndtr(SHIFT_SIGMAS)))
    stand_out = moved_m.mean() > sigmas * moved_m.std(ddof=1) / np.sqrt(len(moved_m))
    return bool(stand_out and np.mean(moved_m**2) > np.mean(np.nan_to_num(stated_m) ** 2))


def _certainly_better(better_m: FloatArray, height_sigma_m: float) -> float:
    """RMS of contrasts (n,) that are gained, in m; 0 where the gain is neither certain nor matters."""
    better_m = better_m[np.isfinite(better_m)]
    if len(better_m) < MIN_SHIFTED_PARCELS:
        return 0.0
    certain = better_m.mean() > SHIFT_SIGMAS * better_m.std(ddof=1) / np.sqrt(len(better_m))
    height_off_m = float(np.sqrt(np.mean(better_m**2)))
    return height_off_m if certain and height_off_m > MIN_HEIGHT_SIGMAS * height_sigma_m else 0.0


def heights_by_place(
    height_m: Float32Array, grid: Grid, parcels: Sequence[Parcel], place_sigma_m: tuple[float, float]
) -> FloatArray:
    """Standard deviations (n,) of the mean heights of parcels by that of the place of a surface, east and north.

    Points at √2 standard deviations to each side have the covariance of the place (Julier and Uhlmann 1997, A new
    extension of the Kalman filter to nonlinear systems). Heights (rows, columns) are nan where unknown.
    """
    filled = _filled(height_m)
    east_m, north_m = (min(math.sqrt(2.0) * sigma_m, MAX_PARCEL_SHIFT_M) for sigma_m in place_sigma_m)
    sides = ((east_m, 0.0), (-east_m, 0.0), (0.0, north_m), (0.0, -north_m))
    off = np.array([_contrasts(filled, grid, parcels, by_m) for by_m in sides])
    off = np.nan_to_num(off - _contrasts(filled, grid, parcels, (0.0, 0.0)))
    return np.asarray(np.sqrt(np.mean(off**2, axis=0)), np.float64)


def _filled(height_m: Float32Array) -> FloatArray:
    """Heights about their mean, with the nearest where they are unknown; some are known."""
    nearest = distance_transform_edt(~np.isfinite(height_m), return_distances=False, return_indices=True)
    filled: FloatArray = height_m[tuple(nearest)].astype(np.float64)
    filled -= filled.mean()
    return filled


def _contrast_kernel(parcel: Parcel, grid: Grid) -> FloatArray:
    """(rows, columns) weights with which heights make the mean height of a parcel over the ring around it."""
    inside = pixels_in(parcel.gross, grid)
    ring = pixels_in(shapely.Polygon(parcel.gross.buffer(SOIL_RING_M).exterior), grid)
    ring &= ~inside
    return inside / max(int(inside.sum()), 1) - ring / max(int(ring.sum()), 1)


def _contrasts(filled: FloatArray, grid: Grid, parcels: Sequence[Parcel], by_m: tuple[float, float]) -> FloatArray:
    """(n,) mean heights of net parcels over the rings around them, all shifted; nan where little of either is known."""
    out = np.full(len(parcels), np.nan)
    for k, parcel in enumerate(parcels):
        net = translate(parcel.net, *by_m)
        gross = translate(parcel.gross, *by_m)
        inside = pixels_in(net, grid)
        sown = pixels_in(gross, grid)
        ring = pixels_in(shapely.Polygon(gross.buffer(SOIL_RING_M).exterior), grid) & ~sown
        out[k] = _mean_of_known(filled[inside]) - _mean_of_known(filled[ring])
    return out


def _mean_of_known(heights_m: FloatArray) -> float:
    """Mean of heights (n,); nan where fewer of them than MIN_KNOWN_SHARE are known."""
    known = heights_m[np.isfinite(heights_m)]
    return float(known.mean()) if len(known) > MIN_KNOWN_SHARE * len(heights_m) else math.nan
