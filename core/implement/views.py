"""Candidate points of the implement in each scan: above the ground, within the search region."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.implement.near_scans import NearScan
from furrowmap.core.implement.seen_implement import (
    CELL_X_M,
    CELL_Z_M,
    Box,
    Plane,
    SideTemplate,
    SideViewGrid,
    fit_height,
)
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel

CUT_M: Final = 0.15
CUT_PER_M: Final = 0.03
"""Points below this height, plus this much per metre of distance from the axle, may be soil or straw."""
TOP_M: Final = 3.2
AGREE_M: Final = 0.06
"""Range tolerance of one pixel: a multiple of the noise, plus the slope within a pixel."""
SEARCH_M: Final = 1.2  # greatest lift
# Detection: least points, least share of the usual points, least share of the usual gain of each.
FEWEST_POINTS: Final = 25
FEWEST_SHARE: Final = 0.12
MIN_PROFILE_GAIN: Final = 0.55
# Ground plane: least share of near points in it, greatest distance from the tyres and slope.
_GROUND_SHARE: Final = 0.15
_GROUND_M: Final = 0.5
_GROUND_SLOPE: Final = 0.25
_GROUND_POINTS: Final = 40_000


@dataclass(frozen=True)
class View:
    """Candidate points of a scan: (n, 3) in the vehicle frame above the ground, range, laser, column of the image."""

    xyz_m: NDArray[np.float32]
    range_m: NDArray[np.float32]
    laser: NDArray[np.uint8]
    column: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.range_m)

    def differs(self, image: NDArray[np.float32], by_m: float = AGREE_M) -> NDArray[np.bool_]:
        """(n,) whether `image` has another range there."""
        differs: NDArray[np.bool_] = _differs(image, self.laser, self.column, self.range_m, by_m)
        return differs


@dataclass(frozen=True)
class Heights:
    """Fits of a template to n scans: height to it or nan, points of the tool, candidates, log-likelihood gain."""

    height_m: FloatArray
    explained: FloatArray
    there: FloatArray
    gain: FloatArray

    @property
    def usual(self) -> tuple[float, float]:
        """Median points explained, and gain of each, in scans that show the tool well."""
        well = self.explained > 0.5 * np.quantile(self.explained, 0.9)
        if not well.any():
            return 0.0, 0.0
        return float(np.median(self.explained[well])), float(np.median(self.gain[well] / self.explained[well]))

    @property
    def sure(self) -> NDArray[np.bool_]:
        """(n,) whether the tool is seen: enough points, with a gain that clutter does not reach."""
        points, gain = self.usual
        return (
            (np.abs(self.height_m) < SEARCH_M - 2 * CELL_Z_M)
            & (self.explained > max(FEWEST_POINTS, FEWEST_SHARE * points))
            & (self.gain > MIN_PROFILE_GAIN * gain * self.explained)
        )


@dataclass(frozen=True)
class Views:
    """Scans within a search region: near points, range images (lasers, COLUMNS) and candidates of each."""

    scans: Sequence[NearScan]
    images: Sequence[NDArray[np.float32]]
    views: Sequence[View]
    ground: Plane
    box_m: Box
    grid: SideViewGrid

    def __len__(self) -> int:
        return len(self.scans)

    def subset(self, numbers: NDArray[np.intp]) -> "Views":
        """A subset of the scans."""
        chosen = numbers.tolist()
        scans, images, views = ([values[k] for k in chosen] for values in (self.scans, self.images, self.views))
        return Views(scans, images, views, self.ground, self.box_m, self.grid)

    @property
    def pairs(self) -> NDArray[np.intp]:
        """(n, 2) indices of successive scans of the recording."""
        index = np.array([scan.index for scan in self.scans], np.int64)
        first = np.flatnonzero(np.diff(index) == 1)
        return np.column_stack([first, first + 1])

    def side(self, number: int, still_m: NDArray[np.float32] | None, lifted_m: float = 0.0) -> NDArray[np.float32]:
        """Side view of the points that differ from `still_m` (all without it), lowered by `lifted_m`."""
        xyz = self.views[number].xyz_m
        if still_m is not None:
            xyz = xyz[self.views[number].differs(still_m)]
        return self.grid.side_view(xyz[:, 0], xyz[:, 2] - np.float32(lifted_m))

    def heights(self, template: SideTemplate, still_m: NDArray[np.float32]) -> Heights:
        """Fit of `template` to the points of each scan that differ from static pixels."""
        found = np.zeros((len(self), 4))
        for number in range(len(self)):
            side = self.side(number, still_m)
            fit, _ = fit_height(side, template, -SEARCH_M, SEARCH_M)
            found[number] = fit.height_m, fit.explained, side.sum(), fit.gain
        return Heights(*found.T)

    def still(self, image: NDArray[np.float32], sides: Sequence[NDArray[np.bool_]]) -> NDArray[np.float32]:
        """(lasers, COLUMNS) `image` where most scans of each of `sides`, (scans,) bool, equal it; nan elsewhere."""
        still = np.ones(image.shape, bool)
        for side in sides:
            there = np.zeros(image.shape, np.int32)
            agree = np.zeros(image.shape, np.int32)
            for number in np.flatnonzero(side).tolist():
                view = self.views[number]
                _compare(image, view.laser, view.column, view.range_m, there, agree)
            still &= (there >= 3) & (agree > 0.6 * there)
        return np.where(still, image, np.float32(np.nan))

    def likely(
        self, number: int, height_m: float, template: SideTemplate, still_m: NDArray[np.float32]
    ) -> NDArray[np.bool_]:
        """Which points of a scan are more likely implement, at this height, than clutter."""
        view = self.views[number]
        grid = self.grid
        column = ((view.xyz_m[:, 0] - grid.x_m) / CELL_X_M).astype(np.intp)
        row = ((view.xyz_m[:, 2] - height_m - grid.z_m) / CELL_Z_M).astype(np.intp)
        likely = view.differs(still_m)
        likely &= (column < grid.columns) & (row >= 0) & (row < grid.rows)
        likely[likely] = template.odds[column[likely], row[likely]] > 1.0
        return likely


def views_of(scans: Sequence[NearScan], ground: Plane, box: Box) -> Views:
    """The candidate points of `scans` in `box`."""
    lasers = 1 + max((int(scan.laser.max(initial=0)) for scan in scans), default=0)
    grid = SideViewGrid(box[0], CUT_M, round((box[1] - box[0]) / CELL_X_M), round((TOP_M - CUT_M) / CELL_Z_M))
    bounds = np.array(box)
    plane = np.array(ground)
    views = [View(*_select(s.xyz_m, s.range_m, s.laser, s.column, plane, bounds)) for s in scans]
    return Views(scans, [scan.image(lasers) for scan in scans], views, ground, box, grid)


def ground_plane(scans: Sequence[NearScan]) -> Plane | None:
    """Robust plane fit to the ground in all scans; None if there is none at the expected height."""
    if not scans:
        return 0.0, 0.0, 0.0
    stride = 1 + sum(len(scan.range_m) for scan in scans) // _GROUND_POINTS
    xyz = np.concatenate([scan.xyz_m[k % stride :: stride] for k, scan in enumerate(scans)]).astype(np.float64)
    basis = np.column_stack([np.ones(len(xyz)), xyz[:, :2]])
    plane = np.zeros(3)
    for tolerance_m in (0.5, 0.3, 0.15, 0.1):
        near = np.abs(xyz[:, 2] - basis @ plane) < tolerance_m
        if np.count_nonzero(near) < _GROUND_SHARE * len(xyz):
            return None
        plane = np.linalg.lstsq(basis[near], xyz[near, 2], rcond=None)[0]
    a, b, c = plane.tolist()
    return (a, b, c) if abs(a) < _GROUND_M and np.hypot(b, c) < _GROUND_SLOPE else None


@kernel()
def _select(xyz_m, range_m, laser, column, ground, box):  # type: ignore[no-untyped-def]
    n = len(xyz_m)
    kept = np.empty(n, np.int64)
    above = np.empty(n, np.float32)
    count = 0
    for i in range(n):
        x = xyz_m[i, 0]
        y = xyz_m[i, 1]
        z = xyz_m[i, 2] - ground[0] - ground[1] * x - ground[2] * y
        if box[0] < x < box[1] and box[2] < y < box[3] and CUT_M + CUT_PER_M * np.sqrt(x * x + y * y) < z < TOP_M:
            kept[count] = i
            above[count] = z
            count += 1
    kept = kept[:count]
    xyz = xyz_m[kept]
    for i in range(count):
        xyz[i, 2] = above[i]
    return xyz, range_m[kept], laser[kept], column[kept]


@kernel()
def _differs(image, laser, column, range_m, by_m):  # type: ignore[no-untyped-def]
    """Whether neither the pixel of a point nor its neighbours in azimuth have its range."""
    out = np.empty(len(range_m), np.bool_)
    columns = image.shape[1]
    for i in range(len(range_m)):
        out[i] = True
        for step in (-1, 0, 1):
            if abs(image[laser[i], (column[i] + step) % columns] - range_m[i]) < by_m:
                out[i] = False
    return out


@kernel()
def _compare(image, laser, column, range_m, there, agree):  # type: ignore[no-untyped-def]
    """Count the points of a scan in each pixel, and those with the range of the image."""
    columns = image.shape[1]
    for i in range(len(range_m)):
        there[laser[i], column[i]] += 1
        for step in (-1, 0, 1):
            if abs(image[laser[i], (column[i] + step) % columns] - range_m[i]) < AGREE_M:
                agree[laser[i], column[i]] += 1
                break
