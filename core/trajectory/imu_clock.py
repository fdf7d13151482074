"""A search for a large offset between the clocks of an IMU and of the positions, before any attitude is known.

For some seconds gyroscopes keep the axes, and the mean of the specific force is nearly vertical. The horizontal
accelerations by the IMU, as complex numbers, are then those by the positions but for a turn, which may be another one
in each window. On wheels the same holds for the direction of the nose and the way by the positions. The offset fits at
which least of the motion is left unexplained.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.trajectory.alignment import chained, moving_mean
from furrowmap.core.trajectory.inertial_start import MAX_IMU_PAUSE_S
from furrowmap.core.values.gnss import Positions
from furrowmap.core.values.inertial import InertialTrack

ComplexArray = NDArray[np.complex128]

STEP_S: Final = 0.1
"""Of the times at which motions are compared, and of the offsets."""
MAX_OFFSET_S: Final = 30.0
WINDOW: Final = 100
"""Steps in which motions are compared at once."""
MAX_WINDOWS: Final = 96
MIN_WINDOWS: Final = 2
MIN_COMMON_WINDOWS: Final = 6
MOTION_HALVES: Final = (10, 20, 40)
"""Steps of half the time over which second differences are taken: the fewest with which the noise of the positions is
below MAX_NOISE_MPS2."""
MAX_NOISE_MPS2: Final = 0.05
MAX_NOSE_HALF: Final = 20
"""The same for ways."""
APART_S: Final = 2.0
"""Offsets closer than this are not told apart by the search."""
MIN_OFFSET_S: Final = 0.3
"""Smaller ones are left to the adjustment."""
CLEAR_SHARE: Final = 0.6
"""The best offset must leave less unexplained than this share of what none leaves, and of what any other leaves."""


def search_imu_clock(imu: InertialTrack, positions: Positions, *, on_wheels: bool) -> float:
    """Time by which the IMU's clock is clearly ahead of the positions'; 0 where it is not by more than MIN_OFFSET_S.

    Args:
        imu: in axes that keep to the vehicle; on wheels in the vehicle's.
        positions: of the antenna.
    """
    if len(imu) < 2 or len(positions.t_s) < 2:
        return 0.0
    half = _half(positions)
    for of_nose in (False, True) if on_wheels else (False,):
        half = min(half, MAX_NOSE_HALF) if of_nose else half
        if found_s := _clearly_best(*_unexplained(imu, positions, half, of_nose=of_nose)):
            return -found_s  # a motion of later is that of the positions at the IMU's true time
    return 0.0


def _half(positions: Positions) -> int:
    noise = float(np.median(positions.white_m[:, 0]))
    step_s = float(np.median(np.diff(positions.t_s)))
    for half in MOTION_HALVES:
        averaged = max(1.0, 0.5 * half * STEP_S / step_s)
        if noise / np.sqrt(averaged) * np.sqrt(6.0) / (half * STEP_S) ** 2 < MAX_NOISE_MPS2:
            return half
    return MOTION_HALVES[-1]


def _unexplained(
    imu: InertialTrack, positions: Positions, half: int, *, of_nose: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(windows, offsets) squares of the motion left, and all of them, nan where unknown; (offsets,) in seconds."""
    t_s = np.arange(imu.t_s[0], imu.t_s[-1], STEP_S)
    rate, force = (_means(imu.t_s, values, t_s) for values in (imu.rate_radps, imu.force_mps2))
    turned = chained(np.ascontiguousarray(Rotation.from_rotvec(rate * STEP_S).as_matrix()))
    pauses = imu.t_s[np.flatnonzero(np.diff(imu.t_s) > MAX_IMU_PAUSE_S)]
    seen, seen_s = _motion(positions, half, of_nose=of_nose)
    kernel = _kernel(half, of_nose=of_nose)
    beside, window = len(kernel) // 2, WINDOW + len(kernel) - 1
    if len(force) < window:
        return np.zeros((0, 1)), np.zeros((0, 1)), np.zeros(1)
    steps = round(MAX_OFFSET_S / STEP_S)
    # The grids of both begin at their own times: their distance is no whole number of steps.
    first = round((t_s[0] - seen_s) / STEP_S)
    offset_s = STEP_S * np.arange(-steps, steps + 1) + (seen_s + first * STEP_S - t_s[0])
    count = min(MAX_WINDOWS, 1 + (len(force) - window) // (WINDOW // 2))
    out = []
    for begin in np.unique(np.linspace(0, len(force) - window, count).astype(int)):
        if np.any((pauses >= t_s[begin]) & (pauses < t_s[begin] + window * STEP_S)):
            continue
        own = _own(turned[begin : begin + window], force[begin : begin + window], kernel, of_nose=of_nose)
        places = first + begin + beside + np.arange(-steps, steps + 1)
        inside = (places >= 0) & (places + len(own) <= len(seen))
        left, whole = np.full((2, len(offset_s)), np.nan)
        windows = np.lib.stride_tricks.sliding_window_view(seen, len(own))[places[inside]]
        together = np.abs(windows @ own.conj())
        squares, of_own = (np.abs(windows) ** 2).sum(axis=1), float((np.abs(own) ** 2).sum())
        if of_nose:
            whole[inside] = squares
            left[inside] = squares - together**2 / of_own
        else:
            whole[inside] = squares - np.abs(windows.sum(axis=1)) ** 2 / len(own) + of_own
            left[inside] = whole[inside] - 2.0 * together
        out.append((left, whole))
    left, whole = np.array(out).reshape(-1, 2, len(offset_s)).transpose(1, 0, 2)
    return left, whole, offset_s


def _means(t_s: FloatArray, values: FloatArray, begin_s: FloatArray) -> FloatArray:
    """(n − 1, 3) means of values (m, 3) between times (n,)."""
    area = np.zeros_like(values)
    area[1:] = np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(t_s)[:, None], axis=0)
    return np.diff(np.column_stack([np.interp(begin_s, t_s, axis) for axis in area.T]), axis=0) / STEP_S


def _kernel(half: int, *, of_nose: bool) -> FloatArray:
    """Weights by which accelerations enter second differences, or speeds ways, of means over half of `half` steps."""
    mean = np.ones(half // 2 + 1 - half // 2 % 2)
    out = np.convolve(np.ones(2 * half) if of_nose else np.convolve(np.ones(half), np.ones(half)), mean)
    return np.asarray(out / out.sum())


def _own(turned: FloatArray, force: FloatArray, kernel: FloatArray, *, of_nose: bool) -> ComplexArray:
    """Horizontal accelerations without their mean, or directions of the nose, by the IMU, in axes of their own."""
    axes = turned[0].T @ turned
    pushed = np.einsum("kij,kj->ki", axes, force)
    up = pushed.mean(axis=0)
    level, _ = Rotation.align_vectors([[0.0, 0.0, 1.0]], [up / max(float(np.linalg.norm(up)), 1e-9)])
    flat = level.apply(axes[:, :, 0] if of_nose else pushed)
    out = np.convolve(flat[:, 0] + 1j * flat[:, 1], kernel, mode="valid")
    return np.asarray(out if of_nose else out - out.mean())


def _motion(positions: Positions, half: int, *, of_nose: bool) -> tuple[ComplexArray, float]:
    """Accelerations or ways of the antenna at times STEP_S apart, nan where unknown, and the first of these times."""
    t_s = np.arange(positions.t_s[0], positions.t_s[-1], STEP_S)
    xy = np.column_stack([np.interp(t_s, positions.t_s, positions.xyz_m[:, axis]) for axis in range(2)])
    after = np.clip(np.searchsorted(positions.t_s, t_s), 1, len(positions.t_s) - 1)
    xy[positions.t_s[after] - positions.t_s[after - 1] > max(1.0, 2.5 * float(np.median(np.diff(positions.t_s))))] = (
        np.nan
    )
    mean = moving_mean(xy, half // 2 + 1 - half // 2 % 2)
    out = np.full(len(mean), np.nan, np.complex128)
    if len(mean) > 2 * half:
        way = (
            mean[2 * half :] - mean[: -2 * half]
            if of_nose
            else mean[2 * half :] - 2 * mean[half:-half] + mean[: -2 * half]
        )
        out[half:-half] = (way[:, 0] + 1j * way[:, 1]) / (1.0 if of_nose else (half * STEP_S) ** 2)
    return out, float(t_s[0])


def _clearly_best(left: FloatArray, whole: FloatArray, offset_s: FloatArray) -> float:
    """The offset that leaves clearly least, by the parabola through three; 0 where it is near none."""
    # Where enough windows are known at all offsets, the others would only make these differ.
    always = np.isfinite(left).all(axis=1)
    if always.sum() >= MIN_COMMON_WINDOWS:
        left, whole = left[always], whole[always]
    known = np.isfinite(left)
    enough = known.sum(axis=0) >= MIN_WINDOWS
    if not enough.any():
        return 0.0
    share = np.full(len(offset_s), np.inf)
    share[enough] = np.nansum(left, axis=0)[enough] / np.maximum(np.nansum(whole, axis=0)[enough], 1e-12)
    best = int(np.argmin(share))
    apart = np.abs(offset_s - offset_s[best]) > APART_S
    others = min(float(share[np.argmin(np.abs(offset_s))]), float(share[apart].min(initial=np.inf)))
    if abs(offset_s[best]) < MIN_OFFSET_S or share[best] > CLEAR_SHARE * others:
        return 0.0
    around = share[max(0, best - 1) : best + 2]
    if len(around) < 3 or not np.isfinite(around).all():
        return float(offset_s[best])
    before, here, after = around
    return float(offset_s[best] + 0.5 * STEP_S * (before - after) / max(before - 2.0 * here + after, 1e-12))
