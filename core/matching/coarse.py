"""The slow part of the solution: poses and ground moved together.

With the surface held fast, poses can follow it but never leave it: whatever tilt or heading the surface was built
with stays. Here the ground moves as well. Corrections of the poses are twists (translation and rotation) at coarse
knots in time, straight in between; the ground is cut into patches, each of which may move by a twist of its own. A
patch's twist is eliminated (Schur complement), which leaves equations between the coarse knots that saw the patch: the
bundle adjustment of Triggs et al. 2000 (Bundle Adjustment, a Modern Synthesis, section 6) with patches of ground for
points. A twist of everything together costs nothing in them, so that GNSS alone decides it.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.knots import STEP_S, Chain, Knots, State
from furrowmap.core.matching.agreement import CoarseGrid, Patches

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SIZE: Final = 9
"""Unknowns of a knot: position, rotation vector, drift of the GNSS positions."""
THREADED: Final = 5_000
"""Fewer patches are done sooner than two threads have begun."""
RIDGE: Final = 1e-8
"""Holds what a patch's returns do not: place and yaw of smooth ground, the tilt of a single line of returns. A share of
what holds its height."""


@dataclass(frozen=True)
class CoarseKnots:
    """The coarse knots of all chains.

    Attributes:
        grids: one for each chain.
        count: of all coarse knots.
        before: (n,) coarse knot before each knot.
        share: (n,) of the way to the next one.
    """

    grids: tuple[CoarseGrid, ...]
    count: int
    before: IntArray
    share: FloatArray

    @classmethod
    def over(cls, knots: Knots, every: int, patch_m: float) -> CoarseKnots:
        """A coarse knot at every so many knots of each chain."""
        grids, before, share, first = [], [], [], 0
        for chain in knots.chains:
            local = np.arange(chain.count)
            # The last knot never opens an interval: the coarse knot at its far end would hang in the air.
            interval = np.minimum(local // every, _intervals(chain, every) - 1)
            grids.append(CoarseGrid(first, every, patch_m))
            before.append(first + interval)
            share.append(local / every - interval)
            first += _intervals(chain, every) + 1
        return cls(tuple(grids), first, np.concatenate(before), np.concatenate(share))

    def touched(self, chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(count,) the coarse knots before and after one of the knots chosen (n,)."""
        out = np.zeros(self.count, np.bool_)
        out[self.before[chosen]] = out[self.before[chosen] + 1] = True
        return out

    def centres(self, knots: Knots, state: State) -> FloatArray:
        """(count, 3) where the vehicle is at each coarse knot; a twist turns about that point."""
        out = []
        for chain, grid in zip(knots.chains, self.grids, strict=True):
            part = slice(chain.first, chain.first + chain.count)
            t = chain.begin_s + grid.every * STEP_S * np.arange(_intervals(chain, grid.every) + 1)
            out.append(np.column_stack([np.interp(t, knots.t_s[part], state.xyz_m[part, k]) for k in range(3)]))
        return np.concatenate(out)


def _intervals(chain: Chain, every: int) -> int:
    """Intervals between the coarse knots of a chain."""
    return -(-(chain.count - 1) // every)


def coarse_equations(
    fine: NormalEquations, coarse: CoarseKnots, centre_m: FloatArray, state: State, reach: int
) -> NormalEquations:
    """Normal equations of the coarse knots from those of all knots (Galerkin's projection).

    Args:
        fine: of all knots, the returns' part against the surface of both halves.
        coarse: knots.
        centre_m: see :meth:`CoarseKnots.centres`.
        state: at which the equations hold.
        reach: how many coarse knots apart two may be that a patch links.
    """
    width = min(reach + 2, coarse.count) * SIZE
    equations = NormalEquations(coarse.count * SIZE, width)
    _project(
        fine.band,
        fine.right,
        coarse.before,
        coarse.share,
        np.ascontiguousarray(state.xyz_m),
        centre_m,
        equations.band,
        equations.right,
    )
    return equations


def free_patches(equations: NormalEquations, patches: list[Patches], patch_m: float, centre_m: FloatArray) -> None:
    """Let the patches of ground move: take what held the poses to fixed ground out of the equations.

    Args:
        equations: of the coarse knots; changed.
        patches: of one surface; the same place in several of them is one patch.
        patch_m: side of a patch.
        centre_m: (count, 3) see :meth:`CoarseKnots.centres`.
    """
    place = np.concatenate([p.place for p in patches])
    if not len(place):
        return
    interval = np.concatenate([p.interval for p in patches])
    order = np.lexsort((interval, place[:, 2], place[:, 1], place[:, 0]))
    place = place[order]
    starts = np.flatnonzero(np.any(np.diff(place, axis=0, prepend=place[:1] - 1) != 0, axis=1))
    early, late, right = (
        np.concatenate([getattr(p, name) for p in patches])[order] for name in ("early", "late", "right")
    )

    def reduce(first: int, last: int) -> None:
        _reduce(
            starts, place, interval[order], early, late, right, patch_m, centre_m, first, last, equations.band,
            equations.right,
        )  # fmt: skip

    if len(order) < THREADED:
        reduce(0, len(centre_m))
        return
    middle = int(np.median(interval)) + 1  # each thread has its own columns, so they share no number they write
    with ThreadPoolExecutor(2) as pool:
        for half in [pool.submit(reduce, 0, middle), pool.submit(reduce, middle, len(centre_m))]:
            half.result()


def fine_step(coarse: CoarseKnots, centre_m: FloatArray, state: State, step: FloatArray) -> FloatArray:
    """The step (n, 9) at all knots that a step (count · 9,) at the coarse ones makes."""
    twist = step.reshape(-1, SIZE)
    out = np.zeros((len(state.xyz_m), SIZE))
    after = np.minimum(coarse.before + 1, coarse.count - 1)
    for knot, weight in ((coarse.before, 1.0 - coarse.share), (after, coarse.share)):
        part = twist[knot].copy()
        part[:, :3] += np.cross(part[:, 3:6], state.xyz_m - centre_m[knot])
        out += weight[:, None] * part
    return out


def coarse_pull(coarse: CoarseKnots, centre_m: FloatArray, state: State, pull: FloatArray) -> FloatArray:
    """A right-hand side (count · 9,) of the coarse knots from one (n, 9) of all knots: :func:`fine_step` transposed."""
    out = np.zeros((coarse.count, SIZE))
    after = np.minimum(coarse.before + 1, coarse.count - 1)
    for knot, weight in ((coarse.before, 1.0 - coarse.share), (after, coarse.share)):
        part = pull.copy()
        part[:, 3:6] += np.cross(state.xyz_m - centre_m[knot], pull[:, :3])
        np.add.at(out, knot, weight[:, None] * part)
    return out.ravel()


@numba.njit(cache=True, nogil=True)
def _project(band, right, before, share, xyz_m, centre_m, coarse_band, coarse_right):  # type: ignore[no-untyped-def]
    """Pᵀ (fine) P, where P's rows of a knot hold hat(s) · [I, [centre − x]ₓ; I; I] at two coarse knots."""
    width = band.shape[0]
    n = len(before)
    reach = width // SIZE
    count = len(centre_m)
    weights = np.empty((n, 2))
    arm = np.empty((n, 2, 3))
    for j in range(n):
        weights[j, 0], weights[j, 1] = 1.0 - share[j], share[j]
        for e in range(2):
            c = min(before[j] + e, count - 1)
            w = weights[j, e]
            for a in range(3):
                arm[j, e, a] = xyz_m[j, a] - centre_m[c, a]
            if w == 0.0:
                continue
            at = coarse_right[c * SIZE : (c + 1) * SIZE]
            fine = right[j * SIZE : (j + 1) * SIZE]
            for a in range(SIZE):
                at[a] += w * fine[a]
            dx, dy, dz = arm[j, e]
            at[3] += w * (dy * fine[2] - dz * fine[1])
            at[4] += w * (dz * fine[0] - dx * fine[2])
            at[5] += w * (dx * fine[1] - dy * fine[0])
    block, left, product = np.empty((SIZE, SIZE)), np.empty((SIZE, SIZE)), np.empty((SIZE, SIZE))
    for j in range(n):
        for step in range(reach):
            i = j + step
            if i >= n:
                break
            nonzero = False
            for a in range(SIZE):
                for b in range(SIZE):
                    row, column = i * SIZE + a, j * SIZE + b
                    if row >= column:
                        block[a, b] = band[row - column, column]
                    else:
                        block[a, b] = band[column - row, row]
                    nonzero = nonzero or block[a, b] != 0.0
            if not nonzero:
                continue
            for e in range(2):
                if weights[i, e] == 0.0:
                    continue
                dx, dy, dz = arm[i, e]
                for b in range(SIZE):
                    for a in range(SIZE):
                        left[a, b] = block[a, b]
                    left[3, b] += dy * block[2, b] - dz * block[1, b]
                    left[4, b] += dz * block[0, b] - dx * block[2, b]
                    left[5, b] += dx * block[1, b] - dy * block[0, b]
                for f in range(2):
                    w = weights[i, e] * weights[j, f]
                    if w == 0.0:
                        continue
                    dx, dy, dz = arm[j, f]
                    for a in range(SIZE):
                        for b in range(SIZE):
                            product[a, b] = w * left[a, b]
                        product[a, 3] += w * (dy * left[a, 2] - dz * left[a, 1])
                        product[a, 4] += w * (dz * left[a, 0] - dx * left[a, 2])
                        product[a, 5] += w * (dx * left[a, 1] - dy * left[a, 0])
                    _add_block(coarse_band, before[i] + e, before[j] + f, product, step > 0)


@numba.njit(cache=True, nogil=True)
def _add_block(band, i, j, block, both):  # type: ignore[no-untyped-def]
    """Add a block at (i, j) to the lower band, and its transpose at (j, i) too if it stands for `both`."""
    for a in range(SIZE):
        for b in range(SIZE):
            row, column = i * SIZE + a, j * SIZE + b
            if row >= column:
                band[row - column, column] += block[a, b]
            if both and column >= row:
                band[column - row, row] += block[a, b]


@numba.njit(cache=True, nogil=True)
def _square(upper):  # type: ignore[no-untyped-def]
    """The symmetric 6 × 6 matrix of its upper triangle."""
    out = np.empty((6, 6))
    e = 0
    for a in range(6):
        for b in range(a, 6):
            out[a, b] = out[b, a] = upper[e]
            e += 1
    return out


@numba.njit(cache=True, nogil=True)
def _reduce(  # type: ignore[no-untyped-def]
    starts, place, interval, early, late, right, patch_m, centre_m, first, last, band, coarse_right
):
    """Take each patch out of the columns of the coarse knots from `first` to before `last`."""
    for group in range(len(starts)):
        begin = starts[group]
        end = starts[group + 1] if group + 1 < len(starts) else len(place)
        if interval[begin] >= last or interval[end - 1] + 1 < first:
            continue
        knots = np.empty(2 * (end - begin), np.int64)
        sums = np.zeros((2 * (end - begin), 6, 6))
        whole = np.zeros((6, 6))
        pull = np.zeros(6)
        used = 0
        for r in range(begin, end):
            pull += right[r]
            for e in range(2):
                knot = interval[r] + e
                part = _square(late[r] if e else early[r])
                whole += part
                if used and knots[used - 1] == knot:
                    sums[used - 1] += part
                elif used > 1 and knots[used - 2] == knot:
                    sums[used - 2] += part
                else:
                    knots[used] = knot
                    sums[used] = part
                    used += 1
        # Of ground that is what holds its height, of a wall its place.
        most = max(whole[0, 0], whole[1, 1], whole[2, 2])
        if most <= 0.0:
            continue
        for a in range(6):
            whole[a, a] += most * RIDGE
        _factor(whole, most * RIDGE)
        cx, cy = (place[begin, 0] + 0.5) * patch_m, (place[begin, 1] + 0.5) * patch_m
        # What remains of the knots' equations without the patch is less Yᵀ Y, with Y = L⁻¹ Mᵀ and L Lᵀ the patch's own.
        moved = np.empty((6, used * 6))
        for u in range(used):
            c = knots[u]
            dx, dy, dz = cx - centre_m[c, 0], cy - centre_m[c, 1], -centre_m[c, 2]
            m = sums[u]
            for b in range(6):
                for a in range(3):
                    moved[b, u * 6 + a] = m[a, b]
                moved[b, u * 6 + 3] = m[3, b] + dy * m[2, b] - dz * m[1, b]
                moved[b, u * 6 + 4] = m[4, b] + dz * m[0, b] - dx * m[2, b]
                moved[b, u * 6 + 5] = m[5, b] + dx * m[1, b] - dy * m[0, b]
        for a in range(6):
            for b in range(a):
                pull[a] -= whole[a, b] * pull[b]
                for r in range(used * 6):
                    moved[a, r] -= whole[a, b] * moved[b, r]
            pull[a] /= whole[a, a]
            for r in range(used * 6):
                moved[a, r] /= whole[a, a]
        row = np.empty(used * 6, np.int64)
        for r in range(used * 6):
            row[r] = knots[r // 6] * SIZE + r % 6
        product = np.empty(used * 6)
        for c in range(used * 6):
            if knots[c // 6] < first or knots[c // 6] >= last:
                continue
            product[c:] = 0.0
            for e in range(6):
                y = moved[e, c]
                coarse_right[row[c]] -= y * pull[e]
                for r in range(c, used * 6):
                    product[r] += y * moved[e, r]
            for r in range(c, used * 6):
                band[row[r] - row[c], row[c]] -= product[r]


@numba.njit(cache=True, nogil=True)
def _factor(matrix, least):  # type: ignore[no-untyped-def]
    """The lower Cholesky factor of a small matrix in its place; rounding leaves no pivot smaller than `least`."""
    for a in range(len(matrix)):
        for b in range(a + 1):
            left = matrix[a, b]
            for e in range(b):
                left -= matrix[a, e] * matrix[b, e]
            matrix[a, b] = np.sqrt(max(left, least)) if a == b else left / matrix[b, b]
