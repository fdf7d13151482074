"""A cloud or a surface compared with surveyed points."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import pyproj
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from furrowmap.core.check_notices import accuracy_notices, precision_notices
from furrowmap.core.clouds import MACHINE, NOISE, Clouds, is_ours, open_clouds
from furrowmap.core.internal_precision import UNSEEN, InternalPrecision, SwathHeights, Told, swath_numbers, told_by
from furrowmap.core.local_plane import local_plane
from furrowmap.core.point_check import PointCheck, three
from furrowmap.core.positional_accuracy import Accuracy, Component
from furrowmap.core.readers.las.cloud import CloudFile
from furrowmap.core.readers.las.header import SIGNATURE
from furrowmap.core.readers.las.points import CloudBatch
from furrowmap.core.surface_at_points import Box, surface_at_points
from furrowmap.core.surveyed_points import SurveyedPoints, read_points
from furrowmap.core.target_discs import find_disc
from furrowmap.core.values.errors import InputError, Notice
from furrowmap.core.values.progress import Progress, silent

FloatArray = NDArray[np.float64]
Targets = Literal["none", "intensity", "colour"]

RADIUS_M: Final = 0.25
"""Returns up to so far from a point make the plane that it is compared with."""
STEEPEST: Final = 0.5
"""A steeper plane shows an edge, where a height depends on the place."""
SEARCH_DIAMETERS: Final = 3.0
"""A target is looked for up to so many of its diameters away."""


@dataclass(frozen=True)
class Check:
    """What surveyed points say of a product.

    Attributes:
        kind: "cloud" or "surface".
        crs: of the product.
        points: one for each surveyed point.
        accuracy: from those that could be compared.
        notices: what a user should know.
    """

    kind: str
    crs: pyproj.CRS
    points: tuple[PointCheck, ...]
    accuracy: Accuracy
    notices: tuple[Notice, ...]


def check_product(
    product: Path,
    points_file: Path,
    *,
    points_crs: pyproj.CRS | None = None,
    targets: Targets = "none",
    diameter_m: float = 0.3,
    sigma_m: float | None = None,
    class_m: float | None = None,
    progress: Progress = silent,
) -> Check:
    """Compare a cloud (LAS, LAZ, COPC) or a surface (GeoTIFF) with surveyed points.

    Args:
        product: the file.
        points_file: of the points; see :func:`furrowmap.core.surveyed_points.read_points`.
        points_crs: of a points file that states none, and of a cloud likewise.
        targets: by what of the returns discs are looked for, which show the horizontal error.
        diameter_m: of the discs.
        sigma_m: standard deviation of the survey along each axis, where the file states none.
        class_m: the vertical accuracy class that is asked for; None for none.
        progress: is told of the share of the cloud that was read.

    Raises:
        InputError: if a file cannot be read, or no point lies in the product.
        RefusedError: if PROJ cannot vouch for the way between their CRS.
    """
    if not product.is_file():
        raise InputError(
            f"{product} {'is a folder' if product.is_dir() else 'is not there'}.",
            "There is nothing to check.",
            "Give a cloud (LAS, LAZ, COPC) or a surface (GeoTIFF).",
            code="no-such-file",
        )
    with product.open("rb") as file:
        is_cloud = file.read(4) == SIGNATURE
    told: Told = "nothing"
    if is_cloud:
        clouds = _opened(product, points_crs)
        survey = read_points(points_file, clouds.crs, points_crs)
        reach = max(RADIUS_M, (SEARCH_DIAMETERS + 1.0) * diameter_m if targets != "none" else 0.0)
        (cloud,) = clouds.files
        own = is_ours(cloud)
        near = _near(clouds, survey, reach, progress, own=own)
        told = _told_by(near, own=own)
        checks = tuple(
            _at_cloud(survey, k, batch, targets, diameter_m)
            for k, batch in enumerate(_by_point(near, survey, reach, told, own=own))
        )
        crs, notices, bounds = (
            clouds.crs,
            [*clouds.notices, *survey.notices],
            (*cloud.header.low[:2], *cloud.header.high[:2]),
        )
    else:
        crs, checks, survey, bounds = surface_at_points(product, points_file, points_crs)
        notices = list(survey.notices)
    stated = np.where(np.isfinite(survey.sigma_m), survey.sigma_m, np.nan if sigma_m is None else sigma_m)
    accuracy = _accuracy(checks, stated, told)
    if accuracy.vertical is None:
        raise InputError(
            f"None of the {len(survey)} points in {points_file.name} lies where {product.name} has heights: "
            f"{checks[0].name} {checks[0].why_not}.",
            "There is nothing to compare.",
            _exchanged(survey, bounds)
            or "See in a GIS whether they lie together; name the points' CRS with --crs if it is another.",
            code="check-nowhere",
        )
    notices += accuracy_notices(checks, accuracy, class_m, targets=targets != "none")
    if is_cloud:
        notices += precision_notices(accuracy.precision, class_m)
    return Check("cloud" if is_cloud else "surface", crs, checks, accuracy, tuple(notices))


def _opened(product: Path, crs: pyproj.CRS | None) -> Clouds:
    """The cloud, in metres.

    Args:
        product: the file.
        crs: of the points: the cloud's as well where it states none, and what one in degrees is brought to.
    """
    try:
        return open_clouds([product], crs)
    except InputError as error:
        if error.code != "crs-not-metres":
            raise
        if crs is None or {axis.unit_name for axis in crs.axis_info} != {"metre"}:
            raise InputError(
                error.lines[0],
                "Points and returns are compared in metres.",
                "Name the points' CRS with --crs, projected and in metres; the cloud is brought to it.",
                code="crs-not-metres",
            ) from None
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


def _exchanged(survey: SurveyedPoints, box: Box) -> str:
    """What to do about points that lie in the product with easting and northing exchanged; empty where they do not."""
    north, east = survey.xyz_m[:, 0], survey.xyz_m[:, 1]
    inside = (east >= box[0]) & (east <= box[2]) & (north >= box[1]) & (north <= box[3])
    if not inside.any():
        return ""
    return (
        f"With easting and northing exchanged {int(inside.sum())} points lie in it: X is the northing in Japan's plane "
        "coordinates. Name the columns n_m and e_m."
    )


def _cells(xy_m: FloatArray, side_m: float, *, around: bool = False) -> NDArray[np.int64]:
    """Numbers of the square cells in which points (n, 2) lie, with those around them if `around`."""
    column, row = np.floor(xy_m / side_m).astype(np.int64).T
    if not around:
        return np.asarray((column << 32) + row, np.int64)
    shift = np.array([-1, 0, 1])
    return np.concatenate([((column + i) << 32) + row + j for i in shift for j in shift])


def _told_by(near: list[CloudBatch], *, own: bool) -> Told:
    """What tells the swaths of the returns around all points apart."""
    if not near:
        return "nothing"
    source, t_s = np.concatenate([part.point_source_id for part in near]), _seconds(near)
    return told_by(source, t_s, own=own)


def _seconds(near: list[CloudBatch]) -> FloatArray | None:
    """Times of returns, counted from no matter when; None where any has none."""
    times = [part.gps_time for part in near]
    known = [t_s for t_s in times if t_s is not None]
    return np.concatenate(known) if len(known) == len(times) else None


def _by_point(
    near: list[CloudBatch], survey: SurveyedPoints, reach_m: float, told: Told, *, own: bool
) -> Iterator[dict[str, Any]]:
    """For each point the returns around it, relative to it: place, brightness, swath."""
    if near:
        xyz = np.concatenate([part.xyz_m for part in near])
        intensity = np.concatenate([part.intensity for part in near]).astype(np.float64)
        source, t_s = np.concatenate([part.point_source_id for part in near]), _seconds(near)
        colours = [part.rgb for part in near]
        coloured = [colour for colour in colours if colour is not None]
        rgb = np.concatenate(coloured).astype(np.float64) if len(coloured) == len(near) else None
        tree = cKDTree(xyz[:, :2])
    for place in survey.xyz_m:
        index = tree.query_ball_point(place[:2], reach_m) if near else []
        yield {
            "xyz": xyz[index] - place if near else np.empty((0, 3)),
            "intensity": intensity[index] if near else np.empty(0),
            "swath": swath_numbers(source[index], t_s[index] if t_s is not None else None, told, own=own)
            if near
            else np.empty(0, np.int64),
            "colour": rgb[index] if near and rgb is not None else None,
        }


def _at_cloud(survey: SurveyedPoints, k: int, near: dict[str, Any], targets: Targets, diameter_m: float) -> PointCheck:
    """What the returns around a point say of it."""
    place = three(survey.xyz_m[k])
    middle = None
    if targets != "none":
        brightness = near["intensity"] if targets == "intensity" else near["colour"]
        if brightness is not None and len(brightness):
            light = brightness if brightness.ndim == 1 else brightness @ np.array([0.299, 0.587, 0.114])
            middle = find_disc(near["xyz"][:, :2], light, diameter_m, SEARCH_DIAMETERS * diameter_m)
    east, north = (place[0] + middle[0], place[1] + middle[1]) if middle is not None else (np.nan, np.nan)
    at = middle if middle is not None else np.zeros(2)
    close = np.hypot(*(near["xyz"][:, :2] - at).T) <= RADIUS_M
    xyz, swath = near["xyz"][close] - np.array([*at, 0.0]), near["swath"][close]
    plane = local_plane(xyz)
    if plane is None:
        why = f"has {len(xyz)} returns within {RADIUS_M:g} m" + (", too few on all sides" if len(xyz) else "")
        return PointCheck(survey.name[k], place, (east, north, np.nan), len(xyz), why_not=why)
    if plane.steepness > STEEPEST:
        found, why = (east, north, np.nan), "lies on an edge or a steep slope"
        return PointCheck(survey.name[k], place, found, len(xyz), plane.steepness, why_not=why)
    found = (east, north, place[2] + plane.height_m)
    return PointCheck(survey.name[k], place, found, len(xyz), plane.steepness, _swath_heights(xyz, swath, place[2]))


def _swath_heights(xyz_m: FloatArray, swath: NDArray[np.int64], base_m: float) -> SwathHeights:
    """What each swath says of a place."""
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


def _accuracy(checks: tuple[PointCheck, ...], sigma_m: FloatArray, told: Told) -> Accuracy:
    error = np.array([check.error_m for check in checks])
    parts: list[Component | None] = []
    for axis in range(3):
        known = np.isfinite(error[:, axis])
        parts.append(Component.of(error[known, axis], sigma_m[known, axis]) if known.any() else None)
    precision = InternalPrecision.of((check.swaths for check in checks), told)
    return Accuracy(vertical=parts[2], easting=parts[0], northing=parts[1], precision=precision)
