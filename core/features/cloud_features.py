"""Features of clouds of any size, tile by tile in bounded memory."""

import math
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.features.breaklines import BREAK_CELL_M, BreakPoints, break_points, breaklines
from furrowmap.core.features.classes import Feature, feature_codes
from furrowmap.core.features.classification import Classified, FeatureTile, classify
from furrowmap.core.features.objects import (
    LineObject,
    PlanePiece,
    Plants,
    ground_lines,
    is_rim,
    join_lines,
    line_objects,
    outline_plane,
    plane_foot,
    plants,
)
from furrowmap.core.features.planes import Plane
from furrowmap.core.pointclouds.cleaning import SquareSpool, blocks, chosen, classified_spool, squares_around
from furrowmap.core.pointclouds.cleaning_steps import Cleaning
from furrowmap.core.pointclouds.joined_clouds import Clouds
from furrowmap.core.pointclouds.spooled_clouds import CLASSED_SHARE
from furrowmap.core.readers.las.cloud import Box, Survey
from furrowmap.core.runtime.arrays import BoolArray, FloatArray
from furrowmap.core.runtime.background import in_turn
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.runtime.record_spool import RecordArray, Square, square_keys
from furrowmap.core.runtime.settings import threads
from furrowmap.core.values.extents import bounds, cells_with_points
from furrowmap.core.values.scan import PointClass

DENSITY_CELL_M: Final = 1.0
VOXEL_RANGE_M: Final = (0.05, 0.4)
"""Limits of the size of voxels."""
MIN_TILE_MARGIN_M: Final = 2.0
TILE_MARGIN_VOXELS: Final = 24.0
"""Least margin of a tile: a wire of the least length that begins at its border, and twice the widest neighbourhood."""
TILE_POINTS: Final = 2_000_000
OWN_CELL_M: Final = 0.5
"""A plant is that of the tile with points in the cell of its top."""


@dataclass
class FoundFeatures:
    """Features found in the tiles done so far: planes by piece, breaks by tile, points of each :class:`Feature`."""

    planes: list[PlanePiece] = field(default_factory=list)
    lines: list[LineObject] = field(default_factory=list)
    plants: list[Plants] = field(default_factory=list)
    breaks: list[BreakPoints] = field(default_factory=list)
    points: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(Feature), np.int64))

    def add(self, other: "FoundFeatures") -> None:
        """Add what another tile holds."""
        for name in ("planes", "lines", "plants", "breaks"):
            getattr(self, name).extend(getattr(other, name))
        self.points += other.points

    def all_lines(self, planes: list[PlanePiece]) -> list[LineObject]:
        """Poles, wires, fences, the feet of the vertical planes among the planes, and lines in the ground."""
        stand = [plane_foot(plane, "fence" if plane.is_open else "wall") for plane in planes if plane.vertical]
        in_ground = ground_lines(breaklines(BreakPoints.joined(self.breaks)))
        walls = [line for line in stand if line.kind == "wall"]
        free = [line for line in join_lines(self.lines) if not any(is_rim(line, wall) for wall in walls)]
        return [*free, *stand, *in_ground]

    def all_plants(self) -> Plants:
        """The plants of all tiles."""
        if not self.plants:
            return Plants.none()
        return Plants(*(np.concatenate([getattr(each, name) for each in self.plants]) for name in vars(Plants.none())))


def measure_density(clouds: Clouds, box: Box | None = None, progress: Progress = silent) -> tuple[float, bool]:
    """Side in m of voxels that fit the spacing of the points of clouds, and whether the files classify ground."""
    total = max(clouds.points, 1)
    covered = np.zeros(0, np.int64)
    count = ground = 0
    for batch in clouds.batches(box, read=lambda done: progress("measuring density", done / total)):
        covered = np.union1d(covered, cells_with_points(batch.xyz_m, DENSITY_CELL_M))
        count += len(batch.xyz_m)
        ground += int(np.count_nonzero(batch.ground))
    spacing = math.sqrt(len(covered) * DENSITY_CELL_M**2 / max(count, 1))
    cell = float(np.clip(math.ceil(spacing * 100.0) / 100.0, *VOXEL_RANGE_M))
    return cell, ground > CLASSED_SHARE * max(count, 1)


def classify_features(
    clouds: Clouds,
    cleaning: Cleaning,
    cell_m: float,
    folder: Path,
    found: FoundFeatures,
    seen: Callable[[Survey], None] | None = None,
    progress: Progress = silent,
) -> Generator[RecordArray, None, None]:
    """The points of clouds in batches with the classes of features, in reproducible order.

    Noise and, in furrowmap's own clouds, the machine keep their classes. Points of other classes than ground are
    classified anew. Raises InputError, RefusedError, OSError as :func:`cleaned`.

    Args:
        cleaning: selects and cleans points, and classifies their ground.
        found: receives the features.
        seen: as in :func:`cleaned`.
        progress: receives the stages of :func:`classified_spool` and "finding features".

    Yields:
        (n,) records of :data:`POINT`.
    """
    with classified_spool(clouds, cleaning, folder, seen, progress) as spool, ThreadPoolExecutor(threads()) as pool:
        parts = blocks(spool, TILE_POINTS)
        coloured = any("red" in file.dimensions for file in clouds.files)
        work = in_turn(pool, lambda part: _classify_block(spool, part, cell_m, coloured), parts, threads())
        for number, (records, here) in enumerate(work, 1):
            found.add(here)
            progress("finding features", number / len(parts))
            yield records


def _classify_block(
    spool: SquareSpool, block: list[Square], cell_m: float, coloured: bool
) -> tuple[RecordArray, FoundFeatures]:
    """The points of a block with their classes, and its features."""
    own = spool.read_squares(block)
    margin = max(MIN_TILE_MARGIN_M, TILE_MARGIN_VOXELS * cell_m)
    low, high = bounds(own["xyz_m"])
    parts = [chosen(own, ~(own["noise"] | own["machine"]))]
    for square in squares_around(block, margin, spool.side_m):
        others = spool.read_squares([square])
        flat = others["xyz_m"][:, :2]
        near = np.all((flat >= low[:2] - margin) & (flat <= high[:2] + margin), axis=1)
        parts.append(chosen(others, near & ~(others["noise"] | others["machine"])))
    if not len(parts[0]):
        return own, FoundFeatures()
    xyz, classes, rgb = (np.concatenate([part[name] for part in parts]) for name in ("xyz_m", "classification", "rgb"))
    corner = np.floor(bounds(xyz)[0])
    scale = 255.0 if coloured and rgb.max() <= 255 else 65535.0
    xyz -= corner
    tile = FeatureTile(xyz, classes == PointClass.GROUND, cell_m, rgb / scale if coloured and rgb.any() else None)
    result = classify(tile)
    mine = np.arange(len(xyz)) < len(parts[0])
    codes = feature_codes(result.feature[mine], result.above_m[mine])
    own["classification"][~(own["noise"] | own["machine"])] = codes
    return own, _own_features(tile, result, mine, corner)


def _own_features(tile: FeatureTile, result: Classified, mine: BoolArray, corner: FloatArray) -> FoundFeatures:
    """What of the features of a tile is its own."""
    rest = result.of_voxel >= 0
    of_voxel = result.of_voxel[rest]
    size = len(result.voxel_m)
    count = np.bincount(of_voxel, mine[rest], size).astype(np.int64)
    above = np.full(size, np.nan)
    above[of_voxel] = result.above_m[rest]
    base = result.voxel_m[:, 2] - np.nan_to_num(above)
    side = 2.0 * tile.cell_m

    def pieces(found: list[Plane], side_m: float, *, is_open: bool) -> Iterator[PlanePiece]:
        for plane in found:
            members = plane.members[count[plane.members] > 0]
            if len(members):
                cut = outline_plane(plane, result.voxel_m[members], count[members], side_m, float(base[members].min()))
                yield replace(
                    cut, centre_m=cut.centre_m + corner, base_m=cut.base_m + float(corner[2]), is_open=is_open
                )

    lines = []
    for line in result.lines:
        points = int(count[line.members].sum())
        if points:
            moved = replace(line, path_m=line.path_m + corner)
            lines.append((moved, points, float(base[line.members].min() + corner[2])))
    scatter = result.feature == Feature.SCATTER
    tops = plants(tile.xyz_m[scatter] + corner, np.nan_to_num(result.above_m[scatter]))
    own = tile.xyz_m[mine] + corner
    inside = _in_own_cells(tops.top_m, own, OWN_CELL_M)
    breaks = break_points(tile.xyz_m[(result.feature == Feature.GROUND) & ~result.hidden] + corner)
    return FoundFeatures(
        [*pieces(result.planes, side, is_open=False), *pieces(result.fences, 2.0 * side, is_open=True)],
        line_objects(lines),
        [Plants(*(values[inside] for values in vars(tops).values()))],
        [breaks.where(_in_own_cells(breaks.xyz_m, own, BREAK_CELL_M))],
        np.bincount(result.feature[mine], minlength=len(Feature)),
    )


def _in_own_cells(place: FloatArray, own: FloatArray, cell_m: float) -> BoolArray:
    """Which places lie in a cell with points of the tile's own."""
    return np.isin(square_keys(*np.floor(place[:, :2].T / cell_m)), cells_with_points(own, cell_m))
