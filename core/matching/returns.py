"""Which returns take part in matching: those of the ground, off the vehicle's own body, thinned to an even rate."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from itertools import chain, islice
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from furrowmap.core.matching.walls import UPRIGHT_RATE_HZ, UprightReturns, no_upright, select_upright
from furrowmap.core.runtime.arrays import FloatArray, first, of_file, parts, scratch_file, taken, zeros
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.runtime.write_errors import writing_scratch
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.time_span import Span
from furrowmap.core.values.trajectory import Motion, Trajectory

MAX_GROUND_RANGE_M: Final = 12.0
"""Further away the rings lie metres apart and graze the ground."""
GROUND_GATE_M: Final = 0.30
GROUND_GATE_SLOPE: Final = 0.05
"""Ground is what lies within GROUND_GATE_M plus this share of the distance of the plane under the vehicle."""
GROUND_RATE_HZ: Final = 22_000.0
"""Returns a second that are kept: beyond, neighbours on the soil repeat each other."""
MANY_LASERS: Final = 40
STAGGER_COLUMNS: Final = 7
"""Of scanners with more than MANY_LASERS lasers, each laser's returns are taken so many columns from those of the next:
whole columns would be few, and neighbours in them repeat each other."""
PIXEL_M: Final = 0.2
PIXELS: Final = 80
"""The body's footprint is learned in a square of PIXELS pixels of PIXEL_M, the vehicle in its middle."""
BODY_SHARE: Final = 0.2
"""Share of the scans with returns above a place of the vehicle frame, from which the place belongs to the vehicle."""
EXTRAPOLATION_S: Final = 0.5
"""Scans reach this far beyond the first approximation: the ground shows where the vehicle was."""
LEARN_SCANS: Final = 20
SELF_RANGE_M: Final = (2.0, 6.0)
HEIGHT_BIN_M: Final = 0.1
HEIGHT_TRUSTED_M: Final = 0.25
"""Ground that lies further from the vehicle frame's origin than this shows that the mounting's height is not known."""
STEP_RETURNS: Final = 1 << 20
"""So many returns are looked at together."""
SCRATCH_BUFFER_BYTES: Final = 1 << 20
"""Written at once to a scratch file."""
BODY_MARGIN: Final = 2
"""Pixels round the footprint that are left out as well."""


@dataclass(frozen=True)
class GroundReturns:
    """Returns of the ground in the order of time.

    Attributes:
        t_s: (n,) float64 UTC by the trajectory's clock.
        xyz_m: (n, 3) float32 in the vehicle frame.
        half: (n,) uint8: 0 or 1, which of two independent halves of the scans a return belongs to.
        body: (80, 80) bool: the vehicle's own footprint, rows to the left, columns forward, 0.2 m a pixel, the
            vehicle's origin in the middle.
        upright: upright returns, off the vehicle's body as well.
        laser: (n,) uint8 which laser measured a return; none of them where that is not known.
        standing: all upright returns: a standing crop all around is taken for the body.
    """

    t_s: FloatArray
    xyz_m: NDArray[np.float32]
    half: NDArray[np.uint8]
    body: NDArray[np.bool_]
    upright: UprightReturns = field(default_factory=no_upright)
    laser: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))
    standing: UprightReturns = field(default_factory=no_upright)

    def __len__(self) -> int:
        return len(self.t_s)

    def part(self, chosen: slice) -> GroundReturns:
        """Some of them, with the upright returns of the same time."""
        if not len(t := self.t_s[chosen]):
            upright = no_upright()
        else:
            u = self.upright
            within = slice(*np.searchsorted(u.t_s, (t[0], t[-1])))
            upright = UprightReturns(u.t_s[within], u.xyz_m[within], u.half[within], u.laser[within])
        return GroundReturns(t, self.xyz_m[chosen], self.half[chosen], self.body, upright, self.laser[chosen])

    def without(self, spans_s: Sequence[Span]) -> GroundReturns:
        """Those that lie in none of some spans of time, which follow each other and do not overlap."""
        u = self.upright
        arrays = _outside(self.t_s, spans_s, self.xyz_m, self.half, self.laser)
        upright = UprightReturns(*_outside(u.t_s, spans_s, u.xyz_m, u.half, u.laser))
        return GroundReturns(*arrays[:3], self.body, upright, arrays[3], self.standing)


def _outside(t_s: FloatArray, spans_s: Sequence[Span], *beside: NDArray[Any]) -> tuple[Any, Any, Any, Any]:
    """Times (n,), which increase, and three arrays (n, …) beside them, without those in spans of time."""
    borders = np.searchsorted(t_s, np.asarray(spans_s, np.float64).ravel()).tolist()
    kept = [slice(*ends) for ends in zip([0, *borders[1::2]], [*borders[::2], len(t_s)], strict=True)]
    count = sum(part.stop - part.start for part in kept)
    out = [zeros((count if len(array) else 0, *array.shape[1:]), array.dtype) for array in (t_s, *beside)]
    for some, array in zip(out, (t_s, *beside), strict=True):
        if len(array):
            np.concatenate([array[part] for part in kept], out=some)
    return out[0], out[1], out[2], out[3]


def ground_returns(
    scans: Iterable[Scan],
    mounting: Mounting,
    trajectory: Trajectory,
    on_scan: Callable[[Scan], None] | None = None,
) -> GroundReturns:
    """The returns of the ground in a recording.

    They are kept in a scratch file, not in memory. The vehicle's own body is learned from them: places of the vehicle
    frame with returns above the ground in BODY_SHARE of the scans.

    Args:
        scans: in the order of time.
        trajectory: the first approximation; scans well outside its span are left out, those at a stand teach nothing
            about the body.
        on_scan: sees each scan on its way.
    """
    rotation = np.ascontiguousarray(mounting.rotation)
    lever = np.asarray(mounting.xyz_m, np.float64)
    seen = np.zeros((PIXELS, PIXELS), np.int32)
    idle = np.zeros_like(seen)
    begin_s = trajectory.span_s[0] - EXTRAPOLATION_S
    end_s = trajectory.span_s[1] + EXTRAPOLATION_S
    count = number = 0
    stride = 1
    upright_stride = 1
    last_s = -np.inf
    scans = iter(scans)
    begin = list(islice(scans, LEARN_SCANS))
    ground_m = ground_height_m(begin, rotation, lever)
    with _Scratch() as ground, _Scratch() as upright:
        for scan in chain(begin, scans):
            if on_scan is not None:
                on_scan(scan)
            if not len(scan):
                continue
            t_s = scan.t_s
            if t_s[0] < begin_s or t_s[-1] > end_s:
                continue
            moves = trajectory.motion[max(0, np.searchsorted(trajectory.t_s, t_s[0]) - 1)] != Motion.STANDING
            xyz = np.ascontiguousarray(scan.xyz_m, np.float32)
            column = np.ascontiguousarray(scan.column, np.uint16)
            if scan.lasers > MANY_LASERS:
                column = column + np.uint16(STAGGER_COLUMNS) * scan.laser
            scanned = t_s, xyz, column, scan.laser
            lying, candidates = select(*scanned, rotation, lever, ground_m, stride, seen if moves else idle)
            standing, standing_in_all = select_upright(*scanned, rotation, lever, ground_m, upright_stride)
            count += moves
            number += 1
            duration_s = max(float(t_s[-1] - max(t_s[0], last_s)), 1e-3)
            last_s = float(t_s[-1])
            stride = max(1, round(candidates / (GROUND_RATE_HZ * duration_s)))
            upright_stride = max(1, round(standing_in_all / (UPRIGHT_RATE_HZ * duration_s)))
            for scratch, (times, places, lasers) in ((ground, lying), (upright, standing)):
                scratch.add(times, places, np.full(len(times), number % 2, np.uint8), lasers)
        margin = np.ones((2 * BODY_MARGIN + 1, 2 * BODY_MARGIN + 1), np.bool_)
        body = binary_dilation(seen >= max(1.0, BODY_SHARE * count), margin)
        all_standing = _without_body(stored := upright.stored(), body & False, stored)
        times, places, halves, lasers = (zeros(column.shape, column.dtype) for column in all_standing)
        what_stands = _without_body(all_standing, body, (times, places, halves, lasers))
        upright_returns = UprightReturns(*what_stands), UprightReturns(*all_standing)
        t_s, xyz_m, half, laser = _without_body(stored := ground.stored(), body, stored)
        return GroundReturns(t_s, xyz_m, half, body, upright_returns[0], laser, upright_returns[1])


def ground_height_m(scans: Sequence[Scan], rotation: FloatArray, lever_m: FloatArray) -> float:
    """Where the ground lies in the vehicle frame: at 0, unless the session does not know the mounting's height.

    The lowest height at which a good part of the returns near the vehicle lie: three tenths as many as at the most
    common one.
    """
    heights = [np.zeros(0)]
    for scan in scans:
        v = scan.xyz_m @ rotation.T + lever_m
        distance = np.hypot(v[:, 0], v[:, 1])
        heights.append(v[(distance > SELF_RANGE_M[0]) & (distance < SELF_RANGE_M[1]), 2])
    z = np.concatenate(heights)
    counts, edges = np.histogram(z, np.arange(-4.0, 4.0 + HEIGHT_BIN_M, HEIGHT_BIN_M))
    if not counts.any():
        return 0.0
    found = np.flatnonzero(counts >= 0.3 * counts.max())[0]
    height = float(np.median(z[(z >= edges[found] - HEIGHT_BIN_M) & (z < edges[found + 1] + HEIGHT_BIN_M)]))
    return height if abs(height) > HEIGHT_TRUSTED_M else 0.0


_Fields = tuple[FloatArray, NDArray[np.float32], NDArray[np.uint8], NDArray[np.uint8]]
"""Times (n,), places in the vehicle frame (n, 3), halves (n,) and lasers (n,) of returns."""


class _Scratch:
    """Returns in nameless files, which the system takes back when nothing maps them any more."""

    def __init__(self) -> None:
        self._stack = ExitStack()
        self._count = 0

    def __enter__(self) -> Self:
        enter = self._stack.enter_context
        self._files = [enter(scratch_file(SCRATCH_BUFFER_BYTES)) for _ in range(4)]
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def add(
        self, t_s: FloatArray, xyz_m: NDArray[np.float32], half: NDArray[np.uint8], laser: NDArray[np.uint8]
    ) -> None:
        """Append returns."""
        with writing_scratch():
            for file, column in zip(self._files, (t_s.data, xyz_m.data, half.data, laser.data), strict=True):
                file.write(column)
        self._count += len(t_s)

    def stored(self) -> _Fields:
        """All that was added; it may be used after the files are closed."""
        if not self._count:
            return np.zeros(0), np.zeros((0, 3), np.float32), np.zeros(0, np.uint8), np.zeros(0, np.uint8)
        with writing_scratch():
            for file in self._files:
                file.flush()
        t_s, xyz_m, half, laser = self._files
        return (
            of_file(t_s, self._count, np.float64),
            of_file(xyz_m, (self._count, 3), np.float32),
            of_file(half, self._count, np.uint8),
            of_file(laser, self._count, np.uint8),
        )


def _without_body(found: _Fields, body: NDArray[np.bool_], out: _Fields) -> _Fields:
    """Those of the returns that are off the body, in the order of time: the first rows of `out`, which may be `found`.

    Pages that are written already are written again quickly; those of another file would all be fresh.
    """
    rows = 0
    for part in parts(len(found[0]), STEP_RETURNS):
        columns = [taken(whole, part) for whole in found]
        t_s, xyz_m, _, _ = columns
        kept = np.flatnonzero(~on_body(xyz_m, body))
        # Packets may come a little out of order; what follows relies on time.
        if np.any(np.diff(t_s) < 0):
            kept = kept[np.argsort(t_s[kept], kind="stable")]
        end = rows + len(kept)
        out[0][rows:end], out[1][rows:end], out[2][rows:end], out[3][rows:end] = (column[kept] for column in columns)
        rows = end
    t_s, xyz_m, half, laser = (first(whole, rows) for whole in out)
    return t_s, xyz_m, half, laser


@kernel()
def on_body(xyz_m, body):  # type: ignore[no-untyped-def]
    """Which returns (n, 3) in the vehicle frame lie above the footprint."""
    out = np.empty(len(xyz_m), np.bool_)
    for i in range(len(xyz_m)):
        row = int(np.floor(xyz_m[i, 1] / PIXEL_M)) + PIXELS // 2
        column = int(np.floor(xyz_m[i, 0] / PIXEL_M)) + PIXELS // 2
        out[i] = 0 <= row < PIXELS and 0 <= column < PIXELS and body[row, column]
    return out


@kernel()
def select(t_s, xyz_m, column, laser, rotation, lever_m, ground_m, stride, seen):  # type: ignore[no-untyped-def]
    """Time, place in the vehicle frame and laser of every `stride`-th firing's ground returns, and the count of all.

    The ground lies about `ground_m` above the vehicle frame's origin.

    `seen` counts the scans with upright returns above each pixel of the vehicle frame.
    """
    n = len(xyz_m)
    times = np.empty(n)
    lasers = np.empty(n, np.uint8)
    out = np.empty((n, 3), np.float32)
    mark = np.zeros((PIXELS, PIXELS), np.bool_)
    kept = candidates = 0
    for i in range(n):
        px = xyz_m[i, 0]
        py = xyz_m[i, 1]
        pz = xyz_m[i, 2]
        x = rotation[0, 0] * px + rotation[0, 1] * py + rotation[0, 2] * pz + lever_m[0]
        y = rotation[1, 0] * px + rotation[1, 1] * py + rotation[1, 2] * pz + lever_m[1]
        z = rotation[2, 0] * px + rotation[2, 1] * py + rotation[2, 2] * pz + lever_m[2]
        square = x * x + y * y
        if not square < MAX_GROUND_RANGE_M * MAX_GROUND_RANGE_M:
            continue
        if abs(z - ground_m) > GROUND_GATE_M + GROUND_GATE_SLOPE * np.sqrt(square):
            if z > ground_m:
                a = int(np.floor(y / PIXEL_M)) + PIXELS // 2
                b = int(np.floor(x / PIXEL_M)) + PIXELS // 2
                if 0 <= a < PIXELS and 0 <= b < PIXELS and not mark[a, b]:
                    mark[a, b] = True
                    seen[a, b] += 1
            continue
        candidates += 1
        if column[i] % stride == 0:
            times[kept] = t_s[i]
            lasers[kept] = laser[i]
            out[kept, 0] = x
            out[kept, 1] = y
            out[kept, 2] = z
            kept += 1
    return (times[:kept], out[:kept], lasers[:kept]), candidates
