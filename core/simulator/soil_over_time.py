"""The ground over time: before any pass, after the first and after the last one.

Heights are kept on cells of 2.5 cm as relief above the field's mean plane, and are bilinear between the cells' middles.
What lies beyond the grid repeats the found ground, so that the field has no edge.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Final, NamedTuple

import numpy as np
import scipy.fft
from numba import njit
from numpy.typing import NDArray

from furrowmap.core.simulator.drive import DRIVE_RATE_HZ, SimulatedTrack, drive_path, plan_path
from furrowmap.core.simulator.noise import Float32Array, FloatArray, random_for
from furrowmap.core.simulator.scenario import EarlierDrive, Scenario, ScenarioSoil
from furrowmap.core.simulator.site import CELL_M

kernel: Final = partial(njit, cache=True, nogil=True, fastmath=False, _nrt=False)
"""For kernels that make no arrays: counting who holds those of a scene would take a third of the time."""
NOISE_BLOCK: Final = 16
"""Cells along the edge of the blocks whose highest point is known."""
FOOTPRINT_M: Final = 0.014
"""Standard deviation of the blur of a beam's footprint, below which relief cannot be measured."""


class Ground(NamedTuple):
    """The ground; a tuple because compiled loops read it.

    Attributes:
        before, middle, after: (rows, cols) relief before the first, between the first and the last, and after the
            last working of a cell. Row and column 0 lie at the local origin; rows go north.
        first_s, last_s: (rows, cols) when a cell was first and last worked; inf: never.
        worked_earlier: (rows, cols) whether an earlier drive worked a cell.
        ceiling: (rows / NOISE_BLOCK, cols / NOISE_BLOCK) highest relief ever of a block and its rim.
        slope_e, slope_n: rise of the mean plane.
    """

    before: Float32Array
    middle: Float32Array
    after: Float32Array
    first_s: Float32Array
    last_s: Float32Array
    worked_earlier: NDArray[np.bool_]
    ceiling: Float32Array
    slope_e: float
    slope_n: float


@dataclass(frozen=True)
class ToolSweep:
    """One pass of the tool, from when it enters the ground to when it leaves it.

    Attributes:
        t_s: (n,) while the machine moves forward, about a centimetre of way apart.
        e_m, n_m: (n,) middle of the tool's line, local.
        begin_s, end_s: when the tool went down and up.
    """

    t_s: FloatArray
    e_m: FloatArray
    n_m: FloatArray
    yaw_rad: FloatArray
    begin_s: float
    end_s: float


def find_sweeps(track: SimulatedTrack, xy_m: tuple[float, float]) -> list[ToolSweep]:
    """The passes of a tool whose line lies at `xy_m` in the vehicle frame."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], track.down.astype(np.int8), [0]])))
    sweeps = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        moving = begin + np.flatnonzero(track.speed_mps[begin:end] > 0.0)
        if len(moving) < 2:
            continue
        way = np.cumsum(track.speed_mps[moving]) / DRIVE_RATE_HZ
        steps = np.linspace(way[0], way[-1], max(2, math.ceil((way[-1] - way[0]) / 0.010) + 1))
        t_s, e, n, yaw = (
            np.interp(steps, way, values[moving]) for values in (track.t_s, track.e_m, track.n_m, track.yaw_rad)
        )
        c = np.cos(yaw)
        s = np.sin(yaw)
        e = e + c * xy_m[0] - s * xy_m[1]
        n = n + s * xy_m[0] + c * xy_m[1]
        sweeps.append(ToolSweep(t_s, e, n, yaw, float(track.t_s[begin]), float(track.t_s[end - 1])))
    return sweeps


def make_ground(scenario: Scenario, sweeps: list[ToolSweep]) -> Ground:
    """The ground of a scenario that is laid out, worked by its earlier drives and then by `sweeps` in their order."""
    soil = scenario.soil
    before, waves = _first_ground(scenario)
    shape = before.shape
    worked_earlier = np.zeros(shape, np.bool_)
    for drive in scenario.earlier:
        if not worked_earlier.any():
            before = before.copy()
        for row, col, height, _ in _workings(drive, earlier_sweeps(drive), before, waves):
            before[row, col] = height
            worked_earlier[row, col] = True
    middle, after = (before.copy(), before.copy()) if sweeps else (before, before)
    first = np.full(shape, np.inf, np.float32)
    last = first.copy()
    for row, col, height, t_s in _workings(scenario, sweeps, before, waves):
        again = np.isfinite(last[row, col])
        second = again & (first[row, col] == last[row, col])
        middle[row[second], col[second]] = after[row[second], col[second]]
        after[row, col] = height
        first[row[~again], col[~again]] = t_s[~again]
        last[row, col] = t_s
    slope = 0.01 * soil.slope_percent
    towards = math.radians(soil.slope_towards_deg)
    ceiling = ceiling_of(np.maximum(np.maximum(before, middle), after))
    slopes = slope * math.sin(towards), slope * math.cos(towards)
    return Ground(before, middle, after, first, last, worked_earlier, ceiling, *slopes)


def earlier_sweeps(earlier: EarlierDrive) -> list[ToolSweep]:
    """The passes of an earlier drive."""
    path = plan_path(earlier.drive, random_for(earlier.seed, "driver"))
    track = drive_path(path, earlier.drive, earlier.implement, random_for(earlier.seed, "tool"))
    return find_sweeps(track, earlier.implement.xy_m)


def _first_ground(scenario: Scenario) -> tuple[Float32Array, Float32Array]:
    """Relief of the ground as the first drive found it, and its waves alone; rows lie along the first drive's lanes."""
    soil = scenario.soil
    drive = scenario.earlier[0].drive if scenario.earlier else scenario.drive
    rows = NOISE_BLOCK * math.ceil(scenario.field.size_n_m / (CELL_M * NOISE_BLOCK))
    cols = NOISE_BLOCK * math.ceil(scenario.field.size_e_m / (CELL_M * NOISE_BLOCK))
    waves = _field(random_for(soil.seed, "undulation"), rows, cols, _waves)
    waves *= soil.undulation_m / math.sqrt(2.0)
    found = _field(random_for(soil.seed, "clods"), rows, cols, lambda k: _clods(k, soil.clod_corr_m))
    found *= soil.clod_sigma_m
    found += waves
    if soil.row_amplitude_m:
        lane = math.radians(90.0 - drive.lane_heading_deg)
        turns = -math.sin(lane) * ((np.arange(cols) + 0.5) * CELL_M - drive.start_xy_m[0]) / soil.row_spacing_m
        turns = turns[None, :] + (
            math.cos(lane) * ((np.arange(rows) + 0.5) * CELL_M - drive.start_xy_m[1]) / soil.row_spacing_m
        )[:, None].astype(np.float32)
        found += np.float32(soil.row_amplitude_m) * np.cos(turns * (2.0 * np.pi), dtype=np.float32)
    return found, waves


def _workings(
    drive: Scenario | EarlierDrive, sweeps: list[ToolSweep], before: Float32Array, waves: Float32Array
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], Float32Array, Float32Array]]:
    """(row, col, relief, t_s) of the cells that each pass of a drive works, in their order."""
    soil = drive.soil
    rows, cols = before.shape
    if not sweeps:
        return
    tilth = _field(random_for(drive.seed, "tilth"), rows, cols, lambda k: _clods(k, soil.tilled_corr_m))
    tilth *= soil.tilled_sigma_m
    half = 0.5 * drive.implement.width_m
    for number, sweep in enumerate(sweeps):
        row, col, t_s, across_m = worked_cells(sweep, half, rows, cols)
        if soil.worked == "same":
            height = before[row, col]
        else:
            # every pass throws up relief of its own: the same random field, from another place of it
            fresh = tilth[(row + 379 * number) % rows, (col + 611 * number) % cols]
            height = waves[row, col] + fresh + _profile(soil, across_m, half).astype(np.float32)
        yield row, col, height, t_s


def worked_cells(
    sweep: ToolSweep, half_m: float, rows: int, cols: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], Float32Array, FloatArray]:
    """(row, col, t_s, across_m) of the cells whose middle the tool's line passes over; across it, left positive."""
    lateral = np.linspace(-half_m, half_m, math.ceil(2.0 * half_m / (0.5 * CELL_M)) + 1)
    found: list[tuple[NDArray[np.int64], FloatArray, FloatArray]] = []
    speed = np.gradient(np.hypot(sweep.e_m - sweep.e_m[0], sweep.n_m - sweep.n_m[0]), sweep.t_s).clip(0.01)
    for part in np.array_split(np.arange(len(sweep.t_s)), max(1, len(sweep.t_s) // 2000)):
        e = sweep.e_m[part, None]
        n = sweep.n_m[part, None]
        c = np.cos(sweep.yaw_rad[part, None])
        s = np.sin(sweep.yaw_rad[part, None])
        col = np.floor((e - s * lateral) / CELL_M).astype(np.int64)
        row = np.floor((n + c * lateral) / CELL_M).astype(np.int64)
        de = (col + 0.5) * CELL_M - e
        dn = (row + 0.5) * CELL_M - n
        along = de * c + dn * s
        across = dn * c - de * s
        inside = (np.abs(across) <= half_m) & (np.abs(along) <= 0.009)
        inside &= (row >= 0) & (col >= 0) & (row < rows) & (col < cols)
        t_s = sweep.t_s[part, None] + along / speed[part, None]
        found.append(((row * cols + col)[inside], t_s[inside], across[inside]))
    flat, t_s, across = (np.concatenate(values) for values in zip(*found, strict=True))
    cell, at = np.unique(flat, return_index=True)
    return cell // cols, cell % cols, t_s[at].astype(np.float32), across[at]


def ground_height(ground: Ground, e_m: FloatArray, n_m: FloatArray, t_s: FloatArray) -> FloatArray:
    """Heights (n,) of the ground at local positions (n,) and their times (n,)."""
    out = np.empty(len(e_m), np.float64)
    _heights(ground, *(np.ascontiguousarray(a, np.float64) for a in (e_m, n_m, t_s)), out)
    return out


def _profile(soil: ScenarioSoil, across_m: FloatArray, half_m: float) -> FloatArray:
    """Height of the worked ground above the field's waves, across a pass: swell, ridges at its borders, furrows."""

    def ridge(x: FloatArray) -> FloatArray:
        return np.exp(-(((half_m - np.abs(x)) / 0.10) ** 2))

    mean = float(ridge(np.linspace(-half_m, half_m, 401)).mean())
    furrows = soil.furrow_m * np.cos(2.0 * np.pi * across_m / soil.furrow_spacing_m)
    return soil.swell_m + soil.ridge_m * (ridge(across_m) - mean) + furrows


def _waves(k: Float32Array) -> Float32Array:
    """Amplitude of waves 5 to 40 m long, the long ones higher."""
    band = (k >= 1.0 / 40.0) & (k <= 1.0 / 5.0)
    return np.where(band, np.maximum(k, np.float32(1e-3)) ** np.float32(-1.5), np.float32(0.0))


def _clods(k: Float32Array, corr_m: float) -> Float32Array:
    """Amplitude spectrum of an isotropic field with the autocorrelation exp(-distance / corr_m), as a beam sees it."""
    w = k * np.float32(2.0 * np.pi)
    exponential = (1.0 + (w * np.float32(corr_m)) ** 2) ** np.float32(-0.75)
    amplitude: Float32Array = exponential * np.exp(np.float32(-0.5) * (w * np.float32(FOOTPRINT_M)) ** 2)
    return amplitude


def _field(
    rng: np.random.Generator, rows: int, cols: int, amplitude: Callable[[Float32Array], Float32Array]
) -> Float32Array:
    """(rows, cols) Gaussian field of unit variance, periodic, of the amplitude spectrum given for waves a metre."""
    spectrum = scipy.fft.rfft2(rng.standard_normal((rows, cols), np.float32), workers=2)
    ky = np.fft.fftfreq(rows, CELL_M).astype(np.float32)
    kx = np.fft.rfftfreq(cols, CELL_M).astype(np.float32)
    for i in range(rows):
        spectrum[i] *= amplitude(np.hypot(ky[i], kx))
    spectrum[0, 0] = 0.0
    field = np.asarray(scipy.fft.irfft2(spectrum, (rows, cols), workers=2, overwrite_x=True), np.float32)
    spread = float(field.std())
    return field * np.float32(1.0 / spread) if spread > 0.0 else field


def ceiling_of(highest: Float32Array) -> Float32Array:
    """Highest value of every block of BLOCK by BLOCK cells and of the cells round it."""
    rows, cols = highest.shape
    return np.ascontiguousarray(
        tops_of(highest).reshape(rows // NOISE_BLOCK, NOISE_BLOCK, cols // NOISE_BLOCK, NOISE_BLOCK).max(axis=(1, 3))
    )


def tops_of(highest: Float32Array) -> Float32Array:
    """Highest value of every cell and of the cells round it."""
    wide = highest.copy()
    for axis in (0, 1):
        np.maximum(wide, np.maximum(np.roll(wide, 1, axis), np.roll(wide, -1, axis)), out=wide)
    return wide


@kernel()
def relief_at(ground, e, n, t):  # type: ignore[no-untyped-def]
    """Relief above the mean plane at one local position and time, bilinear between the cells' middles."""
    rows, cols = ground.before.shape
    x = e / CELL_M - 0.5
    y = n / CELL_M - 0.5
    col = math.floor(x)
    row = math.floor(y)
    fx = x - col
    fy = y - row
    out = 0.0
    for k in range(4):
        i = row + (k >> 1)
        j = col + (k & 1)
        weight = (fy if k >> 1 else 1.0 - fy) * (fx if k & 1 else 1.0 - fx)
        if 0 <= i < rows and 0 <= j < cols:
            if t < ground.first_s[i, j]:
                out += weight * ground.before[i, j]
            elif t < ground.last_s[i, j]:
                out += weight * ground.middle[i, j]
            else:
                out += weight * ground.after[i, j]
        else:
            out += weight * ground.before[i % rows, j % cols]
    return out


@kernel()
def _heights(ground, e_m, n_m, t_s, out):  # type: ignore[no-untyped-def]
    for i in range(len(e_m)):
        plane = ground.slope_e * e_m[i] + ground.slope_n * n_m[i]
        out[i] = plane + relief_at(ground, e_m[i], n_m[i], t_s[i])
