"""Returns of a moving scanner as heights of small cells at many times, and how they change with the mounting."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter
from scipy.spatial.transform import Rotation

from furrowmap.core.values.scan import Scan
from furrowmap.core.values.trajectory import Trajectory

FloatArray = NDArray[np.float64]

CELL_M: Final = 0.25
NEAREST_M: Final = 1.0
"""Nearer returns are of the vehicle itself."""
MOST_RETURNS: Final = 1_600_000
LEAST_IN_PLANE: Final = 30
LEAST_IN_GROUP: Final = 3
SMOOTH: Final = 1.4
"""Only cells count whose heights scatter at most this many times as much as those of the smoothest tenth."""
PARAMETERS: Final = 7
"""Three angles about the vehicle's axes, the time offset, and the scanner's place in the vehicle frame."""
LASERS: Final = 16
"""Groups of lasers with a range constant each."""


@dataclass(frozen=True)
class StripReturns:
    """Returns with the poses at their times.

    Attributes:
        t_s: (n,) times, in their order.
        sensor_m: (n, 3) in the frame of the scanner.
        laser: (n,) group of the laser.
        origin_m: (n, 3) of the vehicle frame, against a local origin.
        rotation: (n, 4) quaternions (w, x, y, z), vehicle to map.
        velocity_mps: (n, 3) of the vehicle.
        rate_radps: (n, 3) angular rate in the map's axes.
        local_m: (3,) the local origin, a corner of a cell.
    """

    t_s: FloatArray
    sensor_m: FloatArray
    laser: NDArray[np.int64]
    origin_m: FloatArray
    rotation: FloatArray
    velocity_mps: FloatArray
    rate_radps: FloatArray
    local_m: FloatArray

    def __len__(self) -> int:
        return len(self.t_s)

    def part(self, chosen: NDArray[np.bool_]) -> StripReturns:
        """Some of the returns."""
        arrays = {name: value[chosen] for name, value in vars(self).items() if name != "local_m"}
        return replace(self, **arrays)


def strip_returns(scans: Iterable[Scan], trajectory: Trajectory) -> StripReturns:
    """Returns of all scans, evenly thinned to MOST_RETURNS."""
    begin_s, end_s = trajectory.span_s
    per_second = MOST_RETURNS / max(end_s - begin_s, 1.0)
    times, places, lasers = [np.zeros(0)], [np.zeros((0, 3), np.float32)], [np.zeros(0, np.int64)]
    for scan in scans:
        if len(scan) < 2:
            continue
        wanted = per_second * max(float(scan.t_s[-1] - scan.t_s[0]), 0.01)
        chosen = slice(None, None, max(1, int(len(scan) / wanted)))
        times.append(scan.t_s[chosen])
        places.append(scan.xyz_m[chosen])
        lasers.append(scan.laser[chosen].astype(np.int64))
    t_s, sensor, laser = np.concatenate(times), np.concatenate(places).astype(np.float64), np.concatenate(lasers)
    order = np.flatnonzero(np.linalg.norm(sensor, axis=1) > NEAREST_M)
    order = order[np.argsort(t_s[order], kind="stable")]
    group = laser[order] * LASERS // (int(laser.max(initial=0)) + 1)
    return _with_poses(t_s[order], sensor[order], group, trajectory)


def at_shifted_times(returns: StripReturns, trajectory: Trajectory, offset_s: float) -> StripReturns:
    """The returns with the poses at times later by an offset; those without a pose there are left out.

    Args:
        returns: of the scanner.
        trajectory: of the frame that carries it.
        offset_s: time by which the scanner's clock is behind.
    """
    return _with_poses(returns.t_s + offset_s, returns.sensor_m, returns.laser, trajectory)


def _with_poses(
    t_s: FloatArray, sensor_m: FloatArray, laser: NDArray[np.int64], trajectory: Trajectory
) -> StripReturns:
    """Returns in the order of time with the poses at theirs."""
    knot, _, inside = trajectory.interval(t_s)
    t_s, knot = t_s[inside], knot[inside]
    poses, (used, which) = trajectory.at(t_s), np.unique(knot, return_inverse=True)
    step_s = (trajectory.t_s[used + 1] - trajectory.t_s[used])[:, None]
    velocity = (trajectory.xyz_m[used + 1] - trajectory.xyz_m[used]) / step_s
    rate = trajectory.turn_rad[used] / step_s
    attitude = Rotation.from_quat(trajectory.quaternion[used], scalar_first=True)
    middle = np.median(poses.xyz_m, axis=0) if len(t_s) else np.zeros(3)
    local = np.round(middle / CELL_M) * CELL_M
    return StripReturns(
        t_s,
        sensor_m[inside],
        laser[inside],
        poses.xyz_m - local,
        np.ascontiguousarray(poses.quaternion),
        velocity[which],
        attitude.apply(rate)[which],
        local,
    )


@dataclass(frozen=True)
class CellHeights:
    """Mean heights of groups: the returns of one cell in one window of time.

    Attributes:
        cell: (g,) number of the cell.
        window: (g,) number of the window.
        count: (g,) returns.
        height_m: (g,) mean height above a plane through the cell's surroundings.
        scatter_m2: (g,) mean square of the heights about it.
        design: (g, PARAMETERS + LASERS) mean derivatives by the parameters.
        place: (g, 2) column and row of the cell, from the local origin.
    """

    cell: NDArray[np.int64]
    window: NDArray[np.int64]
    count: NDArray[np.int64]
    height_m: FloatArray
    scatter_m2: FloatArray
    design: FloatArray
    place: NDArray[np.int64]


def cell_heights(
    returns: StripReturns, window: NDArray[np.int64], mounting: FloatArray, lever_m: FloatArray
) -> CellHeights:
    """Place the returns with a mounting and sum them up.

    Args:
        returns: n of them.
        window: (n,) number of each return's window of time, not decreasing.
        mounting: (3, 3) scanner to vehicle.
        lever_m: (3,) scanner in the vehicle frame.
    """
    r = returns
    reach = np.ascontiguousarray(r.sensor_m @ mounting.T)
    arm = _all_turned(r.rotation, reach + lever_m)
    xyz = r.origin_m + arm
    first = np.floor(xyz[:, :2].min(axis=0) / CELL_M)
    index = (np.floor(xyz[:, :2] / CELL_M) - first).astype(np.int64)
    shape = index.max(axis=0) + 1
    cell = index[:, 0] * shape[1] + index[:, 1]
    planes = _planes(_plane_sums(xyz, cell, int(shape.prod())), (int(shape[0]), int(shape[1])))
    velocity = r.velocity_mps + np.cross(r.rate_radps, arm)
    groups, sums = _sums(xyz, reach, velocity, r.rotation, r.laser, cell, window, planes)
    count = groups[:, 2]
    mean = sums / count[:, None]
    scatter = np.maximum(mean[:, 1] - mean[:, 0] ** 2, 0.0)
    place = np.column_stack(np.divmod(groups[:, 0], shape[1])) + first.astype(np.int64)
    return CellHeights(groups[:, 0], groups[:, 1], count, mean[:, 0], scatter, mean[:, 2:], place)


def smooth_groups(heights: CellHeights) -> tuple[FloatArray, NDArray[np.intp]]:
    """Variance of single heights, and the groups of cells that are smooth: plants move and let beams through."""
    known = heights.count >= LEAST_IN_GROUP
    cells = int(heights.cell.max(initial=0)) + 1
    squares = np.bincount(heights.cell[known], (heights.scatter_m2 * heights.count)[known], cells)
    freedom = np.bincount(heights.cell[known], (heights.count - 1)[known], cells)
    variance = np.where(freedom >= 10, squares / np.maximum(freedom, 1), np.inf)
    seen = np.isfinite(variance)
    if not seen.any():
        return np.zeros(0), np.zeros(0, np.intp)
    limit = SMOOTH**2 * float(np.quantile(variance[seen], 0.1))
    chosen = np.flatnonzero(known & (variance[heights.cell] <= limit))
    return variance[heights.cell[chosen]], chosen


def _planes(sums: FloatArray, shape: tuple[int, int]) -> FloatArray:
    """(cells, 5) plane through each cell and its neighbours: middle x, y and slopes by x, y; and whether it is one."""

    def around(values: FloatArray) -> FloatArray:
        out: FloatArray = uniform_filter(values.reshape(shape), 3, mode="constant").ravel() * 9.0
        return out

    n, x, y, z, xx, yy, xy, zx, zy = (around(column) for column in sums.T)
    with np.errstate(invalid="ignore", divide="ignore"):
        x, y, z = x / n, y / n, z / n
        cxx, cyy, cxy, czx, czy = xx / n - x * x, yy / n - y * y, xy / n - x * y, zx / n - z * x, zy / n - z * y
        determinant = cxx * cyy - cxy**2
        slope_x, slope_y = (czx * cyy - czy * cxy) / determinant, (czy * cxx - czx * cxy) / determinant
    good = (n > LEAST_IN_PLANE) & (determinant > (0.4 * CELL_M) ** 4)
    return np.where(good[:, None], np.column_stack([x, y, slope_x, slope_y, good]), 0.0)


@numba.njit(cache=True, nogil=True)
def _turned(q, x, y, z):  # type: ignore[no-untyped-def]
    """A vector rotated by a unit quaternion (w, x, y, z)."""
    tx, ty, tz = 2 * (q[2] * z - q[3] * y), 2 * (q[3] * x - q[1] * z), 2 * (q[1] * y - q[2] * x)
    return (
        x + q[0] * tx + q[2] * tz - q[3] * ty,
        y + q[0] * ty + q[3] * tx - q[1] * tz,
        z + q[0] * tz + q[1] * ty - q[2] * tx,
    )


@numba.njit(cache=True, nogil=True)
def _all_turned(rotation, vectors):  # type: ignore[no-untyped-def]
    """Vectors (n, 3) rotated by unit quaternions (n, 4)."""
    out = np.empty_like(vectors)
    for i in range(len(vectors)):
        out[i, 0], out[i, 1], out[i, 2] = _turned(rotation[i], vectors[i, 0], vectors[i, 1], vectors[i, 2])
    return out


@numba.njit(cache=True, nogil=True)
def _plane_sums(xyz, cell, cells):  # type: ignore[no-untyped-def]
    out = np.zeros((cells, 9))
    for i in range(len(xyz)):
        c = cell[i]
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        out[c, 0] += 1.0
        out[c, 1] += x
        out[c, 2] += y
        out[c, 3] += z
        out[c, 4] += x * x
        out[c, 5] += y * y
        out[c, 6] += x * y
        out[c, 7] += z * x
        out[c, 8] += z * y
    return out


@numba.njit(cache=True, nogil=True)
def _sums(xyz, reach, velocity, rotation, laser, cell, window, planes):  # type: ignore[no-untyped-def]
    """Groups (g, 3) cell, window, count, and sums (g, 2 + PARAMETERS + LASERS) of heights, squares and derivatives."""
    n = len(xyz)
    groups = np.zeros((n, 3), np.int64)
    sums = np.zeros((n, 2 + PARAMETERS + LASERS))
    last_window = np.full(len(planes), -1, np.int64)
    group_of = np.zeros(len(planes), np.int64)
    used = 0
    q = np.empty(4)
    for i in range(n):
        c = cell[i]
        if planes[c, 4] == 0.0:
            continue
        if last_window[c] != window[i]:
            last_window[c], group_of[c] = window[i], used
            groups[used, 0], groups[used, 1] = c, window[i]
            used += 1
        g = group_of[c]
        groups[g, 2] += 1
        sx, sy = planes[c, 2], planes[c, 3]
        height = xyz[i, 2] - sx * (xyz[i, 0] - planes[c, 0]) - sy * (xyz[i, 1] - planes[c, 1])
        sums[g, 0] += height
        sums[g, 1] += height * height
        q[0], q[1], q[2], q[3] = rotation[i, 0], -rotation[i, 1], -rotation[i, 2], -rotation[i, 3]
        nx, ny, nz = _turned(q, -sx, -sy, 1.0)
        ux, uy, uz = reach[i, 0], reach[i, 1], reach[i, 2]
        sums[g, 2] += uy * nz - uz * ny
        sums[g, 3] += uz * nx - ux * nz
        sums[g, 4] += ux * ny - uy * nx
        sums[g, 5] += velocity[i, 2] - sx * velocity[i, 0] - sy * velocity[i, 1]
        sums[g, 6] += nx
        sums[g, 7] += ny
        sums[g, 8] += nz
        sums[g, 9 + laser[i]] += (ux * nx + uy * ny + uz * nz) / np.sqrt(ux * ux + uy * uy + uz * uz)
    return groups[:used].copy(), sums[:used].copy()
