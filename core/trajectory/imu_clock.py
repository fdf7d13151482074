"""A search for a large offset between the clocks of an IMU and of the positions, before any attitude is known.

For some seconds gyroscopes keep the axes, and the mean of the specific force is nearly vertical. The horizontal
accelerations by the IMU, as complex numbers, are then those by the positions but for a turn, which may be another one
in each window. On wheels the same holds for the direction of the nose and the way by the positions. The offset fits at
which least of the motion is left unexplained.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.preintegration import cross_matrix
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
ABOVE_NOISE: Final = 5.0
"""Ways of less than so many standard deviations show no direction."""
MIN_MOVING: Final = 0.1
"""Share of the time in which the way must show a direction."""
LEAST_COMPARED: Final = 0.3
"""Share of the motion compared at most that must be compared at an offset."""
APART: Final = 1.5
"""Offsets closer than this share of the time of second differences, and than APART_S, are not told apart."""
APART_S: Final = 2.0
MIN_OFFSET_S: Final = 0.3
"""Smaller ones are left to the adjustment; the standard deviation of those that it does not show."""
CLEAR_SHARE: Final = 0.6
"""The best offset must leave less unexplained than this share of what none leaves, and of what any other leaves."""


def search_imu_clock(imu: InertialTrack, positions: Positions, arm_m: FloatArray, *, on_wheels: bool) -> float:
    """Time by which the IMU's clock is clearly ahead of the positions'; 0 where it is not by more than MIN_OFFSET_S.

    Args:
        imu: in axes that keep to the vehicle; on wheels in the vehicle's. Without wheels the direction of the nose only
            counts where positions hide accelerations, and from APART_S on: an aircraft may turn before or after it.
        arm_m: (3,) from the IMU to the antenna in these axes. Where it turns off, an antenna ahead is early.
    """
    if len(imu) < 2 or len(positions.t_s) < 2:
        return 0.0
    half = _half(positions)
    least_s = MIN_OFFSET_S if on_wheels else APART_S
    t_s = np.arange(imu.t_s[0], imu.t_s[-1], STEP_S)
    rate, force = (_means(imu.t_s, values, t_s) for values in (imu.rate_radps, imu.force_mps2))
    if len(rate) > 1:
        force += np.cross(np.gradient(rate, STEP_S, axis=0), arm_m) + np.cross(rate, np.cross(rate, arm_m))
    # The bias that gravity shows is that of the gyroscopes, or of few and long accelerations.
    for turned in (_turned(rate - _rate_bias(_turned(rate), force)), _turned(rate)):
        for of_nose in (False, True) if on_wheels or half == MOTION_HALVES[-1] else (False,):
            motion = _Motion(imu, t_s, turned, force, of_nose)
            found_s = _clearly_best(*_unexplained(motion, positions, half), half)
            if found_s is not None:  # a motion of later is that of the positions at the IMU's true time
                return -found_s if abs(found_s) > (least_s if of_nose else MIN_OFFSET_S) else 0.0
    return 0.0


@dataclass(frozen=True)
class _Motion:
    """Measurements of an IMU in equal steps.

    Attributes:
        t_s: (n,) begins of the steps, and the end of the last.
        turned: (n, 3, 3) rotations to the first axes.
        force: (n − 1, 3) means.
        of_nose: whether the direction of the nose is compared with that of travel, instead of accelerations.
    """

    imu: InertialTrack
    t_s: FloatArray
    turned: FloatArray
    force: FloatArray
    of_nose: bool


def _half(positions: Positions) -> int:
    noise = float(np.median(positions.white_m[:, 0]))
    step_s = float(np.median(np.diff(positions.t_s)))
    for half in MOTION_HALVES:
        averaged = max(1.0, 0.5 * half * STEP_S / step_s)
        if noise / np.sqrt(averaged) * np.sqrt(6.0) / (half * STEP_S) ** 2 < MAX_NOISE_MPS2:
            return half
    return MOTION_HALVES[-1]


def _unexplained(motion: _Motion, positions: Positions, half: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(windows, offsets) squares of the motion left, and all of them, nan where unknown; (offsets,) in seconds."""
    imu = motion.imu
    t_s = motion.t_s
    turned = motion.turned
    force = motion.force
    of_nose = motion.of_nose
    pauses = imu.t_s[np.flatnonzero(np.diff(imu.t_s) > MAX_IMU_PAUSE_S)]
    seen, seen_s = _motion(positions, half, of_nose=of_nose)
    kernel = _kernel(half, of_nose=of_nose)
    beside = len(kernel) // 2
    window = WINDOW + len(kernel) - 1
    if len(force) < window or len(seen) < WINDOW:
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
        squares = (np.abs(windows) ** 2).sum(axis=1)
        of_own = float((np.abs(own) ** 2).sum())
        if of_nose:
            whole[inside] = squares
            left[inside] = squares - together**2 / np.maximum(squares, 1.0)
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


def _turned(rate: FloatArray) -> FloatArray:
    """(n + 1, 3, 3) rotations to the first axes after n steps of angular rates (n, 3)."""
    return np.asarray(chained(np.ascontiguousarray(Rotation.from_rotvec(rate * STEP_S).as_matrix())))


def _rate_bias(turned: FloatArray, force: FloatArray) -> FloatArray:
    """(3,) bias of the gyroscopes by which gravity keeps its direction, that about the vertical left out.

    Accelerations average out over many windows.
    """
    normal = 1e-3 * np.eye(3)
    right = np.zeros(3)
    for begin in range(0, len(force) - WINDOW + 1, WINDOW):
        axes = turned[begin].T @ turned[begin : begin + WINDOW]
        pushed = np.einsum("kij,kj->ki", axes, force[begin : begin + WINDOW])
        design = -cross_matrix(np.broadcast_to(pushed.mean(axis=0), pushed.shape)) @ (np.cumsum(axes, axis=0) * STEP_S)
        design -= design.mean(axis=0)
        normal += np.einsum("kai,kaj->ij", design, design)
        right += np.einsum("kai,ka->i", design, pushed - pushed.mean(axis=0))
    return np.asarray(np.linalg.solve(normal, right))


def _averaged(half: int) -> int:
    """Steps, an odd number, over which positions are averaged."""
    return half // 2 + 1 - half // 2 % 2


def _kernel(half: int, *, of_nose: bool) -> FloatArray:
    """Weights by which accelerations enter second differences, or speeds ways, of means over half of `half` steps."""
    mean = np.ones(_averaged(half))
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
    return np.asarray(out / np.maximum(np.abs(out), 1e-9) if of_nose else out - out.mean())


def _motion(positions: Positions, half: int, *, of_nose: bool) -> tuple[ComplexArray, float]:
    """Accelerations, or directions of travel (0 at a stand), nan where unknown, STEP_S apart; and the first time."""
    t_s = np.arange(positions.t_s[0], positions.t_s[-1], STEP_S)
    interval_s = np.diff(positions.t_s)
    xy = np.column_stack([np.interp(t_s, positions.t_s, positions.xyz_m[:, axis]) for axis in range(2)])
    step_s = float(np.median(interval_s))
    after = np.clip(np.searchsorted(positions.t_s, t_s), 1, len(interval_s))
    xy[interval_s[after - 1] > max(1.0, 2.5 * step_s)] = np.nan
    averaged = _averaged(half)
    mean = moving_mean(xy, averaged)
    out = np.full(len(mean), np.nan, np.complex128)
    if len(mean) <= 2 * half:
        return out, float(t_s[0])
    before = mean[: -2 * half]
    here = mean[half:-half]
    later = mean[2 * half :]
    way = later - before if of_nose else (later - 2.0 * here + before) / (half * STEP_S) ** 2
    moved = way[:, 0] + 1j * way[:, 1]
    if of_nose:
        noise = float(np.median(positions.white_m[:, 0])) / np.sqrt(max(1.0, averaged * STEP_S / step_s))
        size = np.abs(moved)
        with np.errstate(invalid="ignore"):
            moved = np.where(size < ABOVE_NOISE * noise, 0.0, moved / np.maximum(size, 1e-9))
        if np.count_nonzero(np.nan_to_num(moved)) < MIN_MOVING * len(moved):
            return out, float(t_s[0])
    out[half:-half] = moved
    return out, float(t_s[0])


def _clearly_best(left: FloatArray, whole: FloatArray, offset_s: FloatArray, half: int) -> float | None:
    """The offset that leaves clearly least, by the parabola through three; None where none does."""
    # Where enough windows are known at all offsets, the others would only make these differ.
    always = np.isfinite(left).all(axis=1)
    if always.sum() >= MIN_COMMON_WINDOWS:
        left = left[always]
        whole = whole[always]
    known = np.isfinite(left)
    enough = known.sum(axis=0) >= MIN_WINDOWS
    share = np.full(len(offset_s), np.inf)
    total = np.nansum(whole, axis=0)
    enough &= total > max(LEAST_COMPARED * total.max(), 1e-9)
    share[enough] = np.nansum(left, axis=0)[enough] / total[enough]
    if not enough.any():
        return None
    best = int(np.argmin(share))
    apart = np.abs(offset_s - offset_s[best]) > max(APART_S, APART * half * STEP_S)
    others = float(share[apart].min(initial=np.inf))
    if abs(offset_s[best]) >= MIN_OFFSET_S:
        others = min(others, float(share[np.argmin(np.abs(offset_s))]))
    if share[best] > CLEAR_SHARE * others:
        return None
    around = share[max(0, best - 1) : best + 2]
    if len(around) < 3 or not np.isfinite(around).all():
        return float(offset_s[best])
    before, here, after = around
    return float(offset_s[best] + 0.5 * STEP_S * (before - after) / max(before - 2.0 * here + after, 1e-12))
