"""Cleaning of clouds: outlier removal, ground classification and thinning, square by square in bounded memory."""

import math
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, Final, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.pointclouds.cleaning_steps import Cleaning
from furrowmap.core.pointclouds.joined_clouds import MACHINE_CLASSES, NOISE_CLASSES, Clouds, is_ours
from furrowmap.core.readers.las.cloud import CloudFile, Survey
from furrowmap.core.readers.las.point_records import CloudBatch
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.background import ahead, in_turn
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.runtime.record_spool import RecordArray, RecordSpool, Square, square_keys, square_of
from furrowmap.core.runtime.settings import threads
from furrowmap.core.surfaces.ground_filter import SMRF, GroundMethod, GroundRaster, ground_of_points
from furrowmap.core.surfaces.outliers import (
    OUTLIER_REACH_M,
    NeighbourStatistics,
    Outliers,
    mean_distance_to,
    mean_neighbour_distance,
    radius_outliers,
    thin_points,
)
from furrowmap.core.values.extents import bounds
from furrowmap.core.values.scan import PointClass

Found = TypeVar("Found")

GROUND_WINDOW_M: Final = 256.0
"""Side of the squares in which the ground is found, with the lowest points around; whole blocks lie in each."""
LOWS_SIDE_M: Final = 64.0
"""Side of the squares by which the lowest points are kept."""
BLOCK_M: Final = 128.0
"""Side of the largest block."""
SQUARE_M: Final = 16.0
DENSE_SQUARE_M: Final = 2.0
"""Sides of the squares, the smallest blocks; a driving scanner records ten thousand points per square metre."""
DENSE: Final = 200.0
"""Density by bounding boxes, in points per square metre, from which on the small squares are used."""
FIRST_RADIUS_M: Final = 1.0
"""First search radius; only points with too few neighbours in it are compared with more distant ones."""
BLOCK_POINTS: Final = 500_000
"""Blocks with more points are quartered, down to one square."""
SPOOLED_POINT: Final = np.dtype([
    ("xyz_m", "<f8", 3), ("t_s", "<f8"), ("intensity", "<u2"), ("point_source_id", "<u2"), ("rgb", "<u2", 3),
    ("classification", "u1"), ("return_number", "u1"), ("returns", "u1"), ("apart_m", "<f4"), ("noise", "?"),
    ("machine", "?"),
])  # fmt: skip
"""A point. `t_s` is UTC, seconds of a week where all clouds have those, or nan. Noise and machine are never ground.
`apart_m` is the mean neighbour distance, where needed; inf for an isolated point."""
SPOOLED_XYZ: Final = np.dtype(("<f8", 3))
BATCHES_AHEAD: Final = 2
"""Batches of points that are read while others are sorted into squares."""


class SquareSpool(RecordSpool):
    """RecordArray by square of the map."""

    def __init__(self, layout: np.dtype[Any], folder: Path, side_m: float) -> None:
        super().__init__(layout, folder)
        self.side_m = side_m

    def keys(self, squares: Iterable[Square]) -> NDArray[np.int64]:
        """Keys of squares."""
        return square_keys(*np.reshape(list(squares), (-1, 2)).T)

    def add_at(self, place_m: FloatArray, records: RecordArray) -> None:
        """Append records (n,) under the squares in which places (n, 2) lie."""
        self.add(records, square_keys(*np.floor(place_m.T / self.side_m)))

    def read_squares(self, squares: Iterable[Square]) -> RecordArray:
        """The records of squares, one square after the other."""
        return self.read(self.keys(squares))


def clean_points(
    clouds: Clouds,
    cleaning: Cleaning,
    folder: Path,
    seen: Callable[[Survey], None] | None = None,
    progress: Progress = silent,
) -> Generator[RecordArray, None, None]:
    """The cleaned points of clouds in batches, in reproducible order.

    Args:
        seen: receives the survey of each file that was read completely.
        progress: receives the stages "reading clouds", "looking for noise" and "cleaning clouds".

    Yields:
        (n,) records of :data:`SPOOLED_POINT`.

    Raises:
        InputError: if a file is damaged, or the library of the ground method is not installed.
        RefusedError: if points lie outside the domain of the CRS.
        OSError: if the temporary files cannot be written.
    """
    points = _read_ahead(clouds, cleaning, seen, progress)
    if cleaning.outliers == "none" and cleaning.ground == "none" and cleaning.voxel_m is None:
        yield from (chosen(records, ~(records["noise"] & cleaning.drop_noise)) for records in points)
        return
    with ExitStack() as stack:
        side_m = square_side_m(clouds)
        spool = stack.enter_context(SquareSpool(SPOOLED_POINT, folder, side_m))
        few = stack.enter_context(SquareSpool(SPOOLED_XYZ, folder, side_m))
        lows = stack.enter_context(SquareSpool(SPOOLED_XYZ, folder, LOWS_SIDE_M))
        for records in points:
            # A voxel belongs to the square of its corner.
            flat = records["xyz_m"][:, :2]
            corner = flat if cleaning.voxel_m is None else np.floor(flat / cleaning.voxel_m) * cleaning.voxel_m
            spool.add_at(corner, records)
        parts = blocks(spool)
        squares = [square for block in parts for square in block]
        usual = NeighbourStatistics()
        if cleaning.outliers == "statistical":
            for square in squares:
                records = spool.read_squares([square])
                some = thin_points(records["xyz_m"][~records["noise"]])  # neighbours of isolated points
                few.add(some, np.repeat(few.keys([square]), len(some)))
        if cleaning.outliers != "none":
            for number, block in enumerate(parts, 1):
                _measure(spool, few, block, cleaning.outliers, cleaning.voxel_m or 0.0, usual)
                progress("looking for noise", number / len(parts))

        def cleaned(ground: GroundRaster | None, block: list[Square]) -> RecordArray:
            records = _with_outliers(spool.read_squares(block), usual)
            records["classification"][records["noise"] & ~np.isin(records["classification"], NOISE_CLASSES)] = (
                PointClass.NOISE
            )
            if cleaning.ground != "none":
                _classify_ground(records, ground)
            kept = ~(records["noise"] & cleaning.drop_noise)
            if cleaning.voxel_m is not None:
                kept[kept] = _one_a_cube(chosen(records, kept), cleaning.voxel_m)
            return chosen(records, kept)

        with ThreadPoolExecutor(threads()) as pool:
            if cleaning.ground != "none":
                _add_lows(spool, parts, usual, lows, pool)
            yield from _by_ground(cleaned, pool, parts, lows, cleaning.ground, side_m, progress)


@contextmanager
def classified_spool(
    clouds: Clouds,
    cleaning: Cleaning,
    folder: Path,
    seen: Callable[[Survey], None] | None = None,
    progress: Progress = silent,
) -> Iterator[SquareSpool]:
    """The points of clouds by square, their ground classified: a context manager that removes them at its end.

    Progress is of the stages "reading clouds" and "cleaning clouds". Raises errors as :func:`clean_points`.
    """
    side_m = square_side_m(clouds)
    with SquareSpool(SPOOLED_POINT, folder, side_m) as spool, SquareSpool(SPOOLED_XYZ, folder, LOWS_SIDE_M) as lows:
        for records in _read_ahead(clouds, cleaning, seen, progress):
            spool.add_at(records["xyz_m"][:, :2], records)
        if cleaning.ground != "none":
            parts = blocks(spool)

            def classify(ground: GroundRaster | None, block: list[Square]) -> None:
                records = spool.read_squares(block)
                _classify_ground(records, ground)
                spool.overwrite(spool.keys(block), records)

            with ThreadPoolExecutor(threads()) as pool:
                _add_lows(spool, parts, NeighbourStatistics(), lows, pool)
                for _ in _by_ground(classify, pool, parts, lows, cleaning.ground, side_m, progress):
                    pass
        yield spool


def _read_ahead(
    clouds: Clouds, cleaning: Cleaning, seen: Callable[[Survey], None] | None, progress: Progress
) -> Iterator[RecordArray]:
    """The points after the steps that need no neighbours, read by another thread."""
    done = [0.0]
    for records in ahead(_wanted(clouds, cleaning, seen, done), BATCHES_AHEAD):
        progress("reading clouds", done[-1])
        yield records


def _wanted(
    clouds: Clouds, cleaning: Cleaning, seen: Callable[[Survey], None] | None, done: list[float]
) -> Iterator[RecordArray]:
    """The same in this thread; the last of `done` is the share of the points that are read."""
    without = list(cleaning.without)
    total = max(clouds.points, 1)
    taken = 0

    def wanted(_: CloudFile, batch: CloudBatch) -> NDArray[np.bool_]:
        return ~np.isin(batch.classification, without)

    for file, batch in clouds.whole_batches(cleaning.box, wanted, seen, lambda read: done.append(read / total)):
        turn = (taken + np.arange(len(batch))) % cleaning.every == 0
        taken += len(batch)
        records = _records(batch.where(turn), is_ours(file), clouds.week_times)
        if len(records):
            yield records


def _records(batch: CloudBatch, ours: bool, week_times: bool) -> RecordArray:
    """Points as records."""
    records = np.zeros(len(batch), SPOOLED_POINT)
    for name in ("xyz_m", "intensity", "point_source_id", "classification", "return_number", "returns"):
        records[name] = getattr(batch, name)
    times = batch.gps_time if week_times else batch.t_s
    records["t_s"] = times if times is not None else np.nan
    if batch.rgb is not None:
        records["rgb"] = batch.rgb
    records["noise"] = np.isin(batch.classification, NOISE_CLASSES)
    records["machine"] = ours & np.isin(batch.classification, MACHINE_CLASSES)
    return records


def chosen(records: RecordArray, which: NDArray[np.bool_]) -> RecordArray:
    """Some of records (n,), copied whole: numpy takes five times as long by a mask, field by field."""
    return records.take(np.flatnonzero(which))


def square_side_m(clouds: Clouds) -> float:
    """Side of the squares; wrong bounding boxes cost memory or time only."""
    area_m2 = sum(float(np.prod(np.subtract(file.header.high, file.header.low)[:2])) for file in clouds.files)
    return DENSE_SQUARE_M if 0.0 < area_m2 < clouds.points / DENSE else SQUARE_M


def blocks(spool: SquareSpool, most_points: int | None = None) -> list[list[Square]]:
    """Squares by block; a block of several squares has at most `most_points`, else :data:`BLOCK_POINTS`."""
    limit = BLOCK_POINTS if most_points is None else most_points
    count = {square_of(key): number for key, number in spool.counts.items()}
    most = round(BLOCK_M / spool.side_m)

    def split(squares: list[Square], across: int) -> Iterator[list[Square]]:
        if across == 1 or sum(count[square] for square in squares) <= limit:
            yield squares
            return
        parts: dict[Square, list[Square]] = {}
        for column, row in squares:
            parts.setdefault((column // (across // 2), row // (across // 2)), []).append((column, row))
        for part in parts.values():
            yield from split(part, across // 2)

    whole: dict[Square, list[Square]] = {}
    for column, row in sorted(count):
        whole.setdefault((column // most, row // most), []).append((column, row))
    return [block for squares in whole.values() for block in split(squares, most)]


def squares_around(block: list[Square], reach_m: float, side_m: float) -> Iterable[Square]:
    """The squares within reach of a block, without its own."""
    reach = math.ceil(reach_m / side_m)
    columns, rows = zip(*block, strict=True)
    near = product(
        range(min(columns) - reach, max(columns) + reach + 1), range(min(rows) - reach, max(rows) + reach + 1)
    )
    own = set(block)
    return (square for square in near if square not in own)


def _measure(
    spool: SquareSpool,
    few: SquareSpool,
    block: list[Square],
    outliers: Outliers,
    slack_m: float,
    usual: NeighbourStatistics,
) -> None:
    """Compute `apart_m` in a block; points of a square may lie `slack_m` beyond its borders."""
    records = spool.read_squares(block)
    known = ~records["noise"]
    own = records["xyz_m"][known]
    if not len(own):
        return
    around = [np.zeros((0, 3))]
    low = own[:, :2].min(axis=0) - FIRST_RADIUS_M
    high = own[:, :2].max(axis=0) + FIRST_RADIUS_M
    for square in squares_around(block, FIRST_RADIUS_M + slack_m, spool.side_m):
        others = spool.read_squares([square])
        xyz = others["xyz_m"][~others["noise"]]
        around.append(xyz[np.all((xyz[:, :2] >= low) & (xyz[:, :2] <= high), axis=1)])
    xyz = np.concatenate([own, *around]) - own[0]
    if outliers == "radius":
        apart_m = np.where(radius_outliers(xyz)[: len(own)], np.inf, 0.0)
    else:
        apart_m = mean_neighbour_distance(xyz, reach_m=FIRST_RADIUS_M, asked=len(own))
        lonely = np.isinf(apart_m)
        if lonely.any():
            others = few.read_squares([*block, *squares_around(block, OUTLIER_REACH_M + slack_m, few.side_m)]) - own[0]
            apart_m[lonely] = mean_distance_to(own[lonely] - own[0], others, OUTLIER_REACH_M)
    records["apart_m"][known] = apart_m
    usual.add(own, records["apart_m"][known].astype(np.float64))
    spool.overwrite(spool.keys(block), records)


def _with_outliers(records: RecordArray, usual: NeighbourStatistics) -> RecordArray:
    """The records with outliers set to noise."""
    known = ~records["noise"]
    apart_m = records["apart_m"][known].astype(np.float64)
    if apart_m.any():
        records["noise"][known] = usual.exceeded(records["xyz_m"][known], apart_m)
    return records


def _add_lows(
    spool: SquareSpool,
    parts: list[list[Square]],
    usual: NeighbourStatistics,
    lows: SquareSpool,
    pool: ThreadPoolExecutor,
) -> None:
    """Store the lowest points of the cells of each block."""

    def lowest(block: list[Square]) -> FloatArray:
        records = _with_outliers(spool.read_squares(block), usual)
        xyz: FloatArray = records["xyz_m"][~(records["noise"] | records["machine"])]
        return xyz[_lowest(xyz, SMRF.cell_m, *bounds(xyz))] if len(xyz) else xyz

    for found in in_turn(pool, lowest, parts, threads()):
        lows.add_at(found[:, :2], found)


@kernel()
def _lowest(xyz_m, cell_m, low, high):  # type: ignore[no-untyped-def]
    """Index of the lowest point of each cell with any, column by column; `low` and `high` are the bounds of all."""
    corner = np.floor(low / cell_m)
    columns = int(np.floor(high[0] / cell_m) - corner[0]) + 1
    rows = int(np.floor(high[1] / cell_m) - corner[1]) + 1
    out = np.full(columns * rows, -1, np.int64)
    for i in range(len(xyz_m)):
        column = np.floor(xyz_m[i, 0] / cell_m) - corner[0]
        row = np.floor(xyz_m[i, 1] / cell_m) - corner[1]
        cell = int(column) * rows + int(row)
        if out[cell] < 0 or xyz_m[i, 2] < xyz_m[out[cell], 2]:
            out[cell] = i
    return out[out >= 0]


def _by_ground(
    work: Callable[[GroundRaster | None, list[Square]], Found],
    pool: ThreadPoolExecutor,
    parts: list[list[Square]],
    lows: SquareSpool,
    method: GroundMethod | Literal["none"],
    side_m: float,
    progress: Progress,
) -> Iterator[Found]:
    """`work` on each block with the ground of its window; reports the stage "cleaning clouds"."""
    done = 0
    for ground, window in _grounds(pool, parts, side_m, lows, method):
        for found in in_turn(pool, partial(work, ground), window, threads()):
            done += 1
            progress("cleaning clouds", done / len(parts))
            yield found


def _grounds(
    pool: ThreadPoolExecutor,
    parts: list[list[Square]],
    side_m: float,
    lows: SquareSpool,
    method: GroundMethod | Literal["none"],
) -> Iterator[tuple[GroundRaster | None, list[list[Square]]]]:
    """The blocks by window, each with its ground, which is found ahead; all blocks without any for the method none."""
    if method == "none":
        yield None, parts
        return
    windows: dict[Square, list[list[Square]]] = {}
    for block in parts:
        column, row = block[0]
        windows.setdefault((int(column * side_m // GROUND_WINDOW_M), int(row * side_m // GROUND_WINDOW_M)), []).append(
            block
        )

    def ground(window: Square) -> GroundRaster | None:
        across = round(GROUND_WINDOW_M / LOWS_SIDE_M)
        first = (window[0] * across, window[1] * across)
        own = [(first[0] + i, first[1] + j) for i in range(across) for j in range(across)]
        margin_m = 2.0 * SMRF.window_m
        xyz = lows.read_squares([*own, *squares_around(own, margin_m, LOWS_SIDE_M)])
        low = np.array(window) * GROUND_WINDOW_M - margin_m
        high = low + GROUND_WINDOW_M + 2.0 * margin_m
        return ground_of_points(xyz[np.all((xyz[:, :2] >= low) & (xyz[:, :2] < high), axis=1)], method)

    yield from zip(in_turn(pool, ground, windows, threads()), windows.values(), strict=True)


def _classify_ground(records: RecordArray, ground: GroundRaster | None) -> None:
    can = ~(records["noise"] | records["machine"])
    found = ground.has(records["xyz_m"][can]) if ground is not None else np.zeros(np.count_nonzero(can), bool)
    records["classification"][can] = np.where(found, PointClass.GROUND, PointClass.OTHER)


def _one_a_cube(records: RecordArray, voxel_m: float) -> NDArray[np.bool_]:
    """The point nearest to the centre of each voxel, noise only without others."""
    place = records["xyz_m"] / voxel_m
    cube = np.floor(place)
    away = np.sum((place - cube - 0.5) ** 2, axis=1)
    order = np.lexsort([away, records["noise"], *cube.T])
    first = np.ones(len(order), bool)
    first[1:] = np.any(np.diff(cube[order], axis=0) != 0, axis=1)
    kept = np.zeros(len(records), bool)
    kept[order[first]] = True
    return kept
