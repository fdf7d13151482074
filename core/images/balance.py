"""Radiometric balance of frames: their exposures and the vignetting, from what several of them see.

The level of a channel is taken for the product of the ground's brightness, a gain of the frame and the vignetting, a
function of the distance from the middle of the image (Goldman and Chen 2005); in logarithms they add up.
"""

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, diags, hstack, identity
from scipy.sparse.linalg import spsolve

from furrowmap.core.runtime.arrays import FloatArray

DARKEST: Final = 6.0
BRIGHTEST: Final = 248.0
"""Levels beyond are cut off, or mostly noise."""
PRIOR: Final = 0.3
"""Standard deviation of gains and of the coefficients of the vignetting, in logarithms."""
LEVEL_NOISE: Final = 0.1
"""Of the logarithm of a level, before it is estimated."""
BALANCE_ROUNDS: Final = 4
BALANCE_HUBER: Final = 1.5
MIN_OBSERVATIONS: Final = 200
"""Observations without which nothing is balanced."""


class Balance(NamedTuple):
    """Gains and vignetting, as natural logarithms of factors of the levels.

    `gain` (n, 3) is of each frame's red, green and blue; `vignetting` (3,) are coefficients of the square, fourth and
    sixth power of the distance from the middle of the image, 1 in its corners. `factor` (n, 3) undoes the gains.
    """

    gain: FloatArray
    vignetting: FloatArray
    factor: FloatArray

    @classmethod
    def none(cls, count: int) -> "Balance":
        """No differences between `count` frames, and no vignetting."""
        return cls(np.zeros((count, 3)), np.zeros(3), np.ones((count, 3)))

    @property
    def corner(self) -> float:
        """Share of the light that is lost in the corners."""
        return float(1.0 - np.exp(self.vignetting.sum()))


def balance_frames(
    count: int, point: NDArray[np.int32], frame: NDArray[np.int32], radius: FloatArray, levels: FloatArray
) -> Balance:
    """Gains and vignetting by robust least squares from levels (m, 3), 0 to 255, of points in frames.

    The points (m,) increase; the radius (m,) is the distance from the middle of the image, 1 in its corners.
    """
    good = ((levels > DARKEST) & (levels < BRIGHTEST)).all(axis=1)
    times = np.bincount(point[good], minlength=int(point.max(initial=0)) + 1)
    good &= times[point] > 1
    if good.sum() < MIN_OBSERVATIONS:
        return Balance.none(count)
    _, which = np.unique(point[good], return_inverse=True)
    frame = frame[good]
    logs = np.log(levels[good])
    square = radius[good] ** 2
    powers = np.column_stack([square, square**2, square**3])
    shared = _fit(which, frame, count, logs.mean(axis=1), powers)
    left = logs - (powers @ shared[count:])[:, None]
    channels = [_fit(which, frame, count, left[:, c], None)[:count] for c in range(3)]
    gain = np.ascontiguousarray(np.column_stack(channels))
    return Balance(gain, np.ascontiguousarray(shared[count:]), np.exp(-gain))


def _fit(
    point: NDArray[np.intp], frame: NDArray[np.int32], count: int, logs: FloatArray, powers: FloatArray | None
) -> FloatArray:
    """Gains (count,) and coefficients of the powers (k,), the brightness of each point eliminated."""
    m = len(logs)
    powers_used = 0 if powers is None else powers.shape[1]
    # scipy's types of sparse products are unions of all that may come out.
    design: Any = coo_matrix((np.ones(m), (np.arange(m), frame)), shape=(m, count)).tocsr()
    if powers is not None:
        design = hstack([design, coo_matrix(powers)]).tocsr()
    of_point: Any = coo_matrix((np.ones(m), (point, np.arange(m))), shape=(int(point[-1]) + 1, m)).tocsr()
    weight = np.ones(m)
    noise = LEVEL_NOISE
    found = np.zeros(count + powers_used)
    for _ in range(BALANCE_ROUNDS):
        # Normal equations of the gains, those of the points' brightness eliminated (Schur complement).
        total = np.maximum(of_point @ weight, 1e-12)
        weighted = diags(weight) @ design
        sums = of_point @ weighted
        right = of_point @ (weight * logs)
        normal = design.T @ weighted - sums.T @ diags(1.0 / total) @ sums + (noise / PRIOR) ** 2 * identity(len(found))
        found = spsolve(normal.tocsc(), weighted.T @ logs - sums.T @ (right / total))
        left = logs - design @ found
        left -= ((of_point @ (weight * left)) / total)[point]
        noise = max(1.4826 * float(np.median(np.abs(left))), 1e-4)
        weight = np.minimum(1.0, BALANCE_HUBER * noise / np.maximum(np.abs(left), 1e-12))
    out: FloatArray = found
    return out
