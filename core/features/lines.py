"""Lines: posts, poles, trunks, wires and rails, from neighbourhoods that are long and thin."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from furrowmap.core.features.neighbours import PointColumns, first_above, sort_into_columns
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.kernels import kernel

MIN_LINEARITY: Final = 0.75
"""Of the voxels that a line is made of."""
MAX_AXIS_DISTANCE_M: Final = 0.1
"""Of a voxel from the axis of its line."""
MAX_LINE_GAP_M: Final = 0.6
"""Or six voxels where that is more."""
MAX_TURN_DEG: Final = 20.0
"""Between the directions of neighbouring voxels of a line."""
MIN_LINE_LENGTH_M: Final = 0.6
MIN_WIRE_LENGTH_M: Final = 2.0
"""Of a line that is not upright: on plants far from a scanner the points of one laser are short lines."""
MIN_SLENDERNESS: Final = 5.0
"""Least ratio of the length of a line to its width."""
LINE_SURROUNDINGS_M: Final = 0.35
"""Within this distance of a line there is little but the line and other lines."""
MIN_LINE_PURITY: Final = 0.5
WIRE_SCATTER: Final = 0.8
"""Of the tolerance of planes: greatest RMS distance of the voxels of a wire from its course. What is thicker than the
scanner's noise makes it is no wire, such as a row of plants or the rim of a crop."""
UPRIGHT: Final = math.cos(math.radians(30.0))


@dataclass(frozen=True)
class DetectedLine:
    """A straight or slightly bent line.

    Attributes:
        members: indices of its voxels.
        path_m: (k, 3) its course, the lower or western end first.
        direction: (3,) unit.
        purity: share of its own among the voxels around it that are on no line.
    """

    members: IntArray
    path_m: FloatArray
    direction: FloatArray
    purity: float

    @property
    def upright(self) -> bool:
        """Whether it is a post, pole or trunk."""
        return bool(abs(self.direction[2]) >= UPRIGHT)


def find_lines(
    xyz_m: FloatArray, linearity: FloatArray, direction: FloatArray, cell_m: float, tolerance_m: float
) -> list[DetectedLine]:
    """Lines in voxels (n, 3), neither ground nor on planes, by linearity (n,), nan for none, and direction (n, 3).

    `tolerance_m` is that of planes: three deviations of the noise.
    """
    linear = np.flatnonzero(linearity >= MIN_LINEARITY)
    if len(linear) < 3:
        return []
    axis_m = max(MAX_AXIS_DISTANCE_M, 1.2 * cell_m)
    gap_m = max(MAX_LINE_GAP_M, 6.0 * cell_m)
    near = sort_into_columns(xyz_m[linear], gap_m)
    along = direction[linear][near.order].astype(np.float64)
    a, b = _links(
        near.xyz_m, near.starts, gap_m, *near.across, along, 0.8 * axis_m, math.cos(math.radians(MAX_TURN_DEG))
    )
    _, label = connected_components(
        coo_array((np.ones(len(a), bool), (a, b)), shape=(len(linear),) * 2), directed=False
    )
    label_of = np.empty(len(linear), np.int64)
    label_of[near.order] = label
    of_line = np.full(len(xyz_m), -1, np.int64)
    of_line[linear] = label_of
    # voxels on the axis of a line, though their own neighbourhood is no line, as where two lines cross
    near = sort_into_columns(xyz_m[linear], 3.0 * axis_m)
    rest = np.flatnonzero(of_line < 0)
    along = direction[linear][near.order].astype(np.float64)
    places = xyz_m[rest] - near.corner_m
    nearest = _nearest_axis(places, near.xyz_m, near.starts, near.side_m, *near.across, along, axis_m)
    of_line[rest[nearest >= 0]] = label_of[near.order][nearest[nearest >= 0]]
    every = sort_into_columns(xyz_m, max(LINE_SURROUNDINGS_M, 4.0 * cell_m))
    calm = np.zeros(len(xyz_m), bool)
    calm[linear] = True
    around = every, calm[every.order], of_line[every.order]
    thick = (axis_m, WIRE_SCATTER * tolerance_m)
    found = (_fit_line(xyz_m, number, members, thick, around) for number, members in _long_lines(xyz_m, of_line))
    return [line for line in found if line is not None]


_Surroundings = tuple[PointColumns, NDArray[np.bool_], IntArray]
"""All voxels, sorted; whether each is linear, and the number of its line."""


def _long_lines(xyz_m: FloatArray, of_line: IntArray) -> Iterator[tuple[int, IntArray]]:
    """Number and members of each line of at least four voxels whose box is as long as a line must be."""
    order = np.argsort(of_line, kind="stable")
    order = order[np.searchsorted(of_line[order], 0) :]
    begin = np.flatnonzero(np.diff(of_line[order], prepend=-1))
    end = np.append(begin[1:], len(order))
    sorted_m = xyz_m[order]
    across = np.maximum.reduceat(sorted_m, begin) - np.minimum.reduceat(sorted_m, begin)
    kept = (end - begin >= 4) & (np.linalg.norm(across, axis=1) >= MIN_LINE_LENGTH_M)
    for first, last in zip(begin[kept].tolist(), end[kept].tolist(), strict=True):
        yield int(of_line[order[first]]), order[first:last]


def _fit_line(
    xyz_m: FloatArray, number: int, members: IntArray, thick_m: tuple[float, float], around: _Surroundings
) -> DetectedLine | None:
    """The line of some voxels, no thicker than that of a pole and a wire."""
    axis_m, wire_m = thick_m
    own = xyz_m[members]
    centre = own.mean(axis=0)
    _, vector = np.linalg.eigh(np.cov((own - centre).T, bias=True))
    direction = vector[:, 2]
    if direction[2] < -0.3 or (abs(direction[2]) <= 0.3 and direction[0] < 0.0):
        direction = -direction
    s = (own - centre) @ direction
    if np.ptp(s) < (MIN_LINE_LENGTH_M if abs(direction[2]) >= UPRIGHT else MIN_WIRE_LENGTH_M):
        return None
    step = max(0.2, 2.0 * axis_m)
    slot = np.floor((s - s.min()) / step).astype(np.int64)
    in_slot = np.bincount(slot)
    every, calm, of_line = around
    others = _disturbing(
        own, every.xyz_m, every.starts, every.side_m, *every.across, every.corner_m, calm, of_line, number
    )
    disturbed = np.bincount(slot, others, len(in_slot))
    pure = in_slot / np.maximum(in_slot + disturbed, 1e-9) >= MIN_LINE_PURITY
    if not pure[in_slot > 0].any():
        return None
    good = pure | (in_slot == 0)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], good.astype(np.int8), [0]])))
    begin = edges[::2]
    end = edges[1::2]
    k = int(np.argmax(end - begin))
    first = int(begin[k])
    last = int(end[k]) - 1
    kept = (slot >= first) & (slot <= last)
    own = xyz_m[members[kept]]
    members = members[kept]
    s = s[kept]
    if len(own) < 4:
        return None
    middle = own.mean(axis=0)
    value, _ = np.linalg.eigh(np.cov((own - middle).T, bias=True))
    length = float(s.max() - s.min())
    if length < MIN_LINE_LENGTH_M or length < MIN_SLENDERNESS * math.sqrt(12.0 * max(value[1], 0.0)) * 0.5:
        return None
    path, scatter_m = course(own, s - s.min(), step)
    if abs(direction[2]) < UPRIGHT and (length < MIN_WIRE_LENGTH_M or scatter_m > wire_m):
        return None
    purity = len(own) / (len(own) + float(disturbed[first : last + 1].sum()))
    return DetectedLine(members, path, direction, purity)


def course(own: FloatArray, s: FloatArray, step: float) -> tuple[FloatArray, float]:
    """A straight or parabolic fit through a line's voxels from end to end, and their RMS distance from it."""
    pieces = max(1, min(int(s.max() / max(step, 1.0)), 50))
    fit = np.polynomial.polynomial.polyfit(s, own, 1 if pieces < 3 else 2)
    at = np.linspace(0.0, s.max(), pieces + 1 if pieces >= 3 else 2)
    out = np.polynomial.polynomial.polyval(at, fit).T
    away = own - np.polynomial.polynomial.polyval(s, fit).T
    return np.asarray(out, np.float64), math.sqrt(float(np.mean(np.sum(away**2, axis=1))))


@kernel()
def _links(xyz, starts, reach, across, rows, direction, axis_m, least_cosine):  # type: ignore[no-untyped-def]
    """Pairs of sorted points that are one line: near, of one direction, each on the axis of the other."""
    first = [0 for _ in range(0)]
    second = [0 for _ in range(0)]
    for i in range(len(xyz)):
        x = xyz[i, 0]
        y = xyz[i, 1]
        z = xyz[i, 2]
        u = direction[i, 0]
        v = direction[i, 1]
        w = direction[i, 2]
        column = int(x // reach)
        row = int(y // reach)
        for beside in range(max(column - 1, 0), min(column + 2, across)):
            for near in range(max(row - 1, 0), min(row + 2, rows)):
                begin = starts[beside * rows + near]
                end = starts[beside * rows + near + 1]
                for j in range(first_above(xyz, begin, end, z - reach), end):
                    c = xyz[j, 2] - z
                    if c > reach:
                        break
                    if j <= i:
                        continue
                    a = xyz[j, 0] - x
                    b = xyz[j, 1] - y
                    square = a * a + b * b + c * c
                    if square > reach * reach:
                        continue
                    p = direction[j, 0]
                    q = direction[j, 1]
                    r = direction[j, 2]
                    if abs(u * p + v * q + w * r) < least_cosine:
                        continue
                    s = a * u + b * v + c * w
                    t = a * p + b * q + c * r
                    if max(square - s * s, square - t * t) <= axis_m * axis_m:
                        first.append(i)
                        second.append(j)
    return np.array(first, np.int64), np.array(second, np.int64)


@kernel()
def _nearest_axis(at, xyz, starts, reach, across, rows, direction, axis_m):  # type: ignore[no-untyped-def]
    """The sorted point whose axis runs nearest to each place; -1 where none does within `axis_m`."""
    out = np.full(len(at), -1, np.int64)
    for i in range(len(at)):
        x = at[i, 0]
        y = at[i, 1]
        z = at[i, 2]
        column = int(x // reach)
        row = int(y // reach)
        best = axis_m * axis_m
        for beside in range(max(column - 1, 0), min(column + 2, across)):
            for near in range(max(row - 1, 0), min(row + 2, rows)):
                begin = starts[beside * rows + near]
                end = starts[beside * rows + near + 1]
                for j in range(first_above(xyz, begin, end, z - reach), end):
                    c = xyz[j, 2] - z
                    if c > reach:
                        break
                    a = xyz[j, 0] - x
                    b = xyz[j, 1] - y
                    square = a * a + b * b + c * c
                    if square > reach * reach:
                        continue
                    s = a * direction[j, 0] + b * direction[j, 1] + c * direction[j, 2]
                    if square - s * s < best:
                        best = square - s * s
                        out[i] = j
    return out


@kernel()
def _disturbing(own, xyz, starts, reach, across, rows, corner, calm, of_line, number):  # type: ignore[no-untyped-def]
    """Number of points around each of a line's own that are neither its own nor linear, each shared among those."""
    out = np.zeros(len(own))
    for i in range(len(own)):
        x = own[i, 0] - corner[0]
        y = own[i, 1] - corner[1]
        z = own[i, 2] - corner[2]
        column = int(x // reach)
        row = int(y // reach)
        others = 0
        ours = 0
        for beside in range(max(column - 1, 0), min(column + 2, across)):
            for near in range(max(row - 1, 0), min(row + 2, rows)):
                begin = starts[beside * rows + near]
                end = starts[beside * rows + near + 1]
                for j in range(first_above(xyz, begin, end, z - reach), end):
                    c = xyz[j, 2] - z
                    if c > reach:
                        break
                    a = xyz[j, 0] - x
                    b = xyz[j, 1] - y
                    if a * a + b * b + c * c <= reach * reach:
                        if of_line[j] == number:
                            ours += 1
                        elif not calm[j]:
                            others += 1
        out[i] = others / max(ours, 1)
    return out
