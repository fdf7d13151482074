"""The ground of the last metres round the vehicle, and how far each scan turned and moved on it."""

from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

import numpy as np

from furrowmap.core.matching.returns import SELF_RANGE_M
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.values.scan import Scan

RECENT_CELL_M: Final = 0.1
SIDE_CELLS: Final = 512
"""Cells lie in a torus: new ground overwrites that of half a side away."""
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


class RecentGround:
    """Mean heights in cells around the vehicle, in a frame of their own."""

    def __init__(self, rotation: FloatArray, sensor_m: FloatArray) -> None:
        self._rotation = rotation
        self._sensor_m = sensor_m
        self._cells = np.zeros((SIDE_CELLS, SIDE_CELLS, 2))
        self._last_s = -np.inf
        self._keys = np.full((SIDE_CELLS, SIDE_CELLS, 2), np.iinfo(np.int32).min, np.int32)

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
        points = _around(
            np.ascontiguousarray(scan.xyz_m, np.float32),
            scan.t_s - middle_s,
            self._rotation,
            self._sensor_m,
            rotation,
            velocity,
            middle_s - self._last_s,
            max(1, len(scan) // SCAN_RETURNS),
        )
        self._last_s = middle_s
        found, normal, used, squares = _matched(points, place_m, self._cells, self._keys, 1.0 / sigma**2)
        shift = found * ADD_SHIFT if added == "expected" else found
        _add(points, place_m, shift, self._cells, self._keys, KNOWN if added == "found-new" else np.inf)
        if used < MIN_MATCHED:
            return None
        covariance = np.linalg.inv(normal)
        sigma_rad = float(np.sqrt(covariance[5, 5]))
        return ScanTurn(found[:3], found[3:], sigma_rad, covariance[:2, :2], float(np.sqrt(squares / used)))


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


@kernel()
def _moved(point, found):  # type: ignore[no-untyped-def]
    """A return with the turns and shifts that were found."""
    c = np.cos(point[3] * found[5])
    s = np.sin(point[3] * found[5])
    x = c * point[0] - s * point[1] + found[0]
    y = s * point[0] + c * point[1] + found[1]
    return x, y, point[2] + point[3] * (found[2] + found[3] * y - found[4] * x)


@kernel()
def _off(x, y, z, cells, keys):  # type: ignore[no-untyped-def]
    """Height of the known ground above a point, and its slopes; nan where it is not known."""
    u = x / RECENT_CELL_M - 0.5
    v = y / RECENT_CELL_M - 0.5
    column = int(np.floor(u))
    line = int(np.floor(v))
    for k in range(4):
        c = column + (k & 1)
        r = line + (k >> 1)
        key = keys[r % SIDE_CELLS, c % SIDE_CELLS]
        if key[0] != c or key[1] != r or cells[r % SIDE_CELLS, c % SIDE_CELLS, 1] < MIN_IN_CELL:
            return np.nan, 0.0, 0.0
    a = column % SIDE_CELLS
    b = line % SIDE_CELLS
    u = u - column
    v = v - line
    a1 = (column + 1) % SIDE_CELLS
    b1 = (line + 1) % SIDE_CELLS
    h00 = cells[b, a, 0]
    h01 = cells[b, a1, 0]
    h10 = cells[b1, a, 0]
    h11 = cells[b1, a1, 0]
    off = (h00 * (1 - u) + h01 * u) * (1 - v) + (h10 * (1 - u) + h11 * u) * v - z
    return (
        off,
        ((h01 - h00) * (1 - v) + (h11 - h10) * v) / RECENT_CELL_M,
        ((h10 - h00) * (1 - u) + (h11 - h01) * u) / RECENT_CELL_M,
    )


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
            off, _, _ = _off(x + place_m[0], y + place_m[1], z + place_m[2], cells, keys)
            if np.isfinite(off):
                squares += min(off * off, CLIPPED_M**2)
                used += 1
        if used >= MIN_MATCHED and squares / used < best:
            best = squares / used
            turn = found[5]
    return turn


@kernel()
def _matched(points, place_m, cells, keys, prior):  # type: ignore[no-untyped-def]
    """What `_matched_from` finds from the expected turn, or from the likely one if heights then fit better.

    Neither alone is right: heights before the matching tell little while the vehicle rocks, and from an expected turn
    that is 2.4° off the matching may end 15 % worse than from the likely one, and lose the way.
    """
    best = _matched_from(0.0, points, place_m, cells, keys, prior)
    turn = _likely_turn(points, place_m, cells, keys)
    if turn == 0.0:
        return best
    other = _matched_from(turn, points, place_m, cells, keys, prior)
    return other if other[3] * best[2] < best[3] * other[2] else best


@kernel()
def _matched_from(turn, points, place_m, cells, keys, prior):  # type: ignore[no-untyped-def]
    """Shifts and turns (6,) by Gauss and Newton, their normal equations, and how many returns lie on known ground."""
    found = np.zeros(6)
    row = np.zeros(6)
    normal = np.diag(prior)
    used = 0
    squares = 0.0
    found[5] = turn
    for _ in range(TURN_ROUNDS):
        normal = np.diag(prior)
        right = -prior * found
        used = 0
        squares = 0.0
        for i in range(len(points)):
            x, y, z = _moved(points[i], found)
            off, slope_x, slope_y = _off(x + place_m[0], y + place_m[1], z + place_m[2], cells, keys)
            if not abs(off) <= GATE_M:
                continue
            weight = 1.0 / (SHARED * NOISE_M**2 * max(1.0, abs(off) / (2.0 * NOISE_M)))
            weight /= max(1.0, (slope_x * slope_x + slope_y * slope_y) / STEEPEST**2)
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
            used += 1
            squares += off * off
        if used < MIN_MATCHED:
            break
        normal = normal + normal.T - np.diag(np.diag(normal))
        step = np.linalg.solve(normal, right)
        found += step
        if np.abs(step).max() < 3e-4:
            break
    return (found if used >= MIN_MATCHED else np.zeros(6)), normal, used, squares


@kernel()
def _add(points, place_m, found, cells, keys, known):  # type: ignore[no-untyped-def]
    """Add returns to the means of their cells, but not of those of which so many are known."""
    for i in range(len(points)):
        x, y, z = _moved(points[i], found)
        column = int(np.floor((x + place_m[0]) / RECENT_CELL_M))
        line = int(np.floor((y + place_m[1]) / RECENT_CELL_M))
        r = line % SIDE_CELLS
        c = column % SIDE_CELLS
        cell = cells[r, c]
        key = keys[r, c]
        z += place_m[2]
        off = z - cell[0]
        if key[0] != column or key[1] != line or cell[1] < 0.5 or (off < -CLIPPED_M and cell[1] <= MIN_IN_CELL):
            # Dust and straw come before the ground below them.
            key[0] = column
            key[1] = line
            cell[0] = z
            cell[1] = 1.0
        elif cell[1] > known:
            continue
        elif abs(off) > GATE_M:
            cell[1] *= 0.7  # what stands there has changed, or is above the ground
        else:
            cell[1] = min(cell[1] + 1.0, MEMORY)
            cell[0] += min(max(off, -CLIPPED_M), CLIPPED_M) / cell[1]
