"""What the vehicle stands on: whether the scanner sits on it as the session says.

The scans show how the scanner stands, the session how the scanner sits on the vehicle. A vehicle stands on the ground
with its wheels, so over a session the ground under it is level in its own frame, at height zero; and it drives where it
looks. Where the ground comes out tilted, or the drive aslant, the mounting is off by that much.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.matching.agreement import LEAST_WEIGHT
from furrowmap.core.matching.knots import STEP_S, Knots, State
from furrowmap.core.matching.surface import TILE, TILE_BITS, Passage, Surface

FloatArray = NDArray[np.float64]

FOOTPRINT_M: Final = ((-0.3, 2.3), (-0.9, 0.9))
"""From, to forward and to the left, of the ground that carries a tractor."""
SPACING_M: Final = 0.15
EVERY_S: Final = 0.25
BLOCK_S: Final = 8.0
"""Ground and ruts of one such time count as one sample."""
LEAST_BLOCKS: Final = 6
"""Less than three quarters of a minute in motion are one or two passes, on which a wheel may follow one ridge or furrow
all the way: half a degree in all blocks alike."""
LEAST_PLACES: Final = 400
MOVING_MPS: Final = 0.2
CERTAIN: Final = 2.5
TOLD_DEG: Final = 0.2
"""A mounting is off where that is seen with CERTAIN standard deviations, and is more than TOLD_DEG."""
HEIGHT_KNOWN_M: Final = 0.15
"""A vehicle that seems to float or sink by more has its origin elsewhere: what lies under it is then not what carries
it."""
RUTS_SIGMA: Final = np.radians(0.05)
"""Ruts and tyres leave a vehicle this much off the ground's level, on the mean of a session."""


@dataclass(frozen=True)
class Stance:
    """How the vehicle stands in its own frame, as turned about its axes: zero where the mounting is right.

    Attributes:
        roll_deg: of the vehicle against the ground that carries it, right side down.
        pitch_deg: the same, nose up.
        yaw_deg: of the vehicle's x axis against the way it goes, counter-clockwise.
        height_m: of the vehicle's origin above the ground.
        sigma_deg: (3,) standard deviations of roll, pitch, yaw; inf where the scans do not show it.
        sigma_height_m: of the height.
    """

    roll_deg: float
    pitch_deg: float
    yaw_deg: float
    height_m: float
    sigma_deg: tuple[float, float, float]
    sigma_height_m: float

    @property
    def turn(self) -> FloatArray | None:
        """(3, 3) rotation that the mounting's takes on its left to be right, of what is certain; None if nothing is."""
        angles = np.array([self.roll_deg, self.pitch_deg, self.yaw_deg])
        certain = np.abs(angles) > np.maximum(CERTAIN * np.array(self.sigma_deg), TOLD_DEG)
        if not certain.any() or abs(self.height_m) > HEIGHT_KNOWN_M:
            return None
        roll, pitch, yaw = np.where(certain, angles, 0.0)
        matrix: FloatArray = Rotation.from_euler("ZYX", [yaw, -pitch, roll], degrees=True).as_matrix()
        return matrix


def stance(knots: Knots, state: State, surface: Surface, passage: Passage | None, guard_s: float) -> Stance:
    """How the vehicle stands on the ground that the scans show.

    Args:
        knots: times.
        state: poses at them.
        surface: of the session.
        passage: of the implement, which tells old soil from new.
        guard_s: see :func:`~furrowmap.core.matching.surface.layers`.
    """
    step = max(1, round(EVERY_S / STEP_S))
    chosen = np.arange(0, len(knots), step)
    velocity = np.zeros((len(knots), 3))
    for chain in knots.chains:
        part = slice(chain.first, chain.first + chain.count)
        velocity[part] = np.gradient(state.xyz_m[part], STEP_S, axis=0)
    along = np.einsum("ij,ij->i", velocity, state.rotation[:, :, 0])
    aside = np.einsum("ij,ij->i", velocity, state.rotation[:, :, 1])
    moving = chosen[np.abs(along[chosen]) > MOVING_MPS]
    level = _level(knots, state, surface, passage, guard_s, moving)
    yaw, yaw_sigma = _mean_of_blocks(knots.t_s[moving], (aside / np.where(along == 0, 1.0, along))[moving])
    return Stance(
        roll_deg=float(np.degrees(-level[0][2])),
        pitch_deg=float(np.degrees(-level[0][1])),
        yaw_deg=float(np.degrees(-yaw)),
        height_m=float(-level[0][0]),
        sigma_deg=(float(np.degrees(level[1][2])), float(np.degrees(level[1][1])), float(np.degrees(yaw_sigma))),
        sigma_height_m=float(level[1][0]),
    )


def _level(
    knots: Knots,
    state: State,
    surface: Surface,
    passage: Passage | None,
    guard_s: float,
    chosen: NDArray[np.intp],
) -> tuple[FloatArray, FloatArray]:
    """Height at the origin, slope forward and slope to the left of the ground in the vehicle's frame, with sigmas."""
    x, y = np.meshgrid(*(np.arange(a, b + 0.5 * SPACING_M, SPACING_M) for a, b in FOOTPRINT_M), indexing="ij")
    places = np.column_stack([x.ravel(), y.ravel()])
    tiles = surface.tiles
    known = passage is not None
    where = passage.tiles if passage is not None else tiles
    none = np.zeros((0, TILE, TILE))
    block = np.floor((knots.t_s[chosen] - knots.t_s[0]) / BLOCK_S).astype(np.int64)
    _, block = np.unique(block, return_inverse=True)
    count = int(block.max(initial=-1)) + 1
    sums = np.zeros((count, 3, 4))
    number = np.zeros(count, np.int64)
    _under(
        knots.t_s[chosen],
        np.ascontiguousarray(state.xyz_m[chosen]),
        np.ascontiguousarray(state.rotation[chosen]),
        block,
        places,
        tiles.cell_m,
        tiles.west,
        tiles.south,
        tiles.number,
        surface.height_m,
        surface.weight,
        known,
        where.cell_m,
        where.west,
        where.south,
        where.number,
        passage.first_s if passage is not None else none,
        passage.last_s if passage is not None else none,
        guard_s,
        sums,
        number,
    )
    enough = number >= LEAST_PLACES
    if enough.sum() < LEAST_BLOCKS:
        return np.zeros(3), np.full(3, np.inf)
    each = np.linalg.solve(sums[enough][:, :, :3], sums[enough][:, :, 3:])[:, :, 0]
    middle = np.median(each, axis=0)
    spread = 1.4826 * np.median(np.abs(each - middle), axis=0) / np.sqrt(enough.sum()) * 1.25
    return middle, np.hypot(spread, [0.01, RUTS_SIGMA, RUTS_SIGMA])


def _mean_of_blocks(t_s: FloatArray, values: FloatArray) -> tuple[float, float]:
    """Median over blocks of time of the values' medians, and its standard deviation."""
    if not len(t_s):
        return 0.0, np.inf
    block = np.floor((t_s - t_s[0]) / BLOCK_S).astype(np.int64)
    each = np.array([np.median(values[block == b]) for b in np.unique(block)])
    if len(each) < LEAST_BLOCKS:
        return 0.0, np.inf
    middle = float(np.median(each))
    return middle, float(1.4826 * np.median(np.abs(each - middle)) / np.sqrt(len(each)) * 1.25 + RUTS_SIGMA)


@numba.njit(cache=True, nogil=True)
def _under(  # type: ignore[no-untyped-def]
    t_s, xyz_m, rotation, block, places, cell_m, west, south, number, height, weight,
    known, other_cell_m, other_west, other_south, other_number, first_s, last_s, guard_s, sums, count,
):  # fmt: skip
    rows, columns = number.shape
    other_rows, other_columns = other_number.shape
    row3 = np.empty(3)
    for k in range(len(t_s)):
        r = rotation[k]
        for i in range(len(places)):
            e = xyz_m[k, 0] + r[0, 0] * places[i, 0] + r[0, 1] * places[i, 1]
            n = xyz_m[k, 1] + r[1, 0] * places[i, 0] + r[1, 1] * places[i, 1]
            layer = 0
            if known:
                x, y = int(np.floor(e / other_cell_m)), int(np.floor(n / other_cell_m))
                a, b = (y >> TILE_BITS) - other_south, (x >> TILE_BITS) - other_west
                if 0 <= a < other_rows and 0 <= b < other_columns and other_number[a, b] >= 0:
                    tile, p, q = other_number[a, b], y & TILE - 1, x & TILE - 1
                    if t_s[k] < first_s[tile, p, q]:
                        layer = 0
                    elif t_s[k] > last_s[tile, p, q] + guard_s:
                        layer = 1
                    else:
                        continue
            x, y = int(np.round(e / cell_m)), int(np.round(n / cell_m))
            a, b = (y >> TILE_BITS) - south, (x >> TILE_BITS) - west
            if not (0 <= a < rows and 0 <= b < columns) or number[a, b] < 0:
                continue
            tile, p, q = number[a, b], y & TILE - 1, x & TILE - 1
            w0, w1 = weight[tile, 2 * layer, p, q], weight[tile, 2 * layer + 1, p, q]
            if w0 + w1 < 2 * LEAST_WEIGHT:
                continue
            z = (w0 * height[tile, 2 * layer, p, q] + w1 * height[tile, 2 * layer + 1, p, q]) / (w0 + w1)
            dx, dy, dz = x * cell_m - xyz_m[k, 0], y * cell_m - xyz_m[k, 1], z - xyz_m[k, 2]
            row3[0] = 1.0
            row3[1] = r[0, 0] * dx + r[1, 0] * dy + r[2, 0] * dz
            row3[2] = r[0, 1] * dx + r[1, 1] * dy + r[2, 1] * dz
            up = r[0, 2] * dx + r[1, 2] * dy + r[2, 2] * dz
            c = block[k]
            count[c] += 1
            for a in range(3):
                sums[c, a, 3] += row3[a] * up
                for b in range(3):
                    sums[c, a, b] += row3[a] * row3[b]
