"""The ground of the last metres round the vehicle, and how far each scan turned and moved on it.

As in :mod:`~furrowmap.core.matching.ground_registration` slopes are multiplied by their reliability, and what they are
made of comes from two halves of the scans: without that smooth ground would show that the vehicle does not turn.
"""

from dataclasses import dataclass
from typing import Final, Literal, NamedTuple, TypeAlias

import numpy as np

from furrowmap.core.matching.returns import SELF_RANGE_M
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel, kernel_part
from furrowmap.core.values.scan import Scan

RECENT_CELL_M: Final = 0.1
SIDE_CELLS: Final = 512
"""Cells lie in a torus: new ground overwrites that of half a side away."""
NO_KEY: Final = np.iinfo(np.int32).min
RANGE_M: Final = (SELF_RANGE_M[0] + 0.5, 10.0)
HIGHEST_M: Final = 1.0
"""What is further above or below the vehicle's wheels is no ground."""
SCAN_RETURNS: Final = 6000
"""Of a scan, about so many are looked at."""
NOISE_M: Final = 0.012
SHARED: Final = 10.0
"""So many neighbouring returns share an error, as in a run's matching."""
GATE_M: Final = 0.15
MEMORY: Final = 20.0
"""Returns of which a cell keeps the mean: soil that was tilled since is forgotten."""
MIN_IN_CELL: Final = 3.0
KNOWN: Final = 6.0
"""Returns of a cell to which no more are added while the place is searched for."""
STEEPEST: Final = 0.4
"""Steeper neighbours are the feet of posts, not relief."""
SLOPES_KEPT: Final = 0.95
"""Of the sums over slopes, after each scan: relief is that of the last two seconds."""
LEAST_RELIEF: Final = 1e-5
LEAST_NOISE: Final = 0.3
UNSURE_NOISE: Final = 0.2
CARRIED_NOISE: Final = 0.1
"""The noise of slopes is known to the one share of itself; the other may be in both halves of the scans, as the rings
of lasers, which go along with the vehicle."""
TURN_ROUNDS: Final = 5
TRIED: Final = 3
TRIED_RAD: Final = np.radians(0.8)
"""So many turns to either side are tried, so far apart: on the wrong one relief does not show the way."""
CLIPPED_M: Final = 0.04
MIN_MATCHED: Final = 300
Added: TypeAlias = Literal["expected", "found", "found-new"]
"""Where a scan is added to the ground, see :meth:`RecentGround.move`."""
ADD_SHIFT: Final = np.array([0.0, 0.0, 1.0, 1.0, 1.0, 1.0])
"""Where positions hold the place, scans are added there: where they are matched, smooth ground would pull them towards
no motion."""


@dataclass(frozen=True)
class ScanTurn:
    """A scan's place on the recent ground, against the place where it was expected.

    Attributes:
        shift_m: (3,) along the axes of the map.
        turn_rad: (3,) about them, counter-clockwise.
        sigma_rad: standard deviation of the last of the turns.
        covariance_m2: (2, 2) of the shift in plan.
        residual_m: RMS of the heights on the ground before.
    """

    shift_m: FloatArray
    turn_rad: FloatArray
    sigma_rad: float
    covariance_m2: FloatArray
    residual_m: float


class RecentSlopes(NamedTuple):
    """What the slopes between cells are made of.

    Attributes:
        relief: variance of true slopes.
        noise: as a multiple of what NOISE_M and the returns in the cells make of it.
    """

    relief: float
    noise: float


class RecentGround:
    """Mean heights in cells around the vehicle, in a frame of their own, by two halves of the scans."""

    def __init__(self, rotation: FloatArray, sensor_m: FloatArray) -> None:
        self._rotation = rotation
        self._sensor_m = sensor_m
        self._cells = np.zeros((SIDE_CELLS, SIDE_CELLS, 4))
        """Height and number of returns by the one half, and by the other."""
        self._half = 0
        self._slope_sums = np.zeros(4)
        self._last_s = -np.inf
        self._keys = np.full((SIDE_CELLS, SIDE_CELLS, 2), NO_KEY, np.int32)

    def move(
        self,
        scan: Scan,
        place_m: FloatArray,
        rotation: FloatArray,
        velocity: FloatArray,
        sigma: FloatArray,
        *,
        added: Added = "expected",
    ) -> ScanTurn | None:
        """Find a scan on the ground so far, and add it there.

        Args:
            place_m: (3,) where the vehicle is expected in the middle of the scan.
            rotation: (3, 3) vehicle to map, expected then.
            velocity: (3,) along the map's axes, and the rate of turn in rad/s.
            sigma: (6,) standard deviations of what is expected: place, height, turns about the three axes.
            added: whether the scan is added where it was expected in plan or where it was found; or there to ground
                only that few returns have shown, as over a long time without positions it would take the ground along.

        Returns:
            None while too little of the ground was seen before.
        """
        middle_s = 0.5 * float(scan.t_s[0] + scan.t_s[-1])
        since_s = middle_s - self._last_s
        points = _around(
            np.ascontiguousarray(scan.xyz_m, np.float32),
            scan.t_s - middle_s,
            self._rotation,
            self._sensor_m,
            rotation,
            velocity,
            since_s,
            max(1, len(scan) // SCAN_RETURNS),
        )
        self._last_s = middle_s
        self._slope_sums = SLOPES_KEPT * self._slope_sums + _slope_sums(points, place_m, self._cells, self._keys)
        found, normal, used, squares = _matched(
            points, place_m, self._cells, self._keys, sigma, _motion(velocity, since_s), self._slopes()
        )
        shift = found * ADD_SHIFT if added == "expected" else found
        _add(points, place_m, shift, self._cells, self._keys, KNOWN if added == "found-new" else np.inf, self._half)
        self._half = 1 - self._half
        if used < MIN_MATCHED:
            return None
        covariance = np.linalg.inv(normal)
        sigma_rad = float(np.sqrt(covariance[5, 5]))
        return ScanTurn(found[:3], found[3:], sigma_rad, covariance[:2, :2], float(np.sqrt(squares / used)))

    def forget(self) -> None:
        """Nothing was seen so far."""
        self._keys[:] = NO_KEY

    def _slopes(self) -> RecentSlopes:
        """What the last scans' slopes are made of; the product of those of the halves is that of relief alone."""
        products, squares, expected, count = self._slope_sums.tolist()
        if count == 0.0:
            return RecentSlopes(LEAST_RELIEF, 1.0)
        return RecentSlopes(max(products / count, LEAST_RELIEF), max((squares - products) / expected, LEAST_NOISE))


def _motion(velocity: FloatArray, since_s: float) -> FloatArray:
    """(6,) how far the vehicle is expected to have moved and turned since the scan before."""
    if not np.isfinite(since_s):
        return np.zeros(6)
    east_m, north_m, turn_rad = velocity * since_s
    return np.array([east_m, north_m, 0.0, 0.0, 0.0, turn_rad])


@kernel()
def _around(xyz_m, t_s, mounting, sensor_m, rotation, velocity, since_s, step):  # type: ignore[no-untyped-def]
    """(n, 4) returns of the ground around the vehicle, in the map's axes, as of the middle of the scan.

    The last column is the share of what is found since the scan before that had happened by then: vehicles sway.
    """
    out = np.empty((len(xyz_m) // step + 1, 4))
    count = 0
    w = np.empty(3)
    v = np.empty(3)
    for i in range(0, len(xyz_m), step):
        for k in range(3):
            w[k] = (
                mounting[k, 0] * xyz_m[i, 0] + mounting[k, 1] * xyz_m[i, 1] + mounting[k, 2] * xyz_m[i, 2] + sensor_m[k]
            )
        if not RANGE_M[0] ** 2 < w[0] * w[0] + w[1] * w[1] < RANGE_M[1] ** 2:
            continue
        for k in range(3):
            v[k] = rotation[k, 0] * w[0] + rotation[k, 1] * w[1] + rotation[k, 2] * w[2]
        if abs(v[2]) > HIGHEST_M:
            continue
        c = np.cos(velocity[2] * t_s[i])
        s = np.sin(velocity[2] * t_s[i])
        out[count, 0] = c * v[0] - s * v[1] + velocity[0] * t_s[i]
        out[count, 1] = s * v[0] + c * v[1] + velocity[1] * t_s[i]
        out[count, 2] = v[2]
        out[count, 3] = 1.0 + t_s[i] / since_s
        count += 1
    return out[:count]


@kernel_part()
def _moved(point, found):  # type: ignore[no-untyped-def]
    """A return with the turns and shifts that were found."""
    c = np.cos(point[3] * found[5])
    s = np.sin(point[3] * found[5])
    x = c * point[0] - s * point[1] + found[0]
    y = s * point[0] + c * point[1] + found[1]
    return x, y, point[2] + point[3] * (found[2] + found[3] * y - found[4] * x)


@kernel_part()
def _height(cell):  # type: ignore[no-untyped-def]
    """Mean height by both halves, and the number of returns."""
    count = cell[1] + cell[3]
    return (cell[0] * cell[1] + cell[2] * cell[3]) / count, count


@kernel_part()
def _slopes_between(h00, h01, h10, h11, u, v):  # type: ignore[no-untyped-def]
    """Slopes along x and y between four cells."""
    return (
        ((h01 - h00) * (1.0 - v) + (h11 - h10) * v) / RECENT_CELL_M,
        ((h10 - h00) * (1.0 - u) + (h11 - h01) * u) / RECENT_CELL_M,
    )


@kernel_part()
def _off(x, y, z, cells, keys):  # type: ignore[no-untyped-def]
    """Height of the known ground above a point, its slopes, and the variance that NOISE_M makes in the mean of these.

    The height is nan where the ground is not known.
    """
    u = x / RECENT_CELL_M - 0.5
    v = y / RECENT_CELL_M - 0.5
    column = int(np.floor(u))
    line = int(np.floor(v))
    for k in range(4):
        c = column + (k & 1)
        r = line + (k >> 1)
        key = keys[r % SIDE_CELLS, c % SIDE_CELLS]
        cell = cells[r % SIDE_CELLS, c % SIDE_CELLS]
        if key[0] != c or key[1] != r or cell[1] + cell[3] < MIN_IN_CELL:
            return np.nan, 0.0, 0.0, 0.0
    a = column % SIDE_CELLS
    b = line % SIDE_CELLS
    u = u - column
    v = v - line
    a1 = (column + 1) % SIDE_CELLS
    b1 = (line + 1) % SIDE_CELLS
    h00, n00 = _height(cells[b, a])
    h01, n01 = _height(cells[b, a1])
    h10, n10 = _height(cells[b1, a])
    h11, n11 = _height(cells[b1, a1])
    off = (h00 * (1 - u) + h01 * u) * (1 - v) + (h10 * (1 - u) + h11 * u) * v - z
    slope_x, slope_y = _slopes_between(h00, h01, h10, h11, u, v)
    along_x = (1.0 / n00 + 1.0 / n01) * (1 - v) ** 2 + (1.0 / n10 + 1.0 / n11) * v**2
    along_y = (1.0 / n00 + 1.0 / n10) * (1 - u) ** 2 + (1.0 / n01 + 1.0 / n11) * u**2
    return off, slope_x, slope_y, 0.5 * (along_x + along_y) * (NOISE_M / RECENT_CELL_M) ** 2


@kernel()
def _slope_sums(points, place_m, cells, keys):  # type: ignore[no-untyped-def]
    """(4,) sums over returns: products of the halves' slopes, squares of both's, their variance by noise, and how many.

    Each is a mean of the two directions.
    """
    sums = np.zeros(4)
    for i in range(len(points)):
        x = points[i, 0] + place_m[0]
        y = points[i, 1] + place_m[1]
        off, slope_x, slope_y, variance = _off(x, y, points[i, 2] + place_m[2], cells, keys)
        steep = slope_x * slope_x + slope_y * slope_y
        if not abs(off) <= GATE_M or steep > STEEPEST**2:
            continue
        u = x / RECENT_CELL_M - 0.5
        v = y / RECENT_CELL_M - 0.5
        column = int(np.floor(u))
        line = int(np.floor(v))
        c00 = cells[line % SIDE_CELLS, column % SIDE_CELLS]
        c01 = cells[line % SIDE_CELLS, (column + 1) % SIDE_CELLS]
        c10 = cells[(line + 1) % SIDE_CELLS, column % SIDE_CELLS]
        c11 = cells[(line + 1) % SIDE_CELLS, (column + 1) % SIDE_CELLS]
        if min(c00[1], c01[1], c10[1], c11[1], c00[3], c01[3], c10[3], c11[3]) < 1.0:
            continue
        one_x, one_y = _slopes_between(c00[0], c01[0], c10[0], c11[0], u - column, v - line)
        other_x, other_y = _slopes_between(c00[2], c01[2], c10[2], c11[2], u - column, v - line)
        sums[0] += 0.5 * (one_x * other_x + one_y * other_y)
        sums[1] += 0.5 * steep
        sums[2] += variance
        sums[3] += 1.0
    return sums


@kernel()
def _doubt(reliability, sigma, motion):  # type: ignore[no-untyped-def]
    """(6,) variances of what is found, as the slopes' reliability is not known better.

    A wrong one shows a wrong share of all that the vehicle moved in plan and turned.
    """
    unreliable = 1.0 - reliability
    error = unreliable * (UNSURE_NOISE + CARRIED_NOISE * unreliable / reliability)
    variance = error * error * (sigma * sigma + motion * motion)
    variance[2:5] = 0.0
    return variance


@kernel()
def _likely_turn(points, place_m, cells, keys):  # type: ignore[no-untyped-def]
    """The turn of those tried at which heights fit best; the expected one if too few returns show any.

    By less than MIN_MATCHED returns chance decides.
    """
    found = np.zeros(6)
    best = np.inf
    turn = 0.0
    for k in range(2 * TRIED + 1):
        found[5] = TRIED_RAD * ((k + 1) // 2) * (1 - 2 * (k & 1))
        squares = 0.0
        used = 0
        for i in range(0, len(points), 4):
            x, y, z = _moved(points[i], found)
            off, _, _, _ = _off(x + place_m[0], y + place_m[1], z + place_m[2], cells, keys)
            if np.isfinite(off):
                squares += min(off * off, CLIPPED_M**2)
                used += 1
        if used >= MIN_MATCHED and squares / used < best:
            best = squares / used
            turn = found[5]
    return turn


@kernel()
def _matched(points, place_m, cells, keys, sigma, motion, slopes):  # type: ignore[no-untyped-def]
    """What `_matched_from` finds from the expected turn, or from the likely one if heights then fit better.

    Neither alone is right: heights before the matching tell little while the vehicle rocks, and from an expected turn
    that is 2.4° off the matching may end 15 % worse than from the likely one, and lose the way.
    """
    best = _matched_from(0.0, points, place_m, cells, keys, sigma, motion, slopes)
    turn = _likely_turn(points, place_m, cells, keys)
    if turn == 0.0:
        return best
    other = _matched_from(turn, points, place_m, cells, keys, sigma, motion, slopes)
    return other if other[3] * best[2] < best[3] * other[2] else best


@kernel()
def _matched_from(turn, points, place_m, cells, keys, sigma, motion, slopes):  # type: ignore[no-untyped-def]
    """Shifts and turns (6,) by Gauss and Newton, their normal equations, and how many returns lie on known ground."""
    found = np.zeros(6)
    row = np.zeros(6)
    prior = 1.0 / (sigma * sigma)
    normal = np.diag(prior)
    used = 0
    squares = 0.0
    found[5] = turn
    for _ in range(TURN_ROUNDS):
        normal = np.zeros((6, 6))
        right = np.zeros(6)
        reliabilities = 0.0
        used = 0
        squares = 0.0
        for i in range(len(points)):
            x, y, z = _moved(points[i], found)
            off, slope_x, slope_y, variance = _off(x + place_m[0], y + place_m[1], z + place_m[2], cells, keys)
            if not abs(off) <= GATE_M:
                continue
            weight = 1.0 / (SHARED * NOISE_M**2 * max(1.0, abs(off) / (2.0 * NOISE_M)))
            weight /= max(1.0, (slope_x * slope_x + slope_y * slope_y) / STEEPEST**2)
            reliability = slopes.relief / (slopes.relief + slopes.noise * variance)
            slope_x *= reliability
            slope_y *= reliability
            part = points[i, 3]
            row[0] = -slope_x
            row[1] = -slope_y
            row[2] = part
            row[3] = part * y
            row[4] = -part * x
            row[5] = part * (slope_x * y - slope_y * x)
            for p in range(6):
                right[p] += weight * row[p] * off
                for q in range(p + 1):
                    normal[p, q] += weight * row[p] * row[q]
            reliabilities += reliability
            used += 1
            squares += off * off
        if used < MIN_MATCHED:
            break
        normal = normal + normal.T - np.diag(np.diag(normal))
        # Observations with these equations and, on top of their noise, errors of the variances of the doubt.
        less = np.linalg.inv(np.eye(6) + normal * _doubt(reliabilities / used, sigma, motion))
        normal = less @ normal + np.diag(prior)
        right = less @ right - prior * found
        step = np.linalg.solve(normal, right)
        found += step
        if np.abs(step).max() < 3e-4:
            break
    return (found if used >= MIN_MATCHED else np.zeros(6)), normal, used, squares


@kernel()
def _add(points, place_m, found, cells, keys, known, half):  # type: ignore[no-untyped-def]
    """Add returns to the means of their cells by one half, but not where so many are known by both."""
    for i in range(len(points)):
        x, y, z = _moved(points[i], found)
        column = int(np.floor((x + place_m[0]) / RECENT_CELL_M))
        line = int(np.floor((y + place_m[1]) / RECENT_CELL_M))
        r = line % SIDE_CELLS
        c = column % SIDE_CELLS
        cell = cells[r, c]
        key = keys[r, c]
        z += place_m[2]
        height, count = _height(cell)
        off = z - height
        if key[0] != column or key[1] != line or count < 0.5 or (off < -CLIPPED_M and count <= MIN_IN_CELL):
            # Dust and straw come before the ground below them.
            key[0] = column
            key[1] = line
            cell[:] = 0.0
            cell[2 * half] = z
            cell[2 * half + 1] = 1.0
        elif count > known:
            continue
        elif abs(off) > GATE_M:
            cell[1] *= 0.7  # what stands there has changed, or is above the ground
            cell[3] *= 0.7
        else:
            mean = cell[2 * half] if cell[2 * half + 1] >= 0.5 else height
            cell[2 * half + 1] = min(cell[2 * half + 1] + 1.0, 0.5 * MEMORY)
            cell[2 * half] = mean + min(max(z - mean, -CLIPPED_M), CLIPPED_M) / cell[2 * half + 1]
