"""Returns registered to reference surfaces that are fixed, or move along with the poses.

With a reference held fixed, poses can follow it but keep whatever tilt or heading it was built with. A free one is cut
into patches, each of which may move by a twist of its own. Eliminating the twists (Schur complement) leaves equations
between the coarse knots that saw the same patch: the bundle adjustment of Triggs et al. 2000 (Bundle Adjustment, a
Modern Synthesis, section 6) with patches in the place of points. A rigid motion of everything costs nothing in them,
so that absolute observations alone determine it.
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.adjustment.banded import NormalEquations
from furrowmap.core.adjustment.knots import KNOT_STEP_S, Knots, Observation, State
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel, kernel_part
from furrowmap.core.values.extents import bounds

UPPER: Final = 21
"""Entries of a symmetric 6 × 6 matrix."""
PATCH_LAYERS: Final = 3
"""Layers of patches: ground before and after the implement's passage, walls."""
MIN_THREADED_PATCHES: Final = 5_000
"""Fewer patches are done sooner than two threads have begun."""
MIN_STORED_ROWS: Final = 1 << 16
"""So many rows, or some more, are stored together."""
RIDGE: Final = 1e-8
"""Determines what a patch's returns do not: place and yaw of smooth ground, the tilt of a single line of returns. A
share of the weight of its height."""


class Patches(NamedTuple):
    """Sums by patch of a reference and interval of the coarse knots.

    Attributes:
        place: (m, 3) int64 column, row and layer of the patch.
        interval: (m,) int64 index of the coarse knot before.
        early: (m, 21) Σ w (1 − s) g gᵀ, with s the share of the interval to the next coarse knot and g = (n, p × n)
            about the patch's centre at the local origin's height; upper triangles, row by row.
        late: (m, 21) Σ w s g gᵀ.
        right: (m, 6) −Σ w g r, with r against the surface of both halves.
    """

    place: NDArray[np.int64]
    interval: NDArray[np.int64]
    early: FloatArray
    late: FloatArray
    right: FloatArray

    @classmethod
    def empty(cls, rows: int) -> "Patches":
        """Rows of zeros."""
        places = np.zeros((rows, 3), np.int64), np.zeros(rows, np.int64)
        return cls(*places, np.zeros((rows, UPPER)), np.zeros((rows, UPPER)), np.zeros((rows, 6)))


class PatchRows(NamedTuple):
    """Rows of :class:`Patches` while a chain's returns are added in the order of time, with room for some more.

    Attributes:
        west: of the patches over the returns, in patches.
        south: the same.
        slots: (PATCH_LAYERS, rows, columns) the row of each patch in the interval at hand, −1 where it has none.
        rows: all of them; those not yet filled are 0.
        progress: (4,) int64: the return to add next, rows filled, the first of the interval at hand, that interval.
    """

    west: int
    south: int
    slots: NDArray[np.int64]
    rows: Patches
    progress: NDArray[np.int64]

    @classmethod
    def over(cls, xyz_m: FloatArray, patch_m: float, room: int) -> "PatchRows":
        """No rows yet, room for some, over returns (n, 3); these alone, as a surface's extent grows with the drive."""
        low, high = (np.floor(end[:2] / patch_m).astype(int) for end in bounds(xyz_m)) if len(xyz_m) else (0, 0)
        columns, rows = np.broadcast_to(high - low + 1, 2)
        west, south = np.broadcast_to(low, 2).tolist()
        slots = np.full((PATCH_LAYERS, rows, columns), -1, np.int64)
        return cls(west, south, slots, Patches.empty(room), np.array([0, 0, 0, -1]))

    @property
    def full(self) -> bool:
        """Whether there is no room left."""
        return bool(self.progress[1] == len(self.rows.interval))

    def longer(self) -> "PatchRows":
        """The same with room for twice as many."""
        rows = Patches._make(np.concatenate([column, np.zeros_like(column)]) for column in self.rows)
        return self._replace(rows=rows)

    def filled(self) -> Patches:
        """Copies of the rows that are filled; the room is not kept."""
        return Patches._make(column[: self.progress[1]].copy() for column in self.rows)


class PatchStore:
    """Patches, whose largest columns lie in scratch files where they have many rows together."""

    def __init__(self) -> None:
        self._stored: list[Patches] = []
        self._waiting: list[Patches] = []
        self._rows = 0

    def add(self, patches: Patches) -> None:
        """Take the next patches."""
        self._waiting.append(patches)
        self._rows += len(patches.interval)
        if self._rows >= MIN_STORED_ROWS:
            self._stored += _stored(self._waiting)
            self._waiting = []
            self._rows = 0

    def all(self) -> list[Patches]:
        """All patches, in the order in which they came."""
        return self._stored + self._waiting


def _stored(found: Sequence[Patches]) -> Iterator[Patches]:
    """Parts of columns that are together."""
    whole = [arrays.concatenated(columns) for columns in zip(*found, strict=True)]
    ends = np.cumsum([len(patches.interval) for patches in found])
    for begin, end in pairwise([0, *ends.tolist()]):
        yield Patches(*(column[begin:end] for column in whole))


def free_patches(equations: NormalEquations, patches: list[Patches], patch_m: float, centre_m: FloatArray) -> None:
    """Let the patches of one surface move: eliminate their twists, one a place, from the coarse knots' equations."""
    place = np.concatenate([p.place for p in patches])
    if not len(place):
        return
    size = len(equations.right) // len(centre_m)
    interval = np.concatenate([p.interval for p in patches])
    order = np.lexsort((interval, place[:, 2], place[:, 1], place[:, 0]))
    place = place[order]
    starts = np.flatnonzero(np.any(np.diff(place, axis=0, prepend=place[:1] - 1) != 0, axis=1))

    def ordered(name: str) -> FloatArray:
        rows = arrays.concatenated([getattr(p, name) for p in patches])
        return arrays.in_parts(lambda part: [rows[order[part]]], len(order))[0]

    every = Patches(place, interval[order], *map(ordered, ("early", "late", "right")))

    def reduce(first: int, last: int) -> None:
        _reduce(size, starts, every, patch_m, centre_m, first, last, equations.band, equations.right)

    if len(order) < MIN_THREADED_PATCHES:
        reduce(0, len(centre_m))
        return
    middle = int(np.median(interval)) + 1  # each thread has its own columns, so they share no number they write
    with ThreadPoolExecutor(2) as pool:
        for half in [pool.submit(reduce, 0, middle), pool.submit(reduce, middle, len(centre_m))]:
            half.result()


@kernel()
def _square(upper):  # type: ignore[no-untyped-def]
    """The symmetric 6 × 6 matrix of its upper triangle."""
    out = np.empty((6, 6))
    e = 0
    for a in range(6):
        for b in range(a, 6):
            out[a, b] = out[b, a] = upper[e]
            e += 1
    return out


@kernel()
def _reduce(size, starts, patches, patch_m, centre_m, first, last, band, coarse_right):  # type: ignore[no-untyped-def]
    """Take each patch out of the columns of the coarse knots from `first` to before `last`."""
    place = patches.place
    interval = patches.interval
    early = patches.early
    late = patches.late
    right = patches.right
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
                slot = used
                if used and knots[used - 1] == knot:
                    slot = used - 1
                elif used > 1 and knots[used - 2] == knot:
                    slot = used - 2
                else:
                    knots[used] = knot
                    used += 1
                own = sums[slot]  # an assignment of arrays would take seconds to compile, for its error message
                own += part
        # The weight of a patch of ground's height, or of a wall's place.
        most = max(whole[0, 0], whole[1, 1], whole[2, 2])
        if most <= 0.0:
            continue
        for a in range(6):
            whole[a, a] += most * RIDGE
        _factor(whole, most * RIDGE)
        cx = (place[begin, 0] + 0.5) * patch_m
        cy = (place[begin, 1] + 0.5) * patch_m
        # What remains of the knots' equations without the patch is less Yᵀ Y, with Y = L⁻¹ Mᵀ and L Lᵀ the patch's own.
        moved = np.empty((6, used * 6))
        for u in range(used):
            c = knots[u]
            dx = cx - centre_m[c, 0]
            dy = cy - centre_m[c, 1]
            dz = -centre_m[c, 2]
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
            row[r] = knots[r // 6] * size + r % 6
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


@kernel()
def _factor(matrix, least):  # type: ignore[no-untyped-def]
    """The lower Cholesky factor of a small matrix in its place; rounding leaves no pivot smaller than `least`."""
    for a in range(len(matrix)):
        for b in range(a + 1):
            left = matrix[a, b]
            for e in range(b):
                left -= matrix[a, e] * matrix[b, e]
            matrix[a, b] = np.sqrt(max(left, least)) if a == b else left / matrix[b, b]


class SliceSums(NamedTuple):
    """Normal equations of the poses of the slices between knots.

    A slice's unknowns are position and rotation vector (map axes) of the pose half-way between its two knots.

    Attributes:
        normal: (n, 21) upper triangles of the normal matrices, row by row.
        right: (n, 6) right-hand sides against a fixed reference.
        right_free: (n, 6) the same against a reference that moves with the poses.
        returns: (n,) how many took part.
    """

    normal: FloatArray
    right: FloatArray
    right_free: FloatArray
    returns: NDArray[np.int64]

    @classmethod
    def empty(cls, knots: int) -> "SliceSums":
        """No returns yet, for a number of knots."""
        return cls(
            arrays.zeros((knots, UPPER)),
            arrays.zeros((knots, 6)),
            arrays.zeros((knots, 6)),
            arrays.zeros(knots, np.int64),
        )

    def take(self, other: "SliceSums") -> None:
        """Add the other's sums to these."""
        for own, more in zip(self, other, strict=True):
            np.add(own, more, out=own)

    def add_to(self, equations: NormalEquations, knots: Knots, *, free: bool) -> None:
        """Add the slices to the equations of all knots: a slice's pose is the mean of those of its two knots."""
        right = np.ascontiguousarray(self.right_free if free else self.right)
        size = len(equations.right) // len(knots)
        _add_slices(size, equations.band, equations.right, knots.linked, self.normal, right)


@kernel()
def _add_slices(size, band, right, linked, normal, slice_right):  # type: ignore[no-untyped-def]
    for k in linked:
        first = k * size
        entry = 0
        for a in range(6):
            half = 0.5 * slice_right[k, a]
            right[first + a] += half
            right[first + size + a] += half
            for b in range(a, 6):
                quarter = 0.25 * normal[k, entry]
                entry += 1
                band[b - a, first + a] += quarter
                band[b - a, first + size + a] += quarter
                band[size + a - b, first + b] += quarter
                if a != b:
                    band[size + b - a, first + a] += quarter


class PlaneEquation(NamedTuple):
    """A return's equation: its distance from a plane, which the pose's movements change.

    Attributes:
        east: of the plane's unit normal, or of one scaled to have an upright part of 1.
        north: the same.
        up: the same.
        weight: 1 / m².
        residual_m: from a fixed reference.
        residual_free_m: from a reference that moves with the poses.
    """

    east: float
    north: float
    up: float
    weight: float
    residual_m: float
    residual_free_m: float


# Inlined by numba, so that the arithmetic is that of the kernel which calls it.
@kernel_part(inline="always")
def add_equation(equation, t_s, x, y, z, layer, patch_m, poses, slices, patches, row):  # type: ignore[no-untyped-def]
    """Add the equation of a return at a place to its slice and, where patches are wanted, to its patch.

    Its derivatives are about the middle of the slice's two knots, and about the patch's centre at the local origin's
    height. `poses` are as :class:`~furrowmap.core.matching.ground_registration.ChainPoses`, `row` (6,) is scratch.
    """
    position_m = poses.position_m
    local = min(int((t_s - poses.begin_s) / KNOT_STEP_S), poses.knots - 2)
    k = poses.first + local
    qx = x - 0.5 * (position_m[k, 0] + position_m[k + 1, 0])
    qy = y - 0.5 * (position_m[k, 1] + position_m[k + 1, 1])
    qz = z - 0.5 * (position_m[k, 2] + position_m[k + 1, 2])
    _plane_row(row, equation.east, equation.north, equation.up, qx, qy, qz)
    _add_to_slice(
        slices.normal, slices.right, slices.right_free, k, row, equation.weight, equation.residual_m,
        equation.residual_free_m,
    )  # fmt: skip
    slices.returns[k] += 1
    every = poses.coarse.every
    if every > 0:
        interval = local // every
        late_share = (local + 0.5) / every - interval
        px = int(np.floor(x / patch_m))
        py = int(np.floor(y / patch_m))
        p = _patch_row(patches, px, py, layer, interval, poses.coarse.first)
        lx = x - (px + 0.5) * patch_m
        ly = y - (py + 0.5) * patch_m
        _plane_row(row, equation.east, equation.north, equation.up, lx, ly, z)
        _add_to_patch(
            patches.rows.early, patches.rows.late, patches.rows.right, p, row, equation.weight, late_share,
            equation.residual_free_m,
        )  # fmt: skip


# Stated: a part without flags gets those of whichever kernel is compiled first.
@kernel_part(error_model="numpy", fastmath={"contract", "nsz"})
def _plane_row(row, nx, ny, nz, x, y, z):  # type: ignore[no-untyped-def]
    """Set `row` (6,) to (n, p × n): derivatives of a distance along n of a point at p from the pose's place."""
    row[0] = nx
    row[1] = ny
    row[2] = nz
    row[3] = y * nz - z * ny
    row[4] = z * nx - x * nz
    row[5] = x * ny - y * nx


@kernel_part(error_model="numpy", fastmath={"contract", "nsz"})
def _add_to_slice(normal, right, right_free, k, row, weight, residual, residual_free):  # type: ignore[no-untyped-def]
    """Add one equation to the sums of slice `k`."""
    entry = 0
    for a in range(6):
        weighted = weight * row[a]
        right[k, a] -= weighted * residual
        right_free[k, a] -= weighted * residual_free
        for b in range(a, 6):
            normal[k, entry] += weighted * row[b]
            entry += 1


@kernel_part(inline="always")
def _patch_row(patches, px, py, layer, interval, coarse_first):  # type: ignore[no-untyped-def]
    """Row of a patch in an interval of the coarse knots, a new one if need be; a new interval frees all slots."""
    progress = patches.progress
    place = patches.rows.place
    if interval != progress[3]:
        _free_slots(patches.slots, place, progress[2], progress[1], patches.west, patches.south)
        progress[2] = progress[1]
        progress[3] = interval
    row = patches.slots[layer, py - patches.south, px - patches.west]
    if row < 0:
        row = progress[1]
        patches.slots[layer, py - patches.south, px - patches.west] = row
        place[row, 0] = px
        place[row, 1] = py
        place[row, 2] = layer
        patches.rows.interval[row] = coarse_first + interval
        progress[1] += 1
    return row


@kernel_part()
def _free_slots(slots, place, first, last, west, south):  # type: ignore[no-untyped-def]
    """Free the slots of the rows from `first` to before `last`."""
    for k in range(first, last):
        slots[place[k, 2], place[k, 1] - south, place[k, 0] - west] = -1


@kernel_part(error_model="numpy", fastmath={"contract", "nsz"})
def _add_to_patch(early, late, right, k, row, weight, late_share, residual):  # type: ignore[no-untyped-def]
    """Add one equation to the sums of row `k`."""
    entry = 0
    for a in range(6):
        weighted = weight * row[a]
        right[k, a] -= weighted * residual
        for b in range(a, 6):
            product = weighted * row[b]
            early[k, entry] += (1.0 - late_share) * product
            late[k, entry] += late_share * product
            entry += 1


@dataclass(frozen=True)
class Registration(Observation):
    """Returns registered at a state, which is the one it is added at.

    Attributes:
        free: whether the references move with the poses; if so, what follows takes them out of the coarse equations.
        references: patches of each reference surface.
        eliminated: equations of the coarse knots by references that are eliminated already.
    """

    sums: SliceSums
    free: bool
    references: Sequence[Sequence[Patches]] = ()
    patch_m: float = 1.0
    eliminated: Sequence[NormalEquations] = ()

    def add(self, equations: NormalEquations, knots: Knots, _state: State) -> None:
        """The sums of the slices."""
        self.sums.add_to(equations, knots, free=self.free)

    def eliminate_references(self, equations: NormalEquations, centre_m: NDArray[np.float64]) -> None:
        """Let the references move: take them out of the equations of the coarse knots at `centre_m` (count, 3)."""
        for part in self.eliminated:
            equations.band[: len(part.band)] += part.band
            equations.right += part.right
        for patches in self.references:
            free_patches(equations, list(patches), self.patch_m, centre_m)
