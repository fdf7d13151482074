"""Checkerboard targets: the middle of a square board with two bright and two dark quarters."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.signal import fftconvolve

from furrowmap.core.runtime.arrays import FloatArray

CELL_SHARE: Final = 0.05
"""Side of the cells of the coarse search, in sides of the board."""
TURN_STEP_DEG: Final = 7.5
MIN_QUARTER_RETURNS: Final = 5
"""Returns of each quarter, at least."""
MIN_BOARD_SHARE: Final = 0.6
"""Share of the variance of the brightness that the board explains, at least. A bright corner of a dark area, the most
alike of what lies on fields, explains a third, and a disc less."""
MIN_PARTED_SHARE: Final = 0.85
"""Share of the returns of each quarter that have its brightness, at least: most stripes have less."""
BORDER_SHARE: Final = 0.05
"""Returns so near to an edge, in sides, may be of both quarters."""
BOARD_STEPS: Final = 25
FINE_SEARCHES: Final = ((0.15, 1.0), (0.03, 0.2))
"""Reach of each fine search in sides, and its turns in steps of the coarse search."""
TURNS: Final = 9


@dataclass(frozen=True)
class Checkerboard:
    """A board.

    Attributes:
        middle_m: (2,) where its quarters meet.
        turn_deg: by which its edges are turned from the axes, counter-clockwise; 0 to 90.
    """

    middle_m: FloatArray
    turn_deg: float


def find_checkerboard(xy_m: FloatArray, brightness: FloatArray, side_m: float, search_m: float) -> Checkerboard | None:
    """The board with the least brightness left unexplained; None where none is found.

    The mean of each cell of a raster is held against boards at all places and turns, by convolution; then each return
    is bright or dark, and the board that parts them best is looked for with finer and finer steps.

    Args:
        xy_m: (n, 2) places of the returns, relative to the expected middle.
        brightness: (n,) intensity or luminance.
        side_m: of the whole board.
        search_m: distance within which the middle lies.
    """
    near = np.hypot(*xy_m.T) <= search_m + side_m
    xy = xy_m[near]
    light = brightness[near]
    coarse = _coarse(xy, light, side_m, search_m)
    if coarse is None:
        return None
    middle = coarse.middle_m
    turn_deg = coarse.turn_deg
    bright = _bright(xy - middle, light, turn_deg, side_m)
    for reach, turn_reach in FINE_SEARCHES:
        middle, turn_deg = _finer(xy, bright, middle, turn_deg, side_m, reach, turn_reach * TURN_STEP_DEG)
    quarter = _quarter(_turned(xy - middle, turn_deg), side_m)
    parted = [float(np.mean(bright[quarter == k] == (-1.0) ** k)) if (quarter == k).any() else 0.0 for k in range(4)]
    return Checkerboard(middle, turn_deg % 90.0) if min(parted) >= MIN_PARTED_SHARE else None


def _quarter(uv: FloatArray, side_m: float) -> FloatArray:
    """Quarter 0 to 3 of places (…, 2) in the axes of a board, counter-clockwise; −1 off it or near its edges."""
    u = uv[..., 0]
    v = uv[..., 1]
    border = BORDER_SHARE * side_m
    out = np.where(v > 0.0, np.where(u > 0.0, 0, 1), np.where(u > 0.0, 3, 2))
    off = np.maximum(np.abs(u), np.abs(v)) > 0.5 * side_m - border
    out[off | (np.minimum(np.abs(u), np.abs(v)) < border)] = -1
    return out


def _turned(xy: FloatArray, turn_deg: float) -> FloatArray:
    """Places (…, 2) in the axes of a board that is turned."""
    turn = np.radians(turn_deg)
    cos = np.cos(turn)
    sin = np.sin(turn)
    return np.stack([cos * xy[..., 0] + sin * xy[..., 1], cos * xy[..., 1] - sin * xy[..., 0]], axis=-1)


def _coarse(xy: FloatArray, light: FloatArray, side_m: float, search_m: float) -> Checkerboard | None:
    """The board of a raster's cell and one of the turns that explains most."""
    cell_m = CELL_SHARE * side_m
    half = int(np.ceil((search_m + side_m) / cell_m))
    count = 2 * half + 1
    column, row = np.rint(xy / cell_m).astype(np.int64).T + half
    at = row * count + column

    def raster(weight: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(at, weight, minlength=count * count).reshape(count, count), np.float64)

    number = raster(np.ones(len(at)))
    total = raster(light)
    squares = raster(light**2)
    reach = int(np.ceil(np.sqrt(0.5) * side_m / cell_m))
    steps = cell_m * np.arange(-reach, reach + 1)
    places = np.stack(np.meshgrid(steps, steps), axis=-1)
    offset = cell_m * (np.arange(count) - half)
    inside = np.hypot(offset[:, None], offset[None]) <= search_m
    best = None
    most = MIN_BOARD_SHARE
    for turn_deg in np.arange(0.0, 90.0, TURN_STEP_DEG).tolist():
        quarter = _quarter(_turned(places, turn_deg), side_m)
        masks = [(quarter == k).astype(np.float64) for k in range(4)]
        returns = [_summed(number, mask) for mask in masks]
        sums = [_summed(total, mask) for mask in masks]
        explained = _explained(returns, sums, _summed(squares, (quarter >= 0).astype(np.float64)))
        explained[~inside] = 0.0
        row_at, column_at = np.unravel_index(int(np.argmax(explained)), explained.shape)
        if explained[row_at, column_at] > most:
            most = float(explained[row_at, column_at])
            best = Checkerboard(cell_m * np.array([column_at - half, row_at - half], np.float64), turn_deg)
    return best


def _summed(raster: FloatArray, mask: FloatArray) -> FloatArray:
    """Sum of a raster over a mask around each of its cells."""
    return np.asarray(fftconvolve(raster, mask[::-1, ::-1], mode="same"))


def _explained(returns: list[FloatArray], sums: list[FloatArray], squares: FloatArray) -> FloatArray:
    """Share of the variance that boards explain; 0 where a quarter has too few returns."""
    enough = np.min(returns, axis=0) > MIN_QUARTER_RETURNS - 0.5
    bright = np.maximum(returns[0] + returns[2], 1.0)
    dark = np.maximum(returns[1] + returns[3], 1.0)
    whole = bright + dark
    apart = (sums[0] + sums[2]) / bright - (sums[1] + sums[3]) / dark
    variance = squares / whole - (np.sum(sums, axis=0) / whole) ** 2
    least = 1e-6 * np.maximum(squares / whole, 1e-12)
    share = bright * dark / whole**2 * apart**2 / np.maximum(variance, least)
    return np.where(enough & (variance > least), share, 0.0)


def _bright(xy: FloatArray, light: FloatArray, turn_deg: float, side_m: float) -> FloatArray:
    """1 for each return that is as bright as the first quarter of a board rather than as the second, −1 else."""
    quarter = _quarter(_turned(xy, turn_deg), side_m)
    first = float(np.median(light[(quarter == 0) | (quarter == 2)]))
    second = float(np.median(light[(quarter == 1) | (quarter == 3)]))
    return np.where(np.abs(light - first) < np.abs(light - second), 1.0, -1.0)


def _finer(
    xy: FloatArray,
    bright: FloatArray,
    middle: FloatArray,
    turn_deg: float,
    side_m: float,
    reach: float,
    turn_reach_deg: float,
) -> tuple[FloatArray, float]:
    """Middle and turn that part bright and dark returns best; the mean of equally good ones."""
    steps = np.linspace(-reach, reach, BOARD_STEPS) * side_m
    shift = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    near = np.hypot(*(xy - middle).T) <= (np.sqrt(0.5) + reach) * side_m
    places = xy[near] - middle
    turns = turn_deg + np.linspace(-turn_reach_deg, turn_reach_deg, TURNS)
    score = np.empty((len(turns), len(shift)))
    for k, turn in enumerate(turns.tolist()):
        of_places = _turned(places, turn)
        of_shift = _turned(shift, turn)
        u = of_places[:, 0, None] - of_shift[:, 0]
        v = of_places[:, 1, None] - of_shift[:, 1]
        on_board = np.maximum(np.abs(u), np.abs(v)) <= 0.5 * side_m
        score[k] = bright[near] @ (np.sign(u) * np.sign(v) * on_board)
    turn_at, shift_at = np.nonzero(score >= score.max() - 0.5)
    return middle + shift[shift_at].mean(axis=0), float(turns[turn_at].mean())
