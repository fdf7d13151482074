"""Several LAS, LAZ or COPC files read as one cloud in metres and one CRS."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import pyproj
from numpy.typing import NDArray

from furrowmap.core.geodesy.crs_change import CrsChange, bounds_in, crs_change
from furrowmap.core.geodesy.measurable_crs import Bounds, expect_map, is_in_metres, proposed_crs
from furrowmap.core.readers.areas.area import Area, nothing_within
from furrowmap.core.readers.las.cloud import Box, CloudFile, Survey, open_cloud
from furrowmap.core.readers.las.points import CloudBatch, TimeKind
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice, RefusedError, UsageError
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.values.crs import full_name_of, name_of
from furrowmap.core.values.height_units import compound_crs, in_metres, vertical_unit_m
from furrowmap.core.values.scan import PointClass

SAME_PLACE_M: Final = 1e-4
SAME_UNIT: Final = 1e-5
"""The international and the US survey foot differ by 2e-6 of their length."""
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
class CloudSource:
    """The CRS of a file of several, and what takes its points to that of all.

    Attributes:
        crs: as the file states it, or the user where it states none.
        flat: its horizontal part.
        change: transformation from `flat`; None where that is the CRS of all.
        unit_m: metres in the unit of the heights.
    """

    crs: pyproj.CRS
    flat: pyproj.CRS
    change: CrsChange | None
    unit_m: float


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
    notices = [notice for file in files for notice in file.notices]
    whole = [_source_crs(file, crs, notices) for file in files]
    vertical = _common_heights(files, whole)
    places = _places(files, whole)
    if dst_crs is None:
        target, changes = _common_map(files, places, notices)
    else:
        target = _parts(dst_crs)[0]
        if not without_option:
            _expect_heights(dst_crs, vertical, target)
        changes = _changes(places, target, notices, without_option=without_option)
    sources = {}
    for file, source, place in zip(files, whole, places, strict=True):
        # without a vertical CRS heights have the unit of the horizontal one, as is usual in LAS files
        unit_m = vertical_unit_m(source) or 1.0
        if unit_m != 1.0:
            notices.append(Notice("heights-in-feet", unit_m=unit_m))
        sources[file.path] = CloudSource(source, place.flat, changes[place.flat], unit_m)
    output = target if vertical is None else compound_crs(target, vertical)
    return Clouds(files, output, sources, tuple(dict.fromkeys(notices)))


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
        flat = _parts(crs)[0] if crs is not None else None
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
        west, south, east, north = _bounds(clouds.files, source.flat) or (0.0, 0.0, 0.0, 0.0)
        at = 0.5 * (west + east), 0.5 * (south + north)
        if source.change is not None:
            x, y = source.change(np.array([at[0]]), np.array([at[1]]))
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


def _source_crs(file: CloudFile, crs: pyproj.CRS | None, notices: list[Notice]) -> pyproj.CRS:
    """The CRS of a file: its own, or the stated one where it has none of a place on the Earth."""
    if file.crs is None:
        if crs is None:
            raise InputError(
                "crs-missing", file=file.path, is_file=any(notice.code == "crs-unreadable" for notice in file.notices)
            )
        return crs
    flat, height = _parts(file.crs)
    if flat.is_geocentric:
        raise InputError("crs-geocentric", file=file.path, crs=full_name_of(file.crs))
    if not (flat.is_projected or flat.is_geographic):
        return _georeferenced(file, crs, notices)
    if height is not None or crs is None or vertical_unit_m(file.crs) != 1.0:
        return file.crs
    stated, stated_height = _parts(crs)
    if stated_height is None or not _same_map(flat, stated, _bounds([file], flat)):
        return file.crs
    return compound_crs(flat, stated_height)


def _georeferenced(file: CloudFile, crs: pyproj.CRS | None, notices: list[Notice]) -> pyproj.CRS:
    """The stated CRS of a file in a local one, or in one of heights alone."""
    assert file.crs is not None
    own = full_name_of(file.crs)
    if crs is None:
        raise InputError("crs-local", file=file.path, crs=own)
    flat, height = _parts(file.crs)
    stated, stated_height = _parts(crs)
    if flat.is_vertical:
        return crs if stated_height is not None else compound_crs(stated, flat)
    units_m = [one.axis_info[0].unit_conversion_factor for one in (flat, stated)]
    names = [one.axis_info[0].unit_name for one in (flat, stated)]
    if not stated.is_geographic and not math.isclose(*units_m, rel_tol=SAME_UNIT):
        raise InputError("crs-local.unit", file=file.path, crs=own, unit=names[0], stated=name_of(crs), other=names[1])
    notices.append(Notice("crs-of-local", path=file.path.name, crs=own, stated=name_of(crs)))
    return crs if height is None or stated_height is not None else compound_crs(stated, height)


def _common_heights(files: Sequence[CloudFile], whole: Sequence[pyproj.CRS]) -> pyproj.CRS | None:
    """The vertical CRS of all files, in metres; None where none states one."""
    found = [_parts(in_metres(crs) or crs)[1] for crs in whole]
    first = found[0]
    for file, crs, other in zip(files, whole, found, strict=True):
        if other is first or (first is not None and other is not None and _same_heights(first, other)):
            continue
        option = None
        if first is None or other is None:
            option = _compound_code(whole[0] if first is None else crs, first or other)
        raise InputError(
            "heights-differ-in-clouds",
            first_file=files[0].path,
            first=first.name if first is not None else None,
            file=file.path,
            other=other.name if other is not None else None,
            option=option,
        )
    return first


def _same_heights(one: pyproj.CRS, other: pyproj.CRS) -> bool:
    """Whether two vertical CRSs in metres are the same, whatever the names that WKT 1 gives them."""
    if one.equals(other):
        return True
    codes = [crs.to_epsg(min_confidence=20) for crs in (one, other)]
    return codes[0] is not None and codes[0] == codes[1]


def _same_map(one: pyproj.CRS, other: pyproj.CRS, bounds: Bounds | None) -> bool:
    """Whether two horizontal CRSs are the same, whatever the names that WKT 1 gives them."""
    if one.equals(other, ignore_axis_order=True):
        return True
    bases = [crs.geodetic_crs for crs in (one, other)]
    if bounds is None or bases[0] is None or bases[1] is None or one.is_projected != other.is_projected:
        return False
    codes = [base.to_epsg(min_confidence=20) for base in bases if base is not None]
    if codes[0] is None or codes[0] != codes[1]:
        return False
    at = 0.5 * (bounds[0] + bounds[2]), 0.5 * (bounds[1] + bounds[3])
    there = pyproj.Transformer.from_crs(one, other, always_xy=True).transform(*at)
    return math.dist(at, there) < SAME_PLACE_M


def _compound_code(flat: pyproj.CRS, vertical: pyproj.CRS | None) -> str | None:
    """The codes of a CRS and of heights as --crs takes them; None where one has no code."""
    codes = [crs.to_authority() for crs in (_parts(flat)[0], vertical) if crs is not None]
    if len(codes) < 2 or codes[0] is None or codes[1] is None or codes[0][0] != codes[1][0]:
        return None
    return f"{codes[0][0]}:{codes[0][1]}+{codes[1][1]}"


@dataclass(frozen=True)
class _FilePlace:
    """The horizontal CRS of a file, and the bounds of some of the points in it; None without points."""

    flat: pyproj.CRS
    bounds: Bounds | None


def _places(files: Sequence[CloudFile], whole: Sequence[pyproj.CRS]) -> list[_FilePlace]:
    """Where the files are; the first points of files of one CRS stand for all of them."""
    found: dict[pyproj.CRS, _FilePlace] = {}
    for crs in whole:
        flat = _parts(crs)[0]
        if flat not in found:
            same = [file for file, other in zip(files, whole, strict=True) if _parts(other)[0] == flat]
            bounds = _bounds(same, flat)
            found[flat] = _FilePlace(_identify_crs(flat, bounds) if bounds is not None else flat, bounds)
    return [found[_parts(crs)[0]] for crs in whole]


def _common_map(
    files: Sequence[CloudFile], places: Sequence[_FilePlace], notices: list[Notice]
) -> tuple[pyproj.CRS, dict[pyproj.CRS, CrsChange | None]]:
    """The horizontal CRS that all files have, and that none of them needs a transformation to it."""
    known = _known(places)
    first = places[0].flat
    for file, place in zip(files, places, strict=True):
        if not _same_map(first, place.flat, place.bounds):
            raise InputError(
                "crs-mixed",
                first_file=files[0].path,
                first=full_name_of(first),
                file=file.path,
                other=full_name_of(place.flat),
                proposal=proposed_crs(known),
            )
    stated_by = str(files[0].path) if files[0].crs is not None else f"{files[0].path} (--crs)"
    notices += expect_map(first, known[:1], stated_by=stated_by)
    return first, {place.flat: None for place in places}


def _changes(
    places: Sequence[_FilePlace], target: pyproj.CRS, notices: list[Notice], *, without_option: bool
) -> dict[pyproj.CRS, CrsChange | None]:
    """The transformation from each horizontal CRS of the files to another one; None where they are the same."""
    known = _known(places)
    changes: dict[pyproj.CRS, CrsChange | None] = {}
    try:
        notices += expect_map(target, known)
        for place in places:
            if place.flat in changes:
                continue
            change = None
            if not _same_map(place.flat, target, place.bounds):
                change = crs_change(place.flat, target, place.bounds or (0.0, 0.0, 0.0, 0.0))
                notices += change.notices
            changes[place.flat] = change
    except RefusedError as error:
        if without_option or error.code not in ("crs-change-grid", "crs-change-unknown", "crs-change-outside"):
            raise
        raise RefusedError(f"{error.code}.dst", **error.values, proposal=proposed_crs(known)) from None
    return changes


def _known(places: Sequence[_FilePlace]) -> list[tuple[pyproj.CRS, Bounds]]:
    """Where files with points are, a place for each horizontal CRS."""
    found = {place.flat: place.bounds for place in places}
    return [(flat, bounds) for flat, bounds in found.items() if bounds is not None]


def _expect_heights(dst_crs: pyproj.CRS, vertical: pyproj.CRS | None, target: pyproj.CRS) -> None:
    """Refuse a CRS of the output with other heights than those of the files: they are not transformed."""
    stated = _parts(dst_crs)[1]
    if stated is None or (vertical is not None and _same_heights(stated, vertical)):
        return
    raise InputError(
        "heights-not-transformed",
        stated=stated.name,
        own=vertical.name if vertical is not None else None,
        flat=name_of(target),
    )


def _parts(crs: pyproj.CRS) -> tuple[pyproj.CRS, pyproj.CRS | None]:
    """Horizontal and vertical part."""
    if crs.is_compound:
        horizontal, vertical = crs.sub_crs_list[:2]
        return horizontal.to_2d(), vertical
    return crs.to_2d(), None


def _identify_crs(flat: pyproj.CRS, place: Bounds) -> pyproj.CRS:
    """The EPSG definition of a CRS that files give as WKT 1 only, where it is the same; else the CRS itself."""
    # WKT 1 has no axis order and no conversion names, so that equal CRS do not compare as equal.
    code = flat.to_epsg(min_confidence=20) if flat.to_epsg() is None else None
    if code is None:
        return flat
    known = pyproj.CRS.from_epsg(code)
    x, y = 0.5 * (place[0] + place[2]), 0.5 * (place[1] + place[3])
    there = pyproj.Transformer.from_crs(flat, known, always_xy=True).transform(x, y)
    return known if known.name == flat.name and math.dist((x, y), there) < SAME_PLACE_M else flat


def _bounds(files: Sequence[CloudFile], flat: pyproj.CRS) -> Bounds | None:
    """Bounds of the first points but a few that may lie far off; those of headers may be wrong. None without points."""
    for file in files:
        for batch in file.batches(batch_points=10_000):
            if len(batch):
                xy = batch.xyz_m[:, :2]
                low = np.quantile(xy, MAX_FAR_SHARE, axis=0, method="lower")
                high = np.quantile(xy, 1.0 - MAX_FAR_SHARE, axis=0, method="higher")
                return bounds_in(flat, xy[((xy >= low) & (xy <= high)).all(axis=1)])
    return None


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
