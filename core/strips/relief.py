"""Places of strips against each other by the relief that they see alike: clods, plants, edges of plots, roofs.

Heights of fine cells at several times are compared within blocks of ground. Where the ground slopes, a strip that is
shifted by u in plan has heights that are higher by −g · u, with the gradient g of what all strips see together (Lucas
and Kanade 1981, An iterative image registration technique with an application to stereo vision). A block's mean heights
at each time take no part: they are observations of their own (:mod:`furrowmap.core.strips.strip_adjustment`), and crops
let beams in deeper from above than from the side. Nor do shifts along the beams in proportion to their obliqueness: the
side of a plot that faces the scanner is seen, the other one lies in its shadow. What is left are shifts of the windows
of a block against each other, as a normal matrix into which poses and mounting are put.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.strips.cell_heights import MIN_CELL_PLANE_RETURNS, CellHeights, cell_heights
from furrowmap.core.strips.strips import STRIP_CELL_M, StripReturns
from furrowmap.core.values.rotation import Mounting

RELIEF_BLOCK_M: Final = 1.0
"""Side of a block, over which a window's returns are shifted alike."""
RELIEF_CELL_RETURNS: Final = 3.0
"""Returns that a fine cell has in the mean: of all windows, where it is compared."""
RELIEF_MIN_CELL_M: Final = 0.05
RELIEF_MIN_FREEDOM: Final = 10
"""Heights of a block beyond its unknowns: with fewer there is no relief to compare."""
RELIEF_CELL_SIGMA_M: Final = 0.003
"""Standard deviation of a fine cell's mean beside the noise of its returns."""
RELIEF_USUAL_RETURNS: Final = 4.0
"""The noise of all cells stands beside that of a cell as that of so many returns: few tell little of their own."""
RELIEF_TOGETHER: Final = 4.0
"""Fine cells err together, so that as many count as one: residuals alone show 1.2, but plants bend relief."""
RELIEF_MIN_SHOWN: Final = 0.5
"""Share of the squares of a block's slopes that is no noise."""
RELIEF_SHIFT_CELL_M: Final = STRIP_CELL_M / 2.0
RELIEF_MOVED_STEP: Final = 16
"""One of so many returns tells by how much a mounting moves a strip."""
RELIEF_MAX_OBLIQUE: Final = 1.0
"""Tangent of the angle of incidence up to which clods hide little of the soil behind them."""
RELIEF_MAX_SHIFT_M: Final = 1.0
RELIEF_MIN_DROP_M: Final = 1.0


@dataclass(frozen=True)
class SeenRelief:
    """Shifts in plan of windows of time against each other, in blocks of ground.

    Attributes:
        groups: a group for each row: the returns of a window in a block.
        row: (r,) rows of the blocks' windows, block after block.
        first: (b + 1,) begin of each block among them.
        normal: normal matrices (2 k, 2 k) of the shifts by easting and northing of a block's k windows, one after
            another, of all blocks.
        right: (2 r,) right sides.
    """

    groups: CellHeights
    row: NDArray[np.int64]
    first: NDArray[np.int64]
    normal: FloatArray
    right: FloatArray


def relief_cell_m(heights: CellHeights) -> float:
    """Side of the fine cells by the density of the returns, a whole share of STRIP_CELL_M."""
    area_m2 = max(len(np.unique(heights.cell)), 1) * heights.cell_m**2
    wanted_m = np.sqrt(RELIEF_CELL_RETURNS * area_m2 / max(float(heights.count.sum()), 1e-6))
    return STRIP_CELL_M / max(1, int(STRIP_CELL_M / max(float(wanted_m), RELIEF_MIN_CELL_M)))


def relief(
    returns: StripReturns, window: NDArray[np.int64], mounting: FloatArray, lever_m: FloatArray, cell_m: float
) -> SeenRelief:
    """Compare the relief that windows of time see.

    Args:
        returns: n of them.
        window: (n,) number of each return's window of time, as :func:`cell_heights` has it.
        mounting: (3, 3) scanner to vehicle.
        lever_m: (3,) scanner in the vehicle frame.
        cell_m: side of the fine cells.
    """
    fine = cell_heights(returns, window, mounting, lever_m, cell_m)
    side = round(RELIEF_BLOCK_M / cell_m)
    at = fine.place // side
    low = at.min(axis=0, initial=0)
    span = int(at[:, 1].max(initial=0) - low[1]) + 1
    windows = int(fine.window.max(initial=0)) + 1
    key, row = np.unique(((at[:, 0] - low[0]) * span + at[:, 1] - low[1]) * windows + fine.window, return_inverse=True)
    count = np.bincount(row, fine.count, len(key))
    height_m = np.bincount(row, fine.height_m * fine.count, len(key)) / np.maximum(count, 1.0)
    number = key // windows
    place = np.column_stack([number // span + low[0], number % span + low[1]])
    inside = fine.member >= 0
    member = np.full(len(fine.member), -1, np.int32)
    member[inside] = row[fine.member[inside]]
    flat = np.zeros((len(key), 2))
    none = np.zeros(len(key))
    groups = CellHeights(
        number, key % windows, count.astype(np.int64), height_m, none, place, flat, member, side * cell_m
    )
    beam = np.column_stack([(place + 0.5) * groups.cell_m, height_m])
    for axis in range(3):
        origin = np.bincount(member[inside], returns.origin_m[inside, axis], len(key))
        beam[:, axis] -= origin / np.maximum(count, 1.0)
    oblique = beam[:, :2] / np.maximum(-beam[:, 2:], RELIEF_MIN_DROP_M)
    return _compared(fine, row.astype(np.int64), groups, oblique)


def _compared(fine: CellHeights, row: NDArray[np.int64], groups: CellHeights, oblique: FloatArray) -> SeenRelief:
    """The shifts of the windows of each block, by groups (g,) of fine cells and the rows (g,) that they belong to."""
    squares = np.bincount(fine.cell, fine.scatter_m2 * fine.count)
    freedom = np.bincount(fine.cell, fine.count - 1)
    usual = float(squares.sum()) / max(float(freedom.sum()), 1.0)
    noise = ((squares + RELIEF_USUAL_RETURNS * usual) / (freedom + RELIEF_USUAL_RETURNS))[fine.cell]
    weight = 1.0 / (noise / fine.count + RELIEF_CELL_SIGMA_M**2)
    # Noise of the slopes of planes through nine cells: where it is all that there is, nothing shows a shift.
    nine = np.maximum(9.0 * np.bincount(fine.cell, fine.count)[fine.cell], MIN_CELL_PLANE_RETURNS)
    unsure = noise / (nine * 0.75 * fine.cell_m**2)
    # Rows are in the order of their blocks.
    begins = np.flatnonzero(np.diff(groups.cell, prepend=-1))
    first = np.append(begins, len(groups.cell)).astype(np.int64)
    block = np.repeat(np.arange(len(begins)), np.diff(first))[row]
    order = np.lexsort((fine.cell, block))
    order = order[(np.einsum("ij,ij->i", oblique, oblique) < RELIEF_MAX_OBLIQUE**2)[row[order]]]
    ends = np.searchsorted(block[order], np.arange(len(begins) + 1)).astype(np.int64)
    normal, right = _shifts(
        ends,
        first,
        fine.cell[order],
        row[order],
        weight[order],
        fine.height_m[order],
        np.ascontiguousarray(fine.slope[order]),
        unsure[order],
        oblique,
    )
    return SeenRelief(groups, np.arange(len(groups.cell)), first, normal, right)


@kernel()
def _shifts(ends, first, cell, row, weight, height, slope, unsure, oblique):  # type: ignore[no-untyped-def]
    """Normal matrices and right sides of :class:`SeenRelief`, by [easting, northing, level] · k of each block."""
    blocks = len(first) - 1
    total_size = 0
    for b in range(blocks):
        total_size += (2 * (first[b + 1] - first[b])) ** 2
    normal = np.zeros(total_size)
    right = np.zeros(2 * first[blocks])
    at = 0
    g = np.ones(3)
    for b in range(blocks):
        k = first[b + 1] - first[b]
        if k > 1:
            whole = np.zeros((3 * k, 3 * k))
            wanted = np.zeros(3 * k)
            cells = 0
            steep = 0.0
            noise = 0.0
            squares = 0.0
            i = ends[b]
            while i < ends[b + 1]:
                j = i
                total = 0.0
                mean = 0.0
                while j < ends[b + 1] and cell[j] == cell[i]:
                    total += weight[j]
                    mean += weight[j] * height[j]
                    j += 1
                mean /= total
                cells += 1
                steep += slope[i, 0] ** 2 + slope[i, 1] ** 2
                noise += 2.0 * unsure[i]
                g[:2] = -slope[i]
                for p in range(i, j):
                    u = row[p] - first[b]
                    off = weight[p] * (height[p] - mean)
                    squares += off * (height[p] - mean)
                    for a in range(3):
                        wanted[a * k + u] += g[a] * off
                    for q in range(i, j):
                        v = row[q] - first[b]
                        share = -weight[p] * weight[q] / total
                        if p == q:
                            share += weight[p]
                        for a in range(3):
                            for d in range(3):
                                whole[a * k + u, d * k + v] += g[a] * g[d] * share
                i = j
            freedom = ends[b + 1] - ends[b] - cells - k
            # Slopes with errors show too little of a shift (errors in variables), by this share of it.
            shown = 1.0 - noise / steep if steep > 0.0 else 0.0
            if freedom >= RELIEF_MIN_FREEDOM and shown >= RELIEF_MIN_SHOWN:
                squares -= _eliminate(whole, wanted, k)
                spread = RELIEF_TOGETHER * max(1.0, squares / freedom)
                _without_course(whole, wanted, oblique, first[b], k)
                for u in range(k):
                    for a in range(2):
                        right[2 * (first[b] + u) + a] = shown * wanted[a * k + u] / spread
                        for v in range(k):
                            for d in range(2):
                                share = shown**2 * whole[a * k + u, d * k + v] / spread
                                normal[at + (2 * u + a) * 2 * k + 2 * v + d] = share
        at += (2 * k) ** 2
    return normal, right


@kernel()
def _eliminate(whole, wanted, k):  # type: ignore[no-untyped-def]
    """Eliminate the levels, which are known against each other alone; the squares that they explain."""
    trace = 0.0
    for i in range(2 * k, 3 * k):
        trace += whole[i, i]
    for i in range(2 * k, 3 * k):
        whole[i, i] += 1e-9 * trace + 1e-12
    explained = 0.0
    # Gauss: each level in turn takes itself out of all other equations.
    for c in range(2 * k, 3 * k):
        pivot = whole[c, c]
        explained += wanted[c] ** 2 / pivot
        for i in range(3 * k):
            if i == c or whole[i, c] == 0.0:
                continue
            factor = whole[i, c] / pivot
            wanted[i] -= factor * wanted[c]
            for j in range(3 * k):
                whole[i, j] -= factor * whole[c, j]
    return explained


@kernel()
def _without_course(whole, wanted, oblique, first, k):  # type: ignore[no-untyped-def]
    """Eliminate shifts in proportion to the obliqueness of the beams."""
    by = np.zeros(2 * k)
    known = 0.0
    asked = 0.0
    trace = 0.0
    for i in range(2 * k):
        trace += whole[i, i]
        for v in range(k):
            by[i] += whole[i, v] * oblique[first + v, 0] + whole[i, k + v] * oblique[first + v, 1]
    for v in range(k):
        for a in range(2):
            known += by[a * k + v] * oblique[first + v, a]
            asked += wanted[a * k + v] * oblique[first + v, a]
    if known <= 1e-9 * trace:
        return
    for i in range(2 * k):
        wanted[i] -= by[i] * asked / known
        for j in range(2 * k):
            whole[i, j] -= by[i] * by[j] / known


@dataclass(frozen=True)
class PlanShifts:
    """Shifts in plan of s strips against their mean; zero where nothing shows them.

    Attributes:
        strip: (s,) number of each strip.
        before_m: (s, 2) easting and northing with the mounting as stated.
        after_m: (s, 2) with the mounting that was used.
        sigma_m: (s, 2) standard deviations of `after_m`.
    """

    strip: NDArray[np.int64]
    before_m: FloatArray
    after_m: FloatArray
    sigma_m: FloatArray

    @property
    def rms_m(self) -> tuple[float, float]:
        """Root mean square of a shift before and after."""
        before, after = (float(np.sqrt(np.mean(np.sum(one**2, axis=1)))) for one in (self.before_m, self.after_m))
        return before, after

    def plain(self) -> dict[str, Any]:
        """For `report.json`."""
        before_m, after_m = self.rms_m
        axes = (("before", self.before_m), ("after", self.after_m), ("sigma", self.sigma_m))
        return {
            "before_rms_m": round(before_m, 4),
            "after_rms_m": round(after_m, 4),
            "strips": [
                {"strip": number, **{f"{name}_m": np.round(values[k], 4).tolist() for name, values in axes}}
                for k, number in enumerate(self.strip.tolist())
            ],
        }


def plan_shifts(
    returns: StripReturns, number: NDArray[np.int64], stated: Mounting, used: Mounting
) -> PlanShifts | None:
    """Shifts of strips in plan: by relief with the mounting in use, and those to which the stated one adds.

    Args:
        number: (n,) number of each return's strip, counted from 1; negative in none.

    Returns:
        None where no two strips see the same relief.
    """
    window = np.where(number > 0, number - 1, -1)
    strips = int(window.max(initial=-1)) + 1
    seen = relief(returns, window, used.rotation, np.asarray(used.xyz_m), RELIEF_SHIFT_CELL_M)
    if not seen.normal.any():
        return None
    rows = np.broadcast_to(np.eye(2), (len(seen.row), 2, 2)).copy()
    normal, right = _put(seen.first, seen.normal, seen.right, rows, 2 * seen.groups.window, 0, 2 * strips)
    # Only differences are known: the mean is taken off.
    apart = np.kron(np.eye(strips) - 1.0 / strips, np.eye(2))
    covariance = apart @ np.linalg.inv(normal + np.eye(2 * strips) / RELIEF_MAX_SHIFT_M**2) @ apart
    after_m = (covariance @ right).reshape(-1, 2)
    part = np.flatnonzero(window >= 0)[::RELIEF_MOVED_STEP]
    turned = stated.rotation - used.rotation
    lever_m = np.asarray(stated.xyz_m) - np.asarray(used.xyz_m)
    attitude = Rotation.from_quat(returns.rotation[part].astype(np.float64), scalar_first=True)
    moved_m = attitude.apply(returns.sensor_m[part] @ turned.T + lever_m)[:, :2]
    count = np.maximum(np.bincount(window[part], minlength=strips), 1)
    added_m = np.column_stack([np.bincount(window[part], axis, strips) / count for axis in moved_m.T])
    sigma_m = np.sqrt(np.maximum(np.diag(covariance), 0.0)).reshape(-1, 2)
    return PlanShifts(np.arange(strips) + 1, after_m + added_m - added_m.mean(axis=0), after_m, sigma_m)


def relief_equations(
    of: SeenRelief, design: Callable[[CellHeights], FloatArray], begin: NDArray[np.int64], fixed: int, unknowns: int
) -> tuple[FloatArray, FloatArray]:
    """Normal matrix (u, u) and right side (u,) of unknowns that shift the windows.

    Args:
        of: the compared relief.
        design: derivatives (rows, fixed + p) of the heights of groups, by their slopes.
        begin: (rows,) first of the p neighbouring unknowns of each row.
        fixed: number of unknowns that all share, which come first.
        unknowns: u, the number of all.
    """
    level = design(of.groups)
    by = np.empty((len(level), 2, level.shape[1]))
    for axis, along in enumerate(np.eye(2)):
        by[:, axis] = design(replace(of.groups, slope=np.tile(-along, (len(level), 1)))) - level
    out: tuple[FloatArray, FloatArray] = _put(of.first, of.normal, of.right, by, begin, fixed, unknowns)
    return out


@kernel()
def _put(first, normal, right, by, begin, fixed, unknowns):  # type: ignore[no-untyped-def]
    """Normal matrix and right side of :func:`relief_equations`, by derivatives (rows, 2, fixed + p) of the shifts."""
    out = np.zeros((unknowns, unknowns))
    wanted = np.zeros(unknowns)
    width = by.shape[2]
    place = np.full(unknowns, -1, np.int64)
    used = np.empty(unknowns, np.int64)
    at = 0
    for b in range(len(first) - 1):
        k = first[b + 1] - first[b]
        count = 0
        for r in range(first[b], first[b + 1]):
            for c in range(width):
                u = c if c < fixed else begin[r] + c - fixed
                if place[u] < 0:
                    place[u] = count
                    used[count] = u
                    count += 1
        moved = np.zeros((2 * k, count))
        for i in range(2 * k):
            for j in range(2 * k):
                share = normal[at + i * 2 * k + j]
                if share != 0.0:
                    r = first[b] + j // 2
                    for c in range(width):
                        u = c if c < fixed else begin[r] + c - fixed
                        moved[i, place[u]] += share * by[r, j % 2, c]
        for i in range(2 * k):
            r = first[b] + i // 2
            for c in range(width):
                u = c if c < fixed else begin[r] + c - fixed
                derivative = by[r, i % 2, c]
                wanted[u] += derivative * right[2 * first[b] + i]
                for m in range(count):
                    out[u, used[m]] += derivative * moved[i, m]
        for m in range(count):
            place[used[m]] = -1
        at += (2 * k) ** 2
    return out, wanted
