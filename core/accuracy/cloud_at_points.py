"""A cloud at surveyed points: height of the local plane, and targets."""

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
from furrowmap.core.pointclouds.flat_targets import TargetShape, find_target
from furrowmap.core.pointclouds.joined_clouds import MACHINE_CLASSES, NOISE_CLASSES, Clouds, is_ours, open_to_measure
from furrowmap.core.pointclouds.local_plane import MAX_PLANE_SLOPE, PLANE_RADIUS_M, local_plane
from furrowmap.core.pointclouds.plane_corners import find_corner
from furrowmap.core.pointclouds.survey_targets import GROUND_ALONE, Target, TargetKind, corners_among, stated_kinds
from furrowmap.core.readers.chosen_survey import SurveyOptions, survey_of
from furrowmap.core.readers.las.cloud import CloudFile
from furrowmap.core.readers.las.point_records import CloudBatch
from furrowmap.core.readers.surveyed_points import SurveyedPoints
from furrowmap.core.runtime.arrays import FloatArray, three
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.progress import Progress, silent

Targets = Literal["none", "intensity", "colour"]

LUMINANCE: Final = np.array([0.299, 0.587, 0.114])
"""Of red, green and blue, after ITU-R BT.601."""
_CORNER: Final = Target(TargetKind.CORNER)


@dataclass(frozen=True)
class TargetSearch:
    """How targets at points are found.

    Attributes:
        targets: attribute in which they are detected; corners of planes are by geometry.
        diameter_m: of discs, or side of checkerboards.
        shape: of those whose points' file does not say what they are.
        board_m: side of checkerboards, where discs are of another size.
    """

    targets: Targets = "none"
    diameter_m: float = 0.3
    shape: TargetShape = "disc"
    board_m: float | None = None

    def at(self, path: Path, survey: SurveyedPoints) -> list[Target]:
        """What to look for at each point of a file; InputError if its column `target` has an unknown target."""
        if self.targets == "none":
            return [_CORNER if corner else GROUND_ALONE for corner in corners_among(survey)]
        usual = TargetKind(self.shape)
        board_m = self.diameter_m if self.board_m is None else self.board_m
        size_m = {TargetKind.DISC: self.diameter_m, TargetKind.CHECKERBOARD: board_m}
        kinds = [kind or usual for kind in stated_kinds(path, survey)]
        return [Target(kind, size_m.get(kind, 0.0)) for kind in kinds]


def cloud_at_points(
    path: Path,
    points_file: Path,
    options: SurveyOptions = SurveyOptions(),
    search: TargetSearch = TargetSearch(),
    progress: Progress = silent,
) -> ProductAtPoints:
    """Height of a LAS, LAZ or COPC file at each point, by a plane through the returns around it, in all and by swath.

    Raises:
        InputError: if a file cannot be read, or names an unknown target.
        RefusedError: if PROJ has no exact transformation between their CRS.
    """
    clouds = open_to_measure(path, options.crs)
    stated = options if options.crs is not None else replace(options, crs=clouds.sources[path].flat)
    survey = survey_of(points_file, clouds.crs, stated)
    wanted = search.at(points_file, survey)
    reach_m = max(target.reach_m for target in wanted)
    (cloud,) = clouds.files
    own = is_ours(cloud)
    near = _near(clouds, survey, reach_m, progress, own=own)
    times = [part.gps_time for part in near if part.gps_time is not None]
    t_s = np.concatenate(times) if near and len(times) == len(near) else None
    source = np.concatenate([np.empty(0, np.uint16), *(part.point_source_id for part in near)])
    swath_key = find_swath_key(source, t_s, own=own) if near else "nothing"
    light = _light(near, search.targets)
    xyz = np.concatenate([np.empty((0, 3)), *(part.xyz_m for part in near)])
    tree = cKDTree(xyz[:, :2])
    points = []
    for name, place, target in zip(survey.name, survey.xyz_m, wanted, strict=True):
        index = tree.query_ball_point(place[:2], target.reach_m)
        swath = swath_numbers(source[index], t_s[index] if t_s is not None else None, swath_key, own=own)
        around = _ReturnsAround(xyz[index] - place, light[index] if light is not None else None, swath)
        points.append(replace(_point_check(name, three(place), around, target), target=target))
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
    """Returns (n, 3) relative to a point, their brightness if targets are looked for and it is known, and swaths."""

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


def _point_check(name: str, place: tuple[float, float, float], around: _ReturnsAround, target: Target) -> PointCheck:
    """Comparison of a point with the returns around it."""
    if target.kind is TargetKind.CORNER:
        return _corner_check(name, place, around)
    middle = None
    if target.kind is not TargetKind.GROUND and around.light is not None and len(around.light):
        shape: TargetShape = "disc" if target.kind is TargetKind.DISC else "checkerboard"
        middle = find_target(shape, around.xyz_m[:, :2], around.light, target.size_m, target.search_m)
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


def _corner_check(name: str, place: tuple[float, float, float], around: _ReturnsAround) -> PointCheck:
    """Comparison of a point with the corner of three planes there, on all axes."""
    corner = find_corner(around.xyz_m)
    if corner is None:
        why = Text("shows no corner of three planes")
        return PointCheck(name, place, (np.nan, np.nan, np.nan), len(around.xyz_m), why_not=why)
    return PointCheck(name, place, three(np.array(place) + corner.middle_m), int(corner.used.sum()))


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
