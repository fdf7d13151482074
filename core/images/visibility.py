"""Which frames see a point: depth maps from the points themselves, and an index of frames by place.

A point of a cloud is seen by a frame where no other point lies clearly nearer to the camera in its direction (z-buffer;
on the visibility of point sets see Katz et al. 2007). The cells of a depth map are as large as the points on the
surfaces in view are dense, so that surfaces are closed.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter

from furrowmap.core.images.image_frames import Frames
from furrowmap.core.images.pinhole import pixel_of
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel

CELL_PX: Final = 4
MAX_DEPTH_CELLS: Final = 256
"""Cells across an image; those of larger images have more pixels."""
POINTS_PER_CELL: Final = 6.0
"""Mean number of points in a cell with any, from which on surfaces are taken to be closed."""
MAX_POOLED_CELLS: Final = 16
MAX_DISTANCE_M: Final = 150.0
"""Points farther from the camera are not looked at."""
MIN_DISTANCE_M: Final = 0.2
INDEX_CELL_M: Final = 2.0
INDEX_BYTES: Final = 64 << 20
PIECE: Final = 256
"""Consecutive points, which mostly lie close together, of which frames that do not look there are left out."""
SLACK_M: Final = 0.10
SLACK_CELLS: Final = 4.0
"""A point is hidden behind another that is nearer by more than SLACK_M and so many widths of a cell: a surface seen
at an angle below about 63° off its normal does not hide itself."""


class FrameView(NamedTuple):
    """Where frames were and what they see, against a local origin.

    Attributes:
        centre_m: (n, 3) projection centres.
        matrix: (n, 3, 3) map to optical frame.
        reach: (2,) tangents of the angles off the optical axis, along rows and columns, beyond which nothing is in the
            image.
        intrinsics: (9,) of the camera.
        widest: tangent of the largest angle that the distortion allows.
        size: (2,) width and height.
    """

    centre_m: FloatArray
    matrix: FloatArray
    reach: FloatArray
    intrinsics: FloatArray
    widest: float
    size: FloatArray

    @classmethod
    def from_frames(cls, frames: Frames, origin_m: tuple[float, float, float]) -> "FrameView":
        """The view of frames."""
        from furrowmap.core.images.pinhole import unproject

        camera = frames.camera
        poses = frames.poses
        width = camera.width
        height = camera.height
        edge_x = np.linspace(0.0, width - 1.0, 9)
        edge_y = np.linspace(0.0, height - 1.0, 9)
        edge = np.concatenate([np.column_stack([edge_x, np.full(9, y)]) for y in (0.0, height - 1.0)])
        edge = np.concatenate([edge, *(np.column_stack([np.full(9, x), edge_y]) for x in (0.0, width - 1.0))])
        tangent = np.abs(unproject(camera, edge)[:, :2])
        return cls(
            np.ascontiguousarray(poses.xyz_m - np.asarray(origin_m)),
            np.ascontiguousarray(poses.rotation.transpose(0, 2, 1) / [poses.scale, poses.scale, 1.0]),
            1.01 * np.where(np.isfinite(tangent), tangent, camera.widest).max(axis=0),
            camera.intrinsics,
            camera.widest,
            np.array([width, height], np.float64),
        )


class PlaceIndex(NamedTuple):
    """Frames by place: which frames have points of a cell of the map in view.

    Attributes:
        corner_m: (2,) lower left corner of the cells, against the local origin.
        columns: of cells; cell (row, column) has the number row · columns + column.
        start: (cells + 1,) int64 where the frames of each cell begin.
        frames: int32 their indices.
    """

    corner_m: FloatArray
    cell_m: float
    columns: int
    start: NDArray[np.int64]
    frames: NDArray[np.int32]


class Visibility(NamedTuple):
    """What the frames see.

    Attributes:
        depth_m: (n, rows, columns) float32 depth in front of which a point in the cell is seen, before any tolerance.
        slack: (n,) share of the depth that is tolerated for the width of a frame's cells.
        cell_px: pixels across a cell of `depth_m`.
    """

    views: FrameView
    depth_m: NDArray[np.float32]
    slack: FloatArray
    cell_px: int
    places: PlaceIndex


class SeenCells(NamedTuple):
    """What the frames see of the points so far.

    Attributes:
        depth_m: (n, rows, columns) float32 least depth in each cell of the images.
        points: (n,) int64 points in each image.
        cell_px: pixels across a cell of `depth_m`.
        corner_m: (2,) lower left corner of the cells of the map, against the local origin.
        frames: (rows · columns, bytes) uint8 of each cell of the map, a bit for each frame that sees points in it.
    """

    depth_m: NDArray[np.float32]
    points: NDArray[np.int64]
    cell_px: int
    corner_m: FloatArray
    cell_m: float
    rows: int
    columns: int
    frames: NDArray[np.uint8]


class VisibilityMaker:
    """Takes the points of a cloud, in any order and in pieces, and gives the visibility of all.

    Memory, or a scratch file, of 4 bytes a cell of the depth maps, at most 260 kB a frame. Points are against a local
    origin.
    """

    def __init__(self, frames: Frames, origin_m: tuple[float, float, float]) -> None:
        camera = frames.camera
        self.view = FrameView.from_frames(frames, origin_m)
        cell_px = max(CELL_PX, -(-max(camera.width, camera.height) // MAX_DEPTH_CELLS))
        images = len(frames), -(-camera.height // cell_px), -(-camera.width // cell_px)
        depth_m = arrays.full(images, np.inf, np.float32)
        low = self.view.centre_m[:, :2].min(axis=0) - MAX_DISTANCE_M
        extent = self.view.centre_m[:, :2].max(axis=0) + MAX_DISTANCE_M - low
        words = -(-len(frames) // 8)
        cell_m = max(INDEX_CELL_M, float(np.sqrt(np.prod(extent) * words / INDEX_BYTES)))
        rows, columns = (int(length) for length in np.ceil(extent[::-1] / cell_m))
        bits = arrays.zeros((rows * columns, words), np.uint8)
        self._seen = SeenCells(depth_m, np.zeros(len(frames), np.int64), cell_px, low, cell_m, rows, columns, bits)

    def add(self, xyz_m: FloatArray) -> None:
        """Points (n, 3) of surfaces, which hide what is behind them."""
        splat(np.ascontiguousarray(xyz_m, np.float64), self.view, self._seen)

    def finish(self) -> Visibility:
        """The visibility of all points; the maker cannot be used any more."""
        seen = self._seen
        slack = np.empty(len(seen.points))
        for k, points in enumerate(seen.points.tolist()):
            depth = seen.depth_m[k]
            pooled = 1
            while pooled < MAX_POOLED_CELLS and points < POINTS_PER_CELL * np.isfinite(_least(depth, pooled)).sum():
                pooled *= 2
            seen.depth_m[k] = widen_depth(depth, pooled)
            slack[k] = SLACK_CELLS * pooled * seen.cell_px / self.view.intrinsics[0]
        return Visibility(self.view, seen.depth_m, slack, seen.cell_px, self._index())

    def _index(self) -> PlaceIndex:
        seen = self._seen
        cells = len(seen.frames)
        count = len(seen.points)
        start = np.zeros(cells + 1, np.int64)
        parts = []
        for begin in range(0, cells, 1 << 12):
            bits = np.unpackbits(seen.frames[begin : begin + (1 << 12)], axis=1, count=count, bitorder="little")
            cell, frame = np.nonzero(bits)
            start[begin + 1 : begin + 1 + len(bits)] = np.bincount(cell, minlength=len(bits))
            parts.append(frame.astype(np.int32))
        frames = np.concatenate([np.zeros(0, np.int32), *parts])
        return PlaceIndex(seen.corner_m, seen.cell_m, seen.columns, np.cumsum(start), frames)


def _least(depth: NDArray[np.float32], pooled: int) -> NDArray[np.float32]:
    """The least depth of `pooled` × `pooled` cells."""
    if pooled == 1:
        return depth
    rows, columns = (-(-length // pooled) * pooled for length in depth.shape)
    padded = np.full((rows, columns), np.inf, np.float32)
    padded[: depth.shape[0], : depth.shape[1]] = depth
    out: NDArray[np.float32] = padded.reshape(rows // pooled, pooled, columns // pooled, pooled).min(axis=(1, 3))
    return out


def widen_depth(depth: NDArray[np.float32], pooled: int) -> NDArray[np.float32]:
    """A depth map of the same size: in each cell the least depth of its pooled cell and of the eight around that."""
    least = minimum_filter(_least(depth, pooled), size=3, mode="nearest")
    wide = np.repeat(np.repeat(least, pooled, axis=0), pooled, axis=1)
    out: NDArray[np.float32] = wide[: depth.shape[0], : depth.shape[1]]
    return out


@kernel(error_model="numpy", fastmath={"contract", "arcp"})
def splat(xyz, view, found):  # type: ignore[no-untyped-def]
    """Kernel of :meth:`VisibilityMaker.add`."""
    # Arrays are taken out of the tuples before the loop: numba counts a reference each time that it takes one.
    centre = view.centre_m
    matrix = view.matrix
    reach = view.reach
    intrinsics = view.intrinsics
    size = view.size
    depth = found.depth_m
    points = found.points
    corner = found.corner_m
    seen = found.frames
    cell = np.empty(PIECE, np.int64)
    for begin in range(0, len(xyz), PIECE):
        end = min(begin + PIECE, len(xyz))
        low = np.full(3, np.inf)
        high = np.full(3, -np.inf)
        for i in range(begin, end):
            for j in range(3):
                low[j] = min(low[j], xyz[i, j])
                high[j] = max(high[j], xyz[i, j])
            at_row = min(max(int((xyz[i, 1] - corner[1]) / found.cell_m), 0), found.rows - 1)
            at_column = min(max(int((xyz[i, 0] - corner[0]) / found.cell_m), 0), found.columns - 1)
            cell[i - begin] = at_row * found.columns + at_column
        middle = 0.5 * (low + high)
        radius = 0.5 * np.sqrt(((high - low) ** 2).sum())
        for k in range(len(centre)):
            dx = middle[0] - centre[k, 0]
            dy = middle[1] - centre[k, 1]
            dz = middle[2] - centre[k, 2]
            if np.sqrt(dx * dx + dy * dy + dz * dz) > MAX_DISTANCE_M + radius:
                continue
            # The sphere around the points against the pyramid around the image.
            forward = matrix[k, 2, 0] * dx + matrix[k, 2, 1] * dy + matrix[k, 2, 2] * dz
            aside = False
            for j in range(2):
                along = abs(matrix[k, j, 0] * dx + matrix[k, j, 1] * dy + matrix[k, j, 2] * dz)
                aside |= along - reach[j] * forward > radius * np.sqrt(1.0 + reach[j] * reach[j])
            if aside:
                continue
            for i in range(begin, end):
                dx = xyz[i, 0] - centre[k, 0]
                dy = xyz[i, 1] - centre[k, 1]
                dz = xyz[i, 2] - centre[k, 2]
                z = matrix[k, 2, 0] * dx + matrix[k, 2, 1] * dy + matrix[k, 2, 2] * dz
                if not z > MIN_DISTANCE_M:
                    continue
                x = matrix[k, 0, 0] * dx + matrix[k, 0, 1] * dy + matrix[k, 0, 2] * dz
                y = matrix[k, 1, 0] * dx + matrix[k, 1, 1] * dy + matrix[k, 1, 2] * dz
                if abs(x) > reach[0] * z or abs(y) > reach[1] * z:
                    continue
                x = x / z
                y = y / z
                if x * x + y * y > view.widest * view.widest:
                    continue
                u, v = pixel_of(intrinsics, x, y)
                if not (-0.5 <= u < size[0] - 0.5 and -0.5 <= v < size[1] - 0.5):
                    continue
                row = int((v + 0.5) / found.cell_px)
                column = int((u + 0.5) / found.cell_px)
                if z < depth[k, row, column]:
                    depth[k, row, column] = z
                points[k] += 1
                seen[cell[i - begin], k >> 3] |= np.uint8(1 << (k & 7))
