"""Several LAS, LAZ or COPC files read as one cloud in metres and one CRS."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import pyproj
from numpy.typing import NDArray

from furrowmap.core.geodesy.measurable_crs import is_in_metres
from furrowmap.core.pointclouds.cloud_crs import (
    MAX_FAR_SHARE,
    CloudSource,
    common_crs,
    first_bounds,
    horizontal_and_vertical,
)
from furrowmap.core.readers.areas.area import Area, nothing_within
from furrowmap.core.readers.las.cloud import Box, CloudFile, Survey, open_cloud
from furrowmap.core.readers.las.point_records import CloudBatch, TimeKind
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice, RefusedError, UsageError
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.values.crs import name_of
from furrowmap.core.values.no_heights import is_any
from furrowmap.core.values.scan import PointClass

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
        sources: of each file, by its path.
        area: points outside of it are left out; None for none.
    """

    files: tuple[CloudFile, ...]
    crs: pyproj.CRS
    sources: Mapping[Path, CloudSource]
    notices: tuple[Notice, ...]
    area: Area | None = None

    @property
    def units_m(self) -> tuple[float, ...]:
        """Metres in the units of the heights of the files, each once."""
        return tuple(dict.fromkeys(self.sources[file.path].unit_m for file in self.files))

    @property
    def as_recorded(self) -> bool:
        """Whether all coordinates are those of the files."""
        return self.units_m == (1.0,) and all(self.sources[file.path].change is None for file in self.files)

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
            source = self.sources[file.path]
            source_box = box if source.change is None else None
            for batch in file.batches(box=source_box):
                if source_box is None:
                    survey.add(batch)
                done += len(batch)
                kept = ~batch.withheld if wanted is None else wanted(file, batch) & ~batch.withheld
                if source.no_heights:
                    kept &= ~is_any(batch.xyz_m[:, 2], source.no_heights, file.header.scale[2])
                points = _placed(batch.where(kept), source)
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


def _placed(batch: CloudBatch, source: CloudSource) -> CloudBatch:
    xyz = batch.xyz_m
    if source.change is not None and len(batch):
        xyz = np.column_stack([*source.change(xyz[:, 0], xyz[:, 1]), xyz[:, 2]])
    if source.unit_m != 1.0:
        xyz = xyz * np.array([1.0, 1.0, source.unit_m])
    return replace(batch, xyz_m=xyz)


def is_ours(file: CloudFile) -> bool:
    """Whether furrowmap wrote a cloud: then classes 64 and 65 are the machine."""
    return file.header.software.startswith("furrowmap")


def open_clouds(
    paths: Sequence[Path],
    crs: pyproj.CRS | None = None,
    dst_crs: pyproj.CRS | None = None,
    *,
    without_option: bool = False,
) -> Clouds:
    """Open clouds that belong together.

    Args:
        paths: of LAS, LAZ or COPC files.
        crs: of files that do not state where on the Earth they are, with or without their heights; those of files that
            state the same horizontal CRS without heights.
        dst_crs: of the output, projected in metres; None for that of the files. With it their horizontal CRSs may
            differ.
        without_option: whether a user cannot choose `dst_crs` with --dst-crs, which errors name otherwise.

    Raises:
        UsageError: if a file is given twice.
        InputError: if a file cannot be read, the CRSs are unknown or differ, the heights are of several systems, or the
            CRS of the output is not projected in metres, or its scale far from one.
        RefusedError: if PROJ has no exact transformation to `dst_crs`.
    """
    given: dict[Path, Path] = {}
    for path in paths:
        first = given.setdefault(resolved(path), path)
        if first is not path:
            raise UsageError("cloud-twice", path=path, first=first)
    files = tuple(open_cloud(path) for path in paths)
    common = common_crs(files, crs, dst_crs, without_option=without_option)
    notices = [notice for file in files for notice in file.notices]
    return Clouds(files, common.crs, common.sources, tuple(dict.fromkeys([*notices, *common.notices])))


def open_to_measure(path: Path, crs: pyproj.CRS | None = None) -> Clouds:
    """A cloud in its CRS, or in another one in metres where nothing can be measured in its own, with a notice.

    Args:
        crs: of a file without one; the first choice of another one.

    Raises:
        InputError, RefusedError: as :func:`open_clouds`.
    """
    try:
        return open_clouds([path], crs)
    except InputError as error:
        if error.code not in ("crs-not-metres", "crs-distorted"):
            raise
        flat = horizontal_and_vertical(crs)[0] if crs is not None else None
        chosen = [flat] if flat is not None and is_in_metres(flat) else []
        if error.values["proposal"] is not None:
            chosen.append(pyproj.CRS(error.values["proposal"]))
        for target in chosen:
            with suppress(InputError, RefusedError):
                clouds = open_clouds([path], crs, target, without_option=True)
                moved = Notice("cloud-transformed", path=path.name, flat=name_of(target))
                return replace(clouds, notices=(*clouds.notices, moved))
        raise


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
        source = clouds.sources[clouds.files[0].path]
        west, south, east, north = first_bounds(clouds.files, source.flat) or (0.0, 0.0, 0.0, 0.0)
        at = 0.5 * (west + east), 0.5 * (south + north)
        if source.change is not None:
            x, y = source.change(np.array([at[0]]), np.array([at[1]]))
            at = float(x[0]), float(y[0])
        return nothing_within(
            clouds.area,
            Text("{points:,} points in {files} file(s)", points=clouds.points, files=len(clouds.files)),
            at if clouds.points else None,
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
    x = batch.xyz_m[:, 0]
    y = batch.xyz_m[:, 1]
    return batch.where((x >= box[0]) & (y >= box[1]) & (x <= box[2]) & (y <= box[3]))


FAR_GAP_M: Final = 1000.0
"""Gap to the others, along either axis."""
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
    squares = np.empty((0, 2))
    counts = np.empty(0, np.int64)
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
