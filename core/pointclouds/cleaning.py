"""Clouds made clean: what is alone called noise, the ground told, thinned; square by square, in bounded memory."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.pointclouds.clouds import MACHINE, NOISE, Clouds, is_ours
from furrowmap.core.readers.las.cloud import Box, CloudFile
from furrowmap.core.readers.las.points import CloudBatch
from furrowmap.core.readers.las.survey import Survey
from furrowmap.core.surfaces.ground import GroundMethod, classify_ground
from furrowmap.core.surfaces.outlier_filter import REACH_M, Outliers
from furrowmap.core.surfaces.outliers import (
    NeighbourStatistics,
    mean_distance_to,
    mean_neighbour_distance,
    radius_outliers,
    thin_points,
)
from furrowmap.core.surfaces.smrf import Smrf
from furrowmap.core.values.point_classes import PointClass
from furrowmap.core.values.progress import Progress, silent
from furrowmap.core.values.record_spool import RecordArray, RecordSpool, Square, square_keys, square_of

FloatArray = NDArray[np.float64]

SMRF: Final = Smrf()
BLOCK_M: Final = 128.0
"""Side of the largest block, in which :func:`classify_ground` works."""
SQUARE_M: Final = 16.0
DENSE_SQUARE_M: Final = 2.0
"""Sides of the squares, the least blocks; the points of a driving scanner lie by the ten thousand a square metre."""
DENSE: Final = 200.0
"""Points a square metre of the clouds' boxes from which on squares are the small ones."""
NEAR_M: Final = 1.0
"""Points with enough neighbours within it need not be compared with more distant ones."""
BLOCK_POINTS: Final = 500_000
"""Blocks with more are quartered, down to one square."""
POINT: Final = np.dtype(
    [
        ("xyz_m", "<f8", 3),
        ("t_s", "<f8"),
        ("intensity", "<u2"),
        ("point_source_id", "<u2"),
        ("rgb", "<u2", 3),
        ("classification", "u1"),
        ("return_number", "u1"),
        ("returns", "u1"),
        ("apart_m", "<f4"),
        ("noise", "?"),
        ("machine", "?"),
    ]
)
"""A point with all that is passed on. `t_s` is UTC, seconds of a week where all clouds have those, or nan. Noise and
the machine are never ground. `apart_m` is how far it is from its neighbours, where that is asked; infinite for one that
is alone in any case."""
PLACE: Final = np.dtype(("<f8", 3))


class SquareSpool(RecordSpool):
    """RecordArray by square of the map.

    Args:
        layout: dtype of a record.
        folder: for the temporary file.
        side_m: of the squares.
    """

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


@dataclass(frozen=True)
class Cleaning:
    """What is to be done, in this order.

    Attributes:
        box: west, south, east, north of the points wanted, in the CRS of the clouds given out; None for all.
        without: classes that are left out.
        every: every so many-th point of those is taken, beginning with the first.
        outliers: how points that are alone are told; they become noise.
        drop_noise: leave noise out, that of the files as well.
        ground: how the ground is told, which becomes class 2, and everything else but noise and the machine 1; "none"
            to leave the classes as they are.
        voxel_m: side of cubes of which one point each is taken, the one nearest to the middle; None for all points.
    """

    box: Box | None = None
    without: frozenset[int] = frozenset()
    every: int = 1
    outliers: Outliers = "none"
    drop_noise: bool = False
    ground: GroundMethod | Literal["none"] = "none"
    voxel_m: float | None = None

    @property
    def uses_neighbours(self) -> bool:
        """Whether a point's neighbours have a say."""
        return self.outliers != "none" or self.ground != "none" or self.voxel_m is not None


def cleaned(
    clouds: Clouds,
    cleaning: Cleaning,
    folder: Path,
    seen: Callable[[Survey], None] | None = None,
    progress: Progress = silent,
) -> Generator[RecordArray, None, None]:
    """The points of clouds as they are wanted, some at a time; the same in the same order each time.

    Args:
        clouds: the clouds.
        cleaning: what is to be done.
        folder: for scratch files.
        seen: is given the survey of each file that was read whole.
        progress: is told of the stages "reading clouds", "looking for noise" and "cleaning clouds".

    Yields:
        (n,) records of :data:`POINT`.

    Raises:
        InputError: if a file turns out to be damaged, or the library of the ground's method is not installed.
        RefusedError: if points have no place in the CRS.
        OSError: if the scratch files cannot be written.
    """
    points = _wanted(clouds, cleaning, seen, progress)
    if not cleaning.uses_neighbours:
        yield from (records[~(records["noise"] & cleaning.drop_noise)] for records in points)
        return
    with ExitStack() as stack:
        side_m = _square_m(clouds)
        spool = stack.enter_context(SquareSpool(POINT, folder, side_m))
        lows, few = (stack.enter_context(SquareSpool(PLACE, folder, side_m)) for _ in range(2))
        for records in points:
            # A cube lies in one square whole, that of its corner.
            flat = records["xyz_m"][:, :2]
            corner = flat if cleaning.voxel_m is None else np.floor(flat / cleaning.voxel_m) * cleaning.voxel_m
            spool.add_at(corner, records)
        blocks = _blocks(spool)
        squares = [square for block in blocks for square in block]
        usual = NeighbourStatistics()
        if cleaning.outliers == "statistical":
            for square in squares:
                _add_few(spool.read_squares([square]), square, few)
        if cleaning.outliers != "none":
            for number, block in enumerate(blocks, 1):
                _measure(spool, few, block, cleaning.outliers, cleaning.voxel_m or 0.0, usual)
                progress("looking for noise", number / len(blocks))
        if cleaning.ground != "none":
            for square in squares:
                _add_lows(_told(spool.read_squares([square]), usual), square, lows)
        for number, block in enumerate(blocks, 1):
            records = _told(spool.read_squares(block), usual)
            records["classification"][records["noise"] & ~np.isin(records["classification"], NOISE)] = PointClass.NOISE
            if cleaning.ground != "none":
                _tell_ground(records, block, lows, cleaning.ground)
            kept = ~(records["noise"] & cleaning.drop_noise)
            if cleaning.voxel_m is not None:
                kept[kept] = _one_a_cube(records[kept], cleaning.voxel_m)
            progress("cleaning clouds", number / len(blocks))
            yield records[kept]


def _wanted(
    clouds: Clouds, cleaning: Cleaning, seen: Callable[[Survey], None] | None, progress: Progress
) -> Iterator[RecordArray]:
    """What can be told of points without their neighbours."""
    without = list(cleaning.without)
    total = max(clouds.points, 1)
    taken = 0

    def wanted(_: CloudFile, batch: CloudBatch) -> NDArray[np.bool_]:
        return ~np.isin(batch.classification, without)

    for file, batch in clouds.whole_batches(
        cleaning.box, wanted, seen, lambda done: progress("reading clouds", done / total)
    ):
        turn = (taken + np.arange(len(batch))) % cleaning.every == 0
        taken += len(batch)
        records = _records(batch.where(turn), is_ours(file), clouds.week_times)
        if len(records):
            yield records


def _records(batch: CloudBatch, ours: bool, week_times: bool) -> RecordArray:
    """Points as they wait for their neighbours."""
    records = np.zeros(len(batch), POINT)
    for name in ("xyz_m", "intensity", "point_source_id", "classification", "return_number", "returns"):
        records[name] = getattr(batch, name)
    times = batch.gps_time if week_times else batch.t_s
    records["t_s"] = times if times is not None else np.nan
    if batch.rgb is not None:
        records["rgb"] = batch.rgb
    records["noise"] = np.isin(batch.classification, NOISE)
    records["machine"] = ours & np.isin(batch.classification, MACHINE)
    return records


def _square_m(clouds: Clouds) -> float:
    """Side of the squares; boxes that lie cost memory or time, and change nothing else."""
    area_m2 = sum(float(np.prod(np.subtract(file.header.high, file.header.low)[:2])) for file in clouds.files)
    return DENSE_SQUARE_M if 0.0 < area_m2 < clouds.points / DENSE else SQUARE_M


def _blocks(spool: SquareSpool) -> list[list[Square]]:
    """The squares by block, each of about :data:`BLOCK_POINTS` at most where it has more than one square."""
    count = {square_of(key): number for key, number in spool.counts.items()}
    most = round(BLOCK_M / spool.side_m)

    def split(squares: list[Square], across: int) -> Iterator[list[Square]]:
        if across == 1 or sum(count[square] for square in squares) <= BLOCK_POINTS:
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


def _around(block: list[Square], reach_m: float, side_m: float) -> Iterable[Square]:
    """The squares within reach of a block that are none of its own."""
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
    """Note how far each point of a block is from its neighbours; squares may reach `slack_m` beyond their borders."""
    records = spool.read_squares(block)
    known = ~records["noise"]
    own = records["xyz_m"][known]
    if not len(own):
        return
    around = [np.zeros((0, 3))]
    low, high = own[:, :2].min(axis=0) - NEAR_M, own[:, :2].max(axis=0) + NEAR_M
    for square in _around(block, NEAR_M + slack_m, spool.side_m):
        others = spool.read_squares([square])
        xyz = others["xyz_m"][~others["noise"]]
        around.append(xyz[np.all((xyz[:, :2] >= low) & (xyz[:, :2] <= high), axis=1)])
    xyz = np.concatenate([own, *around]) - own[0]
    if outliers == "radius":
        apart_m = np.where(radius_outliers(xyz)[: len(own)], np.inf, 0.0)
    else:
        apart_m = mean_neighbour_distance(xyz, reach_m=NEAR_M, asked=len(own))
        lonely = np.isinf(apart_m)
        if lonely.any():
            others = few.read_squares([*block, *_around(block, REACH_M + slack_m, few.side_m)]) - own[0]
            apart_m[lonely] = mean_distance_to(own[lonely] - own[0], others, REACH_M)
    records["apart_m"][known] = apart_m
    usual.add(own, records["apart_m"][known].astype(np.float64))
    spool.overwrite(spool.keys(block), records)


def _add_few(records: RecordArray, square: Square, few: SquareSpool) -> None:
    """Keep of a square what points that have no neighbours near are compared with."""
    some = thin_points(records["xyz_m"][~records["noise"]])
    few.add(some, np.repeat(few.keys([square]), len(some)))


def _told(records: RecordArray, usual: NeighbourStatistics) -> RecordArray:
    """The records with those as noise that are farther from their neighbours than is usual."""
    known = ~records["noise"]
    apart_m = records["apart_m"][known].astype(np.float64)
    if apart_m.any():
        records["noise"][known] = usual.exceeded(records["xyz_m"][known], apart_m)
    return records


def _add_lows(records: RecordArray, square: Square, lows: SquareSpool) -> None:
    """Keep of a square the lowest points of its cells, all that the filter sees of land around a block."""
    xyz = _ground_like(records)
    column, row = np.floor(xyz[:, :2].T / SMRF.cell_m).astype(np.int64)
    order = np.lexsort([xyz[:, 2], row, column])
    first = np.ones(len(order), bool)
    first[1:] = (np.diff(column[order]) != 0) | (np.diff(row[order]) != 0)
    lowest = xyz[order[first]]
    lows.add(lowest, np.repeat(lows.keys([square]), len(lowest)))


def _ground_like(records: RecordArray) -> FloatArray:
    """Places of what can be ground."""
    xyz: FloatArray = records["xyz_m"][~(records["noise"] | records["machine"])]
    return xyz


def _tell_ground(records: RecordArray, block: list[Square], lows: SquareSpool, method: GroundMethod) -> None:
    can = ~(records["noise"] | records["machine"])
    own = records["xyz_m"][can]
    around = lows.read_squares(_around(block, 2.0 * SMRF.window_m, lows.side_m))
    asked = np.arange(len(own) + len(around)) < len(own)
    ground = classify_ground(np.concatenate([own, around]), method, SMRF, asked)[: len(own)]
    records["classification"][can] = np.where(ground, PointClass.GROUND, PointClass.OTHER)


def _one_a_cube(records: RecordArray, voxel_m: float) -> NDArray[np.bool_]:
    """Which point of each cube is nearest to its middle, noise only where there is nothing else."""
    place = records["xyz_m"] / voxel_m
    cube = np.floor(place)
    away = np.sum((place - cube - 0.5) ** 2, axis=1)
    order = np.lexsort([away, records["noise"], *cube.T])
    first = np.ones(len(order), bool)
    first[1:] = np.any(np.diff(cube[order], axis=0) != 0, axis=1)
    kept = np.zeros(len(records), bool)
    kept[order[first]] = True
    return kept
