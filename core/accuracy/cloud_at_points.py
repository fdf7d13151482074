"""A cloud at surveyed points: height of the local plane, and disc targets."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from furrowmap.core.accuracy.point_check import (
    NO_SWATHS,
    PointCheck,
    ProductAtPoints,
    SwathHeights,
    find_swath_key,
    swath_numbers,
)
from furrowmap.core.pointclouds.joined_clouds import MACHINE_CLASSES, NOISE_CLASSES, Clouds, is_ours, open_to_measure
from furrowmap.core.readers.las.cloud import CloudFile
from furrowmap.core.readers.las.point_records import CloudBatch
from furrowmap.core.readers.surveyed_points import SurveyedPoints, SurveyOptions, survey_of
from furrowmap.core.runtime.arrays import FloatArray, three
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.progress import Progress, silent

STEP_SHARE: Final = 0.15
"""Spacing of the search grid, in disc diameters."""
MIN_DISC_RETURNS: Final = 8
MIN_CONTRAST_ERRORS: Final = 6.0
"""Least contrast of a disc, in standard errors from the variation of the ground."""
MIN_CONTRAST_SIGMAS: Final = 2.0
"""And in standard deviations of the brightness of the ground."""
FINE_SHARE: Final = 0.6
FINE_STEPS: Final = 61
"""Extent of the fine search in radii, and its steps along each axis."""


def find_disc(xy_m: FloatArray, brightness: FloatArray, diameter_m: float, search_m: float) -> FloatArray | None:
    """Centre (2,) of a disc that is brighter or darker than the ground around it; None where none is found.

    A grid search for the greatest contrast between the disc and the ring around it, then a fit of its edge. Places (n,
    2) of the returns are relative to the expected centre, from which it lies within `search_m`; brightness (n,) is
    intensity or luminance.
    """
    radius = 0.5 * diameter_m
    steps = np.arange(-search_m, search_m + 1e-9, STEP_SHARE * diameter_m)
    places = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    places = places[np.hypot(*places.T) <= search_m]
    best = None
    surest = MIN_CONTRAST_ERRORS
    for place in places:
        contrast = _contrast(np.hypot(*(xy_m - place).T), brightness, radius)
        if contrast is not None and abs(contrast) > surest:
            best = place
            surest = abs(contrast)
    return _centred(xy_m, brightness, best, radius) if best is not None else None


def _contrast(distance_m: FloatArray, brightness: FloatArray, radius_m: float) -> float | None:
    """Difference of the means of disc and ring in standard errors; None with too few returns or too little contrast."""
    inside = brightness[distance_m < 0.9 * radius_m]
    around = brightness[(distance_m > 1.1 * radius_m) & (distance_m < 2.0 * radius_m)]
    if min(len(inside), len(around)) < MIN_DISC_RETURNS:
        return None
    difference = float(inside.mean() - around.mean())
    uneven = float(around.std()) + 1e-9 * (1.0 + abs(float(around.mean())))
    if abs(difference) < MIN_CONTRAST_SIGMAS * uneven:
        return None
    return difference / (uneven * float(np.sqrt(1.0 / len(inside) + 1.0 / len(around))))


def _centred(xy_m: FloatArray, brightness: FloatArray, middle: FloatArray, radius_m: float) -> FloatArray:
    """Centre of the disc whose edge best parts brighter and darker returns; the mean of equally good ones."""
    distance = np.hypot(*(xy_m - middle).T)
    inside = float(np.median(brightness[distance < 0.8 * radius_m]))
    around = float(np.median(brightness[(distance > 1.2 * radius_m) & (distance < 2.0 * radius_m)]))
    near = distance < 2.5 * radius_m
    own = np.where(np.abs(brightness[near] - inside) < np.abs(brightness[near] - around), 1.0, -1.0)
    steps = np.linspace(-FINE_SHARE, FINE_SHARE, FINE_STEPS) * radius_m
    places = middle + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    apart = np.hypot(*(xy_m[near][:, None] - places[None]).transpose(2, 0, 1))
    score = own @ (apart < radius_m)
    return np.asarray(places[score >= score.max() - 0.5].mean(axis=0), np.float64)


Targets = Literal["none", "intensity", "colour"]

PLANE_RADIUS_M: Final = 0.25
"""Radius of the returns to which the plane at a point is fitted."""
MAX_PLANE_SLOPE: Final = 0.5
"""A steeper plane is an edge, where the height depends on the position."""
MIN_PLANE_RETURNS: Final = 6
PLANE_OUTLIER_SIGMAS: Final = 3.5
"""Outlier threshold, in robust standard deviations."""
SPACINGS: Final = 2.0
"""Side of the cells in which returns are compared, in mean point spacings."""
SEARCH_DIAMETERS: Final = 3.0
"""Search radius of a target, in its diameters."""
LUMINANCE: Final = np.array([0.299, 0.587, 0.114])
"""Of red, green and blue, after ITU-R BT.601."""


def cloud_at_points(
    path: Path,
    points_file: Path,
    options: SurveyOptions = SurveyOptions(),
    targets: Targets = "none",
    diameter_m: float = 0.3,
    progress: Progress = silent,
) -> ProductAtPoints:
    """Height of a LAS, LAZ or COPC file at each point, by a plane through the returns around it, in all and by swath.

    Args:
        targets: attribute in which discs are detected, for the horizontal error.

    Raises:
        InputError: if a file cannot be read.
        RefusedError: if PROJ has no exact transformation between their CRS.
    """
    clouds = open_to_measure(path, options.crs)
    stated = options if options.crs is not None else replace(options, crs=clouds.sources[path].flat)
    survey = survey_of(points_file, clouds.crs, stated)
    reach_m = max(PLANE_RADIUS_M, (SEARCH_DIAMETERS + 1.0) * diameter_m if targets != "none" else 0.0)
    (cloud,) = clouds.files
    own = is_ours(cloud)
    near = _near(clouds, survey, reach_m, progress, own=own)
    times = [part.gps_time for part in near if part.gps_time is not None]
    t_s = np.concatenate(times) if near and len(times) == len(near) else None
    source = np.concatenate([np.empty(0, np.uint16), *(part.point_source_id for part in near)])
    swath_key = find_swath_key(source, t_s, own=own) if near else "nothing"
    light = _light(near, targets)
    xyz = np.concatenate([np.empty((0, 3)), *(part.xyz_m for part in near)])
    tree = cKDTree(xyz[:, :2])
    points = []
    for name, place in zip(survey.name, survey.xyz_m, strict=True):
        index = tree.query_ball_point(place[:2], reach_m)
        swath = swath_numbers(source[index], t_s[index] if t_s is not None else None, swath_key, own=own)
        around = _ReturnsAround(xyz[index] - place, light[index] if light is not None else None, swath)
        points.append(_point_check(name, three(place), around, diameter_m))
    return ProductAtPoints(
        crs=clouds.crs,
        points=tuple(points),
        survey=survey,
        box_m=(*cloud.header.low[:2], *cloud.header.high[:2]),
        swath_key=swath_key,
        notices=(*clouds.notices, *survey.notices),
    )


def _near(clouds: Clouds, survey: SurveyedPoints, reach_m: float, progress: Progress, *, own: bool) -> list[CloudBatch]:
    """The returns up to `reach_m` from any point, in metres and the clouds' CRS."""
    tree = cKDTree(survey.xyz_m[:, :2])
    cells = np.unique(_cells(survey.xyz_m[:, :2], reach_m, around=True))
    low = survey.xyz_m[:, :2].min(axis=0) - reach_m
    high = survey.xyz_m[:, :2].max(axis=0) + reach_m
    unwanted = [*NOISE_CLASSES, *(MACHINE_CLASSES if own else ())]

    def read(done: int) -> None:
        progress("reading the cloud", min(1.0, done / max(clouds.points, 1)))

    def wanted(_: CloudFile, batch: CloudBatch) -> NDArray[np.bool_]:
        return ~np.isin(batch.classification, unwanted)

    out = []
    box = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    for _, batch in clouds.whole_batches(box, wanted, read=read):
        part = batch.where(np.isin(_cells(batch.xyz_m[:, :2], reach_m), cells))
        if len(part):
            distance, _ = tree.query(part.xyz_m[:, :2], distance_upper_bound=reach_m)
            out.append(part.where(np.isfinite(distance)))
    progress("reading the cloud", 1.0)
    return out


def _cells(xy_m: FloatArray, side_m: float, *, around: bool = False) -> NDArray[np.int64]:
    """Keys of the square cells that hold points (n, 2), with the neighbouring ones if `around`."""
    column, row = np.floor(xy_m / side_m).astype(np.int64).T
    if not around:
        return np.asarray((column << 32) + row, np.int64)
    shift = np.array([-1, 0, 1])
    return np.concatenate([((column + i) << 32) + row + j for i in shift for j in shift])


@dataclass(frozen=True)
class _ReturnsAround:
    """Returns (n, 3) relative to a point, their brightness if discs are looked for and it is known, and swaths."""

    xyz_m: FloatArray
    light: FloatArray | None
    swath: NDArray[np.int64]


def _light(near: list[CloudBatch], targets: Targets) -> FloatArray | None:
    """Brightness (n,) of the returns for target detection; None where there is none."""
    if targets == "none" or not near:
        return None
    if targets == "intensity":
        return np.concatenate([part.intensity for part in near]).astype(np.float64)
    colours = [part.rgb for part in near if part.rgb is not None]
    if len(colours) < len(near):
        return None
    light: FloatArray = np.concatenate(colours).astype(np.float64) @ LUMINANCE
    return light


def _point_check(name: str, place: tuple[float, float, float], around: _ReturnsAround, diameter_m: float) -> PointCheck:
    """Comparison of a point with the returns around it."""
    middle = None
    if around.light is not None and len(around.light):
        middle = find_disc(around.xyz_m[:, :2], around.light, diameter_m, SEARCH_DIAMETERS * diameter_m)
    east, north = (place[0] + middle[0], place[1] + middle[1]) if middle is not None else (np.nan, np.nan)
    at = middle if middle is not None else np.zeros(2)
    close = np.hypot(*(around.xyz_m[:, :2] - at).T) <= PLANE_RADIUS_M
    xyz = around.xyz_m[close] - np.array([*at, 0.0])
    swath = around.swath[close]
    plane = local_plane(xyz)
    if plane is None:
        why = Text(
            "has {returns} returns within {radius_m:g} m{returns:, too few on all sides|}",
            returns=len(xyz),
            radius_m=PLANE_RADIUS_M,
        )
        return PointCheck(name, place, (east, north, np.nan), len(xyz), why_not=why)
    if plane.steepness > MAX_PLANE_SLOPE:
        found = (east, north, np.nan)
        why = Text("lies on an edge or a steep slope")
        return PointCheck(name, place, found, len(xyz), plane.steepness, why_not=why)
    found = (east, north, place[2] + plane.height_m)
    return PointCheck(name, place, found, len(xyz), plane.steepness, _swath_heights(xyz, swath, place[2]))


def _swath_heights(xyz_m: FloatArray, swath: NDArray[np.int64], base_m: float) -> SwathHeights:
    """Height at a point by swath."""
    planes = [(number, local_plane(xyz_m[swath == number])) for number in np.unique(swath).tolist()]
    known = [(number, plane) for number, plane in planes if plane is not None]
    if not known:
        return NO_SWATHS
    freedom = sum(plane.freedom for _, plane in known)
    squares = sum(float(np.sum(plane.above_m**2)) for _, plane in known)
    return SwathHeights(
        tuple((number, base_m + plane.height_m) for number, plane in known),
        float(np.sqrt(squares / freedom)) if freedom > 0 else float("nan"),
        max(plane.range_m for _, plane in known),
    )


@dataclass(frozen=True)
class LocalPlane:
    """A plane through n returns: its rise to the east and north, places (n, 2) relative to the point, and residuals."""

    height_m: float
    slope: tuple[float, float]
    xy_m: FloatArray
    above_m: FloatArray

    @property
    def steepness(self) -> float:
        """Slope as a ratio."""
        return float(np.hypot(*self.slope))

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the fit."""
        return len(self.above_m) - 3

    @property
    def range_m(self) -> float:
        """Greatest difference of residuals within a cell of two mean point spacings, where relief is negligible."""
        radius_m = float(np.hypot(*self.xy_m.T).max())
        side_m = SPACINGS * radius_m * np.sqrt(np.pi / len(self.above_m))
        column, row = np.floor(self.xy_m / side_m).astype(np.int64).T
        cell = np.unique(column * (1 << 32) + row, return_inverse=True)[1]
        low = np.full(cell.max() + 1, np.inf)
        high = np.full(cell.max() + 1, -np.inf)
        np.minimum.at(low, cell, self.above_m)
        np.maximum.at(high, cell, self.above_m)
        return float((high - low).max())


def local_plane(xyz_m: FloatArray) -> LocalPlane | None:
    """Plane through returns (n, 3) around 0, 0, refitted once without outliers.

    None with too few returns, or where they do not lie on all sides.
    """
    keep = np.ones(len(xyz_m), bool)
    for _ in range(2):
        if keep.sum() < MIN_PLANE_RETURNS:
            return None
        x, y, z = xyz_m[keep].T
        (height, east, north), _, rank, _ = np.linalg.lstsq(np.column_stack([np.ones(len(x)), x, y]), z, rcond=1e-6)
        if rank < 3 or min(x.max(), -x.min(), y.max(), -y.min()) <= 0.0:
            return None
        above = xyz_m[:, 2] - height - east * xyz_m[:, 0] - north * xyz_m[:, 1]
        used = keep
        scatter = 1.4826 * float(np.median(np.abs(above[keep])))
        keep = np.abs(above) <= max(PLANE_OUTLIER_SIGMAS * scatter, 1e-3)
    return LocalPlane(float(height), (float(east), float(north)), xyz_m[used, :2], above[used])
