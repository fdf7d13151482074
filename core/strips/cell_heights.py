"""Heights of small cells at many times by the returns of a moving scanner, and how they change with the mounting.

Their least squares, in which the height of each cell itself is eliminated, are in :func:`adjust_cells`.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.adjustment.banded import huber_weight
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.strips.strips import LASER_GROUPS, STRIP_CELL_M, StripReturns

MIN_CELL_PLANE_RETURNS: Final = 30
MIN_GROUP_RETURNS: Final = 3
MAX_ROUGHNESS_RATIO: Final = 1.4
"""Only cells count whose heights scatter at most this many times as much as those of the smoothest tenth."""
PARAMETERS: Final = 7
"""Three angles about the vehicle's axes, the time offset, and the scanner's place in the vehicle frame."""
ROBUST_ROUNDS: Final = 3


@dataclass(frozen=True)
class CellHeights:
    """Mean heights of groups: the returns of one cell in one window of time.

    Attributes:
        cell: (g,) number of the cell.
        window: (g,) number of the window.
        count: (g,) returns.
        height_m: (g,) mean height above a plane through the cell's surroundings.
        scatter_m2: (g,) mean square of the heights about it.
        place: (g, 2) column and row of the cell, from the local origin.
        slope: (g, 2) of the plane, by easting and northing.
        member: (n,) the group of each return, −1 for those in none.
        cell_m: side of a cell.
    """

    cell: NDArray[np.int64]
    window: NDArray[np.int64]
    count: NDArray[np.int64]
    height_m: FloatArray
    scatter_m2: FloatArray
    place: NDArray[np.int64]
    slope: FloatArray
    member: NDArray[np.int32]
    cell_m: float = STRIP_CELL_M


def cell_heights(
    returns: StripReturns,
    window: NDArray[np.int64],
    mounting: FloatArray,
    lever_m: FloatArray,
    cell_m: float = STRIP_CELL_M,
) -> CellHeights:
    """Place the returns with a mounting and sum them up.

    Args:
        returns: n of them.
        window: (n,) number of each return's window of time, not decreasing where not negative; returns with a
            negative one do not take part.
        mounting: (3, 3) scanner to vehicle.
        lever_m: (3,) scanner in the vehicle frame.
        cell_m: side of a cell.
    """
    r = returns
    xyz, low, high = _placed(r.sensor_m, r.origin_m, r.rotation, window, np.ascontiguousarray(mounting), lever_m)
    first = np.floor(low / cell_m)
    shape = (np.floor(high / cell_m) - first).astype(np.int64) + 1
    cell, sums = _plane_sums(xyz, window, first, int(shape[0]), int(shape[1]), cell_m)
    planes = _planes(sums, int(shape[0]), int(shape[1]), cell_m)
    groups, heights, member = _sums(xyz, cell, window, planes)
    count = groups[:, 2]
    mean = heights / count[:, None]
    scatter = np.maximum(mean[:, 1] - mean[:, 0] ** 2, 0.0)
    place = np.column_stack(np.divmod(groups[:, 0], shape[1])) + first.astype(np.int64)
    slope = planes[groups[:, 0], 2:4]
    return CellHeights(groups[:, 0], groups[:, 1], count, mean[:, 0], scatter, place, slope, member, cell_m)


def smooth_groups(heights: CellHeights) -> tuple[FloatArray, NDArray[np.intp]]:
    """Variance of single heights, and the groups of cells that are smooth: plants move and let beams through."""
    known = heights.count >= MIN_GROUP_RETURNS
    cells = int(heights.cell.max(initial=0)) + 1
    squares = np.bincount(heights.cell[known], (heights.scatter_m2 * heights.count)[known], cells)
    freedom = np.bincount(heights.cell[known], (heights.count - 1)[known], cells)
    variance = np.where(freedom >= 10, squares / np.maximum(freedom, 1), np.inf)
    seen = np.isfinite(variance)
    if not seen.any():
        return np.zeros(0), np.zeros(0, np.intp)
    limit = MAX_ROUGHNESS_RATIO**2 * float(np.quantile(variance[seen], 0.1))
    chosen = np.flatnonzero(known & (variance[heights.cell] <= limit))
    return variance[heights.cell[chosen]], chosen


def same_cell_pairs(cell: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices of all pairs of groups in one cell, the earlier group first."""
    order = np.argsort(cell, kind="stable")
    ordered = cell[order]
    firsts = [np.zeros(0, np.intp)]
    seconds = [np.zeros(0, np.intp)]
    for apart in range(1, int(np.bincount(np.unique(cell, return_inverse=True)[1]).max(initial=1))):
        same = np.flatnonzero(ordered[apart:] == ordered[:-apart])
        firsts.append(order[same])
        seconds.append(order[same + apart])
    return np.concatenate(firsts), np.concatenate(seconds)


def derivatives(
    returns: StripReturns, heights: CellHeights, chosen: NDArray[np.intp], mounting: FloatArray, lever_m: FloatArray
) -> FloatArray:
    """Mean derivatives (c, PARAMETERS + LASERS) of the heights of some groups by the parameters.

    Args:
        returns: that `heights` were made of.
        heights: with the same mounting and lever.
        chosen: (c,) the groups.
        mounting: (3, 3) scanner to vehicle.
        lever_m: (3,) scanner in the vehicle frame.
    """
    row = np.full(len(heights.cell), -1, np.int32)
    row[chosen] = np.arange(len(chosen))
    r = returns
    sums = _derivative_sums(
        heights.member, row, heights.slope, r.sensor_m, r.laser, r.rotation, r.velocity_mps, r.rate_radps,
        np.ascontiguousarray(mounting), lever_m, len(chosen),
    )  # fmt: skip
    out: FloatArray = sums / heights.count[chosen][:, None]
    return out


@kernel()
def _turned(w, i, j, k, x, y, z):  # type: ignore[no-untyped-def]
    """A vector rotated by a unit quaternion (w, i, j, k)."""
    tx = 2 * (j * z - k * y)
    ty = 2 * (k * x - i * z)
    tz = 2 * (i * y - j * x)
    return x + w * tx + j * tz - k * ty, y + w * ty + k * tx - i * tz, z + w * tz + i * ty - j * tx


@kernel()
def _reach(m, x, y, z):  # type: ignore[no-untyped-def]
    """A vector rotated by a matrix."""
    return (
        m[0, 0] * x + m[0, 1] * y + m[0, 2] * z,
        m[1, 0] * x + m[1, 1] * y + m[1, 2] * z,
        m[2, 0] * x + m[2, 1] * y + m[2, 2] * z,
    )


@kernel()
def _placed(sensor, origin, rotation, window, mounting, lever):  # type: ignore[no-untyped-def]
    """Returns in the map (n, 3) float32, and their least and greatest easting and northing."""
    n = len(sensor)
    out = np.empty((n, 3), np.float32)
    low = np.full(2, np.inf)
    high = np.full(2, -np.inf)
    for i in range(n):
        if window[i] < 0:
            continue
        ux, uy, uz = _reach(mounting, sensor[i, 0], sensor[i, 1], sensor[i, 2])
        ax, ay, az = _turned(
            rotation[i, 0], rotation[i, 1], rotation[i, 2], rotation[i, 3], ux + lever[0], uy + lever[1], uz + lever[2]
        )
        out[i, 0] = origin[i, 0] + ax
        out[i, 1] = origin[i, 1] + ay
        out[i, 2] = origin[i, 2] + az
        x = float(out[i, 0])
        y = float(out[i, 1])
        low[0], low[1] = min(low[0], x), min(low[1], y)
        high[0], high[1] = max(high[0], x), max(high[1], y)
    return out, low, high


@kernel()
def _plane_sums(xyz, window, first, columns, rows, side):  # type: ignore[no-untyped-def]
    """Cell (n,) of each return, and sums (cells, 9): number, x, y, z, x², y², xy, zx, zy."""
    cell = np.zeros(len(xyz), np.int64)
    out = np.zeros((columns * rows, 9))
    for i in range(len(xyz)):
        if window[i] < 0:
            continue
        x = float(xyz[i, 0])
        y = float(xyz[i, 1])
        z = float(xyz[i, 2])
        c = int(np.floor(x / side) - first[0]) * rows + int(np.floor(y / side) - first[1])
        cell[i] = c
        out[c, 0] += 1.0
        out[c, 1] += x
        out[c, 2] += y
        out[c, 3] += z
        out[c, 4] += x * x
        out[c, 5] += y * y
        out[c, 6] += x * y
        out[c, 7] += z * x
        out[c, 8] += z * y
    return cell, out


@kernel()
def _planes(sums, columns, rows, side):  # type: ignore[no-untyped-def]
    """(cells, 5) plane through each cell and its neighbours: middle x, y and slopes by x, y; and whether it is one."""
    out = np.zeros((columns * rows, 5))
    s = np.empty(9)
    for a in range(columns):
        for b in range(rows):
            c = a * rows + b
            if sums[c, 0] == 0.0:
                continue
            s[:] = 0.0
            for p in range(max(a - 1, 0), min(a + 2, columns)):
                for q in range(max(b - 1, 0), min(b + 2, rows)):
                    for j in range(9):
                        s[j] += sums[p * rows + q, j]
            n = s[0]
            if n <= MIN_CELL_PLANE_RETURNS:
                continue
            x = s[1] / n
            y = s[2] / n
            z = s[3] / n
            cxx = s[4] / n - x * x
            cyy = s[5] / n - y * y
            cxy = s[6] / n - x * y
            czx = s[7] / n - z * x
            czy = s[8] / n - z * y
            determinant = cxx * cyy - cxy**2
            if determinant > (0.4 * side) ** 4:
                out[c, 0] = x
                out[c, 1] = y
                out[c, 2] = (czx * cyy - czy * cxy) / determinant
                out[c, 3] = (czy * cxx - czx * cxy) / determinant
                out[c, 4] = 1.0
    return out


@kernel()
def _sums(xyz, cell, window, planes):  # type: ignore[no-untyped-def]
    """Groups (g, 3) cell, window, count; sums (g, 2) of heights and squares; the group (n,) of each return, or −1."""
    n = len(xyz)
    member = np.full(n, -1, np.int32)
    last_window = np.full(len(planes), -1, np.int64)
    group_of = np.zeros(len(planes), np.int32)
    used = 0
    for i in range(n):
        c = cell[i]
        if window[i] < 0 or planes[c, 4] == 0.0:
            continue
        if last_window[c] != window[i]:
            last_window[c] = window[i]
            group_of[c] = used
            used += 1
        member[i] = group_of[c]
    groups = np.zeros((used, 3), np.int64)
    sums = np.zeros((used, 2))
    for i in range(n):
        g = member[i]
        if g < 0:
            continue
        c = cell[i]
        groups[g, 0] = c
        groups[g, 1] = window[i]
        groups[g, 2] += 1
        height = xyz[i, 2] - planes[c, 2] * (xyz[i, 0] - planes[c, 0]) - planes[c, 3] * (xyz[i, 1] - planes[c, 1])
        sums[g, 0] += height
        sums[g, 1] += height * height
    return groups, sums, member


@kernel()
def _derivative_sums(  # type: ignore[no-untyped-def]
    member, row, slope, sensor, laser, rotation, velocity, rate, mounting, lever, rows
):
    """Sums (rows, PARAMETERS + LASERS) of the derivatives of the returns' heights by the parameters."""
    out = np.zeros((rows, PARAMETERS + LASER_GROUPS))
    for i in range(len(member)):
        g = member[i]
        if g < 0 or row[g] < 0:
            continue
        r = row[g]
        sx = slope[g, 0]
        sy = slope[g, 1]
        w = rotation[i, 0]
        a = rotation[i, 1]
        b = rotation[i, 2]
        c = rotation[i, 3]
        ux, uy, uz = _reach(mounting, sensor[i, 0], sensor[i, 1], sensor[i, 2])
        ax, ay, az = _turned(w, a, b, c, ux + lever[0], uy + lever[1], uz + lever[2])
        nx, ny, nz = _turned(w, -a, -b, -c, -sx, -sy, 1.0)
        vx = velocity[i, 0] + rate[i, 1] * az - rate[i, 2] * ay
        vy = velocity[i, 1] + rate[i, 2] * ax - rate[i, 0] * az
        vz = velocity[i, 2] + rate[i, 0] * ay - rate[i, 1] * ax
        out[r, 0] += uy * nz - uz * ny
        out[r, 1] += uz * nx - ux * nz
        out[r, 2] += ux * ny - uy * nx
        out[r, 3] += vz - sx * vx - sy * vy
        out[r, 4] += nx
        out[r, 5] += ny
        out[r, 6] += nz
        out[r, 7 + laser[i]] += (ux * nx + uy * ny + uz * nz) / np.sqrt(ux * ux + uy * uy + uz * uz)
    return out


@dataclass(frozen=True)
class GroupHeights:
    """Heights of g groups: the returns of one cell in one window of time.

    Attributes:
        cell: (g,) number of the cell, 0 to c − 1, each with a group.
        window: (g,) number of the window; no two groups of a cell share one.
        height_m: (g,) mean height.
        weight: (g,) its inverse variance.
        design: (g, p) derivatives by the parameters.
    """

    cell: NDArray[np.int64]
    window: NDArray[np.int64]
    height_m: FloatArray
    weight: FloatArray
    design: FloatArray


def adjust_cells(groups: GroupHeights, spread: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Parameters and heights of windows that bring the groups of each cell to one height.

    Args:
        spread: (p + w,) standard deviations of the p parameters and of the w windows' heights before.

    Returns:
        What parameters and windows put into the heights (p + w,), its covariance, and the mean heights of the cells
        as measured (c,).
    """
    g = groups
    parameters = g.design.shape[1]
    order = np.argsort(g.cell, kind="stable")
    begin = np.concatenate([[0], np.cumsum(np.bincount(g.cell))])
    cell = g.cell[order]
    window = g.window[order]
    height = g.height_m[order]
    independent = g.weight[order]
    design = np.ascontiguousarray(g.design[order])
    robust = np.ones(len(order))
    for _ in range(ROBUST_ROUNDS):
        weight = independent * robust
        normal, right, middle, means = _normal_equations(begin, window, height, design, weight, len(spread))
        normal[parameters:, :parameters] = normal[:parameters, parameters:].T
        normal[np.diag_indices_from(normal)] += 1.0 / spread**2
        off = np.linalg.solve(normal, right)
        shift = off[parameters:][window]
        windows = np.bincount(cell, weight * shift) / np.bincount(cell, weight)
        residual = height - design @ off[:parameters] - shift - (middle - means @ off[:parameters] - windows)[cell]
        robust = huber_weight(np.abs(residual) * np.sqrt(independent))
    return off, np.asarray(np.linalg.inv(normal), np.float64), middle


@kernel()
def _normal_equations(begin, window, height, design, weight, unknowns):  # type: ignore[no-untyped-def]
    """Normal matrix without its lower left, right side, mean heights of the cells, mean derivatives (c, p)."""
    p = design.shape[1]
    cells = len(begin) - 1
    normal = np.zeros((unknowns, unknowns))
    right = np.zeros(unknowns)
    middle = np.zeros(cells)
    means = np.zeros((cells, p))
    for c in range(cells):
        total = 0.0
        mean = means[c]
        for g in range(begin[c], begin[c + 1]):
            total += weight[g]
            middle[c] += weight[g] * height[g]
            for j in range(p):
                mean[j] += weight[g] * design[g, j]
        middle[c] /= total
        for j in range(p):
            mean[j] /= total
        for g in range(begin[c], begin[c + 1]):
            w = weight[g]
            u = p + window[g]
            off = w * (height[g] - middle[c])
            right[u] += off
            normal[u, u] += w
            for h in range(begin[c], begin[c + 1]):
                normal[u, p + window[h]] -= w * weight[h] / total
            for j in range(p):
                apart = design[g, j] - mean[j]
                right[j] += off * design[g, j]
                normal[j, u] += w * apart
                for k in range(j + 1):
                    normal[j, k] += w * apart * (design[g, k] - mean[k])
    for j in range(p):
        for k in range(j):
            normal[k, j] = normal[j, k]
    return normal, right, middle, means
