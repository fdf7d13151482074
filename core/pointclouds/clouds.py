"""Several LAS, LAZ or COPC files read as one cloud in metres and one CRS."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import pyproj
from numpy.typing import NDArray
from pyproj.crs import CompoundCRS

from furrowmap.core.geodesy.crs_change import CrsChange, crs_change
from furrowmap.core.geodesy.crs_choice import choose_crs
from furrowmap.core.readers.areas.area import Area, nothing_within
from furrowmap.core.readers.las.cloud import Box, CloudFile, Survey, open_cloud
from furrowmap.core.readers.las.points import CloudBatch, TimeKind
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice, UsageError
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.values.crs import full_name_of
from furrowmap.core.values.height_units import with_height_unit
from furrowmap.core.values.scan import PointClass

SAME_PLACE_M: Final = 1e-4
NOISE_CLASSES: Final = (7, 18)
"""Low and high noise (LAS 1.4 R15, table 17)."""
MACHINE_CLASSES: Final = (PointClass.VEHICLE, PointClass.IMPLEMENT)
"""Classes of furrowmap's own clouds."""


@dataclass(frozen=True)
class CloudPoints:
    """n selected points: (n, 3) in the CRS of the :class:`Clouds`, UTC (n,) or None, ground (n,) by the file."""

    xyz_m: FloatArray
    t_s: FloatArray | None
    ground: NDArray[np.bool_]


@dataclass(frozen=True)
class Clouds:
    """Clouds read as one.

    Attributes:
        crs: of the output, projected in metres, with a vertical part where known.
        change: transformation from the horizontal CRS of the files; None where they agree.
        unit_m: unit of the heights of the files.
        area: points outside of it are left out; None for none.
    """

    files: tuple[CloudFile, ...]
    crs: pyproj.CRS
    change: CrsChange | None
    unit_m: float
    notices: tuple[Notice, ...]
    area: Area | None = None

    @property
    def points(self) -> int:
        """Number of points in all files."""
        return sum(file.points for file in self.files)

    @property
    def week_times(self) -> bool:
        """Whether all times are seconds of an unknown GPS week."""
        kinds = {file.clock for file in self.files if file.header.has_time}
        return kinds == {TimeKind.WEEK}

    def batches(
        self,
        box: Box | None = None,
        classes: frozenset[int] | None = None,
        seen: Callable[[Survey], None] | None = None,
        read: Callable[[int], None] | None = None,
    ) -> Iterator[CloudPoints]:
        """The points, file by file.

        Args:
            box: west, south, east, north in `crs`; None for all points.
            classes: to select; None for all but noise and, in furrowmap's own clouds, vehicle and implement.
            seen: receives the survey of each file that was read completely.
            read: receives the number of points read so far.

        Raises:
            InputError: if points are damaged.
            RefusedError: if they lie outside the domain of the CRS.
        """
        own = [*NOISE_CLASSES, *MACHINE_CLASSES]

        def wanted(file: CloudFile, batch: CloudBatch) -> NDArray[np.bool_]:
            if classes is not None:
                return np.isin(batch.classification, list(classes))
            return ~np.isin(batch.classification, own if is_ours(file) else NOISE_CLASSES)

        for _, batch in self.whole_batches(box, wanted, seen, read):
            yield CloudPoints(batch.xyz_m, batch.t_s, batch.classification == PointClass.GROUND)

    def whole_batches(
        self,
        box: Box | None = None,
        wanted: Callable[[CloudFile, CloudBatch], NDArray[np.bool_]] | None = None,
        seen: Callable[[Survey], None] | None = None,
        read: Callable[[int], None] | None = None,
    ) -> Iterator[tuple[CloudFile, CloudBatch]]:
        """The points with all attributes in `crs` and metres, without those with the *withheld* flag.

        `wanted` selects points of a batch. Raises errors as :meth:`batches`.
        """
        done = 0
        box = self.selected(box)
        for file in self.files:
            survey = Survey(file)
            source_box = box if self.change is None else None
            for batch in file.batches(box=source_box):
                if source_box is None:
                    survey.add(batch)
                done += len(batch)
                kept = ~batch.withheld if wanted is None else wanted(file, batch) & ~batch.withheld
                points = self._placed(batch.where(kept))
                points = points if source_box is box else _within(points, box)
                yield file, points if self.area is None else points.where(self.area.contains(points.xyz_m))
                if read is not None:
                    read(done)
            if seen is not None and source_box is None:
                seen(survey)

    def selected(self, box: Box | None) -> Box | None:
        """What a box has in common with that of the area; None where there is neither."""
        if self.area is None or box is None:
            return box if self.area is None else self.area.bounds_m
        west, south, east, north = self.area.bounds_m
        return max(box[0], west), max(box[1], south), min(box[2], east), min(box[3], north)

    def _placed(self, batch: CloudBatch) -> CloudBatch:
        xyz = batch.xyz_m
        if self.change is not None and len(batch):
            xyz = np.column_stack([*self.change(xyz[:, 0], xyz[:, 1]), xyz[:, 2]])
        if self.unit_m != 1.0:
            xyz = xyz * np.array([1.0, 1.0, self.unit_m])
        return replace(batch, xyz_m=xyz)


def is_ours(file: CloudFile) -> bool:
    """Whether furrowmap wrote a cloud: then classes 64 and 65 are the machine."""
    return file.header.software.startswith("furrowmap")


def open_clouds(paths: Sequence[Path], crs: pyproj.CRS | None = None, dst_crs: pyproj.CRS | None = None) -> Clouds:
    """Open clouds that belong together.

    Args:
        paths: of LAS, LAZ or COPC files.
        crs: of files without one.
        dst_crs: of the output, projected in metres; None for that of the files.

    Raises:
        UsageError: if a file is given twice.
        InputError: if a file cannot be read, the CRS are unknown or differ, or the output CRS is not projected in
            metres.
        RefusedError: if PROJ has no exact transformation to `dst_crs`.
    """
    given: dict[Path, Path] = {}
    for path in paths:
        first = given.setdefault(resolved(path), path)
        if first is not path:
            raise UsageError("cloud-twice", path=path, first=first)
    files = tuple(open_cloud(path) for path in paths)
    source = _common_crs(files, crs)
    flat, height = _parts(source)
    flat = _identify_crs(flat, _place(files))
    notices = [notice for file in files for notice in file.notices]
    change = None
    if dst_crs is not None:
        target, _ = _parts(dst_crs)
        _require_metres(target, "--dst-crs", files, source)
        if not flat.equals(target, ignore_axis_order=True):
            change = crs_change(flat, target, _place(files))
            notices += change.notices
    else:
        _require_metres(flat, str(files[0].path), files, source)
        target = flat
    unit_m = 1.0  # without a vertical CRS heights have the unit of the horizontal one, as is usual in LAS files
    if height is not None or flat.is_projected:
        unit_m = float((height or flat).axis_info[0].unit_conversion_factor)
    if unit_m != 1.0:
        notices.append(Notice("heights-in-feet", unit_m=unit_m))
    whole = target
    if height is not None:
        metric = height if unit_m == 1.0 else with_height_unit(height, 1.0, "metre")
        whole = CompoundCRS(f"{target.name} + {metric.name}", [target, metric])
    return Clouds(files, whole, change, unit_m, tuple(notices))


def box_in(clouds: Clouds, box: Box | None, box_crs: pyproj.CRS | None) -> Box | None:
    """The box of the points to use: what a box, in a CRS of its own, and the area of the clouds have in common."""
    if box is None or box_crs is None:
        return clouds.selected(box)
    change = pyproj.Transformer.from_crs(box_crs.to_2d(), clouds.crs.to_2d(), always_xy=True)
    west, south, east, north = change.transform_bounds(*box)
    return clouds.selected((west, south, east, north))


def no_points_error(clouds: Clouds, box: Box | None) -> InputError:
    """The error where no point is selected."""
    if clouds.area is not None:
        west, south, east, north = _place(clouds.files)
        at = 0.5 * (west + east), 0.5 * (south + north)
        if clouds.change is not None:
            x, y = clouds.change(np.array([at[0]]), np.array([at[1]]))
            at = float(x[0]), float(y[0])
        return nothing_within(
            clouds.area, f"{clouds.points:,} points in {len(clouds.files)} file(s)", at if clouds.points else None
        )
    return InputError(
        "no-points-left",
        points=clouds.points,
        files=len(clouds.files),
        box=", ".join(f"{value:g}" for value in box) if box is not None else None,
    )


def _within(batch: CloudBatch, box: Box | None) -> CloudBatch:
    if box is None:
        return batch
    x, y = batch.xyz_m[:, 0], batch.xyz_m[:, 1]
    return batch.where((x >= box[0]) & (y >= box[1]) & (x <= box[2]) & (y <= box[3]))


def _common_crs(files: Sequence[CloudFile], crs: pyproj.CRS | None) -> pyproj.CRS:
    """The CRS of all files."""
    found: list[tuple[CloudFile, pyproj.CRS]] = []
    for file in files:
        stated = file.crs or crs
        if stated is None:
            raise InputError(
                "crs-missing", file=file.path, is_file=any(notice.code == "crs-unreadable" for notice in file.notices)
            )
        found.append((file, stated))
    first_file, first = found[0]
    for file, other in found[1:]:
        if not first.equals(other, ignore_axis_order=True):
            raise InputError(
                "crs-mixed",
                first_file=first_file.path,
                first=full_name_of(first),
                file=file.path,
                other=full_name_of(other),
            )
    return first


def _parts(crs: pyproj.CRS) -> tuple[pyproj.CRS, pyproj.CRS | None]:
    """Horizontal and vertical part."""
    if crs.is_compound:
        horizontal, vertical = crs.sub_crs_list[:2]
        return horizontal.to_2d(), vertical
    return crs.to_2d(), None


def _identify_crs(flat: pyproj.CRS, place: Box) -> pyproj.CRS:
    """The EPSG definition of a CRS that files give as WKT 1 only, where it is the same; else the CRS itself."""
    # WKT 1 has no axis order and no conversion names, so that equal CRS do not compare as equal.
    code = flat.to_epsg(min_confidence=20) if flat.to_epsg() is None else None
    if code is None:
        return flat
    known = pyproj.CRS.from_epsg(code)
    x, y = 0.5 * (place[0] + place[2]), 0.5 * (place[1] + place[3])
    there = pyproj.Transformer.from_crs(flat, known, always_xy=True).transform(x, y)
    return known if known.name == flat.name and math.dist((x, y), there) < SAME_PLACE_M else flat


def _require_metres(flat: pyproj.CRS, stated_by: str, files: Sequence[CloudFile], source: pyproj.CRS) -> None:
    """Raises InputError where the CRS stated by a file or option is not projected in metres."""
    if flat.is_projected and all(axis.unit_conversion_factor == 1.0 for axis in flat.axis_info):
        return
    units = " and ".join(sorted({axis.unit_name for axis in flat.axis_info}))
    raise InputError(
        "crs-not-metres", stated_by=stated_by, flat=full_name_of(flat), units=units, files=_proposal(files, source)
    )


def _proposal(files: Sequence[CloudFile], source: pyproj.CRS) -> str:
    flat, _ = _parts(source)
    geographic = flat.geodetic_crs
    if geographic is None:
        return ""
    west, south, east, north = _place(files)
    to_degrees = pyproj.Transformer.from_crs(flat, geographic.to_2d(), always_xy=True)
    lon, lat = to_degrees.transform(0.5 * (west + east), 0.5 * (south + north))
    choice = choose_crs(lon, lat) if np.isfinite([lon, lat]).all() else None
    return f", such as --dst-crs {choice.code}" if choice is not None else ""


def _place(files: Sequence[CloudFile]) -> Box:
    """Box of the first points, as those of headers may be wrong."""
    for file in files:
        for batch in file.batches(batch_points=10_000):
            (west, south), (east, north) = batch.xyz_m[:, :2].min(axis=0), batch.xyz_m[:, :2].max(axis=0)
            return float(west), float(south), float(east), float(north)
    return 0.0, 0.0, 0.0, 0.0


FAR_GAP_M: Final = 1000.0
"""Gap to the others, along either axis."""
MAX_FAR_SHARE: Final = 0.001
"""Largest share of points that are left out."""
SPARSE_PER_M2: Final = 0.01
"""Only clouds with fewer points on the rectangle of their header are searched."""
_SIDE_M: Final = 100.0


def near_box(clouds: Clouds, progress: Progress = silent) -> tuple[Box | None, tuple[Notice, ...]]:
    """The box of all points but a few that lie far off, and a warning; None where there are none.

    Raises InputError if a file is damaged.
    """
    sides = [np.subtract(file.header.high[:2], file.header.low[:2]) for file in clouds.files if file.points]
    sparse = [
        file.points < SPARSE_PER_M2 * float(np.prod(side)) and float(np.max(side)) > FAR_GAP_M
        for file, side in zip((file for file in clouds.files if file.points), sides, strict=True)
    ]
    if not any(sparse):
        return None, ()
    total = max(clouds.points, 1)
    squares, counts = np.empty((0, 2)), np.empty(0, np.int64)
    for batch in clouds.batches(read=lambda done: progress("looking for far points", done / total)):
        found, number = np.unique(np.floor(batch.xyz_m[:, :2] / _SIDE_M), axis=0, return_counts=True)
        squares, inverse = np.unique(np.concatenate([squares, found]), axis=0, return_inverse=True)
        counts = np.bincount(inverse.ravel(), np.concatenate([counts, number]), len(squares)).astype(np.int64)
    near = _near(squares[:, 0], counts) & _near(squares[:, 1], counts) if len(squares) else np.ones(0, bool)
    far = int(counts[~near].sum())
    if not 0 < far <= MAX_FAR_SHARE * counts.sum():
        return None, ()
    west, south = (squares[near].min(axis=0) * _SIDE_M).tolist()
    east, north = ((squares[near].max(axis=0) + 1.0) * _SIDE_M).tolist()
    return (west, south, east, north), (
        Notice(
            "points-far",
            far=far,
            counts=int(counts.sum()),
            far_m=FAR_GAP_M,
            west=west,
            south=south,
            east=east,
            north=north,
        ),
    )


def _near(place: NDArray[np.float64], counts: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which squares are of a group with many points; groups are divided by gaps along an axis."""
    order = np.argsort(place, kind="stable")
    group = np.empty(len(place), np.int64)
    group[order] = np.cumsum(np.diff(place[order], prepend=place[order[0]]) > FAR_GAP_M / _SIDE_M)
    held = np.bincount(group, counts)
    kept: NDArray[np.bool_] = (held > MAX_FAR_SHARE * counts.sum())[group]
    return kept
