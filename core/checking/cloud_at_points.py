"""A cloud at surveyed points: height of the local plane, and disc targets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np
import pyproj
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from furrowmap.core.checking.internal_precision import UNSEEN, SwathHeights, SwathKey, find_swath_key, swath_numbers
from furrowmap.core.checking.local_plane import local_plane
from furrowmap.core.checking.point_check import PointCheck, ProductAtPoints, three
from furrowmap.core.checking.target_discs import find_disc
from furrowmap.core.pointclouds.clouds import MACHINE, NOISE, Clouds, is_ours, open_clouds
from furrowmap.core.readers.las.cloud import CloudFile
from furrowmap.core.readers.las.points import CloudBatch
from furrowmap.core.readers.surveyed_points import SurveyedPoints, SurveyOptions, survey_of
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.progress import Progress, silent

FloatArray = NDArray[np.float64]
Targets = Literal["none", "intensity", "colour"]

RADIUS_M: Final = 0.25
"""Radius of the returns to which the plane at a point is fitted."""
STEEPEST: Final = 0.5
"""A steeper plane is an edge, where the height depends on the position."""
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
    """Height of a cloud at each point, from a plane through the returns around it, in all and by swath.

    Args:
        path: of a LAS, LAZ or COPC file.
        points_file: see :func:`~furrowmap.core.readers.surveyed_points.read_points`.
        options: what is stated about the points.
        targets: attribute in which discs are detected, for the horizontal error.
        diameter_m: of the discs.
        progress: receives the share of the cloud that was read.

    Raises:
        InputError: if a file cannot be read.
        RefusedError: if PROJ has no exact transformation between their CRS.
    """
    clouds = _opened(path, options.crs)
    survey = survey_of(points_file, clouds.crs, options)
    reach_m = max(RADIUS_M, (SEARCH_DIAMETERS + 1.0) * diameter_m if targets != "none" else 0.0)
    (cloud,) = clouds.files
    own = is_ours(cloud)
    near = _near(clouds, survey, reach_m, progress, own=own)
    swath_key = _swath_key(near, own=own)
    around = _by_point(near, survey, reach_m, targets, swath_key, own=own)
    return ProductAtPoints(
        crs=clouds.crs,
        points=tuple(
            _point_check(name, three(xyz_m), returns, diameter_m)
            for name, xyz_m, returns in zip(survey.name, survey.xyz_m, around, strict=True)
        ),
        survey=survey,
        box_m=(*cloud.header.low[:2], *cloud.header.high[:2]),
        swath_key=swath_key,
        notices=(*clouds.notices, *survey.notices),
    )


def _opened(product: Path, crs: pyproj.CRS | None) -> Clouds:
    """The cloud in metres; `crs` is that of the points, and the target of a cloud in degrees."""
    try:
        return open_clouds([product], crs)
    except InputError as error:
        if error.code != "crs-not-metres":
            raise
        if crs is None or {axis.unit_name for axis in crs.axis_info} != {"metre"}:
            raise InputError("crs-not-metres.check", what=error.what) from None
    return open_clouds([product], crs, crs)


def _near(clouds: Clouds, survey: SurveyedPoints, reach_m: float, progress: Progress, *, own: bool) -> list[CloudBatch]:
    """The returns up to `reach_m` from any point, in metres and the clouds' CRS."""
    tree = cKDTree(survey.xyz_m[:, :2])
    cells = np.unique(_cells(survey.xyz_m[:, :2], reach_m, around=True))
    low, high = survey.xyz_m[:, :2].min(axis=0) - reach_m, survey.xyz_m[:, :2].max(axis=0) + reach_m
    unwanted = [*NOISE, *(MACHINE if own else ())]

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


def _swath_key(near: list[CloudBatch], *, own: bool) -> SwathKey:
    """What separates the swaths of the returns around all points."""
    if not near:
        return "nothing"
    source, t_s = np.concatenate([part.point_source_id for part in near]), _seconds(near)
    return find_swath_key(source, t_s, own=own)


def _seconds(near: list[CloudBatch]) -> FloatArray | None:
    """Times of returns from an arbitrary origin; None where any has none."""
    times = [part.gps_time for part in near]
    known = [t_s for t_s in times if t_s is not None]
    return np.concatenate(known) if len(known) == len(times) else None


@dataclass(frozen=True)
class _Around:
    """The returns around a point, n of them.

    Attributes:
        xyz_m: (n, 3) relative to the point.
        light: (n,) brightness for disc detection; None where it is not requested or not available.
        swath: (n,) swath number.
    """

    xyz_m: FloatArray
    light: FloatArray | None
    swath: NDArray[np.int64]


def _by_point(
    near: list[CloudBatch], survey: SurveyedPoints, reach_m: float, targets: Targets, swath_key: SwathKey, *, own: bool
) -> Iterator[_Around]:
    """The returns around each point."""
    if not near:
        yield from [_Around(np.empty((0, 3)), None, np.empty(0, np.int64))] * len(survey)
        return
    xyz = np.concatenate([part.xyz_m for part in near])
    source, t_s = np.concatenate([part.point_source_id for part in near]), _seconds(near)
    light = _light(near, targets)
    tree = cKDTree(xyz[:, :2])
    for place in survey.xyz_m:
        index = tree.query_ball_point(place[:2], reach_m)
        yield _Around(
            xyz[index] - place,
            light[index] if light is not None else None,
            swath_numbers(source[index], t_s[index] if t_s is not None else None, swath_key, own=own),
        )


def _light(near: list[CloudBatch], targets: Targets) -> FloatArray | None:
    """Brightness (n,) of the returns for target detection; None where there is none."""
    if targets == "none":
        return None
    if targets == "intensity":
        return np.concatenate([part.intensity for part in near]).astype(np.float64)
    colours = [part.rgb for part in near if part.rgb is not None]
    if len(colours) < len(near):
        return None
    light: FloatArray = np.concatenate(colours).astype(np.float64) @ LUMINANCE
    return light


def _point_check(name: str, place: tuple[float, float, float], around: _Around, diameter_m: float) -> PointCheck:
    """Comparison of a point with the returns around it."""
    middle = None
    if around.light is not None and len(around.light):
        middle = find_disc(around.xyz_m[:, :2], around.light, diameter_m, SEARCH_DIAMETERS * diameter_m)
    east, north = (place[0] + middle[0], place[1] + middle[1]) if middle is not None else (np.nan, np.nan)
    at = middle if middle is not None else np.zeros(2)
    close = np.hypot(*(around.xyz_m[:, :2] - at).T) <= RADIUS_M
    xyz, swath = around.xyz_m[close] - np.array([*at, 0.0]), around.swath[close]
    plane = local_plane(xyz)
    if plane is None:
        why = f"has {len(xyz)} returns within {RADIUS_M:g} m" + (", too few on all sides" if len(xyz) else "")
        return PointCheck(name, place, (east, north, np.nan), len(xyz), why_not=why)
    if plane.steepness > STEEPEST:
        found, why = (east, north, np.nan), "lies on an edge or a steep slope"
        return PointCheck(name, place, found, len(xyz), plane.steepness, why_not=why)
    found = (east, north, place[2] + plane.height_m)
    return PointCheck(name, place, found, len(xyz), plane.steepness, _swath_heights(xyz, swath, place[2]))


def _swath_heights(xyz_m: FloatArray, swath: NDArray[np.int64], base_m: float) -> SwathHeights:
    """Height at a point by swath."""
    planes = [(number, local_plane(xyz_m[swath == number])) for number in np.unique(swath).tolist()]
    known = [(number, plane) for number, plane in planes if plane is not None]
    if not known:
        return UNSEEN
    freedom = sum(plane.freedom for _, plane in known)
    squares = sum(float(np.sum(plane.above_m**2)) for _, plane in known)
    return SwathHeights(
        tuple((number, base_m + plane.height_m) for number, plane in known),
        float(np.sqrt(squares / freedom)) if freedom > 0 else float("nan"),
        max(plane.range_m for _, plane in known),
    )
