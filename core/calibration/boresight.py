"""Boresight of a scanner on a vehicle with an IMU, from ground that is seen at several times.

The trajectory is known, so where the same ground comes out at different heights, the mounting is off (or the clock, or
the lasers' ranges). Heights of cells at each time are observations of three angles, a time offset, constants of the
lasers, and a height of each window of time for what the trajectory is off; the heights of the cells are eliminated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial.transform import Rotation

from furrowmap.core.calibration.strips import (
    LASERS,
    PARAMETERS,
    CellHeights,
    StripReturns,
    cell_heights,
    smooth_groups,
)
from furrowmap.core.estimation.robust import huber_weight
from furrowmap.core.values.errors import Notice
from furrowmap.core.values.mounting import Mounting
from furrowmap.core.values.trajectory import Trajectory

FloatArray = NDArray[np.float64]

WINDOW_S: Final = 1.0
MOST_WINDOWS: Final = 400
HEIGHT_M: Final = 0.005
"""Standard deviation of what a window's heights are off, of a laser's range constant, and of a cell's mean."""
TIME_S: Final = 0.001
"""Standard deviation of the time offset between scanner and positions before it is estimated."""
ANGLE: Final = np.radians(5.0)
"""Of each angle."""
ROUNDS: Final = 6
SETTLED: Final = np.radians(0.001)
ROBUST_ROUNDS: Final = 3
LEAST_GROUPS: Final = 500
CERTAIN_DEG: Final = 0.2
"""Largest standard deviation of an angle with which the boresight is used."""


@dataclass(frozen=True)
class Boresight:
    """The mounting at which ground seen at several times coincides.

    Attributes:
        mounting: of the scanner.
        correction_deg: (3,) rotation from the stated mounting, about the vehicle's x, y and z axes.
        sigma_deg: (3,) standard deviation, that of the trajectory's attitude included.
        time_offset_s: time by which the scanner's clock is behind the positions', and its standard deviation.
        scatter_m: scatter of the ground's heights with the stated mounting and with this one (RMS between times).
        cells: number of cells that count.
        certain: whether all angles are known well enough to be used.
    """

    mounting: Mounting
    correction_deg: tuple[float, float, float]
    sigma_deg: tuple[float, float, float]
    time_offset_s: tuple[float, float]
    scatter_m: tuple[float, float]
    cells: int
    certain: bool

    @property
    def differs(self) -> bool:
        """Whether an angle is off the stated one by more than three standard deviations."""
        return any(abs(off) > 3.0 * sigma for off, sigma in zip(self.correction_deg, self.sigma_deg, strict=True))


def boresight(returns: StripReturns, trajectory: Trajectory, stated: Mounting) -> Boresight | None:
    """The boresight; None where too little ground is seen at several times.

    Args:
        returns: of the scanner, with their poses.
        trajectory: they are from.
        stated: the mounting as the session states it.
    """
    if len(returns) < LEAST_GROUPS:
        return None
    lever = np.asarray(stated.xyz_m, np.float64)
    length_s = max(WINDOW_S, float(np.ptp(returns.t_s)) / MOST_WINDOWS)
    window = ((returns.t_s - returns.t_s[0]) / length_s).astype(np.int64)
    windows, rotation = int(window[-1]) + 1, stated.rotation
    first = _fitted(cell_heights(returns, window, rotation, lever), windows)
    if first is None:
        return None
    fitted = first
    for _ in range(ROUNDS):
        if np.abs(fitted.values[:3]).max() < SETTLED:
            break
        rotation = Rotation.from_rotvec(fitted.values[:3]).as_matrix() @ rotation
        again = _fitted(cell_heights(returns, window, rotation, lever), windows)
        if again is None:
            return None
        fitted = again
    own = np.degrees(np.sqrt(np.diag(fitted.covariance)[:3]))
    inside = (trajectory.t_s >= returns.t_s[0]) & (trajectory.t_s <= returns.t_s[-1])
    sigma = np.hypot(own, np.nanmedian(trajectory.sigma[inside, 3:], axis=0))
    correction = np.degrees(Rotation.from_matrix(rotation @ stated.rotation.T).as_rotvec())
    return Boresight(
        Mounting.from_rotation(stated.xyz_m, rotation),
        _three(correction),
        _three(sigma),
        (float(fitted.values[3]), float(np.sqrt(fitted.covariance[3, 3]))),
        (first.apart_m, fitted.apart_m),
        fitted.cells,
        bool((sigma < CERTAIN_DEG).all()),
    )


def boresight_notices(found: Boresight | None) -> list[Notice]:
    """The mounting of a scanner on a vehicle with an IMU: used as found, or assumed as stated."""
    if found is None or not found.certain:
        text = (
            "The scans do not show how the scanner is mounted: too little smooth ground is seen at several times. The "
            "session's [lidar] rpy_deg is used as it is; an error of 0.1° in it moves points by 2 cm at 10 m."
        )
        return [Notice("boresight-assumed", text)]
    if not found.differs:
        return []
    angles, sigmas = (", ".join(f"{value:.3f}" for value in values) for values in (
        found.mounting.rpy_deg, found.sigma_deg
    ))  # fmt: skip
    text = (
        f"The scanner's mounting is off: ground seen at several times coincides to {1e3 * found.scatter_m[1]:.0f} mm "
        f"instead of {1e3 * found.scatter_m[0]:.0f} mm with rpy_deg = [{angles}] (± {sigmas}° about the vehicle's "
        "axes), which is used."
    )
    return [Notice("boresight-off", text)]


def _three(values: FloatArray) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


@dataclass(frozen=True)
class _Fitted:
    """Corrections of the parameters, their covariance, the RMS of heights before, and the number of cells."""

    values: FloatArray
    covariance: FloatArray
    apart_m: float
    cells: int


def _fitted(heights: CellHeights, windows: int) -> _Fitted | None:
    """Least squares of all parameters, the heights of the cells eliminated."""
    variance, chosen = smooth_groups(heights)
    cell, several = np.unique(heights.cell[chosen], return_inverse=True)
    if len(chosen) < LEAST_GROUPS or len(chosen) < 1.5 * len(cell):
        return None
    count, height = heights.count[chosen], heights.height_m[chosen]
    rows = np.arange(len(chosen))
    windowed = sparse.csr_matrix((np.ones(len(rows)), (rows, heights.window[chosen])), (len(rows), windows))
    design = sparse.hstack([sparse.csr_matrix(heights.design[chosen]), windowed]).tocsr()
    member = sparse.csr_matrix((np.ones(len(rows)), (several, rows)), (len(cell), len(rows)))
    spread = np.concatenate([np.full(3, ANGLE), [TIME_S], np.full(LASERS + windows, HEIGHT_M)])
    independent = 1.0 / (variance / count + HEIGHT_M**2)
    robust = np.ones(len(rows))
    for _ in range(ROBUST_ROUNDS):
        weight = independent * robust
        total: FloatArray = np.asarray(member @ weight)
        weighted = sparse.diags(weight) @ design
        means = sparse.diags(1.0 / total) @ (member @ weighted)
        normal = (design.T @ weighted - means.T @ sparse.diags(total) @ means).toarray() + np.diag(1.0 / spread**2)
        middle: FloatArray = np.asarray(member @ (weight * height)) / total
        right = np.asarray(weighted.T @ height - means.T @ (total * middle))
        covariance = np.asarray(np.linalg.inv(normal), np.float64)
        off = covariance @ right
        residual = np.asarray(height - design @ off - member.T @ (middle - means @ off))
        robust = huber_weight(np.abs(residual) * np.sqrt(independent))
    apart = height - middle[several]
    rms = float(np.sqrt(np.average(apart**2, weights=count)))
    return _Fitted(-off[:PARAMETERS], covariance[:PARAMETERS, :PARAMETERS], rms, len(cell))
